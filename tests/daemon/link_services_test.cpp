#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>
#include <vector>

#include "daemon/io/interlock_service.hpp"
#include "daemon/io/regulator_service.hpp"

/// The services of the devices without a clock of their own, in virtual time: what a failing device, and a loop that no
/// longer ticks, come to.
namespace isorig::daemon::test {
namespace {

using drivers::DeviceError;
using drivers::Fault;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

constexpr std::int64_t kMs = 1'000'000;

/// What fails next, and what was done.
struct Scripted {
  std::vector<std::string> done;
  const char* failing = "";  ///< the call that throws `fault`
  Fault fault = Fault::kTimeout;
  bool foreign = false;  ///< ... or something that is no DeviceError

  void call(const std::string& what) {
    if (what == failing) {
      if (foreign) throw std::runtime_error("not from a driver");
      throw DeviceError(fault, what + " failed");
    }
    done.push_back(what);
  }
};

class Chain final : public interlock::Device {
 public:
  Scripted script;
  void connect() override { script.call("connect"); }
  void disconnect() noexcept override { script.done.emplace_back("disconnect"); }
  interlock::State read() override {
    if (std::string(script.failing) == "read") script.call("read");
    return {.estop_closed = true, .guard_closed = true};
  }
  void hold_pressure(bool energise) override { script.call(energise ? "hold" : "release"); }
  [[nodiscard]] interlock::Counters counters() const noexcept override { return {.lost_edges = 7}; }
};

class InterlockServiceTest : public ::testing::Test {
 protected:
  /// Turns of 5 ms until `until_ms`; the loop ticks meanwhile, or not.
  void run(std::int64_t until_ms, bool loop_ticks = true) {
    for (; now_ms_ < until_ms; now_ms_ += 5) {
      if (loop_ticks) ++link_.loop_beat;
      service_.run_once(now_ms_ * kMs);
    }
  }
  LinkHealth health() {
    LinkHealth last;
    while (link_.health.pop(last)) {
    }
    return last;
  }

