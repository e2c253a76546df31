#include "base/spsc_queue.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <cstdint>
#include <thread>

namespace isorig::base {
namespace {

TEST(SpscQueue, RoundsItsCapacityUpToAPowerOfTwo) {
  EXPECT_EQ(SpscQueue<int>(0).capacity(), 2U);
  EXPECT_EQ(SpscQueue<int>(2).capacity(), 2U);
  EXPECT_EQ(SpscQueue<int>(3).capacity(), 4U);
  EXPECT_EQ(SpscQueue<int>(1000).capacity(), 1024U);
}

TEST(SpscQueue, FirstInFirstOutAcrossManyRoundsOfTheRing) {
  SpscQueue<int> queue(4);
  int next_in = 0, next_out = 0;
  for (int round = 0; round < 1000; ++round) {
    for (int i = 0; i <= round % 4; ++i) ASSERT_TRUE(queue.push(next_in++));
    EXPECT_EQ(queue.size(), static_cast<std::size_t>(round % 4 + 1));
    int item = -1;
    while (queue.pop(item)) ASSERT_EQ(item, next_out++);
    EXPECT_EQ(queue.size(), 0U);
  }
  EXPECT_EQ(next_out, next_in);
  EXPECT_EQ(queue.dropped(), 0U);
}

TEST(SpscQueue, AFullQueueKeepsTheOldAndCountsTheNew) {
  SpscQueue<int> queue(4);
  for (int i = 0; i < 4; ++i) EXPECT_TRUE(queue.push(i));
  EXPECT_FALSE(queue.push(4));
  EXPECT_FALSE(queue.push(5));
  EXPECT_EQ(queue.dropped(), 2U);
  EXPECT_EQ(queue.size(), 4U);
  int item = -1;
  ASSERT_TRUE(queue.pop(item));
  EXPECT_EQ(item, 0);
  EXPECT_TRUE(queue.push(6)) << "one place is free again";
  for (const int wanted : {1, 2, 3, 6}) {
    ASSERT_TRUE(queue.pop(item));
    EXPECT_EQ(item, wanted);
  }
  EXPECT_FALSE(queue.pop(item));
  EXPECT_EQ(item, 6) << "an empty queue leaves the item alone";
}

TEST(SpscQueue, IsNoexcept) {
  SpscQueue<int> queue(2);
  int item = 0;
  static_assert(noexcept(queue.push(1))&& noexcept(queue.pop(item))&& noexcept(queue.size()));
  EXPECT_FALSE(queue.pop(item));
}

/// Bigger than a word, so that an item torn between two writes would show.
struct Item {
  std::uint64_t number;
  std::uint64_t square;
  std::uint64_t inverted;
};

class SpscQueueThreads : public ::testing::TestWithParam<std::size_t> {};
INSTANTIATE_TEST_SUITE_P(Capacities, SpscQueueThreads, ::testing::Values(2U, 64U, 4096U));

TEST_P(SpscQueueThreads, NothingIsLostTornOrReordered) {
  // Two slots are a switch between the threads for every second item, each a time slice long on a busy machine.
  const std::uint64_t items = GetParam() < 64 ? 5'000 : 200'000;
  SpscQueue<Item> queue(GetParam());
  std::uint64_t refused = 0;
  std::thread producer([&] {
    for (std::uint64_t i = 0; i < items; ++i) {
      while (!queue.push({i, i * i, ~i})) {
        ++refused;
        std::this_thread::yield();
      }
    }
  });
  std::uint64_t expected = 0, torn = 0, oversize = 0;
  while (expected < items) {
    Item item{};
    if (!queue.pop(item)) {
      std::this_thread::yield();
      continue;
    }
    if (item.number != expected || item.square != expected * expected || item.inverted != ~expected) ++torn;
    if (queue.size() > queue.capacity()) ++oversize;
    ++expected;
  }
  producer.join();
  EXPECT_EQ(torn, 0U);
  EXPECT_EQ(oversize, 0U);
  EXPECT_EQ(queue.dropped(), refused);
  EXPECT_EQ(queue.size(), 0U);
}

TEST_P(SpscQueueThreads, WhatIsDroppedIsCounted) {
  constexpr std::uint64_t kItems = 100'000;
  SpscQueue<std::uint64_t> queue(GetParam());
  std::atomic<bool> done{false};
  std::thread producer([&] {
    for (std::uint64_t i = 1; i <= kItems; ++i) queue.push(i);
    done.store(true, std::memory_order_release);
  });
  std::uint64_t received = 0, last = 0, disorder = 0;
  const auto drain = [&] {
    std::uint64_t item = 0;
    while (queue.pop(item)) {
      if (item <= last) ++disorder;
      last = item;
      ++received;
    }
  };
  while (!done.load(std::memory_order_acquire)) {
    drain();
    // An observer's view stays sane while both ends move.
    if (queue.size() > queue.capacity()) ++disorder;
  }
  drain();
  producer.join();
  EXPECT_EQ(disorder, 0U);
  EXPECT_EQ(received + queue.dropped(), kItems);
}

TEST(SpscQueueThreads, SizeIsSaneForAThirdThread) {
  SpscQueue<int> queue(8);
  std::atomic<bool> done{false};
  std::thread producer([&] {
    while (!done.load(std::memory_order_relaxed)) queue.push(1);
  });
  std::thread consumer([&] {
    int item = 0;
    while (!done.load(std::memory_order_relaxed)) static_cast<void>(queue.pop(item));
  });
  std::size_t largest = 0;
  for (int i = 0; i < 200'000; ++i) largest = std::max(largest, queue.size());
  done.store(true);
  producer.join();
  consumer.join();
  EXPECT_LE(largest, queue.capacity());
}

}  // namespace
}  // namespace isorig::base
