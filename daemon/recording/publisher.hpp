#pragma once
#include <atomic>
#include <cstdint>
#include <memory>
#include <string>

#include "daemon/recording/live_sink.hpp"

namespace isorig::daemon {

/// What makes multicast go on a machine without a network, for messages.
inline constexpr const char* kMulticastRoute = "`ip link set lo multicast on; ip route add 224.0.0.0/4 dev lo`";

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
  /// errno of the newest that the kernel refused; 0: none was.
  [[nodiscard]] int failed_errno() const noexcept { return failed_errno_.load(std::memory_order_relaxed); }

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
  std::atomic<std::uint64_t> published_{0};
  std::atomic<std::uint64_t> failed_{0};
  std::atomic<int> failed_errno_{0};
};

/// What the log says of a network that takes no messages. ISORIG_PROGRESS counts them, but is a message too: nobody
/// hears it before the network is back.
class PublishWatch {
 public:
  /// Asked about once a second: a line when messages begin to fail, and one when none has failed for kQuietLooks looks.
  [[nodiscard]] std::string look(std::uint64_t failed, int error);

  static constexpr int kQuietLooks = 5;  ///< single datagrams that a busy kernel refuses are told once, not each second

 private:
  std::uint64_t failed_ = 0;
  std::uint64_t before_ = 0;  ///< how many had failed before those that are being told of
  int quiet_looks_ = kQuietLooks;
};

}  // namespace isorig::daemon
