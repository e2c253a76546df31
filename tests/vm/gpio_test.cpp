// The GPIO driver against a real kernel's chip. Times are compared in order only: the processor is emulated.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <csignal>
#include <memory>

#include "drivers/clock/real_clock.hpp"
#include "drivers/interlock/gpio_interlock.hpp"
#include "tests/vm/gpio_sim.hpp"

namespace isorig::interlock {
namespace {

using drivers::DeviceError;
using drivers::Fault;
using ::testing::HasSubstr;

constexpr std::size_t kEstop = 0, kGuard = 1, kVent = 2, kSync = 3;
const std::vector<std::string> kLines{"ESTOP", "GUARD", "VENT", "SYNC"};
constexpr std::int64_t kClosing_ns = 300'000'000;  // far more than this machine takes between two calls

GpioInterlock::Options options() {
  GpioInterlock::Options o;
  o.chip = "isorig-chain";
  o.estop = {"ESTOP", false, Bias::kAsIs};
  o.guard = GpioLine{"GUARD", false, Bias::kAsIs};
  o.vent_valve = GpioLine{"VENT", false, Bias::kAsIs};
  o.sync = GpioLine{"3", false, Bias::kAsIs};  // by its offset
  o.closing_ns = kClosing_ns;
  return o;
}

class GpioOnKernel : public ::testing::Test {
 protected:
  GpioOnKernel() { plug(); }

  void plug() {
    chip = std::make_unique<test::GpioSim>("chain", "isorig-chain", kLines);
    chip->drive(kEstop, true);
    chip->drive(kGuard, true);
  }
  void connect() {
    device.connect();
    device.read();
    pass(kClosing_ns);
    ASSERT_TRUE(device.read().estop_closed);
  }
  void pass(std::int64_t ns) { clock.sleep_until_ns(clock.now_ns() + ns); }
  template <class Call>
  DeviceError error_of(Call call) {
    try {
      call();
    } catch (const DeviceError& error) {
      return error;
    }
    ADD_FAILURE() << "no error";
    return {Fault::kTimeout, "none"};
  }

