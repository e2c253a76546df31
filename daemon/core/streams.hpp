#pragma once
#include <cstddef>

#include "base/spsc_queue.hpp"
#include "daemon/core/records.hpp"

namespace isorig::daemon {

/// The queues from the real-time core to one consumer. The recorder and the publisher have a set each, since
/// a queue has one reader; a full queue drops and counts (`dropped()`), which is itself reported as an event.
struct Streams {
  explicit Streams(std::size_t samples = 1 << 16)
      : frame(samples), pressure(samples), control(samples / 8), events(4096), exchanges(4096), sync(256) {}

  base::SpscQueue<FrameRecord> frame;
  base::SpscQueue<PressureRecord> pressure;
  base::SpscQueue<ControlRecord> control;
  base::SpscQueue<EventRecord> events;
  base::SpscQueue<ExchangeRecord> exchanges;
  base::SpscQueue<SyncRecord> sync;

  [[nodiscard]] std::size_t dropped() const noexcept {
    return frame.dropped() + pressure.dropped() + control.dropped() + events.dropped() + exchanges.dropped() +
           sync.dropped();
  }
};

}  // namespace isorig::daemon
