#pragma once
#include <cstdint>
#include <cstring>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

namespace isorig::system_test {

/// What kill_victim writes of each write and sync of a segment, and of each sync of their folder; of a write its bytes
/// follow. kNames: the names of all segments up to `segment` are on the disk.
struct TraceEntry {
  enum class Kind : std::int32_t { kWrite, kSync, kNames };
  Kind kind = Kind::kWrite;
  std::int32_t segment = 0;
  std::int64_t rig_ns = 0;
  std::uint64_t offset = 0;
  std::uint64_t size = 0;
};

struct Traced {
  TraceEntry entry;
  std::string_view bytes;
};

/// Views into `trace`.
inline std::vector<Traced> read_trace(std::string_view trace) {
  std::vector<Traced> all;
  while (!trace.empty()) {
    TraceEntry entry;
    if (trace.size() < sizeof entry) throw std::runtime_error("the trace is cut");
    std::memcpy(&entry, trace.data(), sizeof entry);
    trace.remove_prefix(sizeof entry);
    if (trace.size() < entry.size) throw std::runtime_error("the trace is cut");
    all.push_back({entry, trace.substr(0, entry.size)});
    trace.remove_prefix(entry.size);
  }
  return all;
}

}  // namespace isorig::system_test
