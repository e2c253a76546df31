#pragma once
#include <array>
#include <cstdint>

#include "daemon/core/links.hpp"
#include "daemon/io/sampled_link.hpp"
#include "drivers/clock_map/sync_line.hpp"

namespace isorig::daemon {

/// Owns the Teensy that measures the pressure and drives the valves.
class PressureService : private SampledLink {
 public:
  /// `line`: the sync line as the interlock's thread sees it.
  PressureService(pressure::Device& device, PressureLink& link, InterlockLink& line, const ServiceConfig& config,
                  const clock::Clock& clock)
      : SampledLink(link.health, config, clock), device_(device), link_(link), line_(line) {
    if (config.fill_limits.pressure_max_psi > 0.0) device.set_limits(config.fill_limits);
  }
  /// One turn; waits at most `wait_ns` for data (0 in virtual time). Never throws.
  void run_once(std::int64_t now_ns, std::int64_t wait_ns) noexcept;
  /// Vents and closes; called on every way out.
  void shut_down() noexcept;

 private:
  void turn(std::int64_t now_ns, std::int64_t wait_ns);
  void drop(std::int64_t now_ns) noexcept override;
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

}  // namespace isorig::daemon
