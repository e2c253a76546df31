// Simulate with known numbers, by the judges of tests/model/effects; the fit of that law beside the nominal
// model must recover them within what its own intervals say, or say that it cannot, and then rightly.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <ostream>
#include <random>

#include "identify/diagnose/fit/intervals.hpp"
#include "identify/diagnose/guard/guard.hpp"
#include "identify/diagnose/noise/noise.hpp"
#include "identify/diagnose/search/hypothesis.hpp"
#include "judge.hpp"

namespace isorig::identify {
namespace {

using test::Track;

constexpr double kStiffness_N_mm = 2.5, kArm_N_mm = 2.0, kArm_s = 0.8;

struct Truth {
  std::string_view physics, law;
  std::vector<double> parameters;
  std::vector<double> coefficients;
  double elongation_at_zero_mm = 20.0;
  double pressure_swing_psi = 0.25;
  /// Error beyond the noise's, as a share of the number. What goes with velocity or acceleration hangs on
  /// corners of 40 ms that are read every 5 ms: a ramp of 2 mm at 10 mm/s has an eighth of its readings
  /// there, each with a velocity that is uncertain by some 0.4 um sqrt(2) / 5 ms = 0.1 mm/s.
  double discretisation = 0.005;
};

/// A shortened session: 15 s rest, a slow triangle, ramps at five velocities with holds, fast small
/// triangles.
struct Session {
  Track track;
  std::vector<std::pair<double, double>> dense;  ///< recorded at 200 Hz, else at 5 Hz
};

Session session(const Truth& truth) {
  Session out;
  Track& track = out.track;
  track.elongation_at_zero_mm = truth.elongation_at_zero_mm;
  std::vector<double>& x = track.position_mm;
  x.push_back(0.0);
  const auto to = [&](double target_mm, double velocity_mm_s) {
    const double from_mm = x.back();
    const auto count = static_cast<int>(std::fabs(target_mm - from_mm) / velocity_mm_s / track.step_s);
    const double start_s = track.t_s(x.size() - 1);
    for (int i = 1; i <= count; ++i) x.push_back(from_mm + (target_mm - from_mm) * i / count);
    if (velocity_mm_s > 0.3) out.dense.emplace_back(start_s - 0.5, track.t_s(x.size() - 1) + 3.0);
  };
  const auto hold = [&](double seconds) {
    x.insert(x.end(), static_cast<std::size_t>(seconds / track.step_s), x.back());
  };
  hold(15.0);
  to(3.0, 0.2);
  to(-3.0, 0.2);
  to(0.0, 0.2);
  hold(20.0);
  for (const double v : {0.5, 2.0, 5.0, 10.0}) {
    to(2.0, v);
    hold(18.0);
    to(0.0, 0.2);
    to(-2.0, v);
    hold(18.0);
    to(0.0, 0.2);
  }
  for (const double size_mm : {0.05, 0.2, 1.0}) {
    for (int i = 0; i < 3; ++i) {
      to(size_mm, 1.0);
      to(-size_mm, 1.0);
    }
    to(0.0, 1.0);
  }
  hold(15.0);
  // Corners take 40 ms, as an acceleration limit makes them.
  constexpr std::size_t kHalf = 20;
  std::vector<double> sum(x.size() + 1, 0.0);
  for (std::size_t i = 0; i < x.size(); ++i) sum[i + 1] = sum[i] + x[i];
  for (std::size_t i = 0; i < x.size(); ++i) {
    const std::size_t from = i > kHalf ? i - kHalf : 0, end = std::min(x.size(), i + kHalf + 1);
    x[i] = (sum[end] - sum[from]) / static_cast<double>(end - from);
  }
  for (std::size_t i = 0; i < x.size(); ++i) {
    track.velocity_mm_s.push_back(i > 0 ? (x[i] - x[i - 1]) / track.step_s : 0.0);
    const double t = track.t_s(i);
    track.excess_psi.push_back(truth.pressure_swing_psi * (0.6 * std::sin(0.31 * t) + 0.4 * std::sin(1.1 * t + 0.5)));
  }
  return out;
}

constexpr unsigned kSeed = 7;
constexpr double kForceNoise_N = 0.02, kPositionNoise_mm = 4e-4, kPressureNoise_psi = 0.005;

messages::Recording record(const Session& session, const test::Curve& force, unsigned seed) {
  const Track& track = session.track;
  std::mt19937 random(seed);
  std::normal_distribution<double> normal;
  std::uniform_real_distribution<double> jitter_s(-2e-4, 2e-4);
  messages::Recording out;
  out.metadata.specimen = "judge";
  out.metadata.rest_length_mm = 90.0;
  out.metadata.pressurized_rest_length_mm = 90.0 - track.elongation_at_zero_mm;
  out.metadata.nominal_pressure_psi = track.nominal_pressure_psi;
  out.pressure.emplace();
  double next_s = 0.0, next_pressure_s = 0.003;
  while (next_s < track.t_s(track.size() - 2) - 0.01) {
    const double t = std::max(0.0, next_s + jitter_s(random));
    const auto i = static_cast<std::size_t>(t / track.step_s);
    const double share = t / track.step_s - static_cast<double>(i);
    const auto at = [&](const std::vector<double>& of) { return of[i] + share * (of[i + 1] - of[i]); };
    out.frame.t_s.push_back(t);
    out.frame.position_mm.push_back(at(track.position_mm) + kPositionNoise_mm * normal(random));
    out.frame.force_N.push_back(at(force) + kForceNoise_N * normal(random));
    const bool dense =
        std::ranges::any_of(session.dense, [&](const auto& d) { return next_s >= d.first && next_s <= d.second; });
    next_s += dense ? 0.005 : 0.2;
    for (; next_pressure_s < next_s; next_pressure_s += 0.2) {
      const auto k = static_cast<std::size_t>(next_pressure_s / track.step_s);
      if (k >= track.size()) break;
      out.pressure->t_s.push_back(next_pressure_s);
      out.pressure->pressure_psi.push_back(track.nominal_pressure_psi + track.excess_psi[k] +
                                           kPressureNoise_psi * normal(random));
    }
  }
  return out;
}

model::Part part_of(const Truth& truth) {
  const model::Physics* physics = model::find_physics(truth.physics);
  model::Part part = model::make_part(*physics, *model::find_law(*physics, truth.law));
  part.parameters = truth.parameters;
  part.coefficients = truth.coefficients;
  return part;
}

model::ModelSpec true_model(const Truth& truth) {
  model::ModelSpec spec = model::nominal_model("slse1");
  spec.parts[0].coefficients = {kStiffness_N_mm};
  spec.parts[1].parameters = {kArm_s};
  spec.parts[1].coefficients = {kArm_N_mm};
  spec.parts.push_back(part_of(truth));
  if (spec.parts.back().law->traits.replaces_arm) spec.parts.erase(spec.parts.begin() + 1);
  return spec;
}

struct Fitted {
  std::vector<Series> series;
  model::ModelSpec spec;
  NoiseModel noise;
  std::vector<NamedValue> values;  ///< of the law's part
  double log_likelihood = 0.0;
  double log_likelihood_of_truth = 0.0;
};

/// The law beside the nominal model from every start that its sheet gives, and from nothing else; the time of
/// an event from a scan.
void fit(const Truth& truth, unsigned seed, Fitted& out) {
  const Session way = session(truth);
  messages::Recording recording = record(way, test::judged_force(true_model(truth), way.track), seed);
  const Guarded guarded = guard_recording(recording);
  // A force that follows a pressure of 30 psi/s bends within a reading of 0.2 s, which may cost that reading.
  for (const DataFault& fault : guarded.faults)
    EXPECT_TRUE(fault.rows == 1 && truth.pressure_swing_psi > 1.0) << "physics taken for a data fault: " << fault.text;
  out.series.push_back(prepare_series("judge", std::move(recording), guarded.usable));
  const std::vector<std::vector<bool>> usable{guarded.usable};
  const InstrumentNoise noise = instrument_noise(out.series, usable);
  const Search search(out.series, noise.noise, 1);
  const Hypothesis nominal = search.nominal(model::nominal_model("slse1"));

  model::ModelSpec spec = nominal.fit.spec;
  spec.parts.push_back(part_of(truth));
  if (spec.parts.back().law->traits.replaces_arm) spec.parts.erase(spec.parts.begin() + 1);
  model::Part& part = spec.parts.back();
  std::vector<Fit> fits;
  std::size_t starts = 1;
  for (const auto& parameter : part.law->parameters) starts = std::max(starts, parameter.starts.size());
  for (std::size_t k = 0; k < starts; ++k) {
    for (std::size_t i = 0; i < part.parameters.size(); ++i) {
      const model::Parameter& parameter = part.law->parameters[i];
      if (parameter.name == "duration_s") {
        part.parameters[i] = out.series[0].excitation.reference.duration_s;
      } else if (!parameter.fixed && !parameter.starts.empty()) {
        part.parameters[i] =
            parameter.starts[std::min(k, parameter.starts.size() - 1)] *
            (parameter.traits.starts_are_shares_of_largest_force ? out.series[0].excitation.reference.largest_force_N
                                                                 : 1.0);
      }
    }
    if (part.law->traits.replaces_arm) part.parameters[0] = nominal.fit.spec.parts[1].parameters[0];
    if (part.physics->name == "grip_slip") {
      for (double width_s = 40.0, centre_s = 150.0; width_s > 0.02; width_s *= 0.3) {
        for (int j = -6; j <= 6; ++j) {
          part.parameters[0] = centre_s + width_s * j / 3.0;
          fits.push_back(search.fit_from(spec, 3));
        }
        const Fit& best = *std::ranges::min_element(fits, {}, &Fit::chi2);
        centre_s = best.spec.parts.back().parameters[0];
      }
      continue;
    }
    fits.push_back(search.fit_from(spec, 30));
  }
  Hypothesis best;
  best.fit = *std::ranges::min_element(fits, {}, &Fit::chi2);
  search.settle(best, true);
  out.spec = best.fit.spec;
  out.noise = best.fit.noise;
  const Problem problem(out.series, out.noise);
  out.values = intervals(problem, out.spec, Spread::kMoves).back();
  out.log_likelihood = problem.log_likelihood(out.spec, out.noise);
  model::ModelSpec exact = true_model(truth);
  Eigen::VectorXd residual;
  (void)problem.solve(exact, residual);
  out.log_likelihood_of_truth = problem.log_likelihood(exact, out.noise);
}

/// Everything refitted but one parameter of the last part.
model::ModelSpec fit_with_held(const Problem& problem, const model::ModelSpec& spec, std::size_t index) {
  model::Law law = *spec.parts.back().law;
  law.parameters[index].fixed = true;
  model::ModelSpec held = spec;
  held.parts.back().law = &law;
  held = problem.fit(held, 25).spec;
  held.parts.back().law = spec.parts.back().law;
  return held;
}

double true_value(const Truth& truth, std::string_view name) {
  const model::Part part = part_of(truth);
  for (std::size_t i = 0; i < part.law->parameters.size(); ++i)
    if (part.law->parameters[i].name == name) return truth.parameters[i];
  for (std::size_t i = 0; i < part.law->coefficients.size(); ++i)
    if (part.law->coefficients[i].name == name) return truth.coefficients[i];
  return std::nan("");
}

const std::vector<Truth>& truths() {
  static const std::vector<Truth> all{
      {"coulomb_friction", "dahl", {0.04}, {0.8}},
      {"coulomb_friction", "jenkins", {0.04}, {0.8}},
      {"coulomb_friction", "iwan", {0.08}, {0.8}},
      {"coulomb_friction", "stribeck", {0.04, 1.5, 0.5}, {0.8}, 20.0, 0.25, 0.04},
      {"coulomb_friction", "stribeck_exponential", {0.04, 1.5, 0.5}, {0.8}, 20.0, 0.25, 0.04},
      {"coulomb_friction", "iwan_stribeck", {0.08, 1.5, 0.5}, {0.8}, 20.0, 0.25, 0.04},
      {"coulomb_friction", "bouc_wen_equal", {0.05, 2.0}, {0.8}},
      {"coulomb_friction", "bouc_wen", {0.05, 2.0, 0.8}, {0.8}},
      {"coulomb_friction", "regularised", {0.3}, {0.8}, 20.0, 0.25, 0.03},
      {"strain_stiffening", "quadratic", {}, {0.06}},
      {"strain_stiffening", "cubic", {}, {0.02}},
      {"strain_stiffening", "polynomial", {}, {0.06, 0.02}},
      {"strain_stiffening", "quintic", {}, {0.06, 0.02, -0.006, 0.002}},
      {"strain_stiffening", "exponential", {2.0}, {0.3}},
      {"strain_stiffening", "knee", {0.7}, {0.6}},
      {"strain_stiffening", "smooth_knee", {0.7, 0.3}, {0.6}},
      {"strain_stiffening", "lock", {6.0}, {0.3}},
      {"second_relaxation", "arm", {9.0}, {0.6}},
      {"second_relaxation", "two_arms", {0.1, 9.0}, {0.6, 0.6}},
      {"second_relaxation", "spectrum", {0.2, 2.0}, {1.5}},
      {"nonlinear_viscosity", "power_arm", {0.8, 1.8}, {2.0}},
      {"nonlinear_viscosity", "yield_arm", {0.8, 0.2}, {2.0}},
      {"nonlinear_viscosity", "power_dashpot", {0.4}, {0.3}, 20.0, 0.25, 0.02},
      {"pressure_coupling", "stiffness", {}, {0.1}},
      {"pressure_coupling", "force", {}, {2.0}},
      {"pressure_coupling", "both", {}, {1.0, 0.2}},
      {"pressure_coupling", "tube", {1.5}, {2.0}},
      {"cyclic_softening", "elastic", {15.0}, {-0.05}},
      {"cyclic_softening", "tangent", {15.0}, {-0.4}},
      {"cyclic_softening", "overall", {15.0, 0.05}, {}},
      {"force_lag", "first_order", {0.03}, {}},
      {"force_lag", "two_poles", {0.02}, {}},
      {"force_delay", "dead_time", {0.02}, {}},
      {"fixture_inertia", "rigid", {}, {0.5}, 20.0, 0.25, 0.02},
      {"fixture_inertia", "sprung", {0.12, 0.3}, {0.5}, 20.0, 0.25, 0.02},
      {"zero_drift", "linear", {}, {4.0}},
      {"zero_drift", "settling", {150.0}, {0.6}},
      {"zero_drift", "wander", {0.0}, {0.2, -0.1, 0.05, 0.1, -0.05, 0.02}},
      {"grip_slip", "event", {170.3, 0.1, 0.0}, {}},
      {"grip_slip", "creep", {170.3, 0.1, 6.0, 0.0}, {}},
      {"crosshead_backlash", "play", {0.08, 0.5}, {}},
      {"crosshead_backlash", "compliant", {0.2, 0.03, 0.5}, {}},
      {"slack", "unilateral", {}, {}, 1.5},
      {"viscous_drag", "linear", {}, {0.03}},
      {"friction_asymmetry", "viscous", {}, {0.03}},
      {"friction_asymmetry", "sliding", {0.04}, {0.3}, 20.0, 0.25, 0.02},
      {"friction_asymmetry", "both", {0.04}, {0.3, 0.03}, 20.0, 0.25, 0.02},
      {"friction_with_pressure", "dahl", {0.04}, {0.05}, 20.0, 4.0},
      {"pressure_threshold", "dead_zone", {12.0}, {3.0}, 20.0, 6.0},
      {"cell_nonlinearity", "quadratic", {2.0}, {}},
      {"cell_nonlinearity", "ceiling", {62.0, 25.0}, {}},
      {"unsettled_start", "exponential", {4.0}, {0.5}},
      {"quasi_linear_viscoelasticity", "fung_arm", {0.8, 0.15}, {2.0}},
      {"quasi_linear_viscoelasticity", "relaxation_time", {0.8, 0.2}, {2.0}},
      {"directional_damping", "series", {0.8, 0.5}, {2.0}},
      {"directional_damping", "parallel", {}, {0.03, 0.015}, 20.0, 0.25, 0.02},
      {"mullins_softening", "ogden_roxburgh", {12.0}, {-0.3}},
      {"mullins_softening", "damage", {1.0}, {-0.1}},
      {"permanent_set", "proportional", {}, {-0.3}},
      {"permanent_set", "yield", {1.0}, {-0.4}},
      {"permanent_set", "saturating", {1.0}, {-0.6}},
      {"friction_with_load", "capstan", {0.04, 0.02}, {}},
      {"trapped_gas", "polytropic", {0.8, 25.0, 1.2, 90.0}, {2.0}},
  };
  return all;
}

/// Maxwell arms under whatever name, fastest first: which of them the nominal model's is cannot be told.
struct Arm {
  double time_constant_s, stiffness_N_mm;
};
std::vector<Arm> arms_of(const model::ModelSpec& spec) {
  std::vector<Arm> out;
  for (const model::Part& part : spec.parts) {
    if (part.physics->name != "maxwell" && part.law->name != "arm" && part.law->name != "two_arms") continue;
    for (std::size_t i = 0; i < part.parameters.size(); ++i) out.push_back({part.parameters[i], part.coefficients[i]});
  }
  std::ranges::sort(out, {}, &Arm::time_constant_s);
  return out;
}

/// The fit's values with what is true of each.
std::vector<std::pair<NamedValue, double>> compared(const Truth& truth, const Fitted& fitted) {
  std::vector<std::pair<NamedValue, double>> out;
  if (truth.law == "arm" || truth.law == "two_arms") {
    const std::vector<Arm> found = arms_of(fitted.spec), right = arms_of(true_model(truth));
    for (const auto& values : intervals(Problem(fitted.series, fitted.noise), fitted.spec, Spread::kMoves)) {
      for (const NamedValue& value : values) {
        for (std::size_t i = 0; i < found.size(); ++i) {
          if (value.value == found[i].time_constant_s) out.emplace_back(value, right[i].time_constant_s);
          if (value.value == found[i].stiffness_N_mm) out.emplace_back(value, right[i].stiffness_N_mm);
        }
      }
    }
    EXPECT_EQ(out.size(), 2 * right.size());
  } else {
    for (const NamedValue& value : fitted.values) out.emplace_back(value, true_value(truth, value.name));
  }
  return out;
}

void PrintTo(const Truth& truth, std::ostream* out) {
  *out << truth.physics << "/" << truth.law;
}

class Recovery : public testing::TestWithParam<Truth> {};

TEST_P(Recovery, FindsTheNumbers) {
  Truth truth = GetParam();
  if (truth.law == "wander") {
    const Session way = session(truth);
    truth.parameters[0] = way.track.t_s(way.track.size() - 1);
  }
  Fitted fitted;
  fit(truth, kSeed, fitted);
  // The noise is what was put in: nothing is left over. What jitter of the stamps and noise of the position
  // do to a friction law may stand beside it.
  EXPECT_NEAR(fitted.noise.white_N, kForceNoise_N, (0.15 + 15.0 * truth.discretisation) * kForceNoise_N);
  EXPECT_LT(fitted.noise.coloured_N, kForceNoise_N);
  for (const auto& [value, right] : compared(truth, fitted)) {
    const double sigma = (value.high - value.low) / (2.0 * 1.96);
    EXPECT_GT(sigma, 0.0) << value.name << " is never known exactly";
    EXPECT_LT(sigma, 0.15 * std::fabs(right)) << value.name << ": too uncertain to be called recovered";
    EXPECT_NEAR(value.value, right, 4.0 * sigma + truth.discretisation * std::fabs(right)) << value.name;
  }
}

INSTANTIATE_TEST_SUITE_P(Catalogue, Recovery, testing::ValuesIn(truths()), [](const auto& truth) {
  return std::string(truth.param.physics) + "__" + std::string(truth.param.law);
});

TEST(Recovery, IsTriedOnEveryLawOfEveryEffect) {
  for (const test::Named& named : test::every_law()) {
    if (!model::is_effect(*named.physics)) continue;
    EXPECT_TRUE(std::ranges::any_of(truths(), [&](const Truth& truth) {
      return truth.physics == named.physics->name && truth.law == named.law->name;
    })) << test::test_name(named);
  }
}

/// A number that this session cannot show.
struct Hidden {
  Truth truth;
  std::string_view number;
  double elsewhere;  ///< a value far from the true one that explains the recording as well
  std::string_view why;
  /// Its range is narrower than its value: the interval has to hold the whole range, not to be wider than the value.
  bool bounded = false;
};

void PrintTo(const Hidden& hidden, std::ostream* out) {
  *out << hidden.truth.law << "/" << hidden.number;
}

class Refusal : public testing::TestWithParam<Hidden> {};

TEST_P(Refusal, IsSaidByTheIntervalAndIsRight) {
  const auto& [truth, number, elsewhere, why, bounded] = GetParam();
  Fitted fitted;
  fit(truth, kSeed, fitted);
  const auto value = std::ranges::find(fitted.values, number, &NamedValue::name);
  ASSERT_NE(value, fitted.values.end());
  const model::Part& part = fitted.spec.parts.back();
  std::size_t index = 0;
  while (part.law->parameters[index].name != number) ++index;
  const model::Parameter& parameter = part.law->parameters[index];
  const bool at_bound = part.parameters[index] <= parameter.lower * (1.0 + 1e-6) ||
                        part.parameters[index] >= parameter.upper * (1.0 - 1e-6);
  const bool wide = bounded ? value->low <= parameter.lower && value->high >= parameter.upper
                            : value->high - value->low > std::fabs(value->value);
  EXPECT_TRUE(at_bound || wide) << why << ", yet the interval is " << value->low << " to " << value->high;
  // Right: held at a value far off, with all else refitted, the likelihood hardly falls (1.9 is the edge of
  // 95 %).
  model::ModelSpec held = fitted.spec;
  held.parts.back().parameters[index] = elsewhere;
  const Problem problem(fitted.series, fitted.noise);
  held = fit_with_held(problem, held, index);
  const double best = problem.log_likelihood(held, fitted.noise);
  EXPECT_GT(best, fitted.log_likelihood - 1.92) << why;
}

const Hidden kHidden[] = {
    {{"pressure_threshold", "dead_zone", {5.0}, {3.0}}, "threshold_psi", 10.0, "the pressure never comes near it"},
    {{"cyclic_softening", "tangent", {2500.0}, {-8.0}}, "travel_mm", 1000.0, "no more than its first slope is seen"},
    {{"zero_drift", "settling", {1.5e4}, {6.0}}, "time_constant_s", 5000.0, "no more than its first slope is seen"},
    {{"coulomb_friction", "bouc_wen_equal", {5e-4, 2.0}, {0.8}},
     "exponent",
     6.0,
     "the presliding is the position's noise"},
    {{"crosshead_backlash", "compliant", {2e-4, 0.03, 0.0}, {}}, "gap_mm", 6e-4, "the gap is the position's noise"},
    {{"trapped_gas", "polytropic", {0.8, 25.0, 1.2, 9000.0}, {1.0}},
     "braid_angle_deg",
     40.0,
     "the strokes are short against the length",
     true},
    {{"trapped_gas", "polytropic", {0.8, 25.0, 1.2, 9000.0}, {1.0}},
     "exponent",
     1.4,
     "the strokes are short against the length",
     true},
};
INSTANTIATE_TEST_SUITE_P(Session, Refusal, testing::ValuesIn(kHidden), [](const auto& hidden) {
  return std::string(hidden.param.truth.law) + "__" + std::string(hidden.param.number);
});

}  // namespace
}  // namespace isorig::identify
