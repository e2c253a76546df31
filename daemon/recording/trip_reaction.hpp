#pragma once
#include <algorithm>
#include <cstdint>
#include <deque>
#include <nlohmann/json.hpp>

#include "daemon/core/records.hpp"

namespace isorig::daemon {

template <typename Record>
[[nodiscard]] auto first_from(const std::deque<Record>& records, std::int64_t ns) {
  return std::lower_bound(records.begin(), records.end(), ns,
                          [](const Record& r, std::int64_t at_ns) { return r.mono_ns < at_ns; });
}

/// What the plant did from a trip to `end_ns`, as far as its samples say: `reaction` of docs/formats/trip.md. The
/// records are in the order of their time and reach back before the trip. A time without samples is named and nothing
/// is concluded from it: the crosshead stood, and the air was out, when that was seen.
[[nodiscard]] nlohmann::ordered_json trip_reaction(const std::deque<FrameRecord>& frame,
                                                   const std::deque<PressureRecord>& pressure,
                                                   const std::deque<ControlRecord>& control, std::int64_t trip_ns,
                                                   std::int64_t end_ns);

}  // namespace isorig::daemon
