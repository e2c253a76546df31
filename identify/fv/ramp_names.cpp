#include "identify/fv/ramps.hpp"

namespace isorig::identify {

std::string_view name(MoveKind kind) noexcept {
  switch (kind) {
    case MoveKind::kIsoVelocity:
      return "iso_velocity";
    case MoveKind::kReturn:
      return "return";
    case MoveKind::kPreconditioning:
      return "preconditioning";
    case MoveKind::kCycle:
      return "cycle";
  }
  return "";
}

std::string_view name(RampFlag flag) noexcept {
  switch (flag) {
    case RampFlag::kNoRestBefore:
      return "no_rest_before";
    case RampFlag::kNoHoldAfter:
      return "no_hold_after";
    case RampFlag::kTooFewSamples:
      return "too_few_samples";
    case RampFlag::kForceClipped:
      return "force_clipped";
    case RampFlag::kGapAtPeak:
      return "gap_at_peak";
    case RampFlag::kForceNotPositive:
      return "force_not_positive";
    case RampFlag::kNeverReachedSpeed:
      return "never_reached_speed";
    case RampFlag::kInterrupted:
      return "interrupted";
    case RampFlag::kOvershot:
      return "overshot";
    case RampFlag::kUnsteadyStart:
      return "unsteady_start";
    case RampFlag::kWentSlack:
      return "went_slack";
    case RampFlag::kShortRest:
      return "short_rest";
  }
  return "";
}

std::string_view text(RampFlag flag) noexcept {
  switch (flag) {
    case RampFlag::kNoRestBefore:
      return "no rest before the ramp, so there is no starting force";
    case RampFlag::kNoHoldAfter:
      return "no hold after the ramp, so its target and peak force are not known";
    case RampFlag::kTooFewSamples:
      return "fewer than 4 samples inside the ramp, so it has no velocity";
    case RampFlag::kForceClipped:
      return "the force channel is saturated";
    case RampFlag::kGapAtPeak:
      return "no sample near the moment the target was reached";
    case RampFlag::kForceNotPositive:
      return "the starting force is not told from zero, so nothing can be normalised by it";
    case RampFlag::kNeverReachedSpeed:
      return "never reached a constant speed";
    case RampFlag::kInterrupted:
      return "was interrupted by a pause";
    case RampFlag::kOvershot:
      return "went past its target";
    case RampFlag::kUnsteadyStart:
      return "the force was still drifting when the ramp began";
    case RampFlag::kWentSlack:
      return "the specimen went slack: its force at the target is not told from zero";
    case RampFlag::kShortRest:
      return "less than 2 s of rest before the ramp";
  }
  return "";
}

}  // namespace isorig::identify
