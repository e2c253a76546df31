#include "firmware/elvh_reader.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "fake_hardware.hpp"
#include "messages/elvh.hpp"

namespace isorig::firmware {
namespace {

using Event = ElvhReader::Event;
using Kind = ElvhReader::Kind;
using Fault = SimulatedElvh::Fault;

struct Seen {
  Event event;
  std::uint64_t at_ns;         ///< the stamp
  std::uint64_t converted_ns;  ///< the truth
  std::uint32_t conversions;   ///< the truth
};

class Reader : public testing::Test {
 protected:
  Reader() { run_us(kSettle_us); }
  void connect(const SimulatedElvh& sensor) {
    hardware.sensor = sensor;
    run_us(kSettle_us);
  }
  std::vector<Seen> run_us(std::uint64_t duration_us) {
    std::vector<Seen> seen;
    const std::uint64_t end = hardware.cycles + duration_us * kCyclesPerUs;
    while (hardware.cycles < end) {
      const Event event = reader.step([this] {
        hardware.cycle_counter();
        return hardware.cycles;
      });
      hardware.cycle_counter();
      if (event.kind == Kind::kNone) continue;
      seen.push_back({event, event.at_cycles * 1000 / kCyclesPerUs, hardware.sensor.converted_ns(),
                      hardware.sensor.conversions()});
    }
    return seen;
  }
  static std::vector<Seen> only(Kind kind, std::vector<Seen> seen) {
    std::erase_if(seen, [kind](const Seen& one) { return one.event.kind != kind; });
    return seen;
  }

