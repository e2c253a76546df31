#include "schedule.hpp"

#include <algorithm>
#include <array>
#include <random>
#include <string_view>

namespace isorig::soak {
namespace {

using daemon::test::At;
using protocol::StepKind;

constexpr double kSlow_mm_s = 0.5;  // the matrix' slow ramp has 0.1, its fast strokes 2 and more
constexpr double kSecondFaultShare = 0.25;

}  // namespace

At situation_of(const protocol::Plan& plan, std::uint32_t index) {
  const auto& step = plan.steps[index];
  switch (step.kind) {
    case StepKind::kPressurize:
      return index > 0 && plan.steps[index - 1].pressure_psi > step.pressure_psi ? At::kLower : At::kFill;
    case StepKind::kSettle:
      return At::kSettle;
    case StepKind::kRamp:
      return step.velocity_mm_s < kSlow_mm_s ? At::kSlow : At::kFast;
    case StepKind::kWave:
      return step.velocity_mm_s < kSlow_mm_s                ? At::kSlow
             : step.shape == protocol::WaveShape::kTriangle ? At::kTriangle
                                                            : At::kSine;
    default:
      return At::kHold;
  }
}

std::vector<Strike> draw(const protocol::Plan& plan, std::uint64_t seed, int count) {
  std::array<std::vector<std::uint32_t>, daemon::test::kSituations> steps_of;
  for (const auto& step : plan.steps) {
    if (step.kind != StepKind::kMark)
      steps_of[static_cast<unsigned>(situation_of(plan, step.index))].push_back(step.index);
  }
  std::vector<const std::vector<std::uint32_t>*> kinds;
  for (const auto& steps : steps_of) {
    if (!steps.empty()) kinds.push_back(&steps);
  }
  // The engine's numbers are the standard's; its distributions are each library's own, and are not used.
  std::mt19937_64 random(seed);
  const auto below = [&](std::size_t n) { return static_cast<std::size_t>(random() % n); };
  const auto within = [&](double low, double high) {
    return low + (high - low) * static_cast<double>(random() >> 11U) * 0x1p-53;
  };
  const auto faults = daemon::test::faults();
  std::vector<Strike> all;
  for (int i = 0; i < count; ++i) {
    Strike s;
    const auto& steps = *kinds[below(kinds.size())];
    s.step = steps[below(steps.size())];
    s.after_s = within(0.01, std::max(0.02, plan.steps[s.step].nominal_s));
    s.fault = below(faults.size());
    const double share = within(0.0, 1.0);
    const std::size_t other = below(faults.size());
    s.second_after_s = within(0.0, 3.0);
    if (share < kSecondFaultShare && other != s.fault) s.second = other;
    s.watch_s = within(8.0, 30.0);
    s.stay_s = within(6.0, 30.0);
    const std::string_view name = faults[s.fault].name;
    // A zero that runs away is seen by nobody (docs/faults.md): not for longer than the bound of the pressure allows.
    if (name == "SensorDrifts") s.watch_s = 8.0;
    all.push_back(s);
  }
  std::sort(all.begin(), all.end(), [](const Strike& a, const Strike& b) {
    return a.step != b.step ? a.step < b.step : a.after_s < b.after_s;
  });
  return all;
}

}  // namespace isorig::soak
