// Bare stepping of a sheathed actuator (two standard linear solids in parallel): model::Actuator, a record at once and
// a step at a time, beside a plain loop that a person would write for one constant pressure and one fixed step. All
// take the same positions and write all forces; the largest difference of the first is printed. Usage: bench_stepping
// SPECIMEN.toml [ticks] [repetitions]
#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <numbers>
#include <vector>

#include "model/actuator.hpp"
#include "sim/specimen.hpp"

namespace {

constexpr double kStep_s = 1e-3;
constexpr double kPressure_psi = 12.0;

/// The two arms' closed step with its constants taken out of the loop: what is left when nothing may change.
void plain_loop(const isorig::model::Actuator& actuator, const std::vector<double>& position_mm,
                std::vector<double>& force_N) {
  const double rest_mm = actuator.rest_length_mm(kPressure_psi);
  const double free_mm = actuator.initial_length_mm() - rest_mm;
  const auto first = actuator.parameters(0, kPressure_psi), second = actuator.parameters(1, kPressure_psi);
  const double decay_1 = std::exp(-first.gamma_1_s * kStep_s), decay_2 = std::exp(-second.gamma_1_s * kStep_s);
  const double gain_1 = -std::expm1(-first.gamma_1_s * kStep_s) / (first.gamma_1_s * kStep_s);
  const double gain_2 = -std::expm1(-second.gamma_1_s * kStep_s) / (second.gamma_1_s * kStep_s);
  double before = (free_mm + position_mm[0]) / rest_mm, arm_1 = 0.0, arm_2 = 0.0;
  for (std::size_t i = 0; i < position_mm.size(); ++i) {
    const double strain = (free_mm + position_mm[i]) / rest_mm, change = strain - before;
    arm_1 = arm_1 * decay_1 + change * gain_1;
    arm_2 = arm_2 * decay_2 + change * gain_2;
    before = strain;
    force_N[i] = (first.k1_N + second.k1_N) * strain + first.k2_N * arm_1 + second.k2_N * arm_2;
  }
}

void stepped(isorig::model::Actuator& actuator, const std::vector<double>& position_mm,
             const std::vector<double>& pressure_psi, std::vector<double>& force_N) {
  actuator.settle(position_mm[0], pressure_psi[0]);
  for (std::size_t i = 0; i < position_mm.size(); ++i)
    force_N[i] = actuator.step(position_mm[i], pressure_psi[i], kStep_s);
}

void stepped_at_once(isorig::model::Actuator& actuator, const std::vector<double>& position_mm,
                     const std::vector<double>& pressure_psi, std::vector<double>& force_N) {
  actuator.settle(position_mm[0], pressure_psi[0]);
  actuator.step_all(position_mm, pressure_psi, kStep_s, force_N);
}

template <typename Work>
double steps_per_s(std::size_t steps, const Work& work) {
  const auto begin = std::chrono::steady_clock::now();
  work();
  return static_cast<double>(steps) / std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
}

}  // namespace

int main(int argc, char** argv) try {
  if (argc < 2) {
    std::fprintf(stderr, "usage: %s SPECIMEN.toml [ticks] [repetitions]\n", argv[0]);
    return 2;
  }
  const auto ticks = static_cast<std::size_t>(argc > 2 ? std::atol(argv[2]) : 4'200'000);
  const int repetitions = argc > 3 ? std::atoi(argv[3]) : 9;
  isorig::model::Actuator actuator(isorig::sim::load_specimen(argv[1]).actuator);
  if (!actuator.has_sheath()) {
    std::fprintf(stderr, "%s: the specimen has no sheath; two solids are compared here\n", argv[1]);
    return 2;
  }
  std::vector<double> position_mm(ticks), constant_psi(ticks, kPressure_psi), measured_psi(ticks);
  std::vector<double> plain_N(ticks), ours_N(ticks), scratch_N(ticks);
  for (std::size_t i = 0; i < ticks; ++i) {
    const double t_s = kStep_s * static_cast<double>(i);
    // A triangle of 2 mm/s and 2 mm, as the protocol's ramps; a pressure that is never the same twice.
    position_mm[i] = 2.0 * std::abs(std::fmod(t_s, 2.0) - 1.0);
    measured_psi[i] = kPressure_psi + 0.02 * std::sin(2.0 * std::numbers::pi * 1.7 * t_s);
  }
  for (int r = 0; r < repetitions; ++r) {
    const double plain = steps_per_s(ticks, [&] { plain_loop(actuator, position_mm, plain_N); });
    const double single = steps_per_s(ticks, [&] { stepped(actuator, position_mm, constant_psi, scratch_N); });
    const double ours = steps_per_s(ticks, [&] { stepped_at_once(actuator, position_mm, constant_psi, ours_N); });
    const double moving = steps_per_s(ticks, [&] { stepped_at_once(actuator, position_mm, measured_psi, scratch_N); });
    double difference_N = 0.0;
    for (std::size_t i = 0; i < ticks; ++i) difference_N = std::max(difference_N, std::abs(plain_N[i] - ours_N[i]));
    std::printf(
        "{\"plain_per_s\": %.4g, \"actuator_per_s\": %.4g, \"actuator_single_per_s\": %.4g, "
        "\"actuator_moving_pressure_per_s\": %.4g, \"largest_difference_N\": %.3g}\n",
        plain, ours, single, moving, difference_N);
  }
  return 0;
} catch (const std::exception& e) {
  std::fprintf(stderr, "%s\n", e.what());
  return 1;
}
