#pragma once
#include <algorithm>
#include <cstddef>

#include "base/spsc_queue.hpp"
#include "daemon/core/records.hpp"

namespace isorig::daemon {

/// The queues from the real-time core to one consumer. The recorder and the publisher have a set each, since
/// a queue has one reader; a full queue drops and counts (`dropped()`), which is itself reported as an event.
struct Streams {
  /// As shipped they hold 65 s of samples at 1 kHz, and of a frame that is asked 200 times a second.
  explicit Streams(std::size_t samples = 1 << 16)
      : frame(samples),
        pressure(samples),
        control(samples / 8),
        events(4096),
        exchanges(samples / 4),
        sync(samples / 32) {}

  base::SpscQueue<FrameRecord> frame;
  base::SpscQueue<PressureRecord> pressure;
  base::SpscQueue<ControlRecord> control;
  base::SpscQueue<EventRecord> events;
  base::SpscQueue<ExchangeRecord> exchanges;
  base::SpscQueue<SyncRecord> sync;

  /// The share of its capacity that the fullest queue holds, 0 to 1. For the producer, which asks at every tick.
  [[nodiscard]] double fullest() const noexcept {
    const auto share = [](const auto& queue) {
      return static_cast<double>(queue.size()) / static_cast<double>(queue.capacity());
    };
    return std::max({share(frame), share(pressure), share(control), share(events), share(exchanges), share(sync)});
  }

  [[nodiscard]] std::size_t dropped() const noexcept {
    return frame.dropped() + pressure.dropped() + control.dropped() + events.dropped() + exchanges.dropped() +
           sync.dropped();
  }
};

}  // namespace isorig::daemon
