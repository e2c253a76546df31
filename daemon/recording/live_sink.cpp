#include "daemon/recording/live_sink.hpp"

namespace isorig::daemon {
namespace {

template <typename Record>
void drain(base::SpscQueue<Record>& queue, std::initializer_list<LiveSink*> sinks,
           void (LiveSink::*take)(const Record&)) {
  Record record;
  while (queue.pop(record)) {
    for (auto* sink : sinks) (sink->*take)(record);
  }
}

}  // namespace

void drain_live(Streams& streams, std::int64_t now_ns, std::initializer_list<LiveSink*> sinks) {
  drain(streams.events, sinks, &LiveSink::on_event);
  drain(streams.frame, sinks, &LiveSink::on_frame);
  drain(streams.pressure, sinks, &LiveSink::on_pressure);
  drain(streams.control, sinks, &LiveSink::on_control);
  drain(streams.exchanges, sinks, &LiveSink::on_exchange);
  drain(streams.sync, sinks, &LiveSink::on_sync);
  for (auto* sink : sinks) sink->end_of_turn(streams.dropped(), now_ns);
}

}  // namespace isorig::daemon