  Chain chain_;
  InterlockLink link_;
  InterlockService service_{chain_, link_};
  std::int64_t now_ms_ = 10'000;
};

TEST_F(InterlockServiceTest, ALoopThatNoLongerTicksDoesNotHoldTheValve) {
  link_.hold_pressure = true;
  run(10'100);
  EXPECT_THAT(chain_.script.done, ElementsAre("connect", "release", "hold"));
  run(10'590, false);
  EXPECT_THAT(chain_.script.done, ElementsAre("connect", "release", "hold"));
  run(10'605, false);
  EXPECT_THAT(chain_.script.done, ElementsAre("connect", "release", "hold", "release"));
  run(10'620);
  EXPECT_EQ(chain_.script.done.back(), "hold");
  EXPECT_TRUE(health().connected);
}

// Whatever the fault says: an input that was not read is an open one, from this turn on.
TEST_F(InterlockServiceTest, AnyErrorLosesTheChainAndItIsTriedAgainHalfASecondLater) {
  for (const bool foreign : {false, true}) {
    for (const Fault fault : {Fault::kRefused, Fault::kTimeout, Fault::kProtocol, Fault::kDisconnected}) {
      chain_.script = {};
      run(now_ms_ + 600);
      ASSERT_TRUE(link_.get_state().estop_closed);
      const auto before = health();
      EXPECT_TRUE(before.connected);
      EXPECT_EQ(before.lost, 7U);
      chain_.script = {{}, "read", fault, foreign};
      const auto failed_ms = now_ms_;
      run(now_ms_ + 5);
      EXPECT_TRUE(link_.get_state().lost);
      EXPECT_FALSE(link_.get_state().estop_closed);
      const auto after = health();
      EXPECT_FALSE(after.connected);
      EXPECT_EQ(after.errors, before.errors + 1);
      EXPECT_EQ(after.failed_ns, failed_ms * kMs);
      EXPECT_THAT(after.detail, HasSubstr(foreign ? "not from a driver" : "read failed"));
      chain_.script.failing = "";
      run(failed_ms + 500);
      EXPECT_THAT(chain_.script.done, ElementsAre("disconnect"));
      run(failed_ms + 510);
      EXPECT_THAT(chain_.script.done, ElementsAre("disconnect", "connect", "release"));
      EXPECT_EQ(health().reconnects, before.reconnects + 1);
    }
  }
}

TEST_F(InterlockServiceTest, AChainThatIsNotThereIsLostAtOnceAndAskedForTwiceASecond) {
  chain_.script.failing = "connect";
  run(12'000);
  EXPECT_TRUE(link_.get_state().lost);
  EXPECT_EQ(health().errors, 4U);
  EXPECT_EQ(health().reconnects, 0U);
}

TEST_F(InterlockServiceTest, ShutDownVents) {
  link_.hold_pressure = true;
  run(10'100);
  chain_.script.done.clear();
  service_.shut_down();
  EXPECT_THAT(chain_.script.done, ElementsAre("release", "disconnect"));
}

class Panel final : public pressure::Regulator {
 public:
  Scripted script;
  pressure::RegulatorState state;
  std::string connect() override {
    script.call("connect");
    return "a regulator";
  }
  void disconnect() noexcept override { script.done.emplace_back("disconnect"); }
  void regulate(float psi) override {
    script.call("regulate");
    state.setpoint_psi = psi;
    state.exhausting = false;
  }
  void exhaust() override {
    script.call("exhaust");
    state.setpoint_psi = 0.0F;
    state.exhausting = true;
  }
  pressure::RegulatorState read() override {
    if (std::string(script.failing) == "read") script.call("read");
    return state;
  }
};

class RegulatorServiceTest : public ::testing::Test {
 protected:
  void run(std::int64_t until_ms, bool loop_ticks = true) {
    for (; now_ms_ < until_ms; now_ms_ += 50) {
      if (loop_ticks) ++link_.loop_beat;
      service_.run_once(now_ms_ * kMs);
    }
  }
  LinkHealth health() {
    LinkHealth last;
    while (link_.regulator_health.pop(last)) {
    }
    return last;
  }
  /// Reports of a regulator that is out of order.
  int faults() {
    int count = 0;
    RegulatorReport report;
    while (link_.regulator_reports.pop(report)) count += report.state.faulty ? 1 : 0;
    return count;
  }

  Panel panel_;
  PressureLink link_;
  RegulatorService service_{panel_, link_};
  std::int64_t now_ms_ = 10'000;
};

TEST_F(RegulatorServiceTest, ALoopThatNoLongerTicksExhausts) {
  link_.set_command({0, 0, 12.0F});
  run(10'200);
  EXPECT_THAT(panel_.script.done, ElementsAre("connect", "regulate"));
  EXPECT_STREQ(health().identity, "a regulator");
  run(10'600, false);
  EXPECT_EQ(panel_.script.done.back(), "regulate");
  run(10'700, false);
  EXPECT_EQ(panel_.script.done.back(), "exhaust");
}

TEST_F(RegulatorServiceTest, OneMissingAnswerIsNoLostConnectionFiveAre) {
  link_.set_command({0, 0, 12.0F});
  run(10'200);
  panel_.script.failing = "read";
  run(10'400);  // four turns
  EXPECT_TRUE(health().connected);
  panel_.script.failing = "";
  run(10'450);  // an answer: counting starts again
  panel_.script.failing = "read";
  run(10'650);
  EXPECT_TRUE(health().connected);
  EXPECT_EQ(faults(), 0);
  run(10'700);  // the fifth
  const auto lost = health();
  EXPECT_FALSE(lost.connected);
  EXPECT_EQ(lost.errors, 9U);
  EXPECT_EQ(panel_.script.done.back(), "disconnect");
  panel_.script.failing = "";
  run(11'000);
  EXPECT_EQ(health().reconnects, 1U);
  EXPECT_EQ(faults(), 1) << "a run that counted on the regulator is over, however short the break was";
}

TEST_F(RegulatorServiceTest, ASetPointThatSomebodyElseChangedIsAFault) {
  link_.set_command({0, 0, 12.0F});
  run(10'200);
  faults();
  panel_.state.setpoint_psi = 3.0F;
  run(10'250);
  EXPECT_EQ(faults(), 1);
  EXPECT_EQ(panel_.script.done.back(), "exhaust");
  const auto said = health();
  EXPECT_THAT(said.detail, HasSubstr("no longer has the set-point"));
  EXPECT_TRUE(said.connected) << "a refusal leaves the connection good";
}

TEST_F(RegulatorServiceTest, ASetPointThatIsNoNumberIsAFault) {
  link_.set_command({0, 0, 12.0F});
  run(10'200);
  faults();
  panel_.state.setpoint_psi = std::numeric_limits<float>::quiet_NaN();
  run(10'250);
  EXPECT_EQ(faults(), 1);
  EXPECT_EQ(panel_.script.done.back(), "exhaust");
}

}  // namespace
}  // namespace isorig::daemon::test
