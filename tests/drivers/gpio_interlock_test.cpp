// The interlock's rules in virtual time, on lines that are made up; the kernel's own lines are in tests/vm.
#include "drivers/interlock/gpio_interlock.hpp"

#include <gtest/gtest.h>
#include <time.h>

#include <array>
#include <deque>
#include <memory>

namespace isorig::interlock {
namespace {

constexpr std::int64_t kMs = 1'000'000;

TEST(StampClock, KnowsMonotonicStamps) {
  StampClock clock;
  EXPECT_EQ(clock.to_mono(5'000 * kMs, 5'001 * kMs, 1'700'000'000'000 * kMs), 5'000 * kMs);
  EXPECT_EQ(clock.kind(), StampClock::Kind::kMonotonic);
}

TEST(StampClock, CarriesRealtimeStampsOver) {
  StampClock clock;
  const std::int64_t realtime_ns = 1'700'000'000'000 * kMs;
  EXPECT_EQ(clock.to_mono(realtime_ns - 3 * kMs, 9'000 * kMs, realtime_ns), 8'997 * kMs);
  EXPECT_EQ(clock.kind(), StampClock::Kind::kRealtime);
}

TEST(StampClock, TakesNoStampOfAClockThatItDoesNotKnow) {
  StampClock clock;
  EXPECT_FALSE(clock.to_mono(77 * kMs, 9'000'000 * kMs, 1'700'000'000'000 * kMs));
  EXPECT_EQ(clock.kind(), StampClock::Kind::kForeign);
}

TEST(Contact, OpensAtOnceAndClosesLate) {
  Contact contact(50 * kMs);
  EXPECT_FALSE(contact.closed(0));
  EXPECT_FALSE(contact.level(true, 100 * kMs)) << "the first level is no contradiction";
  EXPECT_FALSE(contact.closed(149 * kMs));
  EXPECT_TRUE(contact.closed(150 * kMs));
  contact.edge(false, 200 * kMs);
  EXPECT_FALSE(contact.closed(200 * kMs));
  EXPECT_EQ(contact.opened_ns(), 200 * kMs);
}

TEST(Contact, BouncesCountFromTheLastClosing) {
  Contact contact(50 * kMs);
  contact.level(true, 0);
  for (std::int64_t t_ms = 100; t_ms < 110; ++t_ms) contact.edge(t_ms % 2 == 1, t_ms * kMs);
  EXPECT_FALSE(contact.closed(158 * kMs));
  EXPECT_TRUE(contact.closed(159 * kMs));
  EXPECT_EQ(contact.openings(), 5U);
}

TEST(Contact, TwoClosingsHaveAnOpeningBetweenThem) {
  Contact contact(50 * kMs);
  contact.level(true, 0);
  contact.edge(true, 100 * kMs);
  EXPECT_FALSE(contact.closed(149 * kMs));
  EXPECT_EQ(contact.opened_ns(), 100 * kMs);
}

TEST(Contact, TheLevelOverrulesTheLastEdge) {
  Contact contact(50 * kMs);
  contact.level(true, 0);
  contact.edge(false, 100 * kMs);
  contact.edge(true, 101 * kMs);
  EXPECT_TRUE(contact.level(false, 102 * kMs)) << "an opening was lost";
  EXPECT_FALSE(contact.closed(1000 * kMs));
  EXPECT_TRUE(contact.level(true, 1100 * kMs)) << "a closing was lost";
  EXPECT_FALSE(contact.closed(1149 * kMs));
  EXPECT_TRUE(contact.closed(1150 * kMs));
}

TEST(Contact, ANewConnectionProvesItselfAnew) {
  Contact contact(50 * kMs);
  contact.level(true, 0);
  ASSERT_TRUE(contact.closed(60 * kMs));
  contact.restart();
  contact.level(true, 100 * kMs);
  EXPECT_FALSE(contact.closed(149 * kMs));
}

/// A chip on the desk: what a test does to it, the driver sees.
struct Chip {
  std::array<bool, 3> level{true, true, false};
  std::deque<GpioEdge> edges;
  std::uint32_t lost = 0;
  bool is_there = true;
  std::optional<bool> output;
  GpioRequest request;

  void edge(std::size_t input, bool active, std::int64_t stamp_ns) {
    level[input] = active;
    edges.push_back({input, active, stamp_ns});
  }
  void require() const {
    if (!is_there) throw drivers::DeviceError(drivers::Fault::kDisconnected, "gone");
  }
};

class Port final : public GpioPort {
 public:
  explicit Port(Chip& chip) : chip_(chip) {
    chip.require();
    chip.output = false;
  }
  bool wait(std::int64_t) override { return !chip_.edges.empty(); }
  GpioEdges read_edges(std::span<GpioEdge> out) override {
    chip_.require();
    GpioEdges taken{0, std::exchange(chip_.lost, 0U)};
    for (; taken.count < std::min(out.size(), kGpioQueue) && !chip_.edges.empty(); chip_.edges.pop_front()) {
      out[taken.count++] = chip_.edges.front();
    }
    return taken;
  }
  bool level(std::size_t input) override {
    chip_.require();
    return chip_.level[input];
  }
  void set_output(bool active) override {
    chip_.require();
    chip_.output = active;
  }

 private:
  Chip& chip_;
};

class GpioOnDesk : public ::testing::Test {
 protected:
  GpioOnDesk()
      : device(options(), clock, [this](const GpioRequest& request) {
          chip.request = request;
          return std::make_unique<Port>(chip);
        }) {}

  static GpioInterlock::Options options() {
    GpioInterlock::Options o;
    o.chip = "desk";
    o.estop.line = "E";
    o.guard = GpioLine{"G"};
    o.sync = GpioLine{"S"};
    o.vent_valve = GpioLine{"V"};
    o.closing_ns = 50 * kMs;
    return o;
  }
  void pass(std::int64_t ms) { clock.sleep_until_ns(clock.now_ns() + ms * kMs); }
  void settle() {
    device.connect();
    device.read();
    pass(50);
    ASSERT_TRUE(device.read().estop_closed);
  }

  clock::VirtualClock clock{10'000'000 * kMs};
  Chip chip;
  GpioInterlock device;
};

TEST_F(GpioOnDesk, AsksForItsLinesAndForTheValveDeEnergised) {
  device.connect();
  ASSERT_EQ(chip.request.inputs.size(), 3U);
  EXPECT_EQ(chip.request.inputs[1].line, "G");
  EXPECT_EQ(chip.request.output->line, "V");
  EXPECT_EQ(chip.output, false);
}

TEST_F(GpioOnDesk, AStampOfTheFutureDoesNotKeepAContactOpen) {
  settle();
  chip.edge(0, false, clock.now_ns());
  chip.edge(0, true, clock.now_ns() + kMs / 2);
  EXPECT_FALSE(device.read().estop_closed);
  pass(50);
  EXPECT_TRUE(device.read().estop_closed);
}

/// This thread was away for longer than the contact takes to count as closed again.
TEST_F(GpioOnDesk, AnOpeningThatWasOverBeforeItWasReadIsToldByItsTime) {
  settle();
  const auto opened_ns = clock.now_ns();
  chip.edge(0, false, opened_ns);
  chip.edge(0, true, opened_ns + kMs);
  pass(60);
  State state = device.read();
  EXPECT_TRUE(state.estop_closed);
  EXPECT_EQ(state.estop_opened_ns, opened_ns);
  EXPECT_EQ(state.guard_opened_ns, 0) << "the other contact's is its own";
  chip.edge(1, false, clock.now_ns());
  chip.edge(1, true, clock.now_ns());
  pass(60);
  state = device.read();
  EXPECT_EQ(state.estop_opened_ns, opened_ns);
  EXPECT_GT(state.guard_opened_ns, opened_ns);
}

TEST_F(GpioOnDesk, AForeignClockLeavesTheContactsAndTakesTheSyncLine) {
  settle();
  chip.edge(2, true, 5);
  chip.edge(0, false, 6);
  const State state = device.read();
  EXPECT_FALSE(state.estop_closed);
  EXPECT_EQ(state.estop_opened_ns, clock.now_ns());
  EXPECT_EQ(state.guard_opened_ns, 0);
  std::array<SyncLineEdge, 4> edges;
  EXPECT_EQ(device.take_sync_edges(edges), 0U);
}

TEST_F(GpioOnDesk, ABurstLongerThanTheQueueIsTakenWholeAndCounted) {
  settle();
  for (int i = 0; i < 40; ++i) chip.edge(0, i % 2 == 1, clock.now_ns());
  chip.lost = 3;
  chip.level[0] = false;
  EXPECT_FALSE(device.read().estop_closed);
  EXPECT_EQ(device.counters().edges, 40U);
  EXPECT_EQ(device.counters().lost_edges, 3U);
  EXPECT_EQ(device.counters().resynchronised, 1U);
  pass(1000);
  EXPECT_FALSE(device.read().estop_closed);
}

TEST_F(GpioOnDesk, AGuardThatIsNotWiredCountsAsClosed) {
  GpioInterlock::Options o = options();
  o.guard.reset();
  GpioInterlock bare(o, clock, [this](const GpioRequest&) { return std::make_unique<Port>(chip); });
  bare.connect();
  EXPECT_TRUE(bare.read().guard_closed);
}

TEST_F(GpioOnDesk, AChipThatWentAndCameHasToCloseAnew) {
  settle();
  chip.is_there = false;
  EXPECT_THROW(device.read(), drivers::DeviceError);
  device.disconnect();
  EXPECT_THROW(device.read(), drivers::DeviceError);
  EXPECT_FALSE(device.wait(kMs));
  chip.is_there = true;
  device.connect();
  EXPECT_FALSE(device.read().estop_closed);
  pass(50);
  EXPECT_TRUE(device.read().estop_closed);
}

}  // namespace
}  // namespace isorig::interlock
