#pragma once
#include <cstddef>
#include <cstdint>
#include <deque>
#include <vector>

#include "daemon/core/records.hpp"

namespace isorig::daemon {

/// The newest events, numbered, for the API. A flood of one kind cannot push out what matters: warnings of one code
/// that follow each other within a second become one entry, and faults and transitions have a store of their own.
class EventHistory {
 public:
  struct Entry {
    std::uint64_t number = 0;  ///< of the last one in it: it is shown again when it has grown
    EventRecord record;        ///< of the first one; `value` is the last one's
    std::uint32_t count = 1;   ///< how many it stands for
  };

  /// Of each kind.
  explicit EventHistory(std::size_t kept) : kept_(kept) {}

  /// True when it is an entry of its own, and worth a line in a log.
  bool add(const EventRecord& record);
  /// What has a number above `after`, by number.
  [[nodiscard]] std::vector<Entry> after(std::uint64_t number) const;
  [[nodiscard]] std::uint64_t last_number() const noexcept { return next_ - 1; }

 private:
  std::size_t kept_;
  std::uint64_t next_ = 1;
  std::deque<Entry> turning_points_;  ///< faults and changes of state
  std::deque<Entry> others_;
};

}  // namespace isorig::daemon
