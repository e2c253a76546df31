#include "firmware/cycle_clock.hpp"

#include <gtest/gtest.h>

namespace isorig::firmware {
namespace {

TEST(CycleClock, StartsAtTheCounterAndNeverLosesACycle) {
  CycleClock clock(180);
  std::uint64_t truth = 0;
  std::uint64_t state = 1;
  while (truth < (std::uint64_t{100} << 32)) {  // a hundred wraps, 40 min
    state = state * 6364136223846793005U + 1442695040888963407U;
    truth += state >> 33U;  // steps of up to half a wrap
    ASSERT_EQ(clock.advance(static_cast<std::uint32_t>(truth)), truth);
  }
}

TEST(CycleClock, TakesAStepOfJustUnderAWholeWrap) {
  CycleClock clock(180);
  EXPECT_EQ(clock.advance(5), 5U);
  EXPECT_EQ(clock.advance(4), 0x1'0000'0004U);
}

// Adding up microseconds per reading would lose the remainders: 0.5 us each at this rate, half of the time.
TEST(CycleClock, MicrosecondsDoNotDrift) {
  CycleClock clock(180);
  std::uint64_t truth = 0;
  std::uint64_t now_us = 0;
  for (int i = 0; i < 2'000'000; ++i) {
    truth += 271;  // 1.506 us
    now_us = clock.us(clock.advance(static_cast<std::uint32_t>(truth)));
    ASSERT_EQ(now_us, truth / 180);
  }
  EXPECT_EQ(now_us, 3'011'111U);
}

TEST(CycleClock, CountsADecade) {
  const CycleClock clock(180);
  constexpr std::uint64_t kDecade_us = 10ULL * 365 * 86'400 * 1'000'000;
  EXPECT_EQ(clock.us(clock.cycles(kDecade_us)), kDecade_us);
  EXPECT_EQ(clock.us(clock.cycles(kDecade_us) - 1), kDecade_us - 1);
}

}  // namespace
}  // namespace isorig::firmware
