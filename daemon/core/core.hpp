#pragma once
#include <array>
#include <atomic>
#include <cstdint>
#include <optional>
#include <string_view>

#include "base/seqlock.hpp"
#include "base/spsc_queue.hpp"
#include "daemon/core/fixed_text.hpp"
#include "daemon/core/links.hpp"
#include "daemon/core/live_window.hpp"
#include "daemon/core/operator_config.hpp"
#include "daemon/core/pressure_guard.hpp"
#include "daemon/core/pressure_loop.hpp"
#include "daemon/core/status.hpp"
#include "daemon/core/streams.hpp"
#include "daemon/core/supervisor.hpp"
#include "messages/elvh.hpp"
#include "protocol/cursor.hpp"

/// The real-time core: one tick() per millisecond makes all decisions. The loop thread calls it in real time,
/// the virtual runner in virtual time; it cannot tell which. docs/threads.md has the contract of every thread.
namespace isorig::daemon {

/// calibrated = raw * scale + offset, for each channel; recorded beside the raw values.
struct Calibration {
  double position_scale = 1.0, position_offset_mm = 0.0;
  double force_scale = 1.0, force_offset_N = 0.0;
  double pressure_scale = 1.0, pressure_offset_psi = 0.0;
};

/// Whether a restart of the frame loses its zero.
enum class FrameZero : std::uint8_t {
  kConfirm,     ///< it may be lost whenever the frame, or the daemon, was started: an operator confirms it
  kFirstHolds,  ///< likewise, but the first connection is known to be right: a simulated rig
  kAbsolute,    ///< never lost: an absolute encoder
};

struct CoreConfig {
  SupervisorConfig supervisor;
  PressureLoopConfig pressure_loop;
  Calibration calibration;
  OperatorConfig operating;
  std::int64_t control_period_ns = 10'000'000;  ///< of ControlRecord
  double pressure_filter_s = 0.02;              ///< of the reading by which "settled" is judged
  double vented_psi = 0.5;                      ///< below this a stopping rig counts as vented
  FrameZero frame_zero = FrameZero::kFirstHolds;
  double vent_time_max_s = 20.0;     ///< stopping takes no longer, vented or not
  double recorder_age_max_s = 10.0;  ///< a recorder that has not come round for longer: program stop
  /// A queue of the recorder that is fuller: program stop, while there is room for what the stop itself measures. At 1
  /// kHz half of it is 33 s, so that a sync of some seconds on a busy disk stops nothing; at 10 kHz, 3.3 s.
  static constexpr double kRecorderQueueMax = 0.5;
};

/// A verb from the operator. The plan has to live until its run has ended.
struct Request {
  enum class Verb : std::uint8_t {
    kStart,
    kPause,
    kResume,
    kAbort,
    kReset,
    kSeal,
    kCalibrate,
    kConfirmZero,
    kArm,
    kGo,
    kSetup,
    kLeaveSetup,
    kJog,
    kGiveUp  ///< of the virtual runner: a fault holds the run, and nobody is there to clear it
  } verb = Verb::kAbort;
  std::uint32_t id = 0;
  const protocol::Plan* plan = nullptr;
  std::uint32_t first_session = 0;
  Calibration calibration;           ///< of kCalibrate
  pressure::FillLimits fill_limits;  ///< of kCalibrate: by that calibration
  double target_mm = 0.0;            ///< of kJog: calibrated, or by how much when `relative`
  bool relative = false;
  double velocity_mm_s = 0.0;  ///< of kJog; 0: as fast as a jog may be
  char by[kByBytes] = {};      ///< who asks, for the events: "ann (uid 1000)"; empty: not known
};

/// What such a request asks for is done however late the loop comes to it.
[[nodiscard]] constexpr bool merely_stops(Request::Verb verb) noexcept {
  using Verb = Request::Verb;
  return verb == Verb::kAbort || verb == Verb::kPause || verb == Verb::kSeal || verb == Verb::kLeaveSetup ||
         verb == Verb::kGiveUp;
}

/// What the host has to say in the events, and so in the recording.
struct HostNote {
  Severity severity = Severity::kInfo;
  char code[32] = {};
  char text[160] = {};
};

struct Reply {
  std::uint32_t id = 0;
  bool accepted = false;
  char text[160] = {};
};

class Core {
  /// What was said of a link already.
  struct LinkSeen {
    std::uint32_t lost = 0, corrupt = 0, errors = 0, reconnects = 0;
    std::int64_t error_said_ns = -1;
  };

 public:
  /// So long after the end of a run the recorder still gets what comes. A disk that hangs then fills no queue with what
  /// belongs to no run.
  static constexpr std::int64_t kRecordedAfterNs = 7'000'000'000;

