#include "messages/elvh.hpp"

#include <gtest/gtest.h>

#include <iomanip>
#include <ostream>

namespace isorig::messages {
namespace {

constexpr uint32_t word(uint32_t status, uint32_t pressure_raw, uint32_t temperature_raw) {
  return status << 30U | pressure_raw << 16U | temperature_raw << 5U;
}

TEST(Elvh, TransferFunctionIsOptionA) {
  struct Row {
    uint16_t raw;
    double psi;
  };
  // DS-0376 p. 6: offset 1638, span 13108 counts, 30 psi. The second row is what a decoder that reads the
  // wrong letter of the part number would call 0 psi; at rest it would show 1638/16384*30 = 3.0 psi.
  for (const Row& row : {Row{1638, 0.0}, Row{0, -3.748855660665243}, Row{14746, 30.0}, Row{1639, 0.0022886786},
                         Row{8192, 15.0}, Row{16383, 33.7465669820}, Row{10377, 20.0007628929}}) {
    EXPECT_NEAR(elvh_pressure_psi(row.raw), row.psi, 1e-9) << row.raw;
  }
  EXPECT_NEAR(kElvhPsiPerCount * 6894.757, 15.78, 0.005);  // Pa per count
}

TEST(Elvh, TemperatureIsElevenBit) {
  EXPECT_DOUBLE_EQ(elvh_temperature_c(0), -50.0);
  EXPECT_DOUBLE_EQ(elvh_temperature_c(2047), 150.0);
  EXPECT_NEAR(elvh_temperature_c(768), 25.0366, 1e-4);
}

TEST(Elvh, UnpacksFieldsAndMasksFiller) {
  const uint32_t filler = 0x1F;
  const ElvhWord unpacked = unpack_elvh(word(2, 0x2AAA, 0x555) | filler);
  EXPECT_EQ(unpacked.status, ElvhStatus::kStale);
  EXPECT_EQ(unpacked.pressure_raw, 0x2AAA);
  EXPECT_EQ(unpacked.temperature_raw, 0x555);
  EXPECT_EQ(pack_elvh(unpacked), word(2, 0x2AAA, 0x555));
  EXPECT_EQ(unpack_elvh(word(0, 0, 0)).status, ElvhStatus::kCurrent);
  EXPECT_EQ(unpack_elvh(word(1, 0, 0)).status, ElvhStatus::kReserved);
  EXPECT_EQ(unpack_elvh(word(3, 0, 0)).status, ElvhStatus::kFault);
}

TEST(Elvh, EncodeInvertsDecodeForEveryCount) {
  for (uint32_t raw = 0; raw <= kElvhMaxPressureRaw; ++raw) {
    const auto temperature_raw = static_cast<uint16_t>(raw & kElvhMaxTemperatureRaw);
    const uint32_t encoded =
        encode_elvh(elvh_pressure_psi(static_cast<uint16_t>(raw)), elvh_temperature_c(temperature_raw));
    ASSERT_EQ(encoded, word(0, raw, temperature_raw));
  }
}

TEST(Elvh, EncodeSaturates) {
  EXPECT_EQ(encode_elvh(-100.0, -100.0), word(0, 0, 0));
  EXPECT_EQ(encode_elvh(100.0, 500.0, ElvhStatus::kFault), word(3, 0x3FFF, 0x7FF));
  EXPECT_EQ(encode_elvh(__builtin_nan(""), __builtin_nan("")), word(0, 0, 0));
}

TEST(ElvhMonitor, HealthyStreamWithSingleStaleWordsIsPlausible) {
  ElvhMonitor monitor;
  for (int i = 0; i < 20'000; ++i) {
    const bool is_stale = i % 3 == 2;  // polled faster than it converts
    const uint32_t raw = 10'377 + (i / 3) % 2;
    const ElvhReading reading = monitor.update(word(is_stale ? 2 : 0, raw, 768), i * 1000);
    ASSERT_TRUE(reading.plausible()) << i << " issues " << reading.issues;
    ASSERT_EQ(reading.fresh, !is_stale);
  }
}

struct SingleWord {
  uint32_t raw_word;
  uint16_t issues;
};

void PrintTo(const SingleWord& word, std::ostream* out) {
  *out << std::hex << std::setw(8) << std::setfill('0') << word.raw_word;
}

class ElvhSingleWord : public testing::TestWithParam<SingleWord> {};

TEST_P(ElvhSingleWord, IsJudged) {
  ElvhMonitor monitor;
  EXPECT_EQ(monitor.update(GetParam().raw_word, 0).issues, GetParam().issues);
}

INSTANTIATE_TEST_SUITE_P(
    Traps, ElvhSingleWord,
    testing::Values(
        // MISO low reads as "current, no errors".
        SingleWord{0x00000000, kElvhBusLow | kElvhBelowRange | kElvhTemperature},
        SingleWord{0xFFFFFFFF, kElvhFaultStatus | kElvhBusHigh | kElvhAboveRange | kElvhTemperature},
        SingleWord{word(0, 1638 - 262, 768), 0}, SingleWord{word(0, 1638 - 263, 768), kElvhBelowRange},
        SingleWord{word(0, 14746 + 262, 768), 0}, SingleWord{word(0, 14746 + 263, 768), kElvhAboveRange},
        SingleWord{word(1, 8192, 768), kElvhReservedStatus}, SingleWord{word(3, 8192, 768), kElvhFaultStatus},
        SingleWord{word(2, 8192, 768), 0},
        // A 2-byte read whose second half the firmware left at zero.
        SingleWord{word(0, 8192, 0), kElvhTemperature}));

TEST(ElvhMonitor, StuckAfterItsRunOnly) {
  ElvhMonitor::Options options;
  options.stuck_run = 100;
  ASSERT_TRUE(options.valid());
  ElvhMonitor monitor(options);
  for (int i = 0; i < 99; ++i) ASSERT_EQ(monitor.update(word(0, 5000, 768), i * 1000).issues, 0) << i;
  EXPECT_EQ(monitor.update(word(0, 5000, 768), 99'000).issues, kElvhStuck);
  // Stale words repeat the count by design and are no evidence either way.
  EXPECT_EQ(monitor.update(word(2, 5000, 768), 100'000).issues, kElvhStuck);
  EXPECT_EQ(monitor.update(word(0, 5001, 768), 101'000).issues, 0);
}

TEST(ElvhMonitor, StuckAtOnceWhileAValveMovesThePressure) {
  ElvhMonitor monitor;  // a quarter of a psi
  int64_t us = 0;
  const auto run = [&](int milliseconds, double sure_rate_psi_s) {
    for (int i = 0; i < milliseconds; ++i) {
      if (monitor.update(word(0, 5000, 768), us += 1000, sure_rate_psi_s).issues != 0) return i;
    }
    return -1;
  };
  EXPECT_EQ(run(2000, 0.0), -1);  // at rest it may stand
  EXPECT_NEAR(run(400, 1.0), 250, 2);
  monitor.reset();
  run(200, 1.0);
  EXPECT_EQ(monitor.update(word(0, 5001, 768), us += 1000, 1.0).issues, 0);  // it moves
  EXPECT_EQ(run(200, 1.0), -1);
  EXPECT_EQ(run(100, 0.0), -1);  // the valve shut: the count has time again
  EXPECT_EQ(run(200, 1.0), -1);
}

TEST(ElvhMonitor, StaleRun) {
  ElvhMonitor monitor;
  EXPECT_EQ(monitor.update(word(0, 5000, 768), 0).issues, 0);
  for (int i = 1; i <= 9; ++i) ASSERT_EQ(monitor.update(word(2, 5000, 768), i * 1000).issues, 0);
  EXPECT_EQ(monitor.update(word(2, 5000, 768), 10'000).issues, kElvhStaleRun);
  EXPECT_EQ(monitor.update(word(0, 5001, 768), 11'000).issues, 0);
}

TEST(ElvhMonitor, RateIsJudgedOverTheGapBetweenFreshWords) {
  ElvhMonitor monitor;  // 2000 psi/s and 0.1 psi: 2.1 psi (917 counts) in 1 ms
  EXPECT_EQ(monitor.update(word(0, 5000, 768), 0).issues, 0);
  EXPECT_EQ(monitor.update(word(0, 5917, 768), 1000).issues, 0);
  EXPECT_EQ(monitor.update(word(0, 5917 + 918, 768), 2000).issues, kElvhTooFast);
  EXPECT_EQ(monitor.update(word(0, 5917, 768), 3000).issues, kElvhTooFast);
  EXPECT_EQ(monitor.update(word(0, 5917 + 918, 768), 5000).issues, 0);  // 2 ms
  EXPECT_EQ(monitor.update(word(0, 1638, 768), 5000 + ElvhMonitor::kMaxRateGap_us + 1).issues, 0);
}

TEST(ElvhMonitor, ResetForgets) {
  ElvhMonitor monitor;
  monitor.update(word(0, 1638, 768), 0);
  monitor.reset();
  EXPECT_EQ(monitor.update(word(0, 14746, 768), 1000).issues, 0);
}

TEST(ElvhMonitor, OptionsAreChecked) {
  ElvhMonitor::Options options;
  EXPECT_TRUE(options.valid());
  options.margin_counts = 2000;  // would let 0x0000 pass
  EXPECT_FALSE(options.valid());
}

}  // namespace
}  // namespace isorig::messages
