#include "proof/foreign_laws/case.hpp"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "proof/fit/nominal.hpp"
#include "proof/generator/size.hpp"

namespace isorig::proof::foreign {
namespace {

/// Of an effect over a faint background, the background's share of the effect's residual.
constexpr double kFaint = 1.0 / 8.0;
constexpr double kAlmostNone = 1e-6;  // of a strength

Random stream(std::uint64_t seed, const std::string& name, const char* what) {
  return {seed, "foreign/" + name + "/" + what};
}

void draw_specimen(Case& c, Random& random) {
  Rig& rig = c.clean;
  rig.rest_length_mm = random.log_uniform(40.0, 250.0);
  rig.stroke_mm = rig.rest_length_mm * random.uniform(0.025, 0.06);
  rig.elongation_mm = rig.stroke_mm * random.uniform(1.6, 4.0);
  rig.peak_N = random.log_uniform(2.0, 500.0);
  rig.stiffness_N_mm = rig.peak_N / (rig.elongation_mm + rig.stroke_mm);
  if (random.chance(0.5)) {
    c.nominal = "slse1";
    rig.arms = {{rig.stiffness_N_mm * random.uniform(0.3, 1.2), random.log_uniform(0.3, 3.0), {}}};
  } else {
    c.nominal = "slse2";
    rig.arms = {{rig.stiffness_N_mm * random.uniform(0.3, 0.8), random.log_uniform(0.12, 0.5), {}},
                {rig.stiffness_N_mm * random.uniform(0.2, 0.7), random.log_uniform(2.0, 6.0), {}}};
  }
  c.rates = {.fast_Hz = std::array{50.0, 100.0, 200.0, 500.0, 1000.0}[random.index(5)],
             .slow_Hz = random.uniform(4.0, 10.0),
             .pressure_Hz = std::array{5.0, 10.0, 20.0, 50.0}[random.index(4)]};
}

Supply draw_supply(Random& random, double swing) {
  Supply s;
  s.nominal_psi = random.log_uniform(4.0, 60.0);
  s.swing_psi = s.nominal_psi * swing;
  s.air = std::array{Air::kDroop, Air::kHunting, Air::kLeak, Air::kTrappedGas}[random.index(4)];
  switch (s.air) {
    case Air::kHunting:
      s.time_s = random.log_uniform(8.0, 60.0);
      break;
    case Air::kLeak:  // half a minute to four minutes from full to refilled
      s.time_s = s.nominal_psi / s.swing_psi * random.log_uniform(30.0, 240.0);
      break;
    default:
      s.time_s = random.log_uniform(0.8, 5.0);
  }
  return s;
}

/// `readings` draws what was added later, so that whatever else is drawn stays.
void draw_instruments(Case& c, Random& random, Random readings) {
  Instruments& i = c.instruments;
  const Rig& rig = c.clean;
  i.force_noise_N = rig.peak_N * random.log_uniform(4e-4, 2e-3);
  i.position_noise_mm = rig.stroke_mm * random.log_uniform(3e-5, 2e-4);
  i.position_step_mm = i.position_noise_mm / 20.0;
  i.force_step_N = i.force_noise_N * (random.chance(0.5) ? 0.2 : 0.02);
  i.pressure_noise_psi = rig.supply.nominal_psi * random.log_uniform(2e-4, 8e-4);
  i.pressure_step_psi = i.pressure_noise_psi / 5.0;
  const Trap trap = c.plan.trap;
  if (trap == Trap::kColouredNoise || (trap == Trap::kNone && random.chance(0.15))) {
    i.coloured_noise_N = i.force_noise_N * random.uniform(0.3, 0.9);
    i.coloured_time_s = random.log_uniform(0.2, 5.0);
    if (readings.chance(0.5)) i.coloured_readings = readings.log_uniform(3.0, 60.0);
  }
  if (trap == Trap::kMainsHum || (trap == Trap::kNone && random.chance(0.15))) {
    i.hum_N = i.force_noise_N * random.uniform(0.5, 2.0);
    i.mains_Hz = random.uniform(49.95, 50.05);
  }
  if (trap == Trap::kOutliers) {
    i.outliers = 6 + static_cast<int>(random.index(20));
    i.outlier_N = 30.0 * i.force_noise_N;
  }
  if (trap == Trap::kCoarseQuantisation) i.force_step_N = i.force_noise_N * random.uniform(1.5, 4.0);
  if (trap == Trap::kPressureClock) i.pressure_clock_s = random.sign() * random.uniform(0.05, 0.3);
  if (trap == Trap::kWarmingNoise) i.warming = random.uniform(0.8, 1.5);
  if (trap == Trap::kNoisyPosition) i.position_noise_mm *= 8.0;
  if (trap == Trap::kNoPressure) i.pressure_recorded = false;
  if (trap == Trap::kGaps) i.gaps = 2 + static_cast<int>(random.index(4));
}

/// The residual after the nominal refit, at a rate at which a strength is found to some per cent.
double left_N(const Rig& rig, const Path& path, const FrameRates& rates) {
  FrameRates coarse = rates;
  coarse.fast_Hz = std::min(rates.fast_Hz, 100.0);
  const Trace trace = read(play(rig, path), path, coarse);
  const NominalFit fit =
      refined(fit_nominal(trace.t_s, trace.position_mm, trace.force_N, static_cast<int>(rig.arms.size())), trace.t_s,
              trace.position_mm, trace.force_N);
  return residual_size_N(fit, dense_rows(trace.t_s));
}

Concealed concealed_at(const Case& c, const std::string& law, double target_N, double size, Random& random) {
  const Kind& kind = kind_of_law(law);
  Concealed one{law, 0.0, size, kind.draw(random, c.clean, c.train), 0.0};
  const auto left_at = [&](double strength) {
    Rig rig = c.clean;
    kind.conceal(strength, one.shape, rig);
    return left_N(rig, c.train, c.rates);
  };
  double left = 0.0;
  for (;;) {
    one.strength = strength_leaving(kind.start, kind.most, target_N * size, left_at);
    left = left_at(one.strength);
    if (kind.stays.empty() || left_at(kAlmostNone * kind.start) < 0.5 * left) break;
    one.shape.at(std::string(kind.stays)) *= 0.5;
  }
  one.residual_over_noise = left / c.instruments.force_noise_N;
  return one;
}

void conceal(const Concealed& one, Rig& rig) {
  kind_of_law(one.law).conceal(one.strength, one.shape, rig);
}

}  // namespace

Case draw_case(std::uint64_t seed, std::size_t number, const CasePlan& plan) {
  Case c;
  c.name = (number < 10 ? "case-00" : number < 100 ? "case-0" : "case-") + std::to_string(number);
  c.plan = plan;
  Random random = stream(seed, c.name, "draw");
  draw_specimen(c, random);
  const bool felt = std::ranges::any_of(
      plan.effects, [](const std::string& law) { return kind_of_law(law).effect == "pressure_coupling"; });
  const bool swings = felt || plan.trap == Trap::kSwingingPressure;
  c.clean.supply = draw_supply(random, swings ? random.log_uniform(0.02, 0.08) : random.log_uniform(0.001, 0.004));
  draw_instruments(c, random, stream(seed, c.name, "noise by readings"));
  c.train = train_path(std::array{Protocol::kRamps, Protocol::kWaves, Protocol::kBoth}[random.index(3)],
                       c.clean.stroke_mm, random);
  c.heldout = heldout_path(c.clean.stroke_mm, random);

  const double target_N = c.instruments.force_noise_N * random.log_uniform(10.0, 40.0);
  for (const std::string& law : plan.effects) c.concealed.push_back(concealed_at(c, law, target_N, plan.size, random));
  if (plan.category == Category::kBackground) {
    const auto& named = kind_of_law(plan.effects.front()).effect;
    const std::array<std::string, 5> faint{"log_normal", "springpot", "fung_square", "ogden", "miehe_damage"};
    std::string law;
    do law = faint[random.index(faint.size())];
    while (kind_of_law(law).effect == named || alike(std::string(kind_of_law(law).effect), std::string(named)));
    const double seen_N = c.concealed.front().residual_over_noise * c.instruments.force_noise_N;
    c.background.push_back(concealed_at(c, law, seen_N, kFaint, random));
    c.background_over_noise = c.background.back().residual_over_noise;
  }
  c.train_rig = c.heldout_rig = c.clean;
  for (const auto* list : {&c.background, &c.concealed}) {
    for (const Concealed& one : *list) {
      conceal(one, c.train_rig);
      if (!kind_of_law(one.law).one_session) conceal(one, c.heldout_rig);
    }
  }
  c.residual_over_noise = left_N(c.train_rig, c.train, c.rates) / c.instruments.force_noise_N;
  return c;
}

MadeRecording record(const Case& drawn, Part part, std::uint64_t seed) {
  const bool heldout = part == Part::kHeldout;
  Random random = stream(seed, drawn.name, heldout ? "heldout" : "train");
  const Rig& rig = heldout ? drawn.heldout_rig : drawn.train_rig;
  const Path& path = heldout ? drawn.heldout : drawn.train;
  const double jitter_most_s = 0.04 / drawn.rates.fast_Hz;
  std::vector<double> jitter_s(frame_times_s(path, drawn.rates).size());
  for (double& j : jitter_s) j = random.uniform(0.0, jitter_most_s);
  messages::RecordingMetadata metadata;
  metadata.specimen = drawn.name;
  metadata.rest_length_mm = rig.rest_length_mm;
  metadata.pressurized_rest_length_mm = rig.rest_length_mm - rig.elongation_mm;
  metadata.nominal_pressure_psi = rig.supply.nominal_psi;
  return measure(read(play(rig, path), path, drawn.rates, jitter_s), drawn.instruments, path.end_s(),
                 std::move(metadata), random);
}

namespace {

nlohmann::ordered_json json_of(const std::vector<Concealed>& list) {
  auto json = nlohmann::ordered_json::array();
  for (const Concealed& one : list) {
    const Kind& kind = kind_of_law(one.law);
    json.push_back({{"effect", kind.effect},
                    {"law", kind.law},
                    {"accepted", kind.accepted},
                    {"acts_on", kind.acts_on},
                    {"depends_on", kind.depends_on},
                    {"source", kind.source},
                    {"size", one.size},
                    {"residual_over_noise", one.residual_over_noise},
                    {"strength", one.strength},
                    {"strength_is", kind.strength_is},
                    {"shape", one.shape}});
  }
  return json;
}

}  // namespace

nlohmann::ordered_json label_of(const Case& c) {
  nlohmann::ordered_json label;
  label["category"] = proof::name_of(c.plan.category);
  label["nominal"] = c.nominal;
  label["trap"] = proof::name_of(c.plan.trap);
  label["effects"] = json_of(c.concealed);
  label["background"] = json_of(c.background);
  label["noise_N"] = c.instruments.force_noise_N;
  label["coloured_noise_N"] = c.instruments.coloured_noise_N;
  label["coloured_readings"] = c.instruments.coloured_readings;
  label["hum_N"] = c.instruments.hum_N;
  label["air"] = name_of(c.clean.supply.air);
  label["fast_Hz"] = c.rates.fast_Hz;
  label["peak_N"] = c.clean.peak_N;
  label["residual_over_noise"] = c.residual_over_noise;
  label["background_over_noise"] = c.background_over_noise;
  label["stiffness_N_mm"] = c.train_rig.stiffness_N_mm;
  for (const Arm& arm : c.train_rig.arms)
    label["arms"].push_back({{"stiffness_N_mm", arm.stiffness_N_mm}, {"time_constant_s", arm.time_s}});
  return label;
}

}  // namespace isorig::proof::foreign
