#include "drivers/api/backoff.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <vector>

namespace isorig::drivers {
namespace {

TEST(Backoff, DoublesUpToItsCapAndStartsOverAfterSuccess) {
  Backoff backoff({.initial_ns = 50, .max_ns = 300, .factor = 2.0});
  EXPECT_TRUE(backoff.is_due(0));
  std::int64_t now_ns = 1000;
  std::vector<std::int64_t> delays_ns;
  for (int i = 0; i < 6; ++i) {
    delays_ns.push_back(backoff.failed(now_ns));
    EXPECT_FALSE(backoff.is_due(now_ns + delays_ns.back() - 1));
    now_ns += delays_ns.back();
    EXPECT_TRUE(backoff.is_due(now_ns));
    EXPECT_EQ(backoff.next_ns(), now_ns);
  }
  EXPECT_THAT(delays_ns, testing::ElementsAre(50, 100, 200, 300, 300, 300));
  EXPECT_EQ(backoff.failures(), 6U);
  backoff.reset();
  EXPECT_TRUE(backoff.is_due(0));
  EXPECT_EQ(backoff.failed(0), 50);
}

TEST(Backoff, StaysAtTheCapForEver) {
  Backoff backoff;
  for (int i = 0; i < 100'000; ++i) backoff.failed(0);
  EXPECT_EQ(backoff.failed(0), Backoff::Options{}.max_ns);
}

}  // namespace
}  // namespace isorig::drivers
