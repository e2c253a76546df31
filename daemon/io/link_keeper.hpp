#pragma once
#include <cmath>
#include <cstdint>
#include <initializer_list>
#include <span>
#include <string>

#include "daemon/core/links.hpp"
#include "drivers/backoff.hpp"
#include "drivers/clock/mapping.hpp"
#include "drivers/error.hpp"

namespace isorig::daemon {

/// When to reconnect, and how often to ask for what. Policy after a reconnect: nothing is sent again by itself;
/// the loop has seen the stream go stale, has brought the rig to its safe state and waits for a reset.
struct ServiceConfig {
  std::int64_t poll_period_ns = 5'000'000;
  std::int64_t heartbeat_period_ns = 50'000'000;
  std::int64_t sync_period_ns = 1'000'000'000;     ///< time exchanges kept in steady state
  std::int64_t sync_burst_period_ns = 20'000'000;  ///< and for the first `sync_burst` of a connection
  int sync_burst = 50;
  pressure::FillLimits fill_limits;  ///< the pressure device fills within these, whoever asks
};

/// What the services of devices with a clock of their own have in common: the connection with its back-off and
/// failures, the clock mapping, and the health they report.
class LinkKeeper {
 protected:
  LinkKeeper(const ServiceConfig& config, const clock::Clock& clock) : config_(config), clock_(clock) {}

  void connect_now() noexcept { backoff_.reset(); }  ///< instead of when the back-off says
  /// "a, b" of the parts that are not empty.
  [[nodiscard]] static std::string words(std::initializer_list<std::string> parts);
  [[nodiscard]] bool may_connect(std::int64_t now_ns) const noexcept { return backoff_.is_due(now_ns); }
  void note_connected(const std::string& identity, double sample_rate_hz) noexcept;
  /// True when the connection has to be started afresh; the caller disconnects.
  bool note_failure(std::int64_t now_ns, const drivers::DeviceError& error) noexcept;
  void note_answer() noexcept { failures_in_a_row_ = 0; }
  /// Stamps what a poll brought and hands it to the loop. Call it after the poll, which may have waited: nothing in it
  /// is younger than now.
  template <typename Sample, typename Queue>
  void hand_over(std::span<const Sample> samples, Queue& queue);
  /// Another time exchange would tell whether the device's clock has stepped: it is wanted now.
  [[nodiscard]] bool clock_in_doubt() const noexcept { return map_.in_doubt() || mapper_.on_its_own(); }
  /// At most every 100 ms, unless forced.
  void report_health(std::int64_t now_ns, base::SpscQueue<LinkHealth>& to, bool force) noexcept;

  /// Of the health reports.
  static constexpr std::int64_t kHealthPeriodNs = 100'000'000;

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

template <typename Sample, typename Queue>
void LinkKeeper::hand_over(std::span<const Sample> samples, Queue& queue) {
  if (!map_.current().known()) return;
  const std::int64_t arrival_ns = clock_.now_ns();
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
