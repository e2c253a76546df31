#pragma once
#include <array>
#include <cstdint>

#include "daemon/core/force_watch.hpp"
#include "daemon/core/links.hpp"
#include "daemon/core/records.hpp"
#include "daemon/core/stream_age.hpp"
#include "daemon/core/trips.hpp"
#include "drivers/api/frame.hpp"
#include "drivers/api/interlock.hpp"
#include "drivers/api/pressure.hpp"
#include "protocol/limits.hpp"

namespace isorig::base {
class TomlTable;
}

namespace isorig::daemon {

inline constexpr double kLongestStopConfirm_s = 2.0;  ///< stop_confirm_max_s is no longer

/// What may not happen while the rig is live, beyond the travel, force and pressure limits of [limits].
struct SupervisorConfig {
  protocol::Limits limits;
  double frame_age_max_s = 0.25;     ///< no frame sample for longer: safe state
  double pressure_age_max_s = 0.25;  ///< no valid pressure reading for longer: safe state
  double regulator_age_max_s = 0.0;  ///< no word from the pressure regulator for longer: safe state; 0: there is none
  double regulator_error_max_psi = 1.0;  ///< its own sensor against the ELVH for longer than a second: safe state
  double interlock_age_max_s = 0.5;      ///< no interlock reading for longer: safe state
  double late_tick_max_s = 0.25;         ///< a tick later than this: program stop
  double following_error_max_mm = 1.0;   ///< position against the commanded segment, plus 50 ms of its speed, at most
  double following_error_min_mm = 0.2;   ///< ... and at low speed this plus 0.25 s of it; half of either is a warning
  double stop_confirm_max_s = 0.3;       ///< a stop that has not ended in standstill within this: safe state
  double standstill_max_mm = 0.05;       ///< a stopped crosshead that leaves its place by more: safe state
  double segment_ack_max_s = 0.5;        ///< a segment the frame does not echo within this: program stop
  double force_rate_window_s = 0.02;     ///< the force rate is the difference over this window
  double frozen_force_max_s = 1.0;       ///< the very same raw force for longer: program stop
  double break_drop_N = 5.0;  ///< half of the force and this much gone within the window: safe state; 0: not judged
  bool guard_open_in_setup = false;  ///< [operator] jog_with_guard_open
  double held_max_s = 3600.0;        ///< a run that is paused or held by a fault for longer is vented; 0: never

  /// Reads [supervisor]; `limits` come from [limits].
  static SupervisorConfig read(const base::TomlTable& table, const protocol::Limits& limits);
};

/// Watches the streams. Pure: it is told what arrived and when, and answers with what is wrong; it moves nothing
/// itself. What a cause calls for depends on the phase (daemon/core/trips.hpp). noexcept, no allocation.
class Supervisor {
 public:
  explicit Supervisor(const SupervisorConfig& config) noexcept;

  /// What the rig is doing: before anything else of a tick. `held`: a run is open.
  void set_state(RunState state, bool run_open) noexcept;
  /// Something that another part of the loop found.
  void report(const char* code, const char* what, double value, double threshold) noexcept {
    note(code, what, value, threshold);
  }

  void on_frame_sample(const FrameRecord& sample) noexcept;
  void on_frame_report(const FrameReport& report) noexcept;
  /// `valid`: the word decoded to a plausible current reading.
  void on_pressure_sample(std::int64_t mono_ns, double pressure_psi, bool valid) noexcept;
  /// The sensor sends fresh conversions, and has sent one and the same count for longer than noise can explain.
  void on_pressure_stuck() noexcept;
  /// A regulator's word, and what the ELVH says at that time.
  void on_regulator(std::int64_t mono_ns, double pressure_psi, double elvh_psi, bool faulty) noexcept;
  /// Whether the pressure device has vented by itself and holds it so, and why.
  void on_device_vented(bool is_vented, pressure::VentCause cause) noexcept;
  void on_interlock(const interlock::State& state) noexcept;
  /// Another calibration is in force: what was read before does not compare.
  void on_calibration() noexcept { force_watch_.restart(); }
  /// A tick that came too late: the time the loop was away is no silence of a stream, nor of a stop that is waited for.
  void on_tick_lateness(std::int64_t now_ns, std::int64_t late_ns) noexcept;
  /// The segment that was commanded, for the check that the frame does it.
  /// `number`: FrameCommand::number.
  void on_segment(const frame::Segment& segment, std::uint32_t number, double from_mm, std::int64_t mono_ns) noexcept;
  /// The frame was told to stop; `request` is FrameLink::stops_requested from now on.
  void on_stop(std::int64_t mono_ns, std::uint32_t request) noexcept;
  /// No stop is waiting to be confirmed (but a fresh one of what stood already), and the crosshead stands as far as its
  /// report and its samples show.
  [[nodiscard]] bool stands() const noexcept { return (!stop_pending_ || stop_renewed_) && frame_stands_; }

  /// Age of the newest sample of each, in s; negative before the first.
  [[nodiscard]] double frame_age_s(std::int64_t now_ns) const noexcept;
  [[nodiscard]] double pressure_age_s(std::int64_t now_ns) const noexcept;

