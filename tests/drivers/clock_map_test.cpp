#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <ctime>
#include <functional>
#include <random>

#include "bench/clock_scenario.hpp"
#include "drivers/clock_map/mapping.hpp"
#include "drivers/clock_map/remap.hpp"
#include "drivers/clock_map/wrap.hpp"

namespace isorig::clock {
namespace {

using bench::ClockScenario;
using bench::ClockSimulation;
using bench::ClockTruth;

struct Errors {
  double sum = 0.0, squares = 0.0, worst_us = 0.0, variances = 0.0, widest_us = 0.0;
  long n = 0, outside = 0, out_of_order = 0;
  std::int64_t last_ns = 0;
  void add(const MappedTime& mapped, std::int64_t true_ns) {
    const double error_us = static_cast<double>(mapped.mono_ns - true_ns) * 1e-3;
    sum += error_us;
    squares += error_us * error_us;
    worst_us = std::max(worst_us, std::abs(error_us));
    variances += mapped.repeatability_ns * mapped.repeatability_ns * 1e-6;
    widest_us = std::max(widest_us, mapped.bound_ns * 1e-3);
    if (!(std::abs(error_us) * 1e3 <= mapped.bound_ns)) ++outside;
    if (n > 0 && mapped.mono_ns <= last_ns) ++out_of_order;
    last_ns = mapped.mono_ns;
    ++n;
  }
  double rms_us() const { return std::sqrt(squares / static_cast<double>(n)); }
  double stated_us() const { return std::sqrt(variances / static_cast<double>(n)); }
};

struct Outcome {
  Errors start, settled, offline;
  std::uint64_t epochs = 0;
};

/// Stamps are mapped as they arrive, by exchanges whose reply has been received.
Outcome run(const ClockScenario& scenario, unsigned seed, const MapOptions& options = {}, bool arrival_known = true) {
  const auto truth = ClockSimulation(scenario, seed).run();
  DeviceClockMap map(options);
  StreamMapper mapper(map);
  Outcome out;
  std::size_t next = 0;
  std::vector<DeviceStamp> stamps;
  for (const auto& stamp : truth.stamps) {
    for (; next < truth.exchanges.size() && truth.exchanges[next].host_recv_ns <= stamp.arrival_ns; ++next) {
      EXPECT_EQ(map.add(truth.exchanges[next]), ExchangeVerdict::kAccepted);
    }
    const auto mapped = arrival_known ? mapper.map(stamp.device_us, stamp.arrival_ns) : mapper.map(stamp.device_us);
    const bool settled = stamp.true_ns >= ClockSimulation::ns(120.0);
    (settled ? out.settled : out.start).add(mapped, stamp.true_ns);
    stamps.push_back({stamp.device_us, stamp.arrival_ns});
  }
  const auto again = remap_offline(truth.exchanges, stamps, options);
  for (std::size_t i = 0; i < again.size(); ++i) out.offline.add(again[i], truth.stamps[i].true_ns);
  out.epochs = map.current().epoch;
  return out;
}

class ClockMapScenario : public ::testing::TestWithParam<unsigned> {};
INSTANTIATE_TEST_SUITE_P(Seeds, ClockMapScenario, ::testing::Values(1U, 2U, 3U, 4U, 5U, 6U));

TEST_P(ClockMapScenario, DelaysAlike) {
  const auto out = run(bench::scenario_a(), GetParam());
  EXPECT_LE(out.start.rms_us(), 40.0);
  EXPECT_LE(out.settled.rms_us(), 15.0);
  EXPECT_LE(out.settled.worst_us, 60.0);
  EXPECT_LE(out.offline.rms_us(), 8.0);
  EXPECT_EQ(out.start.outside + out.settled.outside + out.offline.outside, 0);
  EXPECT_EQ(out.start.out_of_order + out.settled.out_of_order + out.offline.out_of_order, 0);
  EXPECT_LE(out.settled.widest_us, 550.0);
  EXPECT_EQ(out.epochs, 1U);
  // The stated deviation is the real one.
  EXPECT_NEAR(out.settled.stated_us() / out.settled.rms_us(), 1.0, 0.35);
  EXPECT_NEAR(out.offline.stated_us() / out.offline.rms_us(), 1.0, 0.5);
}

TEST_P(ClockMapScenario, TailsUnlike) {
  const auto out = run(bench::scenario_b(), GetParam());
  EXPECT_LE(out.start.rms_us(), 40.0);
  EXPECT_LE(out.settled.rms_us(), 10.0);
  EXPECT_LE(out.settled.worst_us, 60.0);
  EXPECT_LE(out.offline.rms_us(), 8.0);
  EXPECT_EQ(out.start.outside + out.settled.outside + out.offline.outside, 0);
}

TEST_P(ClockMapScenario, BaseDelaysUnlikeAreInTheBoundOnly) {
  const auto out = run(bench::scenario_c(), GetParam());
  // Half the 0.2 ms by which the two base delays differ; no software can do better.
  EXPECT_NEAR(out.settled.sum / static_cast<double>(out.settled.n), 100.0, 8.0);
  EXPECT_LE(out.settled.rms_us(), 105.0);
  EXPECT_EQ(out.start.outside + out.settled.outside + out.offline.outside, 0);
}

TEST_P(ClockMapScenario, LargeSkewWholeMicrosecondsAndOtherTails) {
  for (const double skew_ppm : {-200.0, 200.0}) {
    ClockScenario s;
    s.duration_s = 900.0;
    s.skew_ppm = skew_ppm;
    s.device_resolution_us = 1.0;
    s.uniform_tails = true;
    const auto out = run(s, GetParam());
    EXPECT_LE(out.start.rms_us(), 120.0);
    EXPECT_LE(out.settled.rms_us(), 25.0);
    EXPECT_EQ(out.start.outside + out.settled.outside + out.offline.outside, 0);
    EXPECT_EQ(out.start.out_of_order + out.settled.out_of_order + out.offline.out_of_order, 0);
  }
}

TEST(ClockMap, ExtremeAsymmetryIsStillInsideTheBound) {
  ClockScenario s;
  s.duration_s = 900.0;
  s.request_base_us = 2.0;
  s.request_tail_us = 5.0;
  s.reply_base_us = 900.0;
  for (unsigned seed = 1; seed <= 3; ++seed) {
    const auto out = run(s, seed);
    EXPECT_EQ(out.start.outside + out.settled.outside + out.offline.outside, 0);
    EXPECT_GT(std::abs(out.settled.sum / static_cast<double>(out.settled.n)), 400.0) << "not asymmetric at all";
  }
}

TEST(ClockMap, CoarseDeviceStampsAreAllowedFor) {
  ClockScenario s;
  s.duration_s = 600.0;
  s.device_resolution_us = 1000.0;
  MapOptions options;
  options.device_resolution_us = 1000.0;
  const auto out = run(s, 1, options, false);
  EXPECT_EQ(out.start.outside + out.settled.outside + out.offline.outside, 0);
  EXPECT_LT(out.settled.rms_us(), 600.0);
}

TEST(ClockMap, FasterExchangesAreBetterAndStayBounded) {
  ClockScenario s;
  s.duration_s = 600.0;
  const auto slow = run(s, 3);
  s.exchange_period_s = 0.02;
  const auto fast = run(s, 3);
  EXPECT_LT(fast.settled.rms_us(), slow.settled.rms_us());
  EXPECT_EQ(fast.settled.outside, 0);
}

/// Device time = host time here, without noise: the arithmetic can be checked by hand.
Exchange plain(double host_s, double device_s, double delay_us = 250.0) {
  const auto ns = [](double s) { return static_cast<std::int64_t>(std::llround(s * 1e9)); };
  return {ns(host_s), ns(host_s) + static_cast<std::int64_t>(2e3 * delay_us), device_s * 1e6 + delay_us,
          device_s * 1e6 + delay_us};
}

TEST(ClockMap, OneExchangeGivesItsMidpoint) {
  DeviceClockMap map;
  StreamMapper mapper(map);
  EXPECT_EQ(mapper.map(0.0, 77).bound_ns, MappedTime::kUnknown) << "before any exchange";
  EXPECT_EQ(map.add(plain(100.0, 5.0)), ExchangeVerdict::kAccepted);
  const auto mapped = mapper.map(5e6 + 250.0);
  EXPECT_EQ(mapped.mono_ns, 100'000'250'000);
  EXPECT_NEAR(mapped.bound_ns, 251e3, 2.0);  // half the round trip and the resolution
  EXPECT_GT(mapped.repeatability_ns, 50e3);
}

TEST(ClockMap, ImpossibleExchangesAreRejected) {
  DeviceClockMap map;
  EXPECT_EQ(map.add({1000, 1000, 0, 0}), ExchangeVerdict::kRejected);
  EXPECT_EQ(map.add({2000, 1000, 0, 0}), ExchangeVerdict::kRejected);
  EXPECT_EQ(map.add({0, 1'000'000, 10, 5}), ExchangeVerdict::kRejected);
  EXPECT_EQ(map.add({0, 1'000'000, 10, 5000}), ExchangeVerdict::kRejected);
  EXPECT_EQ(map.add({0, 1'000'000, std::nan(""), 5}), ExchangeVerdict::kRejected);
  EXPECT_EQ(map.rejected(), 5U);
  EXPECT_EQ(map.current().epoch, 0U);
}

TEST(ClockMap, ASingleWrongExchangeIsDropped) {
  DeviceClockMap map;
  StreamMapper mapper(map);
  for (int i = 0; i < 60; ++i) EXPECT_EQ(map.add(plain(100.0 + i, 5.0 + i)), ExchangeVerdict::kAccepted);
  const auto wrong = plain(160.0, 65.1);  // 0.1 s wrong
  EXPECT_FALSE(map.agrees(wrong));
  EXPECT_EQ(map.add(wrong), ExchangeVerdict::kHeld);
  EXPECT_TRUE(map.in_doubt());
  EXPECT_TRUE(map.current().known()) << "samples are withheld for one bad exchange";
  const double bound_ns = mapper.map(65.5e6).bound_ns;
  EXPECT_GT(bound_ns, 100e6) << "which of the two is wrong is not known yet";
  EXPECT_LT(bound_ns, 102e6);
  EXPECT_EQ(map.add(plain(161.0, 66.0)), ExchangeVerdict::kAccepted);
  EXPECT_EQ(map.rejected(), 1U);
  EXPECT_EQ(map.current().epoch, 1U);
  const auto mapped = mapper.map(66.5e6);
  EXPECT_NEAR(static_cast<double>(mapped.mono_ns), 161.5e9, 1e3);
  EXPECT_LT(mapped.bound_ns, 300e3);
}

class ClockMapRestart : public ::testing::TestWithParam<double> {};
// Back to zero; and forwards by 40 min, as a restart looks behind a 32-bit counter that is extended.
INSTANTIATE_TEST_SUITE_P(Jumps, ClockMapRestart, ::testing::Values(-60.0, 2400.0));

TEST_P(ClockMapRestart, BeginsAnEpochAndStaysMonotone) {
  DeviceClockMap map;
  StreamMapper mapper(map);
  std::vector<Exchange> exchanges;
  std::vector<DeviceStamp> stamps;
  std::vector<std::int64_t> truth;
  std::int64_t last_ns = 0;
  std::vector<ExchangeVerdict> verdicts;
  for (int tick = 0; tick < 12000; ++tick) {  // 100 stamps and one exchange a second
    const double host_s = 100.0 + tick * 0.01;
    const double device_s = host_s - 40.0 + (tick >= 6030 ? GetParam() : 0.0);
    if (tick % 100 == 0) {
      exchanges.push_back(plain(host_s - 0.0005, device_s - 0.0005));
      verdicts.push_back(map.add(exchanges.back()));
    }
    const auto true_ns = static_cast<std::int64_t>(std::llround(host_s * 1e9));
    const auto mapped = mapper.map(device_s * 1e6, true_ns + 300'000);
    EXPECT_GT(mapped.mono_ns, last_ns) << tick;
    last_ns = mapped.mono_ns;
    EXPECT_NEAR(static_cast<double>(mapped.mono_ns - true_ns), 0.0, mapped.bound_ns) << tick;
    EXPECT_LE(mapped.mono_ns, true_ns + 300'000) << "stamped in the future";
    const bool in_doubt = tick >= 6030 && tick < 6200;
    EXPECT_LT(mapped.bound_ns, in_doubt ? 20e6 : 1e6) << tick;  // a sample's period, and what it took to arrive
    stamps.push_back({device_s * 1e6, true_ns + 300'000});
    truth.push_back(true_ns);
  }
  EXPECT_EQ(mapper.epoch(), 2U);
  EXPECT_EQ(verdicts[61], ExchangeVerdict::kHeld);
  EXPECT_EQ(verdicts[62], ExchangeVerdict::kRestarted);
  EXPECT_EQ(std::count(verdicts.begin(), verdicts.end(), ExchangeVerdict::kAccepted), 118);

  const auto again = remap_offline(exchanges, stamps);
  for (std::size_t i = 0; i < again.size(); ++i) {
    ASSERT_NEAR(static_cast<double>(again[i].mono_ns - truth[i]), 0.0, again[i].bound_ns) << i;
    ASSERT_LT(again[i].bound_ns, 1e6) << i;
  }
}

/// Several wrong ones in a row that agree with nothing leave the map as it is; a clock that was set does not.
TEST(ClockMap, WrongExchangesThatDoNotAgreeDoNotRestart) {
  DeviceClockMap map;
  for (int i = 0; i < 60; ++i) EXPECT_EQ(map.add(plain(100.0 + i, 5.0 + i)), ExchangeVerdict::kAccepted);
  EXPECT_EQ(map.add(plain(160.0, 65.1)), ExchangeVerdict::kHeld);
  EXPECT_EQ(map.add(plain(160.01, 65.31)), ExchangeVerdict::kHeld);
  EXPECT_EQ(map.add(plain(160.02, 64.72)), ExchangeVerdict::kHeld);
  EXPECT_EQ(map.add(plain(160.03, 65.03)), ExchangeVerdict::kAccepted);
  EXPECT_EQ(map.rejected(), 3U);
  EXPECT_EQ(map.current().epoch, 1U);
  EXPECT_EQ(map.add(plain(160.04, 65.09)), ExchangeVerdict::kHeld);
  EXPECT_EQ(map.add(plain(160.05, 65.10)), ExchangeVerdict::kRestarted);
  EXPECT_EQ(map.current().epoch, 2U);
}

/// A device that counts 1000 samples a second, in blocks of 5 as a poll brings them, whose clock is set `step_us` on.
struct StepOutcome {
  int outside = 0, backwards = 0;
  double worst_us = 0.0, widest_us = 0.0, settled_bound_us = 0.0;
  int in_doubt = 0;
};
StepOutcome step(double step_us, double exchange_every_s, bool checked, bool counted) {
  DeviceClockMap map;
  StreamMapper mapper(map);
  if (counted) mapper.set_period_us(1000.0);
  std::mt19937_64 random(3);
  std::exponential_distribution<double> tail(1.0 / 60.0);
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  std::uint32_t taken = 1;
  StepOutcome out;
  std::int64_t last_ns = 0;
  double next_exchange_s = 0.0;
  const auto device_us = [&](double host_s) {
    return host_s * 1e6 * (1.0 + 20e-6) + (host_s >= 60.0 + 0.4 ? step_us : 0.0);
  };
  for (int poll = 0; poll < 13'000; ++poll) {
    const double now_s = 0.005 * poll + 0.005;
    const auto ns = [](double s) { return 1'000'000'000'000 + static_cast<std::int64_t>(std::llround(s * 1e9)); };
    const double sent_s = now_s - 1e-6 * (20.0 + tail(random));
    const double at_s = sent_s + 1e-6 * (10.0 + 0.3 * tail(random));
    const double back_s = std::max(now_s, at_s + 5e-6);
    const Exchange e{ns(sent_s), ns(back_s), std::floor(device_us(at_s)), std::floor(device_us(at_s))};
    // As the daemon's frame thread: every poll brings an exchange, few are kept.
    const bool contradicts = checked && (!map.agrees(e) || map.in_doubt() || mapper.on_its_own());
    if (now_s < 1.0 || now_s >= next_exchange_s || contradicts || (counted && mapper.on_its_own())) {
      map.add(e);
      if (!contradicts) next_exchange_s = now_s + exchange_every_s;
    }
    for (; 1e-3 * taken < at_s; ++taken) {
      const double true_s = 1e-3 * taken + 1e-5 * uniform(random);  // the sampler's own jitter
      const auto mapped = mapper.map(std::floor(device_us(true_s)), ns(back_s), taken);
      const double error_us = 1e-3 * static_cast<double>(mapped.mono_ns - ns(true_s));
      if (mapped.mono_ns <= last_ns) ++out.backwards;
      last_ns = mapped.mono_ns;
      if (now_s < 50.0) continue;
      if (std::abs(error_us) > 1e-3 * mapped.bound_ns) ++out.outside;
      if (1e-3 * mapped.bound_ns > 2000.0) ++out.in_doubt;
      out.worst_us = std::max(out.worst_us, std::abs(error_us));
      out.widest_us = std::max(out.widest_us, 1e-3 * mapped.bound_ns);
      if (poll == 12'999) out.settled_bound_us = 1e-3 * mapped.bound_ns;
    }
  }
  return out;
}

TEST(ClockMap, NoSampleIsOutsideItsBoundWhenTheDevicesClockSteps) {
  std::printf("  step/us  exchanges        outside  worst/us  widest/us  in doubt\n");
  for (const double step_us : {-50e3, 50e3, -30e6, 30e6, -8e3, 8e3}) {
    for (const bool checked : {true, false}) {
      const auto out = step(step_us, 1.0, checked, true);
      std::printf("  %8.0f %-16s %8d %9.0f %10.0f %9d\n", step_us, checked ? "each checked" : "one a second",
                  out.outside, out.worst_us, out.widest_us, out.in_doubt);
      EXPECT_EQ(out.outside, 0) << step_us;
      EXPECT_EQ(out.backwards, 0);
      EXPECT_LT(out.worst_us, 6000.0);
      EXPECT_LT(out.in_doubt, 40) << "a step was not cleared up";
      EXPECT_LT(out.settled_bound_us, 1000.0);
    }
  }
  const auto none = step(0.0, 1.0, true, true);
  EXPECT_EQ(none.outside + none.in_doubt, 0);
}

TEST(ClockMap, AStepSmallerThanTheJitterIsFoundByTheNextExchange) {
  const auto out = step(-400.0, 1.0, true, false);
  EXPECT_EQ(out.outside, 0);
  EXPECT_EQ(out.backwards, 0);
}

TEST(ClockMap, AToldRestartForgetsAtOnce) {
  DeviceClockMap map;
  StreamMapper mapper(map);
  for (int i = 0; i < 10; ++i) map.add(plain(100.0 + i, 5.0 + i));
  map.restart();
  EXPECT_EQ(mapper.map(16e6).bound_ns, MappedTime::kUnknown);
  EXPECT_EQ(map.add(plain(111.0, 0.5)), ExchangeVerdict::kAccepted);
  EXPECT_EQ(map.current().epoch, 2U);
  EXPECT_NEAR(static_cast<double>(mapper.map(0.6e6).mono_ns), 111.1e9, 300e3);
}

TEST(ClockMap, TheBoundGrowsThroughAGapAndHolds) {
  for (unsigned seed = 1; seed <= 4; ++seed) {
    auto scenario = bench::scenario_a();
    scenario.duration_s = 2400.0;
    const auto truth = ClockSimulation(scenario, seed).run();
    DeviceClockMap map;
    StreamMapper mapper(map);
    std::size_t next = 0;
    Errors gap, after;
    double last_bound_ns = 0.0;
    for (const auto& stamp : truth.stamps) {
      for (; next < truth.exchanges.size() && truth.exchanges[next].host_recv_ns <= stamp.arrival_ns; ++next) {
        const auto at_ns = truth.exchanges[next].host_send_ns;
        const bool silent = at_ns > ClockSimulation::ns(600.0) && at_ns < ClockSimulation::ns(1800.0);
        if (!silent) {
          EXPECT_EQ(map.add(truth.exchanges[next]), ExchangeVerdict::kAccepted);
        }
      }
      const auto mapped = mapper.map(stamp.device_us, stamp.arrival_ns);
      if (stamp.true_ns > ClockSimulation::ns(602.0) && stamp.true_ns < ClockSimulation::ns(1799.0)) {
        if (gap.n > 0) {
          EXPECT_GE(mapped.bound_ns, last_bound_ns - 1e3);
        }
        gap.add(mapped, stamp.true_ns);
        last_bound_ns = mapped.bound_ns;
      } else if (stamp.true_ns > ClockSimulation::ns(1930.0)) {
        after.add(mapped, stamp.true_ns);
      }
    }
    EXPECT_EQ(gap.outside, 0);
    EXPECT_GT(gap.widest_us, 2000.0) << "20 min without an exchange cannot be as sure as one second";
    EXPECT_EQ(after.outside, 0);
    EXPECT_LE(after.rms_us(), 20.0);
    EXPECT_EQ(map.current().epoch, 1U);
  }
}

TEST(ClockMap, DenseStampsStayMonotoneAtTheirPaceWhateverTheSnapshotSays) {
  // Stamps 5 us apart through the start-up burst, when snapshots move by up to milliseconds.
  ClockScenario scenario;
  scenario.duration_s = 1.0;
  scenario.stamp_period_s = 5e-6;
  scenario.burst = 0;
  scenario.exchange_period_s = 0.02;
  scenario.spike_probability = 0.2;
  const auto truth = ClockSimulation(scenario, 5).run();
  DeviceClockMap map;
  StreamMapper mapper(map);
  std::size_t next = 0;
  std::int64_t last_ns = 0;
  double last_device_us = 0.0;
  Errors all;
  for (const auto& stamp : truth.stamps) {
    for (; next < truth.exchanges.size() && truth.exchanges[next].host_recv_ns <= stamp.true_ns; ++next) {
      map.add(truth.exchanges[next]);
    }
    if (next == 0) continue;
    const auto mapped = mapper.map(stamp.device_us);
    if (last_ns > 0) {
      const double pace = static_cast<double>(mapped.mono_ns - last_ns) / (stamp.device_us - last_device_us) * 1e-3;
      ASSERT_GT(pace, 0.49);
      ASSERT_LT(pace, 1.51);
    }
    all.add(mapped, stamp.true_ns);
    last_ns = mapped.mono_ns;
    last_device_us = stamp.device_us;
  }
  EXPECT_EQ(all.outside, 0);
  EXPECT_GT(all.n, 100000);
}

TEST(ClockMap, OlderStampsAreMappedInTheirPlace) {
  DeviceClockMap map;
  StreamMapper mapper(map);
  for (int i = 0; i < 10; ++i) map.add(plain(100.0 + i, 5.0 + i));
  const auto newest = mapper.map(14.5e6);
  const auto older = mapper.map(14.4e6);
  EXPECT_NEAR(static_cast<double>(newest.mono_ns - older.mono_ns), 0.1e9, 1e4);
  EXPECT_EQ(mapper.map(14.5e6).mono_ns, newest.mono_ns);
}

TEST(ClockMap, MappingIsQuickAndNeverThrows) {
  DeviceClockMap map;
  StreamMapper mapper(map);
  static_assert(noexcept(mapper.map(0.0)));
  for (int i = 0; i < 100; ++i) map.add(plain(100.0 + i, 5.0 + i));
  constexpr int kStamps = 200'000;
  // Of this thread: the time in which others have the processor is not the mapping's.
  const auto cpu_ns = [] {
    timespec t{};
    ::clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
    return 1e9 * static_cast<double>(t.tv_sec) + static_cast<double>(t.tv_nsec);
  };
  const double start_ns = cpu_ns();
  std::int64_t sum = 0;
  for (int i = 0; i < kStamps; ++i) sum += mapper.map(105e6 + i).mono_ns;
  const double each_ns = (cpu_ns() - start_ns) / kStamps;
  EXPECT_GT(sum, 0);
  std::printf("%.1f ns per stamp\n", each_ns);
  EXPECT_LT(each_ns, 2000.0);  // 10 ns; sanitizers allowed for
}

TEST(RemapOffline, NothingToGoBy) {
  const std::vector<DeviceStamp> stamps{{1e6, 42}};
  const auto mapped = remap_offline({}, stamps);
  ASSERT_EQ(mapped.size(), 1U);
  EXPECT_EQ(mapped[0].mono_ns, 42);
  EXPECT_EQ(mapped[0].bound_ns, MappedTime::kUnknown);
  EXPECT_TRUE(remap_offline(std::vector{plain(1.0, 1.0)}, {}).empty());
}

TEST(RemapOffline, KeepsTheOrderOfTheStampsAndOneExchangeIsEnough) {
  const std::vector<Exchange> one{plain(100.0, 5.0)};
  const std::vector<DeviceStamp> stamps{{6e6, 101'000'000'000}, {4e6, 99'000'000'000}, {5e6 + 250.0, 100'000'000'000}};
  const auto mapped = remap_offline(one, stamps);
  EXPECT_EQ(mapped[0].mono_ns, 101'000'000'000);
  EXPECT_EQ(mapped[1].mono_ns, 99'000'000'000);
  EXPECT_EQ(mapped[2].mono_ns, 100'000'250'000);
  EXPECT_GT(mapped[0].bound_ns, mapped[2].bound_ns);
}

TEST(Wander, DepartureIsTheIntegralsDeviation) {
  const Wander wander{2.0, 300.0};
  // Var D = double integral of the covariance of x(u) - x(0), summed numerically.
  for (const double s : {3.0, 60.0, 900.0}) {
    constexpr int kSteps = 400;
    const auto cov = [&](double a, double b) { return 4.0 * std::exp(-std::abs(a - b) / 300.0); };
    double variance = 0.0;
    for (int i = 0; i < kSteps; ++i) {
      for (int j = 0; j < kSteps; ++j) {
        const double u = (i + 0.5) * s / kSteps, v = (j + 0.5) * s / kSteps;
        variance += cov(u, v) - cov(u, 0) - cov(v, 0) + cov(0, 0);
      }
    }
    variance *= (s / kSteps) * (s / kSteps);
    EXPECT_NEAR(wander.departure_us(s), std::sqrt(variance), 0.003 * std::sqrt(variance)) << s;
    EXPECT_EQ(wander.departure_us(-s), wander.departure_us(s));
    EXPECT_GE(wander.largest_departure_us(s), wander.departure_us(s));
  }
}

TEST(Envelope, IsWhatCausalityAllows) {
  // Two exchanges 10 s apart, +-100 us each, no wander: the extreme lines cross between them.
  const std::vector<Interval> two{{-10.0, -100.0, -10.0, 100.0}, {0.0, -100.0, 0.0, 100.0}};
  const auto e = envelope(two, {0.0, 600.0}, 5.0, 250.0);
  ASSERT_TRUE(e.consistent);
  EXPECT_NEAR(e.high_us, 100.0, 0.01);
  EXPECT_NEAR(e.low_us, -100.0, 0.01);
  EXPECT_NEAR(e.rate_high_ppm, 20.0, 0.01);
  EXPECT_NEAR(e.rate_low_ppm, -20.0, 0.01);
  const std::vector<Interval> past{{-20.0, -100.0, -20.0, 100.0}, {-10.0, -100.0, -10.0, 100.0}};
  EXPECT_NEAR(envelope(past, {0.0, 600.0}, 5.0, 250.0).high_us, 300.0, 0.01);
  EXPECT_NEAR(envelope(past, {0.0, 600.0}, 5.0, 5.0).high_us, 150.0, 0.01) << "limited by the rate's prior";
  const std::vector<Interval> apart{{-10.0, -100.0, -10.0, 100.0}, {0.0, 4000.0, 0.0, 4100.0}};
  EXPECT_FALSE(envelope(apart, {0.0, 600.0}, 5.0, 250.0).consistent);
  EXPECT_FALSE(envelope({}, {}, 5.0, 250.0).consistent);
}

TEST(DelayFilter, KnowsItsErrorAndBeatsTheLeastRoundTrip) {
  // 30 exchanges at once with a clock that stands still: nothing but delays to find out.
  std::mt19937_64 random(11);
  std::exponential_distribution<double> tail(1.0 / 300.0);
  double squares = 0.0, stated = 0.0, simple = 0.0;
  constexpr int kTrials = 400;
  for (int trial = 0; trial < kTrials; ++trial) {
    DelayFilter filter(Wander{1e-6, 600.0});
    double least = 1e9, midpoint = 0.0;
    for (int i = 0; i < 30; ++i) {
      const Interval e{i * 1e-4, -250.0 - tail(random), i * 1e-4, 250.0 + tail(random)};
      filter.add(e);
      if (e.high_us - e.low_us < least) {
        least = e.high_us - e.low_us;
        midpoint = 0.5 * (e.high_us + e.low_us);
      }
    }
    squares += filter.state().mean[0] * filter.state().mean[0];
    stated += filter.state().covariance(0, 0);
    simple += midpoint * midpoint;
  }
  const double rms = std::sqrt(squares / kTrials);
  EXPECT_LT(rms, 12.0);
  EXPECT_LT(rms, 0.5 * std::sqrt(simple / kTrials));
  EXPECT_NEAR(std::sqrt(stated / kTrials) / rms, 1.0, 0.4);
}

TEST(WrapExtender, CountsWraps) {
  WrapExtender w;
  EXPECT_EQ(w.extend(4'294'967'000U), 4'294'967'000);
  EXPECT_EQ(w.extend(10U), 4'294'967'306);
  EXPECT_EQ(w.extend(4'294'967'200U), 4'294'967'200) << "slightly late, from before the wrap";
  EXPECT_EQ(w.extend(20U), 4'294'967'316);
  std::int64_t truth = 4'294'967'316;
  for (int i = 0; i < 100; ++i) {
    truth += 1'800'000'000;  // 30 min
    EXPECT_EQ(w.extend(static_cast<std::uint32_t>(truth)), truth);
  }
  w.restart();
  EXPECT_EQ(w.extend(5U), 5);
}

TEST(WrapExtender, TheHostCountsWrapsMissedInSilence) {
  WrapExtender w;
  EXPECT_EQ(w.extend(1000U, 0), 1000);
  std::int64_t truth_us = 1000;
  for (const std::int64_t silence_us :
       {1'000'000LL, 3'000'000'000LL, 4'294'967'296LL, 30'000'000'000LL, 86'400'000'000LL}) {
    truth_us += silence_us;
    const auto host_ns =
        static_cast<std::int64_t>(static_cast<double>(truth_us - 1000) * 1e3 * (1.0 + 200e-6)) + 400'000;
    EXPECT_EQ(w.extend(static_cast<std::uint32_t>(truth_us), host_ns), truth_us) << silence_us;
  }
  EXPECT_EQ(w.extend(static_cast<std::uint32_t>(truth_us - 50), 0) - truth_us > 0, false) << "late, not a wrap";
}

}  // namespace
}  // namespace isorig::clock
