#pragma once
#include <cstdint>
#include <string>
#include <type_traits>
#include <vector>

/// A compiled protocol: a flat list of steps, every number resolved. The real-time loop walks it
/// (cursor.hpp), `isorig plan` prints it, the recorder stores it: the estimate and the run come from the same
/// data.
///
/// Positions: crosshead relative to the unpressurized rest length, extension positive. Pressure: gauge.
namespace isorig::protocol {

enum class StepKind : std::uint8_t { kPressurize, kSettle, kRamp, kHold, kWave, kMark };

/// How the recorder keeps the samples of a step. LCM and the supervisor get every sample regardless.
enum class Keep : std::uint8_t {
  kFull,      ///< every sample
  kAveraged,  ///< mean, minimum and maximum over RecordingPolicy::average_interval_s; the last `before_s`
              ///< stay in memory and are written in full when the next full-rate step begins (a ramp's
              ///< run-up)
};

enum class OnTimeout : std::uint8_t { kContinue, kStop };
enum class WaveShape : std::uint8_t { kTriangle, kSine };

/// `session` of a step that belongs to none.
inline constexpr std::uint32_t kNoSession = 0xffffffffU;

/// Trivially copyable; fields that a kind does not name are zero.
struct Step {
  std::uint32_t index = 0;
  std::uint32_t session = kNoSession;  ///< index into Plan::sessions
  std::int32_t repetition = 0;         ///< of its session, from 1; 0 outside sessions
  StepKind kind = StepKind::kMark;
  Keep keep = Keep::kAveraged;  ///< of the step's own time; what lies round a ramp: RecordingPolicy
  OnTimeout on_timeout = OnTimeout::kStop;
  WaveShape shape = WaveShape::kTriangle;

  // Every kind.
  double start_s = 0.0;    ///< expected start, from the plan's start
  double nominal_s = 0.0;  ///< expected duration
  double worst_s = 0.0;    ///< duration when the step ends by its time-out
  double position_before_mm = 0.0;
  double position_after_mm = 0.0;
  double pressure_psi = 0.0;  ///< the set-point in force during the step (of a pressurize: the new one)
  double full_after_s = 0.0;  ///< after a ramp or wave kept in full: so long the next steps are, too

  // pressurize: done when |pressure - pressure_psi| <= tolerance_psi for settled_for_s.
  double tolerance_psi = 0.0;
  double rate_psi_s = 0.0;  ///< slope of the set-point, > 0
  // settle: done when |slope of force over window_s| <= force_slope_N_s for settled_for_s.
  double force_slope_N_s = 0.0;
  double window_s = 0.0;
  // pressurize and settle
  double settled_for_s = 0.0;
  double timeout_s = 0.0;
  // ramp; of a wave: its centre and its peak speed
  double target_mm = 0.0;
  double velocity_mm_s = 0.0;  ///< magnitude, > 0
  // hold
  double duration_s = 0.0;
  // wave: `cycles` periods about position_before_mm, extension first, ending where it began. A frame takes
  // only (target, velocity) segments: a triangle is exact; a sine runs as 4 * segments_per_quarter chords per
  // cycle, equal in time, and leaves the true sine by at most deviation_mm (wave.hpp).
  double amplitude_mm = 0.0;  ///< half of peak to peak, > 0
  double frequency_hz = 0.0;
  double deviation_mm = 0.0;
  double reached_hz = 0.0;  ///< what the rig's turning points are expected to leave of frequency_hz
  std::uint32_t cycles = 0;
  std::uint32_t segments_per_quarter = 0;

  std::uint32_t line = 0;  ///< of the step in the protocol's file
  std::uint32_t column = 0;
  char label[48] = {};  ///< of a mark, NUL-terminated
};
static_assert(std::is_trivially_copyable_v<Step>);

/// One repetition at one pressure: the unit of resume and of export. Steps first_step..last_step, inclusive.
/// A session always begins with its own pressurize (before any motion), at sessions[i].position_mm: whoever
/// resumes there moves the vented actuator to that position first (Cursor does) and needs nothing else.
struct Session {
  std::uint32_t first_step = 0;
  std::uint32_t last_step = 0;
  std::int32_t repetition = 0;
  double pressure_psi = 0.0;
  double position_mm = 0.0;  ///< where its first step expects the crosshead
  std::string label;         ///< "repetition 3, 15 psi"; unique within the plan
};

enum class RecordingMode : std::uint8_t { kRoundRamps, kFull, kAveraged };

struct RecordingPolicy {
  RecordingMode mode = RecordingMode::kRoundRamps;
  /// Kept in full before a ramp (the paper's F0 is the mean of the last 2 s). The plan does not mark it: the
  /// recorder holds the last before_s of averaged stretches in memory, which also serves where the end of the
  /// step before is not known in advance (settle).
  double before_s = 3.0;
  double after_s = 5.0;             ///< kept in full after a ramp; Cursor marks it
  double average_interval_s = 0.1;  ///< elsewhere
};

/// [twin]: the model that isorig-web steps beside the run (docs/web.md), and what it does where the two part. The
/// daemon itself has no model.
struct TwinWish {
  enum class OnParting : std::uint8_t { kMark, kPause, kAbort };
  std::string model;  ///< file in isorig-web's folder of models; empty: none is asked for
  OnParting on_parting = OnParting::kMark;
};
[[nodiscard]] constexpr const char* name_of(TwinWish::OnParting what) noexcept {
  return what == TwinWish::OnParting::kPause ? "pause" : what == TwinWish::OnParting::kAbort ? "abort" : "mark";
}

struct Plan {
  std::string name;
  std::string description;
  std::string source;  ///< file name, for messages
  RecordingPolicy recording;
  TwinWish twin;
  bool approaches = true;               ///< false: no step moves, and the crosshead is left where it is
  double approach_velocity_mm_s = 0.0;  ///< from wherever the crosshead is to the first step's position
  std::vector<Step> steps;              ///< never empty
  std::vector<Session> sessions;        ///< never empty: a protocol that names none is one session

  // Totals.
  double nominal_s = 0.0;
  double worst_s = 0.0;      ///< every pressurize and settle runs into its time-out
  double full_rate_s = 0.0;  ///< how much of nominal_s is recorded at full rate
  double travel_mm = 0.0;
  double peak_speed_mm_s = 0.0;
  double position_min_mm = 0.0;
  double position_max_mm = 0.0;
  double pressure_max_psi = 0.0;

  /// What is no error, and not what a reader of the protocol expects; each with its place.
  std::vector<std::string> warnings;
};

/// "ramp to +2 mm at 10 mm/s": a step in words, for plans, events and screens.
[[nodiscard]] std::string describe(const Step& step);
[[nodiscard]] const char* name_of(StepKind kind) noexcept;

}  // namespace isorig::protocol