  static constexpr std::uint32_t kCyclesPerUs = FakeHardware::kCyclesPerUs;
  static constexpr std::uint64_t kSettle_us = 10'000;  ///< the sensor's own start, and what a stall leaves
  FakeHardware hardware;
  ElvhReader reader{{}, hardware};
};

// A word that is new was converted between two polls, and is stamped with their middle: off by half a poll
// period at most, and by what a pass of the loop takes.
TEST_F(Reader, StampsAreWithinHalfAPollPeriodOfTheConversion) {
  for (const std::uint32_t period_ns : {430'000U, 459'777U, 490'000U}) {
    connect(SimulatedElvh(period_ns));
    const auto seen = run_us(2'000'000);
    ASSERT_GT(seen.size(), 1'990'000'000 / period_ns - 2);
    double sum_us = 0.0;
    double worst_us = 0.0;
    for (std::size_t i = 1; i < seen.size(); ++i) {
      ASSERT_EQ(seen[i].event.kind, Kind::kConversion);
      ASSERT_EQ(seen[i].event.missed, 0U);
      ASSERT_EQ(seen[i].conversions, seen[i - 1].conversions + 1);
      const double error_us = 1e-3 * (static_cast<double>(seen[i].at_ns) - static_cast<double>(seen[i].converted_ns));
      sum_us += error_us;
      worst_us = std::max(worst_us, std::abs(error_us));
    }
    EXPECT_LE(worst_us, 125.0 + 2.0) << period_ns;
    EXPECT_GT(worst_us, 100.0) << "the bound is met for another reason than thought";
    EXPECT_LT(std::abs(sum_us / static_cast<double>(seen.size())), 5.0) << "the middle is unbiased";
    EXPECT_EQ(hardware.bus_violations, 0);
  }
}

TEST_F(Reader, PollsFourThousandTimesASecondAndReadsTheWholeWord) {
  hardware.sensor.set_valves(hardware.now_ns(), 1000, 0);
  hardware.reads = 0;
  const auto seen = run_us(1'000'000);
  EXPECT_NEAR(static_cast<double>(hardware.reads), 4000.0, 5.0);
  EXPECT_NEAR(static_cast<double>(seen.size()), 1e6 / 460.0, 10.0);
  for (const Seen& one : seen) {
    const messages::ElvhWord word = messages::unpack_elvh(one.event.raw_word);
    EXPECT_EQ(word.status, messages::ElvhStatus::kCurrent);
    EXPECT_EQ(word.temperature_raw, SimulatedElvh::kTemperatureRaw);
  }
  EXPECT_NEAR(messages::unpack_elvh(seen.back().event.raw_word).pressure_raw, SimulatedElvh::kSupplyRaw, 2);
}

TEST_F(Reader, MeasuresTheConversionPeriod) {
  EXPECT_EQ(reader.period_cycles(), 460U * kCyclesPerUs);
  connect(SimulatedElvh(487'300));
  run_us(1'000'000);
  EXPECT_NEAR(static_cast<double>(reader.period_cycles()) / kCyclesPerUs, 487.3, 1.0);
}

TEST_F(Reader, CountsWhatAStallMissed) {
  run_us(500'000);
  for (const std::uint64_t stall_us : {1'000U, 3'137U, 20'000U, 1'234'567U}) {
    const auto before = run_us(2'000).back();
    hardware.cycles += stall_us * kCyclesPerUs;
    const auto seen = run_us(5'000);
    ASSERT_GT(seen.size(), 8U);
    std::uint32_t counted = 0;
    for (const Seen& one : seen) {
      counted += one.event.missed;
      // The sensor holds its latest conversion, no older than a period; and never is it a report.
      EXPECT_EQ(one.event.kind, Kind::kConversion);
      EXPECT_LE(std::abs(static_cast<double>(one.at_ns) - static_cast<double>(one.converted_ns)), 232e3);
    }
    const double passed = static_cast<double>(seen.back().conversions - before.conversions);
    const double missed = passed - static_cast<double>(seen.size());
    // The phase of the last stamp is known to half a poll period, so it may be one off; and the period to 0.1
    // %.
    EXPECT_NEAR(static_cast<double>(counted), missed, 1.0 + 2e-3 * missed) << stall_us;
  }
}

TEST_F(Reader, ReportsASilentSensorWithItsLastValueAsStale) {
  run_us(100'000);
  hardware.sensor.set_fault(Fault::kSilent);
  const auto seen = run_us(100'000);
  const auto reports = only(Kind::kReport, seen);
  EXPECT_NEAR(static_cast<double>(reports.size()), 98.0, 2.0);
  EXPECT_FALSE(reader.is_healthy());
  for (const Seen& report : reports) {
    const messages::ElvhWord word = messages::unpack_elvh(report.event.raw_word);
    EXPECT_EQ(word.status, messages::ElvhStatus::kStale);
    EXPECT_EQ(word.pressure_raw, SimulatedElvh::kRestRaw);
    EXPECT_EQ(word.temperature_raw, SimulatedElvh::kTemperatureRaw) << "the word is whole";
  }
  hardware.sensor.set_fault(Fault::kNone);
  const auto after = run_us(10'000);
  EXPECT_GT(only(Kind::kConversion, after).size(), 18U);
  EXPECT_TRUE(reader.is_healthy());
}

struct Broken {
  Fault fault;
  std::uint32_t word;
};

TEST_F(Reader, ReportsLinesThatAreNoSensorOnceAMillisecond) {
  const messages::ElvhWord diagnostic{messages::ElvhStatus::kFault, SimulatedElvh::kRestRaw,
                                      SimulatedElvh::kTemperatureRaw};
  for (const Broken& broken : {Broken{Fault::kAbsent, 0xFFFFFFFFU}, Broken{Fault::kShorted, 0U},
                               Broken{Fault::kDiagnostic, messages::pack_elvh(diagnostic)}}) {
    hardware.sensor.set_fault(Fault::kNone);
    run_us(10'000);
    hardware.sensor.set_fault(broken.fault);
    run_us(2'000);
    const auto seen = run_us(100'000);
    EXPECT_EQ(only(Kind::kConversion, seen).size(), 0U);
    EXPECT_NEAR(static_cast<double>(seen.size()), 100.0, 1.0);
    for (const Seen& one : seen) EXPECT_EQ(one.event.raw_word & ~0x1FU, broken.word & ~0x1FU);
    EXPECT_FALSE(reader.is_healthy());
  }
  EXPECT_EQ(hardware.bus_violations, 0);
}

TEST_F(Reader, DoesNotBelieveAStatusThatNeverSaysStale) {
  hardware.sensor.set_fault(Fault::kStuckCurrent);
  run_us(5'000);
  const auto seen = run_us(100'000);
  EXPECT_EQ(only(Kind::kConversion, seen).size(), 0U);
  EXPECT_NEAR(static_cast<double>(seen.size()), 100.0, 1.0);
}

// Its data sheet gives the period as typical only.
TEST_F(Reader, BelievesAFastSensor) {
  connect(SimulatedElvh(300'000));
  const auto seen = run_us(1'000'000);
  EXPECT_EQ(only(Kind::kReport, seen).size(), 0U);
  EXPECT_GT(seen.size(), 3'300U);
}

TEST_F(Reader, ABusThatNeverAnswersIsReportedAndLeftAlone) {
  hardware.is_bus_dead = true;
  const auto seen = run_us(100'000);
  EXPECT_GT(seen.size(), 60U);
  for (const Seen& one : seen) {
    EXPECT_EQ(one.event.kind, Kind::kReport);
    EXPECT_EQ(one.event.raw_word, ElvhReader::kNothing);
  }
}

}  // namespace
}  // namespace isorig::firmware
