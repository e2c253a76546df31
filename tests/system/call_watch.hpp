#pragma once
#include <array>
#include <atomic>
#include <cstdint>

/// What call_watch.cpp, preloaded into a daemon, and the test that looks at it share: a file that both have mapped.
namespace isorig::system_test {

/// One place that did what its thread may not do. Written once, then `times` alone counts.
struct ForbiddenCall {
  std::array<char, 16> thread;
  std::array<char, 64> call;
  /// "file+0xoffset" from the caller outwards, for addr2line; empty ones at the end.
  std::array<std::array<char, 256>, 10> stack;
  std::atomic<std::uint64_t> times;
};

struct WatchedThread {
  std::array<char, 16> name;
  std::atomic<std::uint64_t> waits;  ///< how often it went to sleep as it may, while watched
  std::atomic<std::uint64_t> talks;  ///< how often it read from or wrote to its device, while watched
};

/// All zero at first.
struct CallWatch {
  static constexpr std::uint32_t kMostCalls = 256;
  std::atomic<std::uint32_t> is_on;  ///< by the test: all threads have started, and none is on its way out
  std::atomic<std::uint64_t> loop_period_ns;
  std::atomic<std::uint32_t> found;  ///< may exceed kMostCalls
  std::atomic<std::uint32_t> told;   ///< of these all is written
  std::array<ForbiddenCall, kMostCalls> calls;
  std::array<WatchedThread, 5> threads;
};

}  // namespace isorig::system_test
