#pragma once
#include <cstdint>

#include "protocol/force_slope.hpp"
#include "protocol/plan.hpp"

/// Progress through a plan: a pure state machine that the real-time loop calls on every tick. It has no
/// clock, does no I/O, never allocates, never throws; the same calls give the same actions.
///
///   Cursor cursor(plan);
///   cursor.start(now_ns, first_session, last_segment_id_sent + 1);
///   every tick: const Action& action = cursor.advance(now_ns, observation);
///               if (action.start_segment) send action.segment to the frame
///               pressure loop: follow action.setpoint_psi at action.rate_psi_s
///
/// It decides what the next set-point is and when a step is done. What is safe is the supervisor's business,
/// and so is venting at the end: after kFinished or kFailed the cursor asks for nothing any more.
namespace isorig::protocol {

/// What the loop knows at a tick: latest values, calibrated.
struct Observation {
  double position_mm = 0.0;
  double force_N = 0.0;
  double pressure_psi = 0.0;     ///< as the pressure loop sees it (filtered): a noisy sample ends "settled"
  bool new_force = false;        ///< force_N was sampled since the last tick (of several: their mean)
  bool segment_reached = false;  ///< the frame says it reached the target ...
  std::uint16_t segment_id = 0;  ///< ... of this segment; any other than the last one sent is ignored
};

enum class CursorState : std::uint8_t { kIdle, kRunning, kPaused, kFinished, kFailed };

enum class Failure : std::uint8_t {
  kNone,
  kPressurizeTimeout,  ///< value: pressure (psi), threshold: set-point
  kSettleTimeout,      ///< only with on_timeout = "stop". value: |slope| (N/s), threshold: its bound
  kMotionTimeout,      ///< the frame did not reach a target. value: position (mm), threshold: target
};
[[nodiscard]] const char* describe(Failure failure) noexcept;

struct MotionCommand {
  std::uint16_t id = 0;        ///< never 0; counts up, so that an old "reached" is never taken for a new one
  double target_mm = 0.0;      ///< calibrated; the daemon takes its zero off
  double velocity_mm_s = 0.0;  ///< magnitude
};

/// What to do now. State lasts; the flags marked "once" are true in one call only.
struct Action {
  CursorState state = CursorState::kIdle;
  Keep keep = Keep::kAveraged;    ///< for the samples of this tick
  bool approaching = false;       ///< vented, on the way to the position where `step` begins
  bool regaining = false;         ///< resumed, and the pressure is not yet back at the set-point: `step` waits
  bool start_segment = false;     ///< once: send `segment` to the frame
  bool step_began = false;        ///< once: `step` has begun (at most one step begins per call)
  bool step_ended = false;        ///< once: `ended_step` is over
  bool settle_timed_out = false;  ///< once, with step_ended: it went on, force still moving at end_value (N/s)
  bool session_ended = false;     ///< once, with step_ended: it was its session's last
  std::uint32_t step = 0;         ///< index into Plan::steps; a mark's label is there
  std::uint32_t ended_step = 0;
  double end_value = 0.0;     ///< of a settle: |slope| when it ended, N/s; of a wave: cycles per second; else 0
  double setpoint_psi = 0.0;  ///< gauge
  double rate_psi_s = 0.0;    ///< slope to take the set-point there, > 0 from the first pressurize on
  MotionCommand segment;      ///< the last one sent
  Failure failure = Failure::kNone;
  double failure_value = 0.0;      ///< what was measured ...
  double failure_threshold = 0.0;  ///< ... and what it was compared with
};

struct Progress {
  double fraction = 0.0;     ///< of the plan's nominal time, 0..1
  double remaining_s = 0.0;  ///< nominal time left; a pause does not count
  double step_elapsed_s = 0.0;
  double step_nominal_s = 0.0;
};

class Cursor {
 public:
  /// A motion has failed when it takes longer than nominal by this share plus this time. Measured frames need
  /// less than 0.1 s more (they lag by 10 ms); a frame that is told a speed and runs 5 % slow is out of
  /// order.
  static constexpr double kMotionSlackShare = 0.05;
  static constexpr double kMotionSlack_s = 5.0;
  /// An approach shorter than this is not commanded: it is below what frames resolve and repeat.
  static constexpr double kAtPosition_mm = 0.005;

  /// The plan has to outlive the cursor and must not change.
  explicit Cursor(const Plan& plan) noexcept : plan_(&plan) {}

