#include "base/seqlock.hpp"

#include <gtest/gtest.h>

#include <array>
#include <atomic>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <thread>
#include <vector>

namespace isorig::base {
namespace {

TEST(SeqLock, GivesBackWhatWasStored) {
  struct Mixed {
    double number;
    char text[13];  // the last word is a part of one
    bool flag;
  };
  SeqLock<Mixed> lock;
  EXPECT_EQ(lock.load().number, 0.0);
  Mixed in{2.5, "twelve chars", true};
  lock.store(in);
  const Mixed out = lock.load();
  EXPECT_EQ(out.number, 2.5);
  EXPECT_STREQ(out.text, "twelve chars");
  EXPECT_TRUE(out.flag);
  in.number = -1.0;
  lock.store(in);
  EXPECT_EQ(lock.load().number, -1.0);
}

TEST(SeqLock, OddSizesReachTheLastByte) {
  const auto whole = [](auto bytes) {
    for (std::size_t i = 0; i < bytes.size(); ++i) bytes[i] = static_cast<char>(i + 1);
    SeqLock<decltype(bytes)> lock;
    lock.store(bytes);
    EXPECT_EQ(lock.load(), bytes) << bytes.size();
  };
  whole(std::array<char, 1>{});
  whole(std::array<char, 7>{});
  whole(std::array<char, 8>{});
  whole(std::array<char, 9>{});
  whole(std::array<char, 4097>{});
}

/// A value whose every word says the same.
struct Uniform {
  std::array<std::uint64_t, 512> words;
};

TEST(SeqLockThreads, ReadersSeeWholeValuesOnlyAndNeverAnOlderOne) {
  constexpr std::uint64_t kStores = 20'000;
  SeqLock<Uniform> lock;
  std::atomic<bool> done{false};
  std::atomic<std::uint64_t> torn{0}, backwards{0}, seen_between{0}, newest{0};
  std::vector<std::thread> readers;
  for (int i = 0; i < 3; ++i) {
    readers.emplace_back([&] {
      std::uint64_t last = 0;
      for (bool more = true; more;) {
        more = !done.load(std::memory_order_acquire);
        const Uniform value = lock.load();
        for (const auto word : value.words) {
          if (word != value.words[0]) ++torn;
        }
        if (value.words[0] < last) ++backwards;
        if (value.words[0] > 0 && more) ++seen_between;
        last = value.words[0];
      }
      EXPECT_EQ(last, newest);  // what was stored last stays
    });
  }
  Uniform value{};
  std::uint64_t n = 0;
  while (n < kStores || seen_between == 0) {
    value.words.fill(++n);
    lock.store(value);
    // A reader gets its copy between two stores: from some time on there is room for it.
    if (n >= kStores) std::this_thread::sleep_for(std::chrono::microseconds(20));
  }
  newest = n;
  done.store(true, std::memory_order_release);
  for (auto& reader : readers) reader.join();
  EXPECT_EQ(torn, 0U);
  EXPECT_EQ(backwards, 0U);
}

}  // namespace
}  // namespace isorig::base
