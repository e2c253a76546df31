#include "proof/generator/effects.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <stdexcept>

namespace isorig::proof {
namespace {

constexpr std::array kNamed{
    EffectKind{"coulomb_friction", "force_N", 0.5, 8.0},
    EffectKind{"strain_stiffening", "of the law", 0.1, 20.0},
    EffectKind{"second_relaxation", "stiffness_N_mm", 0.3, 5.0},
    EffectKind{"nonlinear_viscosity", "of the law", 0.2, 1.5},
    EffectKind{"pressure_coupling", "force_N_psi", 4.0, 60.0},
    EffectKind{"cyclic_softening", "share", 0.02, 0.4},
    EffectKind{"force_lag", "time_constant_s", 0.01, 0.06},
    EffectKind{"force_delay", "delay_s", 0.01, 0.06},
    EffectKind{"fixture_inertia", "mass_kg", 0.8, 3.0},
    EffectKind{"zero_drift", "force_N", 0.8, 6.0},
    EffectKind{"grip_slip", "slip_mm", 0.1, 0.8},
    EffectKind{"crosshead_backlash", "play_mm", 0.08, 0.5},
    EffectKind{"slack", "force_below_zero_N", 1.0, 3.0},
};

constexpr std::array kStrange{
    EffectKind{"screw_ripple", "force_N", 0.5, 4.0, false},
    EffectKind{"thermal_cycle", "share", 0.01, 0.2, false},
    EffectKind{"snap_through", "force_N", 0.6, 4.0, false},
    EffectKind{"thixotropy", "share", 0.3, 0.9, false},
    EffectKind{"load_train_resonance", "period_s", 0.08, 0.14, false},
    EffectKind{"range_switch", "gain", 0.1, 0.8, false},
};

}  // namespace

std::span<const EffectKind> named_effects() {
  return kNamed;
}
std::span<const EffectKind> strange_effects() {
  return kStrange;
}

const EffectKind& effect_kind(std::string_view name) {
  for (const auto kinds : {named_effects(), strange_effects()}) {
    const auto found = std::ranges::find(kinds, name, &EffectKind::name);
    if (found != kinds.end()) return *found;
  }
  throw std::invalid_argument("no effect is called " + std::string(name));
}

ConcealedEffect draw_effect(const EffectKind& kind, Random& random, const RigParameters& rig, const Motion& train) {
  ConcealedEffect effect{std::string(kind.name), kind.start, 1.0, {}};
  auto& shape = effect.shape;
  const double fastest_s = rig.specimen.arms.front().time_constant_s;
  const double slowest_s = rig.specimen.arms.back().time_constant_s;
  if (kind.name == "coulomb_friction") {
    shape["presliding_mm"] = random.log_uniform(0.005, 0.05);
    if (random.chance(0.4)) {
      shape["stribeck_share"] = random.uniform(0.15, 0.5);
      shape["stribeck_mm_s"] = random.log_uniform(0.5, 4.0);
    }
  } else if (kind.name == "strain_stiffening") {
    shape["law"] = static_cast<double>(random.index(4));
    shape["sign"] = random.sign();
    shape["at_mm"] = random.uniform(-1.0, 1.0);
    shape["width_mm"] = random.log_uniform(0.1, 0.5);
    shape["scale_mm"] = random.uniform(1.2, 3.0);
  } else if (kind.name == "second_relaxation") {
    // Far enough from what the nominal model has to be another time.
    const bool slower = random.chance(0.6) || fastest_s < 0.6;
    shape["time_constant_s"] =
        slower ? slowest_s * random.log_uniform(6.0, 20.0) : fastest_s / random.log_uniform(6.0, 15.0);
    shape["arms"] = random.chance(0.7) ? 1.0 : 3.0;
  } else if (kind.name == "nonlinear_viscosity") {
    shape["yield"] = random.chance(0.35) ? 1.0 : 0.0;
    shape["arm"] = static_cast<double>(random.index(rig.specimen.arms.size()));
  } else if (kind.name == "pressure_coupling") {
    shape["stiffness_share"] = random.uniform(0.0, 1.0);
    shape["sign"] = random.sign();
  } else if (kind.name == "cyclic_softening") {
    shape["travel_mm"] = random.log_uniform(8.0, 60.0);
  } else if (kind.name == "zero_drift") {
    shape["time_s"] = random.chance(0.5) ? 0.0 : random.log_uniform(600.0, 3000.0);
    shape["sign"] = random.sign();
  } else if (kind.name == "grip_slip") {
    const auto& window = train.windows()[1 + random.index(train.windows().size() - 2)];
    shape["at_s"] = window.start_s + random.uniform(0.85, 1.6);
  } else if (kind.name == "screw_ripple") {
    shape["pitch_mm"] = random.uniform(0.3, 1.2);
  } else if (kind.name == "thermal_cycle") {
    shape["period_s"] = random.uniform(500.0, 1100.0);
  } else if (kind.name == "snap_through") {
    shape["at_mm"] = random.uniform(0.2, 1.2);
    shape["width_mm"] = random.uniform(0.2, 0.9);
  } else if (kind.name == "thixotropy") {
    shape["time_s"] = random.log_uniform(8.0, 60.0);
  } else if (kind.name == "load_train_resonance") {
    shape["damping"] = random.log_uniform(0.03, 0.12);
  } else if (kind.name == "range_switch") {
    shape["above_rest_N"] = random.uniform(-1.5, 1.5);
  }
  return effect;
}

namespace {

void conceal_stiffening(const ConcealedEffect& effect, Hidden& h) {
  const double s = effect.strength * effect.shape.at("sign");
  switch (static_cast<int>(effect.shape.at("law"))) {
    case 0:
      h.quadratic_N_mm2 += s;
      break;
    case 1:
      h.cubic_N_mm3 += s;
      break;
    case 2:
      h.exponential_N += effect.strength;
      h.exponential_mm = effect.shape.at("scale_mm");
      break;
    default:
      h.knee_N_mm += s;
      h.knee_at_mm = effect.shape.at("at_mm");
      h.knee_width_mm = effect.shape.at("width_mm");
  }
}

void conceal_slack(double below_zero_N, Specimen& specimen) {
  // As short as it must be for the slow triangle's turning point, 4 mm below rest, to ask for a push.
  constexpr double kTurn_mm = 4.0;
  const double elongation_mm = kTurn_mm - below_zero_N / specimen.stiffness_N_mm;
  specimen.pressurized_rest_length_mm = specimen.rest_length_mm - elongation_mm;
}

void conceal_strange(const ConcealedEffect& effect, RigParameters& rig) {
  const auto& shape = effect.shape;
  const double s = effect.strength;
  Hidden& h = rig.hidden;
  if (effect.name == "screw_ripple") {
    h.ripple_N += s;
    h.ripple_pitch_mm = shape.at("pitch_mm");
  } else if (effect.name == "thermal_cycle") {
    h.thermal_share += s;
    h.thermal_period_s = shape.at("period_s");
  } else if (effect.name == "snap_through") {
    h.snap_N += s;
    h.snap_at_mm = shape.at("at_mm");
    h.snap_width_mm = shape.at("width_mm");
  } else if (effect.name == "thixotropy") {
    h.thixotropy += s;
    h.thixotropy_s = shape.at("time_s");
  } else if (effect.name == "load_train_resonance") {
    h.resonance_Hz = 1.0 / std::fmax(s, 0.004);
    h.resonance_damping = shape.at("damping");
  } else if (effect.name == "range_switch") {
    h.range_gain += s;
    h.range_from_N = shape.at("above_rest_N") + rig.specimen.stiffness_N_mm * (rig.specimen.rest_length_mm -
                                                                               rig.specimen.pressurized_rest_length_mm);
  } else {
    throw std::invalid_argument("no effect is called " + effect.name);
  }
}

}  // namespace

void conceal(const ConcealedEffect& effect, RigParameters& rig) {
  const auto shape = [&effect](const char* key) {
    const auto found = effect.shape.find(key);
    return found == effect.shape.end() ? 0.0 : found->second;
  };
  const double s = effect.strength;
  Hidden& h = rig.hidden;
  if (effect.name == "coulomb_friction") {
    h.friction_N += s;
    h.presliding_mm = shape("presliding_mm");
    h.stribeck_share = shape("stribeck_share");
    if (h.stribeck_share > 0.0) h.stribeck_mm_s = shape("stribeck_mm_s");
  } else if (effect.name == "strain_stiffening") {
    conceal_stiffening(effect, h);
  } else if (effect.name == "second_relaxation") {
    const int arms = static_cast<int>(shape("arms"));
    for (int i = 0; i < arms; ++i)
      h.further_arms.push_back({s / arms, shape("time_constant_s") * std::pow(3.0, i - (arms - 1) / 2.0)});
  } else if (effect.name == "nonlinear_viscosity") {
    Arm& arm = rig.specimen.arms[static_cast<std::size_t>(shape("arm"))];
    if (shape("yield") > 0.0)
      arm.yield_N = s;
    else
      arm.exponent = std::exp(-s);
  } else if (effect.name == "pressure_coupling") {
    h.force_per_pressure_N_psi += s * shape("sign") * (1.0 - shape("stiffness_share"));
    constexpr double kTypical_mm = 10.0;
    h.stiffness_per_pressure_N_mm_psi += s * shape("sign") * shape("stiffness_share") / kTypical_mm;
  } else if (effect.name == "cyclic_softening") {
    h.softening += s;
    h.softening_travel_mm = shape("travel_mm");
  } else if (effect.name == "force_lag") {
    h.lag_s += s;
  } else if (effect.name == "force_delay") {
    h.delay_s += s;
  } else if (effect.name == "fixture_inertia") {
    h.mass_kg += s;
  } else if (effect.name == "zero_drift") {
    h.drift_N += s * shape("sign");
    h.drift_time_s = shape("time_s");
  } else if (effect.name == "grip_slip") {
    h.slip_mm += s;
    h.slip_at_s = shape("at_s");
  } else if (effect.name == "crosshead_backlash") {
    h.backlash_mm += s;
  } else if (effect.name == "slack") {
    h.slack = true;
    conceal_slack(s, rig.specimen);
  } else {
    conceal_strange(effect, rig);
  }
}

}  // namespace isorig::proof