  /// Begins with session `first_session` (0: with the plan's first step, also when it stands before any
  /// session). The actuator is expected vented; the cursor moves it to the first step's position
  /// (`approaching`), then begins. `next_segment_id` continues the caller's numbering (0 is taken as 1).
  void start(std::int64_t now_ns, std::uint32_t first_session = 0, std::uint16_t next_segment_id = 1) noexcept;

  /// One tick. Times must not decrease. About 3 ns in a hold. The reference stays valid until the next call
  /// of any member.
  const Action& advance(std::int64_t now_ns, const Observation& seen) noexcept;

  /// From now on time stands still for the plan: holds and time-outs freeze. The caller stops the frame.
  /// No effect unless running.
  void pause(std::int64_t now_ns) noexcept;
  /// Goes on once the pressure is back within the last pressurize's tolerance (after a pause that sealed the valves it
  /// is not), else fails at its time-out. Then the next advance() commands an interrupted motion again, from wherever
  /// the frame stopped; settle and pressurize judge afresh. No effect unless paused.
  void resume(std::int64_t now_ns) noexcept;

  [[nodiscard]] const Action& action() const noexcept { return action_; }
  /// Cheap, but not for every tick.
  [[nodiscard]] Progress progress(std::int64_t now_ns) const noexcept;
  /// kNoSession outside of sessions.
  [[nodiscard]] std::uint32_t session() const noexcept { return plan_->steps[action_.step].session; }

 private:
  void begin_step(std::int64_t now_ns, const Observation& seen, std::uint32_t index) noexcept;
  void end_step(std::int64_t now_ns, const Observation& seen) noexcept;
  void begin_motion(std::int64_t now_ns, const Observation& seen, double target_mm, double velocity_mm_s) noexcept;
  void begin_stroke(std::int64_t now_ns) noexcept;
  void send_segment(double target_mm, double velocity_mm_s) noexcept;
  void fail(Failure failure, double value, double threshold) noexcept;
  void decide_keep(std::int64_t now_ns) noexcept;
  void tick_approach(std::int64_t now_ns, const Observation& seen) noexcept;
  /// Of a resumed run: the pressure is back, and the plan goes on.
  bool has_regained(std::int64_t now_ns, const Observation& seen) noexcept;
  /// The plan's time goes on from where the pause stopped it.
  void go_on(std::int64_t now_ns) noexcept;
  void tick_pressurize(std::int64_t now_ns, const Observation& seen) noexcept;
  void tick_settle(std::int64_t now_ns, const Observation& seen) noexcept;
  void tick_ramp(std::int64_t now_ns, const Observation& seen) noexcept;
  void tick_wave(std::int64_t now_ns, const Observation& seen) noexcept;
  [[nodiscard]] bool reached(const Observation& seen) const noexcept {
    return seen.segment_reached && seen.segment_id == action_.segment.id;
  }

  static constexpr std::int64_t kNever = INT64_MAX;
  static constexpr std::uint32_t kNoStep = 0xffffffffU;

  const Plan* plan_;
  Action action_;
  bool has_flags_ = false;               ///< some "once" flag is set
  bool begin_pending_ = false;           ///< start() was called, the first advance() begins
  bool reissue_pending_ = false;         ///< resume() was called during a motion
  std::int64_t quiet_until_ns_ = 0;      ///< before this nothing can happen: the fast path of a hold
  std::int64_t step_begin_ns_ = 0;       ///< shifted by pauses, as are all below
  std::int64_t step_end_ns_ = 0;         ///< of a hold
  std::int64_t deadline_ns_ = 0;         ///< time-out of what is under way
  std::int64_t good_since_ns_ = kNever;  ///< pressure or slope is within its bound since
  std::int64_t full_until_ns_ = 0;       ///< the tail after a ramp; wall time, not shifted
  std::int64_t stroke_begin_ns_ = 0;
  std::int64_t next_chord_ns_ = kNever;
  std::int64_t pause_ns_ = 0;
  std::uint32_t pressurize_ = kNoStep;  ///< the last one that began
  std::int64_t regain_deadline_ns_ = 0;
  bool has_strayed_ = false;  ///< the pressure was off its set-point when the run was resumed
  std::uint32_t stroke_ = 0, chord_ = 0;
  std::uint16_t next_id_ = 1;
  ForceSlope slope_;
};

}  // namespace isorig::protocol
