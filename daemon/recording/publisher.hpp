#pragma once
#include <atomic>
#include <cstdint>
#include <memory>
#include <string>

#include "daemon/recording/live_sink.hpp"

namespace isorig::daemon {

/// Publishes every sample over LCM, in batches that fit one Ethernet frame (docs/lcm-channels.md). It only
/// publishes: LCM knows no sender, so nothing that moves the rig is ever taken from it.
///
/// publish() has been measured to take 27 ms on an idle machine: it runs in a thread of its own, fed by its
/// own queues. When that thread is late the queues drop and count; subscribers see the count in
/// ISORIG_PROGRESS and an event, and the recording is not concerned.
class Publisher final : public LiveSink {
 public:
  static constexpr const char* kDefaultUrl = "udpm://239.255.76.67:7667?ttl=0";  // ttl 0: stays on this machine

  /// Throws std::runtime_error with what to do when LCM cannot open the URL.
  explicit Publisher(const std::string& url = kDefaultUrl);
  ~Publisher() override;
  Publisher(const Publisher&) = delete;
  Publisher& operator=(const Publisher&) = delete;

  /// Publishes all that is queued (drain_live() with this sink alone); a batch is sent when it is full or the queues
  /// are empty, so that a message is never older than the caller's period. One thread.
  void drain(Streams& streams, std::int64_t now_ns) { drain_live(streams, now_ns, {this}); }

  void on_event(const EventRecord& record) override;
  void on_frame(const FrameRecord& record) override;
  void on_pressure(const PressureRecord& record) override;
  void on_control(const ControlRecord& record) override;
  void on_exchange(const ExchangeRecord& record) override;
  void on_sync(const SyncRecord& record) override;
  void end_of_turn(std::size_t dropped, std::int64_t now_ns) override;

  /// From any thread.
  [[nodiscard]] std::uint64_t published() const noexcept { return published_.load(std::memory_order_relaxed); }
  /// The kernel refused them (no route, no buffers).
  [[nodiscard]] std::uint64_t failed() const noexcept { return failed_.load(std::memory_order_relaxed); }

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
  std::atomic<std::uint64_t> published_{0};
  std::atomic<std::uint64_t> failed_{0};
};

}  // namespace isorig::daemon
