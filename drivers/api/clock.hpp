#pragma once
#include <atomic>
#include <cstdint>

namespace isorig::clock {

/// The one clock: CLOCK_MONOTONIC in nanoseconds, `mono_ns` everywhere. Nothing else asks for the time.
class Clock {
 public:
  virtual ~Clock() = default;
  /// Now, in ns. Wait-free; may be called from the real-time loop.
  [[nodiscard]] virtual std::int64_t now_ns() const noexcept = 0;
  /// Blocks until `deadline_ns` (absolute). The virtual clock jumps there instead.
  virtual void sleep_until_ns(std::int64_t deadline_ns) noexcept = 0;
};

/// Time that moves when it is told to, for deterministic runs faster than real time.
/// One thread advances it; others may read.
class VirtualClock final : public Clock {
 public:
  explicit VirtualClock(std::int64_t start_ns = 0) noexcept : now_ns_(start_ns) {}
  [[nodiscard]] std::int64_t now_ns() const noexcept override { return now_ns_.load(std::memory_order_relaxed); }
  void sleep_until_ns(std::int64_t deadline_ns) noexcept override {
    if (deadline_ns > now_ns()) now_ns_.store(deadline_ns, std::memory_order_relaxed);
  }

 private:
  std::atomic<std::int64_t> now_ns_;
};

/// One two-way exchange with a device: the host sent at `host_send_ns`, the device received the request at
/// `device_rx_us` and answered at `device_tx_us` (its own clock, extended to 64 bit, fractional microseconds
/// allowed), the host had the answer at `host_recv_ns`. A device with a single stamp sets both equal.
/// Causality is the only assumption: host_send <= host(device_rx) and host(device_tx) <= host_recv.
struct Exchange {
  std::int64_t host_send_ns = 0;
  std::int64_t host_recv_ns = 0;
  double device_rx_us = 0.0;
  double device_tx_us = 0.0;
};

}  // namespace isorig::clock
