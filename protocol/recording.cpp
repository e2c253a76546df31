#include "protocol/recording.hpp"

#include <algorithm>

namespace isorig::protocol {
namespace {

bool moves(const Step& step) {
  return step.kind == StepKind::kRamp || step.kind == StepKind::kWave;
}

}  // namespace

Keep resolve_keep(RecordingMode mode, StepKind kind, std::optional<Keep> own) {
  if (own) return *own;
  if (mode == RecordingMode::kFull) return Keep::kFull;
  if (mode == RecordingMode::kAveraged) return Keep::kAveraged;
  return kind == StepKind::kRamp || kind == StepKind::kWave ? Keep::kFull : Keep::kAveraged;
}

void resolve_recording(Plan& plan) {
  const auto& policy = plan.recording;
  double full_until_s = 0.0;  // end of what is counted so far
  const auto count = [&](double from_s, double to_s) {
    from_s = std::max(from_s, full_until_s);
    to_s = std::min(to_s, plan.nominal_s);
    if (to_s <= from_s) return;
    plan.full_rate_s += to_s - from_s;
    full_until_s = to_s;
  };
  plan.full_rate_s = 0.0;
  for (Step& step : plan.steps) {
    if (step.keep != Keep::kFull) continue;
    const bool round = moves(step) && policy.mode != RecordingMode::kFull;
    if (round) step.full_after_s = policy.after_s;
    count(step.start_s - (round ? policy.before_s : 0.0),
          step.start_s + step.nominal_s + (round ? policy.after_s : 0.0));
  }
}

}  // namespace isorig::protocol