  clock::RealClock clock;
  std::unique_ptr<test::GpioSim> chip;
  GpioInterlock device{options(), clock};
};

TEST_F(GpioOnKernel, AnOpeningActsAtOnceAndAClosingLate) {
  device.connect();
  EXPECT_FALSE(device.read().estop_closed) << "closed before it was seen closed for long enough";
  pass(kClosing_ns);
  State state = device.read();
  EXPECT_TRUE(state.estop_closed && state.guard_closed);

  const std::int64_t before_ns = clock.now_ns();
  chip->drive(kEstop, false);
  ASSERT_TRUE(device.wait(1'000'000'000));
  state = device.read();
  EXPECT_FALSE(state.estop_closed);
  EXPECT_TRUE(state.guard_closed);
  EXPECT_EQ(device.stamp_clock(), StampClock::Kind::kMonotonic);
  EXPECT_GT(state.estop_opened_ns, before_ns);
  EXPECT_LT(state.estop_opened_ns, state.mono_ns);

  chip->drive(kEstop, true);
  EXPECT_FALSE(device.read().estop_closed);
  pass(kClosing_ns);
  EXPECT_TRUE(device.read().estop_closed);
}

TEST_F(GpioOnKernel, ABouncingContactIsOpenUntilItIsQuiet) {
  connect();
  for (int i = 0; i < 6; ++i) {
    chip->drive(kEstop, i % 2 == 1);
    EXPECT_FALSE(device.read().estop_closed);
  }
  EXPECT_EQ(device.estop().openings(), 3U);
  pass(kClosing_ns);
  EXPECT_TRUE(device.read().estop_closed);
}

TEST_F(GpioOnKernel, AnOpeningBetweenTwoReadsIsNotMissed) {
  connect();
  chip->drive(kGuard, false);
  chip->drive(kGuard, true);
  EXPECT_FALSE(device.read().guard_closed);
}

TEST_F(GpioOnKernel, ABurstThatOverflowsTheKernelsQueueEndsOnTheLevel) {
  connect();
  for (int i = 0; i < 101; ++i) chip->drive(kEstop, i % 2 == 1);  // ends low: open
  State state = device.read();
  EXPECT_FALSE(state.estop_closed);
  EXPECT_GE(device.counters().lost_edges, 1U);
  EXPECT_LT(device.counters().edges, 101U);
  pass(kClosing_ns);
  EXPECT_FALSE(device.read().estop_closed);

  for (int i = 0; i < 101; ++i) chip->drive(kEstop, i % 2 == 0);  // ends high: closed
  EXPECT_FALSE(device.read().estop_closed);
  pass(kClosing_ns);
  EXPECT_TRUE(device.read().estop_closed);
  std::printf("202 edges: %u came, %u lost or full queues, %u resynchronised\n", device.counters().edges,
              device.counters().lost_edges, device.counters().resynchronised);
}

TEST_F(GpioOnKernel, ALineHeldBySomeoneElseIsNamedWithItsHolder) {
  GpioInterlock::Options other = options();
  other.consumer = "somebody-else";
  other.estop.line = "SYNC";
  other.guard.reset();
  other.sync.reset();
  other.vent_valve.reset();
  GpioInterlock holder(other, clock);
  holder.connect();
  const DeviceError error = error_of([&] { device.connect(); });
  EXPECT_EQ(error.fault(), Fault::kRefused);
  EXPECT_THAT(error.what(), HasSubstr("held by \"somebody-else\""));
  holder.disconnect();
  EXPECT_NO_THROW(device.connect());
}

TEST_F(GpioOnKernel, SaysWhichLineOrChipIsMissing) {
  GpioInterlock::Options wrong = options();
  wrong.guard->line = "DOOR";
  const DeviceError line = error_of([&] { GpioInterlock(wrong, clock).connect(); });
  EXPECT_EQ(line.fault(), Fault::kIdentity);
  EXPECT_THAT(line.what(), HasSubstr("no line \"DOOR\""));
  wrong.chip = "elsewhere";
  const DeviceError missing = error_of([&] { GpioInterlock(wrong, clock).connect(); });
  EXPECT_EQ(missing.fault(), Fault::kDisconnected);
  EXPECT_THAT(missing.what(), HasSubstr("isorig-chain"));
}

TEST_F(GpioOnKernel, TwoChipsOfOneLabelAreRefused) {
  test::GpioSim twin("twin", "isorig-chain", kLines);
  EXPECT_EQ(error_of([&] { device.connect(); }).fault(), Fault::kIdentity);
}

TEST_F(GpioOnKernel, AChipThatVanishesIsFoundAgainUnderAnotherNumber) {
  connect();
  device.hold_pressure(true);
  const std::string before = chip->chip();
  chip->unplug();
  EXPECT_TRUE(device.wait(1'000'000'000)) << "the wait goes on";
  EXPECT_EQ(error_of([&] { device.read(); }).fault(), Fault::kDisconnected);
  EXPECT_EQ(error_of([&] { device.hold_pressure(false); }).fault(), Fault::kDisconnected);
  device.disconnect();
  EXPECT_EQ(error_of([&] { device.connect(); }).fault(), Fault::kDisconnected);

  chip.reset();
  test::GpioSim in_its_place("other", "another-chip", kLines);
  plug();
  EXPECT_NE(chip->chip(), before);
  connect();
  EXPECT_FALSE(chip->value(kVent)) << "a new connection begins de-energised";
}

TEST_F(GpioOnKernel, TheValveVentsWhenTheProcessIsKilled) {
  int ready[2];
  ASSERT_EQ(pipe(ready), 0);
  const pid_t child = fork();
  if (child == 0) {
    GpioInterlock holder(options(), clock);
    holder.connect();
    holder.hold_pressure(true);
    (void)!write(ready[1], "x", 1);
    for (;;) pause();
  }
  char byte = 0;
  ASSERT_EQ(read(ready[0], &byte, 1), 1);
  EXPECT_TRUE(chip->value(kVent));
  kill(child, SIGKILL);
  waitpid(child, nullptr, 0);
  EXPECT_FALSE(chip->value(kVent));
  close(ready[0]);
  close(ready[1]);
}

TEST_F(GpioOnKernel, TheValveFollowsAndIsReleasedVenting) {
  connect();
  device.hold_pressure(true);
  EXPECT_TRUE(chip->value(kVent));
  device.hold_pressure(false);
  EXPECT_FALSE(chip->value(kVent));
  device.hold_pressure(true);
  device.disconnect();
  EXPECT_FALSE(chip->value(kVent));
}

TEST_F(GpioOnKernel, SyncEdgesComeInOrderWithTheirPolarity) {
  connect();
  const std::int64_t before_ns = clock.now_ns();
  chip->drive(kSync, true);
  chip->drive(kSync, false);
  chip->drive(kSync, true);
  device.read();
  std::array<SyncLineEdge, 8> edges;
  ASSERT_EQ(device.take_sync_edges(edges), 3U);
  EXPECT_TRUE(std::is_sorted(edges.begin(), edges.begin() + 3,
                             [](const auto& a, const auto& b) { return a.mono_ns < b.mono_ns; }));
  EXPECT_GT(edges[0].mono_ns, before_ns);
  EXPECT_TRUE(edges[2].rising);
  EXPECT_EQ(device.take_sync_edges(edges), 0U);
}

TEST_F(GpioOnKernel, AClosedContactMayPullTheLineLow) {
  GpioInterlock::Options low = options();
  low.estop = {"ESTOP", true, Bias::kPullUp};
  low.closing_ns = 0;
  GpioInterlock inverted(low, clock);
  inverted.connect();
  EXPECT_FALSE(inverted.read().estop_closed) << "a broken wire is pulled up: open";
  chip->drive(kEstop, false);
  EXPECT_TRUE(inverted.read().estop_closed);
  chip->drive(kEstop, true);
  EXPECT_FALSE(inverted.read().estop_closed);
}

}  // namespace
}  // namespace isorig::interlock