  Core(const CoreConfig& config, FrameLink& frame, PressureLink& pressure, InterlockLink& interlock, Streams& recorder,
       Streams* publisher) noexcept;

  /// One millisecond. `late_ns` is how long after its deadline the loop woke up, `last_run_ns` how long the
  /// previous tick took. No allocation, lock, log or blocking call: tests/daemon/allocation_test.cpp proves it.
  void tick(std::int64_t now_ns, std::int64_t late_ns, std::int64_t last_run_ns) noexcept;
  /// Ticks that were skipped because the loop came back late; counted, never made up for.
  void note_missed_ticks(std::uint64_t count) noexcept { overruns_ += count; }
  /// Ends the run and vents, with the next tick and after the requests queued before it. Waits for nothing: any
  /// thread, at any time.
  void request_abort() noexcept { abort_wanted_.store(true, std::memory_order_release); }
  /// Whoever sent this request was told that it has no answer: what it would begin does not begin any more. What stops
  /// is carried out however late. Any thread.
  void withdraw(std::uint32_t request) noexcept;
  /// From the recorder: why it cannot keep what it is given (full disk, write error): program stop; reset is refused
  /// until it can again, which an empty text says. One thread at a time.
  void set_recorder_fault(std::string_view why) noexcept {
    RecorderFault fault;
    copy_text(fault.text, why);
    if (!why.empty()) recorder_faults_.push(fault);
    recorder_fault_.store(!why.empty(), std::memory_order_release);
  }
  /// From the recorder, between runs: why a run could not be recorded, empty when it could; the rig is not ready
  /// meanwhile. False: the loop has not taken what was said before, say it again. One thread at a time.
  [[nodiscard]] bool set_storage(std::string_view why_not) noexcept {
    RecorderFault words;
    copy_text(words.text, why_not);
    return storage_words_.push(words);
  }
  /// From the recorder, after each turn. Without it for too long the recorder counts as hung: program stop.
  void recorder_turn(std::int64_t now_ns) noexcept { recorder_turn_ns_.store(now_ns, std::memory_order_release); }
  /// A further consumer of the samples, for readings. Before the first tick.
  void set_observer(LiveStreams* observer) noexcept { observer_ = observer; }

  /// The way in for verbs (one producer: the API), the way out for answers and for events (one consumer).
  base::SpscQueue<Request> requests{16};
  base::SpscQueue<Reply> replies{16};
  base::SpscQueue<HostNote> notes{64};
  base::SpscQueue<EventRecord> host_events{4096};

  /// The faults may be newer than the rest, never older.
  [[nodiscard]] Status status() const noexcept {
    const auto rest = status_.load();
    return {rest, faults_.load()};
  }
  /// Without the faults, which are most of a status: for who asks often.
  [[nodiscard]] LoopStatus loop_status() const noexcept { return status_.load(); }
  /// For the thread that ticks.
  [[nodiscard]] RunState state() const noexcept { return state_; }
  [[nodiscard]] Outcome outcome() const noexcept { return outcome_; }

 private:
  template <typename Record, typename Sample>
  [[nodiscard]] Record begin_record(const Stamped<Sample>& in) const noexcept;
  void read_frame() noexcept;
  void watch_zero(const FrameReport& report) noexcept;
  void read_pressure() noexcept;
  void take_sync(const SyncReport& report) noexcept;
  void read_interlock() noexcept;
  /// core_verbs.cpp. What may be refused says why, else nullptr.
  void take_requests(std::int64_t now_ns) noexcept;
  Reply answer(std::int64_t now_ns, const Request& request) noexcept;
  [[nodiscard]] bool take_withdrawal(const Request& request) noexcept;
  const char* carry_out(std::int64_t now_ns, const Request& request) noexcept;
  const char* start(std::int64_t now_ns, const Request& request) noexcept;
  const char* pause(std::int64_t now_ns) noexcept;
  const char* resume(std::int64_t now_ns) noexcept;
  const char* set_up(std::int64_t now_ns) noexcept;
  const char* confirm_zero(std::int64_t now_ns) noexcept;
  const char* reset(std::int64_t now_ns) noexcept;
  [[nodiscard]] bool is_stopped(std::int64_t now_ns) const noexcept;
  void supervise(std::int64_t now_ns) noexcept;
  void step_plan(std::int64_t now_ns) noexcept;
  void command(std::int64_t now_ns) noexcept;
  /// What is known of a device's clock, for events.
  struct ClockSeen {
    std::uint32_t rejected = 0, epoch = 0;
  };
  void note_clock(std::int64_t now_ns, const LinkHealth& health, ClockSeen& seen, const char* rejected,
                  const char* restarted) noexcept;
  /// The record and the status of each control period, and of each tick with an answer. Answers go out last: a status
  /// that is asked for after an answer holds what the answer says.
  void hand_off(std::int64_t now_ns) noexcept;

