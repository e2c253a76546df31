#pragma once
#include <cstdint>

#include "base/spsc_queue.hpp"
#include "daemon/core/records.hpp"

namespace isorig::daemon {

/// A queue whose next record may be looked at.
template <typename Record>
class PeekedQueue {
 public:
  /// Calls take(record) for everything stamped before `end`.
  template <typename Take>
  void until(base::SpscQueue<Record>& queue, std::int64_t end, Take take) {
    while (waiting_ || queue.pop(next_)) {
      waiting_ = true;
      if (stamp(next_) >= end) return;
      waiting_ = false;
      take(next_);
    }
  }

  [[nodiscard]] bool has_more(const base::SpscQueue<Record>& queue) const noexcept {
    return waiting_ || queue.size() > 0;
  }

 private:
  static std::int64_t stamp(const ControlRecord& r) { return r.mono_ns; }
  static std::int64_t stamp(const EventRecord& r) { return r.mono_ns; }
  static std::int64_t stamp(const SyncRecord& r) { return r.mono_ns; }
  static std::int64_t stamp(const ExchangeRecord& r) { return r.exchange.host_recv_ns; }
  Record next_{};
  bool waiting_ = false;
};

}  // namespace isorig::daemon
