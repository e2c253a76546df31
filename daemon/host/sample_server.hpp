#pragma once
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <string>

#include "daemon/host/peer.hpp"
#include "daemon/recording/live_sink.hpp"

namespace isorig::daemon {

/// Streams every live record to whoever connects to SOCKET.samples (docs/sample-stream.md). Takes no commands: what a
/// subscriber sends is thrown away.
///
/// The publisher's thread hands over a turn's records encoded once, and never waits: it appends a shared block to a
/// bounded queue. All sockets are served by the thread in run(). Each subscriber has a queue of its own, bounded in
/// bytes; what finds it full is left out and counted, and the subscriber is told before its next record.
class SampleServer final : public LiveSink {
 public:
  struct Limits {
    std::size_t subscribers = 16;                           ///< one more is closed at once
    std::size_t queue_bytes = std::size_t{2} << 20U;        ///< of each subscriber: some 25 s at 1 kHz
    std::size_t handed_over_bytes = std::size_t{2} << 20U;  ///< blocks on the way to the thread in run()
  };

  /// Binds and listens. Throws std::runtime_error (unix_listener.hpp). Whom `may_see` does not want is closed at once;
  /// without it everybody is served who may open the socket.
  SampleServer(const std::filesystem::path& socket_path, unsigned mode, std::string rig, std::int64_t epoch_unix_us,
               const Limits& limits, std::function<bool(const Peer&)> may_see = {});
  ~SampleServer() override;

  /// Serves until stop().
  void run();
  void stop();
  /// Takes the socket file away: for a process that leaves without its destructors.
  void unlink() noexcept;

  void on_event(const EventRecord& record) override;
  void on_frame(const FrameRecord& record) override;
  void on_pressure(const PressureRecord& record) override;
  void on_control(const ControlRecord& record) override;
  void on_exchange(const ExchangeRecord&) override {}  // for who maps clocks again: LCM and the recording have them
  void on_sync(const SyncRecord&) override {}
  void end_of_turn(std::size_t dropped, std::int64_t now_ns) override;

 private:
  struct Impl;
  class Subscriber;
  std::unique_ptr<Impl> impl_;
};

}  // namespace isorig::daemon
