#pragma once
#include <array>
#include <cstdint>
#include <span>
#include <string>

#include "daemon/core/links.hpp"
#include "daemon/io/frame_service.hpp"
#include "daemon/io/link_keeper.hpp"
#include "drivers/clock/sync_line.hpp"

/// The device side of the links: each service owns one device and is run by one thread in real time
/// (`run_once` at its period) or inline by the virtual runner. The same code in both. Everything that blocks or
/// throws stays in here.
namespace isorig::daemon {

class PressureService : private LinkKeeper {
 public:
  /// `line`: the sync line as the interlock's thread sees it.
  PressureService(pressure::Device& device, PressureLink& link, InterlockLink& line, const ServiceConfig& config,
                  const clock::Clock& clock)
      : LinkKeeper(config, clock), device_(device), link_(link), line_(line) {
    if (config.fill_limits.pressure_max_psi > 0.0) device.set_limits(config.fill_limits);
  }
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
  std::int64_t last_sync_ns_ = 0;
  std::uint64_t last_command_ = ~std::uint64_t{0};
  bool vented_ = false;  ///< the device vented by itself, and the loop has not been told
  std::array<pressure::Sample, 512> samples_{};
  std::array<clock::Exchange, 16> exchanges_{};
};

/// The regulator that sets the pressure while the Teensy measures it. A loop that does not tick gets no set-point
/// through: the regulator exhausts.
class RegulatorService : private LinkKeeper {
 public:
  RegulatorService(pressure::Regulator& device, PressureLink& link, const ServiceConfig& config,
                   const clock::Clock& clock)
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