  /// What records are labelled with: before and after a run there is no step.
  [[nodiscard]] std::uint32_t step_now() const noexcept {
    const bool before = (state_ == RunState::kArmed || state_ == RunState::kCountdown) && !(run_open_ && run_begun_);
    return state_ == RunState::kIdle || state_ == RunState::kReady || state_ == RunState::kSetup || before ? kNoStep
                                                                                                           : step_;
  }
  /// The run that `request` names is open from now on; nothing of it has begun.
  void open_run(std::int64_t now_ns, const Request& request) noexcept;
  /// The open run begins, or goes on.
  void set_off(std::int64_t now_ns) noexcept;

  /// core_operator.cpp. What may be refused says why, else nullptr.
  void arm(std::int64_t now_ns) noexcept;
  const char* count_down(std::int64_t now_ns, const Request& request) noexcept;
  /// From armed, or from a countdown, back to where the operator came from.
  void stand_down(std::int64_t now_ns, Severity severity, const char* code, const char* why) noexcept;
  void watch_operator(std::int64_t now_ns, const char* not_ready) noexcept;
  [[nodiscard]] double operator_left_s(std::int64_t now_ns) const noexcept;
  [[nodiscard]] const char* why_no_setup(std::int64_t now_ns) const noexcept;
  void enter_setup(std::int64_t now_ns, const char* text) noexcept;
  void leave_setup(std::int64_t now_ns, Severity severity, const char* code, const char* why) noexcept;
  void watch_setup(std::int64_t now_ns) noexcept;
  const char* jog(std::int64_t now_ns, const Request& request) noexcept;
  char jog_refusal_[160] = {};  ///< where it has numbers
  void end_jog(std::int64_t now_ns, Severity severity, const char* code, const char* why, double value,
               double threshold) noexcept;
  void end_run(std::int64_t now_ns, Outcome outcome, const char* why) noexcept;
  void abort(std::int64_t now_ns, const char* why) noexcept;
  void stop_and_vent(std::int64_t now_ns) noexcept;
  /// What the loop itself finds, beside the supervisor: recorder, pressure loop, time in which nothing went on.
  void watch_itself(std::int64_t now_ns) noexcept;
  /// Every cause is an event and stands in Status::faults once. True when the rig is faulted now and was not before.
  bool take_trips(std::int64_t now_ns, const TripList& found) noexcept;
  /// To the faulted state, by the reaction that the severity calls for.
  void trip_over(std::int64_t now_ns, const Trip& trip) noexcept;
  [[nodiscard]] bool is_listed(const Trip& trip) const noexcept;
  void clear_faults() noexcept;
  void list_fault(std::int64_t now_ns, const Trip& trip, std::string_view text) noexcept;
  /// The cause in words, with what the driver of the device concerned says of it.
  void describe(std::int64_t now_ns, const Trip& trip, FixedText<400>& text) const noexcept;
  /// What is missing for ready; nullptr: nothing.
  [[nodiscard]] const char* why_not_ready(std::int64_t now_ns) const noexcept;
  /// Events for what the links went through: errors, reconnections, restarts, losses.
  void follow_links(std::int64_t now_ns, bool tell_losses) noexcept;
  void follow_link(std::int64_t now_ns, const char* error_code, const char* reconnect_code, const LinkHealth& now,
                   LinkSeen& seen) noexcept;
  /// Commands a segment, to a calibrated target; also for whoever lets an operator move the crosshead. False, with
  /// nothing sent, when a limit that is passed does not let it through; then the rig is faulted.
  bool move_to(std::int64_t now_ns, std::uint16_t id, double target_mm, double velocity_mm_s) noexcept;
  /// The frame has to stop, until it is seen to stand: it comes before all segments that wait.
  void request_stop(std::int64_t now_ns) noexcept;
  /// Both valves shut, until the plan or the operator goes on.
  void seal() noexcept;
  void transition(std::int64_t now_ns, RunState to, Severity severity, const char* code, const char* text, double value,
                  double threshold) noexcept;
  void emit(const EventRecord& event) noexcept;
  /// With a step other than the present one.
  void emit_of(std::uint32_t step, std::int64_t now_ns, Severity severity, const char* code, std::string_view text,
               double value, double threshold) noexcept;
  void emit(std::int64_t now_ns, Severity severity, const char* code, std::string_view text, double value,
            double threshold) noexcept;
  void emit_step(std::int64_t now_ns, const protocol::Action& action) noexcept;
  template <typename T>
  void fan_out(base::SpscQueue<T> Streams::*queue, const T& record) noexcept {
    if (run_open_ || recorded_) (recorder_.*queue).push(record);
    if (publisher_ != nullptr) (publisher_->*queue).push(record);
  }

