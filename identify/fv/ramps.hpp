#pragma once
#include <cstddef>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "identify/fv/segments.hpp"
#include "messages/recording.hpp"

namespace isorig::identify {

/// The motions of a recording, found in its position signal alone, and the points that the iso-velocity ramps
/// among them put on a force-velocity curve (section "Analysis" of the paper that model/force_velocity.hpp
/// cites).
///
/// No marker, no commanded speed and no threshold in mm/s enters: a motion is what the noise of the position
/// does not explain, and what a motion is for is told from the motions round it. Speeds from 0.01 mm/s
/// upwards, dense or sparse sampling. Limits: a stroke below 40 standard deviations of the position noise or
/// 1 % of the recording's range is not seen; a ramp with fewer than 4 samples inside has no velocity and says
/// so.

/// A number with its standard error (NaN: unknown).
struct Estimate {
  double value = 0.0;
  double standard_error = 0.0;
};

enum class MoveKind {
  kIsoVelocity,      ///< one stroke between holds: a point of the curve
  kReturn,           ///< takes the specimen back to where the ramp before began, much slower than it
  kPreconditioning,  ///< as slow as the returns, before the first ramp
  kCycle,            ///< a leg between turning points without a hold: triangles, sines, preconditioning cycles
};
[[nodiscard]] std::string_view name(MoveKind kind) noexcept;

/// What to know before a ramp is used. The first group makes the point unusable, the second qualifies it.
enum class RampFlag {
  kNoRestBefore,       ///< less than 0.5 s at rest before: no F0
  kNoHoldAfter,        ///< the recording ends, so the target is not known
  kTooFewSamples,      ///< fewer than 4 samples inside the ramp: no velocity
  kForceClipped,       ///< the force channel is saturated where F0 or the peak is read
  kGapAtPeak,          ///< no force sample near the moment the target is reached
  kForceNotPositive,   ///< F0 is not told from zero: nothing to normalise by
  kNeverReachedSpeed,  ///< no stretch of constant speed: the velocity is not a test velocity
  kInterrupted,        ///< by a pause: a part of a ramp, or the whole with a rest in it
  kOvershot,           ///< went past its target (see `overshoot_mm`)
  kUnsteadyStart,      ///< the force was still drifting (see `drift_N_s`)
  kWentSlack,          ///< the force at the target is not told from zero: a specimen that cannot push
  kShortRest,          ///< less than the 2 s of rest that F0 asks for
};
[[nodiscard]] std::string_view name(RampFlag flag) noexcept;
/// A sentence for people.
[[nodiscard]] std::string_view text(RampFlag flag) noexcept;

struct Move {
  MoveKind kind = MoveKind::kCycle;
  std::size_t first = 0;  ///< samples [first, last] hold the motion
  std::size_t last = 0;
  double t_start_s = 0.0;  ///< corners of the piecewise-linear fit
  double t_end_s = 0.0;
  double from_mm = 0.0;
  double to_mm = 0.0;
  Estimate velocity_mm_s;
  [[nodiscard]] double stroke_mm() const noexcept { return to_mm - from_mm; }
};

/// One iso-velocity ramp as a point of the curve. What cannot be given is empty, and a flag says why.
struct Ramp {
  Move move;
  std::vector<RampFlag> flags;
  double overshoot_mm = 0.0;              ///< past the target, in the direction of motion
  double plateau_share = 0.0;             ///< of the ramp's duration, at constant speed (NaN: too few samples)
  std::optional<Estimate> start_force_N;  ///< F0: mean force of the 2 s before
  std::optional<Estimate> drift_N_s;      ///< slope of the force in those 2 s
  std::optional<double> t_peak_s;         ///< when the position first reached its target
  std::optional<Estimate> peak_force_N;   ///< force at that moment
  std::optional<Estimate> strain_rate_per_s;
  std::optional<Estimate> normalized_force;
  /// Given where the force at rest wanders from ramp to ramp: `normalized_force` if that is all the zero's.
  std::optional<double> normalized_force_if_zero_drifts;
  std::optional<double> initial_strain;  ///< eps0
  std::optional<double> strain_step;     ///< signed
  std::optional<double> pressure_before_psi;
  std::optional<double> pressure_change_psi;  ///< at the peak, against the 2 s before
  [[nodiscard]] bool has(RampFlag flag) const noexcept;
  /// Has everything that a fit needs, and reached its speed.
  [[nodiscard]] bool usable() const noexcept;
};

struct RampAnalysis {
  SignalNoise position_noise_mm;
  SignalNoise force_noise_N;
  std::vector<Move> moves;              ///< everything that moved, in order
  std::vector<Ramp> ramps;              ///< the iso-velocity ones
  std::vector<std::string> statements;  ///< what this recording cannot give, in sentences
  std::size_t clipped_samples = 0;
};

struct RampOptions {
  double rest_window_s = 2.0;  ///< for F0, as the paper has it
  double shortest_hold_s = 0.5;
};

/// The motions alone (positions in mm).
[[nodiscard]] std::vector<Move> find_moves(std::span<const double> t_s, std::span<const double> position_mm,
                                           const RampOptions& options = {});

/// Motions, then forces. Never throws on content: what is not there is said in `statements` and flags.
[[nodiscard]] RampAnalysis analyse_ramps(const messages::Recording& recording, const RampOptions& options = {});

}  // namespace isorig::identify
