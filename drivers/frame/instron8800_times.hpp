#pragma once
#include "drivers/config/instron8800_config.hpp"

/// What a line of an 8800 takes, reckoned from its configuration: questions one after the other, `gap_us` before each,
/// their characters at the line's speed, and `answer_s` of the controller. docs/wire-8800.md has the sum.
namespace isorig::frame {

/// A crosshead of the emulated frame stands so long after it was told to, at 1 mm/s; no real one was measured.
inline constexpr double kStandsAfter_s = 0.15;

struct Instron8800Times {
  double value_s = 0.0;  ///< a force or a position, from the gap before its question to its answer
  /// Between two samples: force, position, a question about the controller, check.
  double round_s = 0.0;
  bool gives_samples = true;  ///< positions further apart than kFarApart_ns are not interpolated between
  /// From C1,0 until the driver has seen it stand, while nothing disturbs the line. Where response_timeout_ms is over
  /// before, the questions begin afresh for ever, and no stop is confirmed.
  double confirms_s = 0.0;
  /// From the request of a stop in mid-ramp until then: what a poll that is under way takes comes before it.
  double confirms_after_request_s = 0.0;
  /// ... and from then to the first sample that says how the crosshead stands.
  double first_sample_s = 0.0;
};

/// At most, with `answer_s` in place of the configuration's `answer_ms`.
[[nodiscard]] Instron8800Times times_of(const Instron8800Config& config, double answer_s) noexcept;

}  // namespace isorig::frame
