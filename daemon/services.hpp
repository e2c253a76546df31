#pragma once
#include <array>
#include <cstdint>
#include <span>
#include <string>

#include "daemon/links.hpp"
#include "drivers/backoff.hpp"
#include "drivers/clock/mapping.hpp"
#include "drivers/clock/sync_line.hpp"

/// The device side of the links: each service owns one device and is run by one thread in real time
/// (`run_once` at its period) or inline by the virtual runner. The same code in both. Everything that blocks or
/// throws stays in here.
namespace isorig::daemon {

/// When to reconnect, and how often to ask for what. Policy after a reconnect: nothing is sent again by itself;
/// the loop has seen the stream go stale, has brought the rig to its safe state and waits for a reset.
struct ServiceConfig {
  std::int64_t poll_period_ns = 5'000'000;
  std::int64_t heartbeat_period_ns = 50'000'000;
  std::int64_t sync_period_ns = 1'000'000'000;     ///< time exchanges kept in steady state
  std::int64_t sync_burst_period_ns = 20'000'000;  ///< and for the first `sync_burst` of a connection
  int sync_burst = 50;
};

/// What both device services have in common: the connection with its back-off and failures, the clock mapping, and the
/// health they report.
class LinkKeeper {
 protected:
  LinkKeeper(const ServiceConfig& config, const clock::Clock& clock) : config_(config), clock_(clock) {}

  void connect_now() noexcept { backoff_.reset(); }  ///< instead of when the back-off says
  [[nodiscard]] bool may_connect(std::int64_t now_ns) const noexcept { return backoff_.is_due(now_ns); }
  void note_connected(const std::string& identity, double sample_rate_hz) noexcept;
  /// True when the connection has to be started afresh; the caller disconnects.
  bool note_failure(std::int64_t now_ns, const drivers::DeviceError& error) noexcept;
  void note_answer() noexcept { failures_in_a_row_ = 0; }
  /// Stamps what a poll brought and hands it to the loop. Call it after the poll, which may have waited: nothing in it
  /// is younger than now.
  template <typename Sample, typename Queue>
  void hand_over(std::span<const Sample> samples, Queue& queue);
  /// At most every 100 ms, unless forced.
  void report_health(std::int64_t now_ns, base::SpscQueue<LinkHealth>& to, bool force) noexcept;

  ServiceConfig config_;
  clock::DeviceClockMap map_;
  LinkHealth health_;
  std::int64_t next_heartbeat_ns_ = 0;
  std::int64_t next_sync_ns_ = 0;
  std::uint32_t last_beat_ = 0;
  int burst_left_ = 0;

 private:
  const clock::Clock& clock_;
  clock::StreamMapper mapper_{map_};
  drivers::Backoff backoff_;
  bool was_connected_ = false;
  int failures_in_a_row_ = 0;
  std::int64_t next_health_ns_ = 0;
};

class FrameService : private LinkKeeper {
 public:
  FrameService(frame::Device& device, FrameLink& link, const ServiceConfig& config, const clock::Clock& clock)
      : LinkKeeper(config, clock), device_(device), link_(link) {}
  /// One turn: reconnect if due, commands, heartbeat, poll. Never throws.
  void run_once(std::int64_t now_ns) noexcept;
  /// The frame stops and the connection closes; called on every way out.
  void shut_down() noexcept;

 private:
  void turn(std::int64_t now_ns);
  void fail(std::int64_t now_ns, const drivers::DeviceError& error) noexcept;
  void take_exchange(const clock::Exchange& exchange);

  frame::Device& device_;
  FrameLink& link_;
  // Between the exchanges that are kept, the one with the shortest round trip.
  clock::Exchange best_;
  bool has_best_ = false;
  std::array<frame::Sample, 512> samples_{};
};

class PressureService : private LinkKeeper {
 public:
  /// `line`: the sync line as the interlock's thread sees it.
  PressureService(pressure::Device& device, PressureLink& link, InterlockLink& line, const ServiceConfig& config,
                  const clock::Clock& clock)
      : LinkKeeper(config, clock), device_(device), link_(link), line_(line) {}
  /// One turn; waits at most `wait_ns` for data (0 in virtual time). Never throws.
  void run_once(std::int64_t now_ns, std::int64_t wait_ns) noexcept;
  /// Vents and closes; called on every way out.
  void shut_down() noexcept;

 private:
  void turn(std::int64_t now_ns, std::int64_t wait_ns);
  void fail(std::int64_t now_ns, const drivers::DeviceError& error) noexcept;
  void check_clock(std::int64_t now_ns);

  pressure::Device& device_;
  PressureLink& link_;
  InterlockLink& line_;
  clock::SyncLine sync_;
  clock::SyncCounts reported_;
  std::int64_t next_command_ns_ = 0;
  std::uint64_t last_command_ = ~std::uint64_t{0};
  std::array<pressure::Sample, 512> samples_{};
  std::array<clock::Exchange, 16> exchanges_{};
};

/// The regulator that sets the pressure while the Teensy measures it. A loop that does not tick gets no set-point
/// through: the regulator exhausts.
class RegulatorService : private LinkKeeper {
 public:
  RegulatorService(pressure::Regulator& device, PressureLink& link, const ServiceConfig& config, const clock::Clock& clock)
      : LinkKeeper(config, clock), device_(device), link_(link) {}
  /// One turn. Never throws.
  void run_once(std::int64_t now_ns) noexcept;
  /// Exhausts and closes; called on every way out.
  void shut_down() noexcept;

 private:
  void turn(std::int64_t now_ns);
  void fail(std::int64_t now_ns, const drivers::DeviceError& error) noexcept;

  void report_fault(std::int64_t now_ns) noexcept;

  pressure::Regulator& device_;
  PressureLink& link_;
  float sent_psi_ = -1.0F;  ///< below 0: it exhausts
  std::int64_t last_beat_ns_ = 0;
};

class InterlockService {
 public:
  InterlockService(interlock::Device& device, InterlockLink& link) : device_(device), link_(link) {}
  void run_once(std::int64_t now_ns) noexcept;
  void shut_down() noexcept;
  /// Waits for an input to change; false at once when the device cannot tell, or is not there.
  bool wait(std::int64_t timeout_ns) noexcept;

 private:
  void turn(std::int64_t now_ns);
  void report_health(std::int64_t now_ns, bool force) noexcept;

  interlock::Device& device_;
  InterlockLink& link_;
  LinkHealth health_;
  bool was_connected_ = false;
  std::int64_t next_health_ns_ = 0;
  bool connected_ = false;
  bool holding_ = false;
  std::uint32_t last_beat_ = 0;
  std::int64_t last_beat_ns_ = 0;
  std::int64_t next_attempt_ns_ = 0;
};

}  // namespace isorig::daemon