  /// Why a motion is not let through, for people; which limit keeps it, what is measured, and the limit itself, in mm
  /// or N.
  struct Binding {
    const char* why = nullptr;
    const char* code = nullptr;
    double value = 0.0, threshold = 0.0;
  };
  /// Of a motion from where the crosshead is to `target_mm` (calibrated): beyond a limit, and inside it until it is
  /// clear (Bounds::is_clear), only what leads away from it is let through. Nothing: it is.
  [[nodiscard]] std::optional<Binding> binding(double target_mm) const noexcept;

  /// What was found since the last call, and what is stale now. Valid until the next call of any member.
  [[nodiscard]] const TripList& check(std::int64_t now_ns) noexcept;

  /// Every stream fresh, the chain closed, the frame without fault. `why` says what is missing, in plain words.
  [[nodiscard]] bool healthy(std::int64_t now_ns, const char** why, bool guard_may_be_open = false) const noexcept;
  /// The crosshead or the force is beyond a limit now: it may be moved back only.
  [[nodiscard]] bool is_beyond_limit() const noexcept { return travel_.beyond != 0 || force_.beyond != 0; }

  /// Forgets what was seen (after a reset): ages start again at `now_ns`. A limit that is passed still lets the
  /// crosshead move away from it, and trips again when it is passed further.
  void rearm(std::int64_t now_ns) noexcept;

 private:
  /// A limit that has tripped: beyond it (+1 above, -1 below), and how far that was known to be.
  struct Passed {
    int beyond = 0;
    double worst = 0.0;
  };

  void note(const char* code, const char* what, double value, double threshold) noexcept;
  void watch_standstill(const FrameReport& report) noexcept;
  /// What a limit is watched with.
  struct Bounds {
    double least, most;
    double tolerance;  ///< it trips that far beyond
    double margin;     ///< ... again when it is passed that much further
    /// Inside, and far enough for noise not to arm it anew.
    [[nodiscard]] bool is_clear(double value, int beyond) const noexcept;
  };
  [[nodiscard]] Bounds travel_bounds() const noexcept;
  [[nodiscard]] Bounds force_bounds() const noexcept;
  void watch_limit(Passed& passed, const char* code, const char* what, double value, const Bounds& bounds) noexcept;
  /// A limit that was passed stays so until the value is clear of it.
  static void rearm_limit(Passed& passed, double value, const Bounds& bounds) noexcept;
  void watch_force(const FrameRecord& sample) noexcept;
  void watch_following(const FrameRecord& sample) noexcept;
  void watch_arrival(const FrameRecord& sample) noexcept;
  void watch_frame_faults(const frame::State& state) noexcept;

  SupervisorConfig config_;
  RunState state_ = RunState::kIdle;
  bool run_open_ = false;
  Phase phase_ = Phase::kBetween;
  TripList found_, trips_;
  Passed travel_, force_;
  [[nodiscard]] std::array<StreamAge*, 4> streams() noexcept {
    return {&frame_age_, &pressure_age_, &interlock_age_, &regulator_age_};
  }
  StreamAge frame_age_, pressure_age_, interlock_age_, regulator_age_;
  Absence absence_;  ///< the last tick that was late
  std::int64_t disagree_since_ns_ = -1;
  interlock::State interlock_;
  frame::State frame_state_;
  bool frame_state_known_ = false;

  ForceWatch force_watch_;
  double last_position_mm_ = 0.0, last_force_N_ = 0.0, last_raw_position_mm_ = 0.0;
  std::int64_t number_missing_ns_ = -1;  ///< a sample that was no number came last
  std::uint32_t reference_epoch_ = 0;
  bool device_vented_ = false;

  bool stop_pending_ = false;  ///< requested, and not yet seen to stand
  bool stop_renewed_ = false;  ///< ... of a crosshead that stood, told nothing since: for a moment it is believed to
  bool told_to_move_ = false;  ///< since the last stop
  std::uint32_t stop_request_ = 0;  ///< the first since then: it, or a later one, has to be confirmed
  std::int64_t stop_since_ns_ = 0;
  bool at_rest_ = false;  ///< stopped and told nothing since: it has to stay at rest_mm_
  double rest_mm_ = 0.0;
  bool must_rest_ = false;
  bool frame_stands_ = false;

  bool segment_active_ = false;
  bool segment_acknowledged_ = false;
  bool segment_moving_ = false;   ///< the frame says so
  bool lag_warned_ = false;       ///< once a segment
  bool segment_arrived_ = false;  ///< the frame has said so
  std::int64_t arrived_ns_ = -1;  ///< when it said so of arrived_; no sample from after that yet
  frame::Segment arrived_;
  frame::Segment segment_;
  std::uint32_t segment_number_ = 0;
  std::uint32_t reconnects_ = 0;          ///< FrameReport's of the newest report
  std::uint32_t segment_reconnects_ = 0;  ///< ... and of the newest when the segment was commanded
  double segment_from_mm_ = 0.0;
  std::int64_t segment_start_ns_ = 0;
};

}  // namespace isorig::daemon
