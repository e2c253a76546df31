#pragma once
#include <vector>

#include "drivers/api/frame.hpp"
#include "sim/device_clock.hpp"
#include "sim/frame/crosshead.hpp"
#include "sim/host.hpp"

namespace isorig::sim {

/// What can be broken in the simulated frame, for tests and demonstrations.
struct FrameFaults {
  bool disconnected = false;       ///< every call throws kDisconnected
  bool silent = false;             ///< every call throws kTimeout
  bool frozen_samples = false;     ///< the sample counter stands still; motion goes on
  bool frozen_force = false;       ///< the load cell repeats its last value
  bool drive_fault = false;        ///< the drive trips: brake, kDriveFault
  bool ignores_segments = false;   ///< accepts the next ones, echoes them, does not move
  bool never_reached = false;      ///< it arrives, and goes on to say "moving"
  bool fault_state = false;        ///< its state is "fault", and no fault bit says why
  bool not_a_number = false;       ///< the load cell reads NaN
  bool heartbeat_refused = false;  ///< the heartbeat register cannot be written
  int stop_refused = 0;            ///< so many stops are refused ("busy"); -1: until switched off
  int stop_lost = 0;               ///< so many stops are acknowledged and not done; -1: until switched off
  bool runs_on = false;            ///< a stop is acknowledged, the state says "stopped", the crosshead goes on
  bool runaway = false;            ///< likewise, and the frame's own watchdog does not stop it either
  bool frozen_registers = false;   ///< samples and state as they were: it hangs behind a gateway that answers
  int polls_lost = 0;              ///< so many polls get no answer; -1: until switched off
  int polls_spoilt = 0;            ///< so many are answered by what is no answer; -1: likewise
  int polls_refused = 0;           ///< so many are answered by an exception; -1: likewise
  int segments_refused = 0;        ///< so many segments are answered by an exception; -1: likewise
  bool echoes_wrong = false;       ///< a segment's target is taken, and echoed, half a millimetre further
  double overshoot_mm = 0.0;       ///< it stops so far beyond the target, and says that this is the target
  double force_error_N = 0.0;      ///< the load cell shows so much more
};

/// The frame as a cabinet: crosshead, load cell, encoder, sampler on a clock of its own, sample ring, its own
/// limits, heartbeat supervision and the interlock input. `advance` and `step` belong to the rig; the rest is
/// frame::Device.
///
/// A fault that stops the motion stays in the fault bits until it is over: a heartbeat that changes again, a
/// chain that is closed again, a segment that leads away from the limit. Motion never resumes by itself.
class SimFrame final : public frame::Device {
 public:
  SimFrame(const FrameParameters& parameters, Host& host, std::uint64_t seed, std::int64_t start_ns, double dt_s);

  frame::Identity connect() override;
  void disconnect() noexcept override { connected_ = false; }
  frame::Poll poll(std::span<frame::Sample> out) override;
  void start_segment(const frame::Segment& segment) override;
  void stop() override;
  void heartbeat(std::uint16_t counter) override;

  /// Before the physics of a step: what starts, what must stop. `drive_enabled`: the interlock chain is
  /// whole.
  void before_step(std::int64_t begin_ns, bool drive_enabled) noexcept {
    if (begin_ns >= next_check_ns_ || drive_enabled != drive_enabled_ || pending_ || faults.drive_fault) {
      check(begin_ns, drive_enabled);
    }
    if (!crosshead_.resting()) crosshead_.step();
  }
  /// After it: limits, and the samples whose time has come.
  void after_step(const StepView& step) noexcept;

  /// Off and on again: no connection, no heartbeat, and a zero that is `zero_shift_mm` away.
  void power_cycle(double zero_shift_mm) noexcept;
  /// Its clock is set: from now on it shows so much more (or less).
  void jump_clock(double by_us) noexcept {
    clock_.jump(by_us);
    next_sample_us_ += by_us;
  }

  [[nodiscard]] const Crosshead& crosshead() const noexcept { return crosshead_; }
  [[nodiscard]] std::uint32_t sequence() const noexcept { return sequence_; }

  FrameFaults faults;

 private:
  void check(std::int64_t now_ns, bool drive_enabled) noexcept;
  void supervise_motion(const StepView& step) noexcept;
  void halt(frame::Motion motion, std::uint16_t fault) noexcept;
  void require_link() const;
  void answer_poll();
  [[nodiscard]] static bool spend(int& count) noexcept;
  [[nodiscard]] frame::Sample sample(const StepView& step, double fraction, double device_us) noexcept;

  FrameParameters p_;
  Host& host_;
  Crosshead crosshead_;
  DeviceClock clock_;
  Random force_noise_, position_noise_;
  Delay request_, reply_;
  double inverse_force_quantum_, inverse_position_quantum_;
  double sample_period_us_;

  // Sampler.
  std::vector<frame::Sample> ring_;
  double next_sample_us_;
  std::int64_t start_ns_;
  std::uint32_t sequence_ = 0;  // of the next sample
  std::size_t write_slot_ = 0;  // where it goes
  std::uint32_t read_ = 0;      // of the next one to hand out
  float last_force_N_ = 0.0F;

  // Motion.
  frame::State state_;
  frame::State said_;  ///< in the last answer
  frame::Segment waiting_;
  bool pending_ = false;  // a segment written but not begun
  std::int64_t pending_ns_ = 0;
  bool moving_ = false;
  bool ignored_ = false;  ///< the present segment
  std::int64_t in_position_ns_ = -1;
  bool drive_enabled_ = true;

  // Heartbeat.
  bool heartbeat_seen_ = false;
  std::int64_t heartbeat_ns_ = 0;
  std::int64_t next_check_ns_ = 0;

  // Link.
  bool connected_ = false;
  std::uint32_t reference_epoch_ = 1;
  std::int64_t next_exchange_ns_ = 0;
  int burst_left_;
};

}  // namespace isorig::sim