  const char* by_ = "";  ///< whose request is carried out, while it is
  CoreConfig config_;
  FrameLink& frame_;
  PressureLink& pressure_;
  InterlockLink& interlock_;
  Streams& recorder_;
  Streams* publisher_;
  LiveStreams* observer_ = nullptr;

  Supervisor supervisor_;
  PressureLoop loop_;
  PressureGuard guard_;
  messages::ElvhMonitor monitor_;
  std::optional<protocol::Cursor> cursor_;
  const protocol::Plan* plan_ = nullptr;

  RunState state_ = RunState::kIdle;
  Outcome outcome_ = Outcome::kNone;
  bool vented_fault_ = false;
  bool run_open_ = false;
  bool run_begun_ = false;  ///< the open run, or the last one, has got beyond its countdown
  std::uint32_t first_session_ = 0;
  std::int64_t operator_until_ns_ = 0;  ///< of Status::operator_left_s
  int said_left_s_ = 0;
  bool setup_wanted_ = false;  ///< once it has stopped, when a limit is passed
  bool jogging_ = false;
  std::int64_t jog_until_ns_ = 0;
  double jog_force_low_N_ = 0.0, jog_force_high_N_ = 0.0, jog_velocity_mm_s_ = 0.0;
  std::int64_t stopping_since_ns_ = 0;
  std::int64_t faulted_since_ns_ = 0;
  std::int64_t held_since_ns_ = 0;

  protocol::Observation seen_;
  double raw_position_mm_ = 0.0;
  double pressure_psi_ = 0.0;
  std::int64_t filter_last_ns_ = 0;
  double force_sum_N_ = 0.0;
  std::uint32_t force_new_ = 0;
  double setpoint_psi_ = -1.0;
  bool regaining_ = false;  ///< as the cursor was when it was last asked
  double commanded_target_mm_ = 0.0;
  double commanded_velocity_mm_s_ = 0.0;  // 0 from when the crosshead is there, or is told to stop
  bool moving_ = false;
  std::uint32_t stops_requested_ = 0;
  std::uint32_t zero_epoch_ = 0, confirmed_zero_ = 0;
  std::uint32_t segments_commanded_ = 0;
  std::uint16_t frame_segment_id_ = 0;  ///< the frame's own, whoever sent it
  Keep keep_ = Keep::kAveraged;
  std::uint32_t step_ = 0;

  std::uint64_t ticks_ = 0;
  std::uint64_t overruns_ = 0;
  std::int64_t next_control_ns_ = 0;
  std::int64_t worst_wakeup_ns_ = 0;
  std::int64_t worst_run_ns_ = 0;
  LinkSeen frame_seen_, pressure_seen_, interlock_seen_, regulator_seen_;
  ClockSeen frame_clock_, pressure_clock_;
  std::uint64_t reported_drops_ = 0;
  bool recorded_ = false;  ///< the recorder gets what comes: a run is open, or was until kRecordedAfterNs ago
  std::int64_t recorded_until_ns_ = 0;
  LoopStatus now_;
  FaultList listed_;
  bool list_changed_ = false;
  base::SeqLock<LoopStatus> status_;
  base::SeqLock<FaultList> faults_;
  struct RecorderFault {
    char text[160] = {};
  };
  [[nodiscard]] Trip judge_recorder(std::int64_t now_ns) noexcept;
  base::SpscQueue<RecorderFault> recorder_faults_{8};
  RecorderFault recorder_trouble_;  ///< what it said last
  base::SpscQueue<RecorderFault> storage_words_{8};
  RecorderFault storage_;  ///< why a run could not be recorded, or empty
  std::atomic<bool> recorder_fault_{false};
  std::atomic<std::int64_t> recorder_turn_ns_{0};  ///< 0: nothing records
  std::uint64_t drops_before_run_ = 0;
  std::int64_t next_loss_ns_ = 0;
  std::array<Reply, 16> answered_{};  ///< in this tick; until the status is stored
  std::size_t answered_count_ = 0;
  std::atomic<bool> abort_wanted_{false};
  std::array<std::atomic<std::uint32_t>, 64> withdrawn_{};  ///< requests; more than can wait at once
  std::atomic<std::uint32_t> withdrawals_{0};
};

}  // namespace isorig::daemon
