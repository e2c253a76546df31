#include "proof/generator/case.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "proof/generator/size.hpp"

namespace isorig::proof {
namespace {

std::string stream(const Case& drawn, const char* what) {
  return drawn.name + "/" + what;
}

void draw_specimen(Case& c, Random& random) {
  constexpr double kPressures_psi[] = {5.0, 10.0, 15.0, 20.0};
  RigParameters& rig = c.clean;
  rig.air.nominal_psi = kPressures_psi[random.index(4)];
  const double filled = rig.air.nominal_psi / 20.0;
  Specimen& s = rig.specimen;
  s.rest_length_mm = random.uniform(86.0, 94.0);
  s.pressurized_rest_length_mm =
      s.rest_length_mm * (1.0 - random.uniform(0.19, 0.25) * std::pow(filled, random.uniform(1.6, 2.1)));
  s.stiffness_N_mm = random.log_uniform(1.0, 3.5);
  if (random.chance(0.6)) {
    c.nominal = "slse1";
    s.arms = {{s.stiffness_N_mm * random.uniform(0.3, 1.2), random.log_uniform(0.3, 3.0)}};
  } else {
    c.nominal = "slse2";
    s.arms = {{s.stiffness_N_mm * random.uniform(0.3, 0.8), random.log_uniform(0.12, 0.5)},
              {s.stiffness_N_mm * random.uniform(0.2, 0.7), random.log_uniform(2.5, 8.0)}};
  }
  rig.crosshead = {random.uniform(50.0, 110.0), random.uniform(0.65, 0.95), random.log_uniform(200.0, 1000.0)};
  rig.air.droop_psi_mm = random.sign() * random.uniform(0.01, 0.05);
  rig.air.recovery_s = random.log_uniform(0.8, 4.0);
  rig.air.swing_psi = random.uniform(0.005, 0.03);
  rig.air.swing_period_s = random.uniform(600.0, 1600.0);
}

void draw_instruments(Case& c, Random& random) {
  Instruments& i = c.instruments;
  i.force_noise_N = random.log_uniform(0.018, 0.05);
  i.position_noise_mm = random.uniform(0.3e-3, 0.6e-3);
  i.force_step_N = random.chance(0.5) ? 5e-3 : 1e-3;
  // Not white alone, now and then, also where there is something to be found.
  const bool coloured = c.plan.trap == Trap::kColouredNoise || (c.plan.trap == Trap::kNone && random.chance(0.2));
  if (coloured) {
    i.coloured_noise_N = i.force_noise_N * random.uniform(0.3, 0.9);
    i.coloured_time_s = random.log_uniform(0.3, 5.0);
  }
  switch (c.plan.trap) {
    case Trap::kOutliers:
      i.outliers = 6 + static_cast<int>(random.index(20));
      break;
    case Trap::kCoarseQuantisation:
      i.force_step_N = random.uniform(0.04, 0.1);
      break;
    case Trap::kPressureClock:
      i.pressure_clock_s = random.sign() * random.uniform(0.05, 0.3);
      break;
    case Trap::kWarmingNoise:
      i.warming = random.uniform(0.8, 1.5);
      break;
    case Trap::kNoisyPosition:
      i.position_noise_mm = random.uniform(2e-3, 4e-3);
      break;
    case Trap::kNoPressure:
      i.pressure_recorded = false;
      break;
    case Trap::kGaps:
      i.gaps = 2 + static_cast<int>(random.index(4));
      break;
    default:
      break;
  }
  if (c.plan.trap == Trap::kSwingingPressure) {
    c.clean.air.droop_psi_mm *= 5.0;
    c.clean.air.swing_psi = random.uniform(0.1, 0.3);
  }
}

/// A spring that is not quite straight and a tail of relaxation: together about half the noise.
void add_background(Case& c, Random& random) {
  const double target_N = c.instruments.force_noise_N * random.uniform(0.5, 1.0);
  RigParameters rig = c.clean;
  const auto add = [](RigParameters& to, double share, double bend) {
    double time_s = 0.08;
    for (int i = 0; i < 5; ++i, time_s *= 6.0)
      to.hidden.further_arms.push_back({share * to.specimen.stiffness_N_mm * std::pow(time_s, -0.15), time_s});
    to.hidden.quadratic_N_mm2 += bend;
  };
  double scale = 0.01;
  const double bend_per_share = random.sign() * 0.15;
  const Motion train = paper_motion(c.train_protocol);
  for (int round = 0; round < 2; ++round) {
    rig = c.clean;
    add(rig, scale, scale * bend_per_share);
    scale *= target_N / std::fmax(residual_left_N(rig, train, {}), 1e-6);
  }
  add(c.clean, scale, scale * bend_per_share);
  c.background_over_noise = residual_left_N(c.clean, train, {}) / c.instruments.force_noise_N;
}

}  // namespace

Case draw_case(std::uint64_t seed, std::size_t number, const CasePlan& plan) {
  Case c;
  c.name = (number < 10 ? "case-00" : number < 100 ? "case-0" : "case-") + std::to_string(number);
  c.plan = plan;
  Random random(seed, stream(c, "draw"));
  draw_specimen(c, random);
  draw_instruments(c, random);
  c.train_protocol.stroke_mm = 2.0;
  c.heldout_protocol.stroke_mm = random.uniform(1.2, 1.8);
  c.heldout_protocol.sine_Hz = {random.uniform(0.2, 0.5), random.uniform(0.8, 2.5)};
  c.heldout_protocol.sine_mm = random.uniform(0.6, 1.2);
  c.heldout_protocol.fast_triangle_mm_s = random.uniform(4.0, 9.0);

  const auto conceals = [&plan](const char* name) { return std::ranges::count(plan.effects, name) > 0; };
  if (conceals("pressure_coupling")) c.clean.air.droop_psi_mm *= 4.0;  // a regulator worth suspecting
  // A specimen that goes slack is a soft one near its pressurized rest length to begin with.
  if (conceals("slack")) c.clean.specimen.pressurized_rest_length_mm = c.clean.specimen.rest_length_mm - 4.0;
  if (plan.category == Category::kBackground) add_background(c, random);

  const Motion train = paper_motion(c.train_protocol);
  c.rig = c.clean;
  for (const std::string& name : plan.effects) {
    ConcealedEffect effect = draw_effect(effect_kind(name), random, c.clean, train);
    const double target_N = c.instruments.force_noise_N * random.log_uniform(10.0, 40.0);
    effect.strength = full_strength(effect, c.clean, train, {}, target_N) * plan.size;
    effect.size = plan.size;
    conceal(effect, c.rig);
    c.effects.push_back(std::move(effect));
  }
  c.residual_over_noise = residual_left_N(c.rig, train, {}) / c.instruments.force_noise_N;
  return c;
}

MadeRecording record(const Case& drawn, Part part, std::uint64_t seed) {
  const bool heldout = part == Part::kHeldout;
  Random random(seed, stream(drawn, heldout ? "heldout" : "train"));
  RigParameters rig = drawn.rig;
  if (heldout) rig.hidden.slip_mm = 0.0;
  const Motion motion = heldout ? heldout_motion(drawn.heldout_protocol) : paper_motion(drawn.train_protocol);
  const Sampling sampling;

  constexpr double kJitter_s = 0.2e-3;
  std::vector<double> jitter_s(frame_times(motion, sampling).size());
  for (double& j : jitter_s) j = random.uniform(-kJitter_s, kJitter_s);
  messages::RecordingMetadata metadata;
  metadata.specimen = drawn.name;
  metadata.rest_length_mm = rig.specimen.rest_length_mm;
  metadata.pressurized_rest_length_mm = rig.specimen.pressurized_rest_length_mm;
  metadata.nominal_pressure_psi = rig.air.nominal_psi;
  return measure(simulate(rig, motion, sampling, jitter_s), drawn.instruments, motion.end_s(), std::move(metadata),
                 random);
}

}  // namespace isorig::proof
