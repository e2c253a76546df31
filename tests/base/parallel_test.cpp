#include "base/parallel.hpp"

#include <gtest/gtest.h>

#include <atomic>
#include <set>
#include <stdexcept>
#include <string>

namespace isorig::base {
namespace {

TEST(Parallel, EveryIndexOnce) {
  for (const unsigned threads : {0U, 1U, 2U, 7U}) {
    std::vector<std::atomic<int>> seen(100);
    parallel_for(seen.size(), threads, [&](std::size_t i) { ++seen[i]; });
    for (const auto& n : seen) EXPECT_EQ(n, 1);
  }
  parallel_for(0, 4, [](std::size_t) { FAIL(); });
}

TEST(Parallel, MoreThreadsThanWork) {
  std::mutex mutex;
  std::set<std::thread::id> who;
  parallel_for(3, 64, [&](std::size_t) {
    const std::lock_guard lock(mutex);
    who.insert(std::this_thread::get_id());
  });
  EXPECT_LE(who.size(), 3U);
}

// A worker's exception ended the process (std::terminate): it belongs to whoever asked for the work.
TEST(Parallel, AnExceptionReachesTheCallerAndEndsTheWork) {
  for (int round = 0; round < 50; ++round) {
    std::atomic<std::size_t> begun{0};
    try {
      parallel_for(100'000, 4, [&](std::size_t i) {
        ++begun;
        if (i >= 5) throw std::runtime_error("at " + std::to_string(i));
      });
      FAIL() << "no exception";
    } catch (const std::runtime_error& e) {
      EXPECT_STREQ(e.what(), "at 5");  // the lowest, whichever thread was first
    }
    EXPECT_LE(begun, 5U + 4U);
  }
}

TEST(Parallel, WithOneThreadToo) {
  std::size_t begun = 0;
  EXPECT_THROW(parallel_for(10, 1,
                            [&](std::size_t) {
                              ++begun;
                              throw std::logic_error("first");
                            }),
               std::logic_error);
  EXPECT_EQ(begun, 1U);
}

}  // namespace
}  // namespace isorig::base
