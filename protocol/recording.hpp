#pragma once
#include <optional>

#include "protocol/plan.hpp"

/// Which part of a plan is recorded at full rate.
namespace isorig::protocol {

/// A step's own word first, then the policy: "round_ramps" keeps ramps and waves.
[[nodiscard]] Keep resolve_keep(RecordingMode mode, StepKind kind, std::optional<Keep> own);

/// Lays before_s and after_s round every ramp and wave that is kept in full: full_after_s on it, full_tail_s
/// on the holds before it. Where the step before has no fixed length (settle, pressurize, a slow ramp), the
/// recorder's memory of the last before_s does the same. Sets Plan::full_rate_s.
void resolve_recording(Plan& plan);

}  // namespace isorig::protocol
