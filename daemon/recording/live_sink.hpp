#pragma once
#include <cstddef>
#include <cstdint>
#include <initializer_list>

#include "daemon/core/streams.hpp"

namespace isorig::daemon {

/// What takes every live record: LCM (publisher.hpp), the sample socket (daemon/host/sample_server.hpp). All sinks are
/// fed by the one thread that empties the publisher's queues, so none of them may wait for a client.
class LiveSink {
 public:
  virtual ~LiveSink() = default;

  virtual void on_event(const EventRecord& record) = 0;
  virtual void on_frame(const FrameRecord& record) = 0;
  virtual void on_pressure(const PressureRecord& record) = 0;
  virtual void on_control(const ControlRecord& record) = 0;
  virtual void on_exchange(const ExchangeRecord& record) = 0;
  virtual void on_sync(const SyncRecord& record) = 0;
  /// The queues are empty. `dropped`: records that these queues have lost since the start, all kinds together.
  virtual void end_of_turn(std::size_t dropped, std::int64_t now_ns) = 0;
};

/// Empties the queues into every sink, events first: who listens for one should not wait for the samples. One thread.
void drain_live(Streams& streams, std::int64_t now_ns, std::initializer_list<LiveSink*> sinks);

}  // namespace isorig::daemon
