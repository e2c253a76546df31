#pragma once
#include <cmath>
#include <cstdint>
#include <span>

#include "daemon/io/link_keeper.hpp"
#include "daemon/io/service_config.hpp"
#include "drivers/clock_map/mapping.hpp"

namespace isorig::daemon {

/// The link of a device that sends samples dated by a clock of its own: adds the mapping of that clock.
class SampledLink : public LinkKeeper {
 protected:
  SampledLink(base::SpscQueue<LinkHealth>& reports, const ServiceConfig& config, const clock::Clock& clock)
      : LinkKeeper(reports), config_(config), host_clock_(clock) {}

  void note_connected(const std::string& identity, double sample_rate_hz) noexcept;
  /// Stamps what a poll brought and hands it to the loop. Call it after the poll, which may have waited: nothing in it
  /// is younger than now.
  template <typename Sample, typename Queue>
  void hand_over(std::span<const Sample> samples, Queue& queue);
  /// Another time exchange would tell whether the device's clock has stepped: it is wanted now.
  [[nodiscard]] bool clock_in_doubt() const noexcept { return map_.in_doubt() || mapper_.on_its_own(); }

  ServiceConfig config_;
  clock::DeviceClockMap map_;
  std::int64_t next_heartbeat_ns_ = 0;
  std::int64_t next_sync_ns_ = 0;
  std::uint32_t last_beat_ = 0;
  int burst_left_ = 0;

 private:
  void complete(LinkHealth& health) const noexcept override;

  const clock::Clock& host_clock_;
  clock::StreamMapper mapper_{map_};
};

template <typename Sample, typename Queue>
void SampledLink::hand_over(std::span<const Sample> samples, Queue& queue) {
  if (!map_.current().known()) return;
  const std::int64_t arrival_ns = host_clock_.now_ns();
  for (const auto& sample : samples) {
    bool counts_itself = true;
    if constexpr (requires { sample.bound_us; })
      counts_itself = sample.bound_us <= 0.0F;  // else the host dates and counts
    const auto device_us = static_cast<double>(sample.device_us);
    const auto stamp =
        counts_itself ? mapper_.map(device_us, arrival_ns, sample.sequence) : mapper_.map(device_us, arrival_ns);
    health_.bound_ns = static_cast<float>(stamp.bound_ns);
    health_.repeatability_ns = static_cast<float>(stamp.repeatability_ns);
    if constexpr (requires { sample.bound_us; }) {
      if (sample.bound_us > 0.0F) {
        health_.bound_ns += 1e3F * sample.bound_us;
        // Anywhere within it, as likely as anywhere else.
        health_.repeatability_ns = std::hypot(health_.repeatability_ns, 1e3F * sample.bound_us / std::sqrt(3.0F));
      }
    }
    queue.push({sample, stamp.mono_ns, health_.bound_ns, health_.repeatability_ns});
  }
}

}  // namespace isorig::daemon
