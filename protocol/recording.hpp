#pragma once
#include <optional>

#include "protocol/plan.hpp"

/// Which part of a plan is recorded at full rate.
namespace isorig::protocol {

/// A step's own word first, then the policy: "round_ramps" keeps ramps and waves.
[[nodiscard]] Keep resolve_keep(RecordingMode mode, StepKind kind, std::optional<Keep> own);

/// Sets full_after_s on every ramp and wave that is kept in full, and Plan::full_rate_s.
void resolve_recording(Plan& plan);

}  // namespace isorig::protocol
