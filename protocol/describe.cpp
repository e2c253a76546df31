#include <string>

#include "base/formatted.hpp"
#include "base/number_text.hpp"
#include "protocol/plan.hpp"

namespace isorig::protocol {
namespace {

std::string position(double value_mm) {
  return value_mm == 0.0 ? "0 mm" : base::formatted("%+.6g mm", value_mm);
}

/// Where the turning points make more of a difference than anybody would round away.
std::string reached_text(const Step& step) {
  if (step.reached_hz > 0.95 * step.frequency_hz) return {};
  return ", of which the turning points leave about " + base::number_text(step.reached_hz, 3) + " Hz";
}

}  // namespace

const char* name_of(StepKind kind) noexcept {
  switch (kind) {
    case StepKind::kPressurize:
      return "pressurize";
    case StepKind::kSettle:
      return "settle";
    case StepKind::kRamp:
      return "ramp";
    case StepKind::kHold:
      return "hold";
    case StepKind::kWave:
      return "wave";
    case StepKind::kMark:
      return "mark";
  }
  return "?";
}

std::string describe(const Step& step) {
  switch (step.kind) {
    case StepKind::kPressurize:
      return "pressurize to " + base::number_text(step.pressure_psi) + " psi at " + base::number_text(step.rate_psi_s) +
             " psi/s, within " + base::number_text(step.tolerance_psi) + " psi for " +
             base::number_text(step.settled_for_s) + " s";
    case StepKind::kSettle:
      return "settle until the force moves by at most " + base::number_text(step.force_slope_N_s) + " N/s over " +
             base::number_text(step.window_s) + " s, for " + base::number_text(step.settled_for_s) + " s";
    case StepKind::kRamp:
      return "ramp to " + position(step.target_mm) + " at " + base::number_text(step.velocity_mm_s) + " mm/s";
    case StepKind::kHold:
      return "hold for " + base::number_text(step.duration_s) + " s";
    case StepKind::kWave: {
      std::string text = step.shape == WaveShape::kSine ? "sine" : "triangle";
      text += " of +-" + base::number_text(step.amplitude_mm) + " mm at " + base::number_text(step.frequency_hz) +
              " Hz" + reached_text(step) + " (peak " + base::number_text(step.velocity_mm_s) + " mm/s), " +
              std::to_string(step.cycles) + (step.cycles == 1 ? " cycle" : " cycles");
      if (step.shape == WaveShape::kSine) {
        text += ", " + std::to_string(4 * step.segments_per_quarter) + " segments per cycle, within " +
                base::number_text(step.deviation_mm) + " mm";
      }
      return text;
    }
    case StepKind::kMark:
      return "mark \"" + std::string(step.label) + "\"";
  }
  return "?";
}

}  // namespace isorig::protocol
