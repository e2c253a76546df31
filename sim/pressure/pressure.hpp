#pragma once
#include <array>
#include <vector>

#include "drivers/api/pressure.hpp"
#include "messages/teensy/fill_guard.hpp"
#include "sim/device_clock.hpp"
#include "sim/host.hpp"
#include "sim/pressure/pneumatics.hpp"
#include "sim/sync_line.hpp"

namespace isorig::sim {

/// What can be broken in the simulated pressure side.
struct PressureFaults {
  bool disconnected = false;      ///< every call throws kDisconnected
  bool silent = false;            ///< nothing arrives, nothing throws
  bool frozen_samples = false;    ///< conversions stop; the link lives
  bool sensor_fault = false;      ///< status bits 11
  bool sensor_stale = false;      ///< status bits 10 and the last value again
  bool bus_low = false;           ///< MISO shorted: 0x00000000
  bool bus_high = false;          ///< MISO open: 0xFFFFFFFF
  bool stuck_value = false;       ///< status 00, the count never changes
  bool ignores_commands = false;  ///< valves stay where they are
  int samples_lost = 0;           ///< so many conversions never arrive; -1: until switched off
  int samples_spoilt = 0;         ///< so many arrive corrupt, and are left out; -1: likewise
  double drift_psi_s = 0.0;       ///< the sensor's zero runs away at this rate; 0: another sensor
  // Between chamber and sensor. The sensor itself is whole: its noise goes on.
  bool tube_off = false;      ///< the sensor reads the room; the branch is narrow: no leak to speak of
  bool tube_blocked = false;  ///< it reads what was locked in
  int tube_lag_ms = 0;        ///< kinked: it follows with this time constant
  int low_permille = 0;       ///< it reads so much too little
};

/// Teensy, ELVH and valve drivers as one device: conversions on a clock of its own, a sample queue that drops
/// the newest when the host stalls, time-sync replies with drawn delays, valve commands with a dead time, and
/// the watchdog that vents. Vents until the first heartbeat. With limits it guards its filling as the firmware does
/// (messages/teensy/fill_guard.hpp), and a command that nobody renews closes both valves, unless it is a full vent;
/// without, as behind an emulated Teensy that does all this for it, the valves stay as they were told.
/// What it has vented by itself stays so until it is told to vent.
class SimPressure final : public pressure::Device {
 public:
  SimPressure(const SensorParameters& parameters, const PneumaticParameters& valves, Host& host, std::uint64_t seed,
              std::int64_t start_ns);

  void set_limits(const pressure::FillLimits& limits) override;
  pressure::Identity connect() override;
  void disconnect() noexcept override { connected_ = false; }
  pressure::Poll poll(std::span<pressure::Sample> samples_out, std::span<clock::Exchange> exchanges_out,
                      std::int64_t timeout_ns) override;
  void command(const pressure::Command& command) override;
  void heartbeat() override;
  void request_time_sync() override;
  std::optional<pressure::SyncEdge> take_sync_edge() override;

  /// Off and on again: counts samples and time anew, knows no heartbeat, vents until the next. The connection ends.
  void power_cycle() noexcept;
  [[nodiscard]] std::uint32_t sequence() const noexcept { return sequence_; }
  /// Its clock is set: from now on it shows so much more (or less).
  void jump_clock(double by_us) noexcept {
    clock_.jump(by_us);
    next_sample_us_ += by_us;
  }

  /// Before the physics of a step: what the valves are told in it (dump is the rig's).
  const ValveTargets& before_step(std::int64_t begin_ns) noexcept {
    if (queue_read_ != queue_write_ || begin_ns >= next_check_ns_) check(begin_ns);
    return targets_;
  }
  /// After it: the conversions whose time has come.
  void after_step(const StepView& step) noexcept;

  PressureFaults faults;

 private:
  struct Pending {
    std::int64_t at_ns = 0;
    std::uint16_t fill_permille = 0, vent_permille = 0;
  };
  struct Reply {
    double at_ns = 0.0;
    clock::Exchange exchange;
  };

  void check(std::int64_t now_ns) noexcept;
  void drive(std::uint16_t fill_permille, std::uint16_t vent_permille, std::int64_t now_ns) noexcept;
  void vent_itself(messages::teensy::VentCause cause, std::int64_t now_ns) noexcept;
  [[nodiscard]] double opening(std::uint16_t permille) const noexcept;
  [[nodiscard]] std::uint32_t convert(double pressure_psi) noexcept;
  [[nodiscard]] double through_tube(double pressure_psi) noexcept;
  void require_link() const;

  SensorParameters p_;
  Host& host_;
  double duty_dead_, duty_step_;
  std::int64_t command_delay_ns_, command_validity_ns_;
  std::int64_t start_ns_;
  DeviceClock clock_;
  Random noise_;
  Delay request_, reply_;
  double sample_period_us_;
  double next_sample_us_;
  std::int64_t next_temperature_ns_;
  double temperature_C_ = 0.0;
  std::uint32_t last_word_ = 0;
  double at_sensor_psi_ = 0.0;
  double drifted_psi_ = 0.0;

  std::vector<pressure::Sample> ring_;
  std::size_t stored_ = 0, oldest_ = 0;
  std::uint32_t sequence_ = 0;  // of the next conversion
  std::uint32_t expected_ = 0;  // by the host
  std::uint32_t dropped_ = 0;
  std::uint32_t spoilt_ = 0;  // since the last poll

  static constexpr std::size_t kQueue = 64;
  std::array<Pending, kQueue> queue_{};
  std::size_t queue_read_ = 0, queue_write_ = 0;
  std::array<Reply, kQueue> replies_{};
  std::size_t replies_pending_ = 0;

  pressure::State state_;
  SyncLineTimes sync_line_;
  ValveTargets targets_;
  messages::teensy::FillGuard guard_;
  bool guards_ = false;
  messages::teensy::Limits limits_;  ///< what every connection begins with, once they were given
  bool heartbeat_seen_ = false;
  std::int64_t heartbeat_ns_ = 0;
  std::int64_t commanded_ns_ = 0;  ///< the newest command reached the valves' driver
  std::int64_t next_check_ns_ = 0;
  bool connected_ = false;
};

}  // namespace isorig::sim
