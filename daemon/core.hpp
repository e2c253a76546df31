#pragma once
#include <cstdint>
#include <optional>

#include "base/spsc_queue.hpp"
#include "daemon/links.hpp"
#include "daemon/live_window.hpp"
#include "daemon/pressure_loop.hpp"
#include "daemon/status.hpp"
#include "daemon/streams.hpp"
#include "daemon/supervisor.hpp"
#include "messages/elvh.hpp"
#include "protocol/cursor.hpp"

/// The real-time core: one tick() per millisecond does all that decides. The loop thread calls it in real time,
/// the virtual runner in virtual time; it cannot tell which. docs/threads.md has the contract of every thread.
namespace isorig::daemon {

/// calibrated = raw * scale + offset, for each channel; recorded beside the raw values.
struct Calibration {
  double position_scale = 1.0, position_offset_mm = 0.0;
  double force_scale = 1.0, force_offset_N = 0.0;
  double pressure_scale = 1.0, pressure_offset_psi = 0.0;
};

struct CoreConfig {
  SupervisorConfig supervisor;
  PressureLoopConfig pressure_loop;
  Calibration calibration;
  std::int64_t control_period_ns = 10'000'000;  ///< of ControlRecord
  double pressure_filter_s = 0.02;              ///< of the reading by which "settled" is judged
  double vented_psi = 0.5;                      ///< below this a stopping rig counts as vented
  double vent_time_max_s = 20.0;                ///< stopping takes no longer, vented or not
};

/// A verb from the operator. The plan has to live until its run has ended.
struct Request {
  enum class Verb : std::uint8_t { kStart, kPause, kResume, kAbort, kReset, kSeal, kCalibrate } verb = Verb::kAbort;
  std::uint32_t id = 0;
  const protocol::Plan* plan = nullptr;
  std::uint32_t first_session = 0;
  Calibration calibration;  ///< of kCalibrate
};

struct Reply {
  std::uint32_t id = 0;
  bool accepted = false;
  char text[160] = {};
};

class Core {
 public:
  Core(const CoreConfig& config, FrameLink& frame, PressureLink& pressure, InterlockLink& interlock, Streams& recorder,
       Streams* publisher) noexcept;

  /// One millisecond. `late_ns` is how long after its deadline the loop woke up, `last_run_ns` how long the
  /// previous tick took. No allocation, lock, log or blocking call: tests/daemon/allocation_test.cpp proves it.
  void tick(std::int64_t now_ns, std::int64_t late_ns, std::int64_t last_run_ns) noexcept;
  /// Ticks that were skipped because the loop came back late; counted, never made up for.
  void note_missed_ticks(std::uint64_t count) noexcept { overruns_ += count; }
  /// From the recorder: it cannot keep what it is given (full disk, write error): program stop; reset is refused
  /// until it can again. Any thread.
  void set_recorder_fault(bool failing) noexcept { recorder_fault_.store(failing, std::memory_order_release); }
  /// A further consumer of the samples, for readings. Before the first tick.
  void set_observer(LiveStreams* observer) noexcept { observer_ = observer; }

  /// The way in for verbs (one producer: the API), the way out for answers and for events (one consumer).
  base::SpscQueue<Request> requests{16};
  base::SpscQueue<Reply> replies{16};
  base::SpscQueue<EventRecord> host_events{4096};

  [[nodiscard]] Status status() const noexcept { return status_.load(); }
  /// For the thread that ticks.
  [[nodiscard]] RunState state() const noexcept { return state_; }
  [[nodiscard]] Outcome outcome() const noexcept { return outcome_; }

 private:
  void read_frame() noexcept;
  void read_pressure() noexcept;
  void take_sync(const SyncReport& report) noexcept;
  void read_interlock() noexcept;
  void take_requests(std::int64_t now_ns) noexcept;
  void supervise(std::int64_t now_ns) noexcept;
  void step_plan(std::int64_t now_ns) noexcept;
  void command(std::int64_t now_ns) noexcept;
  void hand_off(std::int64_t now_ns) noexcept;

  /// What records are labelled with: before and after a run there is no step.
  [[nodiscard]] std::uint32_t step_now() const noexcept {
    return state_ == RunState::kIdle || state_ == RunState::kReady ? kNoStep : step_;
  }
  void begin_run(std::int64_t now_ns, const Request& request) noexcept;
  void end_run(std::int64_t now_ns, Outcome outcome, const char* why) noexcept;
  void stop_and_vent(std::int64_t now_ns) noexcept;
  void send_stop() noexcept;
  void transition(std::int64_t now_ns, RunState to, Severity severity, const char* code, const char* text, double value,
                  double threshold) noexcept;
  void emit(const EventRecord& event) noexcept;
  void emit(std::int64_t now_ns, Severity severity, const char* code, std::string_view text, double value,
            double threshold) noexcept;
  void emit_step(std::int64_t now_ns, const protocol::Action& action) noexcept;
  template <typename T>
  void fan_out(base::SpscQueue<T> Streams::* queue, const T& record) noexcept {
    (recorder_.*queue).push(record);
    if (publisher_ != nullptr) (publisher_->*queue).push(record);
  }

  CoreConfig config_;
  FrameLink& frame_;
  PressureLink& pressure_;
  InterlockLink& interlock_;
  Streams& recorder_;
  Streams* publisher_;
  LiveStreams* observer_ = nullptr;

  Supervisor supervisor_;
  PressureLoop loop_;
  messages::ElvhMonitor monitor_;
  std::optional<protocol::Cursor> cursor_;
  const protocol::Plan* plan_ = nullptr;

  RunState state_ = RunState::kIdle;
  Outcome outcome_ = Outcome::kNone;
  bool vented_fault_ = false;
  bool run_open_ = false;
  std::int64_t stopping_since_ns_ = 0;
  std::int64_t faulted_since_ns_ = 0;

  protocol::Observation seen_;
  double raw_position_mm_ = 0.0;
  double pressure_psi_ = 0.0;
  std::int64_t filter_last_ns_ = 0;
  double force_sum_N_ = 0.0;
  std::uint32_t force_new_ = 0;
  std::uint16_t last_segment_id_ = 0;
  double setpoint_psi_ = -1.0;
  double commanded_velocity_mm_s_ = 0.0;
  bool moving_ = false;
  Keep keep_ = Keep::kAveraged;
  std::uint32_t step_ = 0;

  std::uint64_t ticks_ = 0;
  std::uint64_t overruns_ = 0;
  std::int64_t next_control_ns_ = 0;
  std::int64_t worst_wakeup_ns_ = 0;
  std::int64_t worst_run_ns_ = 0;
  std::uint64_t frame_lost_ = 0;
  std::uint64_t pressure_lost_ = 0;
  std::uint64_t reported_drops_ = 0;
  LinkHealth frame_health_;
  LinkHealth pressure_health_;
  Status now_;
  SeqLock<Status> status_;
  std::atomic<bool> recorder_fault_{false};
};

}  // namespace isorig::daemon
