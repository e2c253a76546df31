#include "daemon/host/event_history.hpp"

#include <algorithm>
#include <cstring>

namespace isorig::daemon {
namespace {

constexpr std::int64_t kOneEntryNs = 1'000'000'000;
/// How far back a warning looks for one of its own code: kinds that alternate are collapsed too.
constexpr std::size_t kLookBack = 32;

bool is_turning_point(const EventRecord& r) noexcept {
  return r.severity >= Severity::kProgramStop || r.from != r.to;
}

}  // namespace

bool EventHistory::add(const EventRecord& record) {
  auto& store = is_turning_point(record) ? turning_points_ : others_;
  if (&store == &others_ && record.severity == Severity::kWarning) {
    const auto end = store.rend() - static_cast<std::ptrdiff_t>(store.size() - std::min(store.size(), kLookBack));
    const auto same = std::find_if(store.rbegin(), end, [&](const Entry& e) {
      return std::strcmp(e.record.code, record.code) == 0 && record.mono_ns - e.record.mono_ns < kOneEntryNs;
    });
    if (same != end) {
      Entry grown = *same;
      store.erase(std::next(same).base());
      ++grown.count;
      grown.record.value = record.value;
      grown.number = next_++;
      store.push_back(grown);  // by number still
      return false;
    }
  }
  store.push_back({next_++, record, 1});
  if (store.size() > kept_) store.pop_front();
  return true;
}

std::vector<EventHistory::Entry> EventHistory::after(std::uint64_t number) const {
  std::vector<Entry> all;
  for (const auto* store : {&turning_points_, &others_}) {
    std::copy_if(store->begin(), store->end(), std::back_inserter(all),
                 [&](const Entry& e) { return e.number > number; });
  }
  std::sort(all.begin(), all.end(), [](const Entry& a, const Entry& b) { return a.number < b.number; });
  return all;
}

}  // namespace isorig::daemon
