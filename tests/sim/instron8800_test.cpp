// The 8800 driver against the emulated controller with the simulated rig behind it, over TCP and a pseudo-terminal.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "instron8800_rig.hpp"

namespace isorig::sim {
namespace {

using drivers::DeviceError;
using drivers::Fault;
using frame::Motion;
using ::testing::HasSubstr;

class Instron8800 : public Instron8800Rig, public ::testing::WithParamInterface<bool> {
 protected:
  Instron8800() { tcp_ = GetParam(); }
};

/// What does not depend on what carries the lines.
class Instron8800Condition : public Instron8800 {};

TEST_P(Instron8800, ConnectsTakesControlAndSwitchesTheWatchdogOn) {
  const auto identity = frame_->connect();
  EXPECT_EQ(identity.maker, "Instron");
  EXPECT_GT(identity.sample_rate_hz, 50.0);
  EXPECT_FALSE(faults_.panel.load());
  EXPECT_FALSE(faults_.watchdog_off.load());
  run_for(1.0);  // every question about the controller's condition has its turn
  EXPECT_TRUE(takes(50));
  EXPECT_THAT(faults_seen_, ::testing::IsEmpty()) << last_what_;
  EXPECT_EQ(state_.fault_bits, 0);
  for (std::size_t i = 1; i < taken_.size(); ++i) {
    EXPECT_EQ(taken_[i].sequence, taken_[i - 1].sequence + 1);
    EXPECT_GT(taken_[i].device_us, taken_[i - 1].device_us);
  }
  EXPECT_TRUE(takes(taken_.size()));  // a sample ends a poll: no question is out
  frame_->disconnect();
  EXPECT_TRUE(until([&] { return faults_.panel.load(); }));  // handed back, in order
  EXPECT_FALSE(faults_.actuator_off.load());
}

TEST_P(Instron8800, EverySampleLiesWithinItsBoundOfTheRamp) {
  frame_->connect();
  turn();
  frame_->start_segment({1, 4.0F, 5.0F});
  EXPECT_TRUE(until([&] { return state_.motion == Motion::kReached; }));
  EXPECT_NEAR(true_mm(), 4.0, 0.01);
  EXPECT_EQ(state_.segment_id, 1);
  EXPECT_NEAR(state_.target_mm, 4.0, 1e-3);
  EXPECT_NEAR(state_.velocity_mm_s, 5.0, 5e-3);
  std::size_t compared = 0;
  double worst_mm = 0.0, worst_bound_us = 0.0;
  for (std::size_t i = 1; i + 1 < taken_.size(); ++i) {
    const auto& s = taken_[i];
    const auto apart_us = taken_[i + 1].device_us - taken_[i - 1].device_us;
    if (apart_us > 12'000) continue;  // this thread was not there
    const double error_mm = std::abs(double{s.position_mm} - plant_at(s).position_mm);
    // 0.2 um of noise, and the curve between two positions: 600 mm/s^2.
    EXPECT_LT(error_mm,
              0.0015 + 5.5e-6 * double{s.bound_us} + 600.0 * std::pow(1e-6 * static_cast<double>(apart_us), 2) / 8.0);
    worst_mm = std::max(worst_mm, error_mm);
    worst_bound_us = std::max(worst_bound_us, double{s.bound_us});
    ++compared;
  }
  EXPECT_GT(compared, 30U);
  const auto at = [&](double mm) {
    return std::find_if(truth_.begin(), truth_.end(), [&](const Truth& t) { return t.position_mm >= mm; })->mono_ns;
  };
  const double plant_s = 1e-9 * static_cast<double>(at(3.9) - at(0.1));
  EXPECT_NEAR(plant_s, 3.8 / 5.0, 0.02);
  std::printf(
      "  %zu samples compared on a 5 mm/s ramp: worst %.4f mm, worst bound %.0f us; 3.8 mm took the plant %.3f s\n",
      compared, worst_mm, worst_bound_us, plant_s);
}

/// In the daemon one thread starts, polls and beats, in this order: a start that takes long withholds the heartbeat.
TEST_P(Instron8800Condition, ItsOwnBlockingIsNoMissedHeartbeat) {
  config_.heartbeat_timeout_ms = kShort_ms;
  start();
  frame_->connect();
  faults_.delay_ms = 120;  // of a dozen questions
  frame_->heartbeat(++beat_);
  beating_ = false;
  const auto began_ns = clock_.now_ns();
  frame_->start_segment({1, 10.0F, 0.5F});
  ASSERT_GT(clock_.now_ns() - began_ns, kShort_ms * std::int64_t{1'000'000});
  turn();
  EXPECT_EQ(state_.fault_bits & frame::kHeartbeatLost, 0);
  EXPECT_EQ(state_.motion, Motion::kMoving);
  // Likewise a stop, during which the daemon sends none on purpose.
  const auto stop_ns = clock_.now_ns();
  while (clock_.now_ns() - stop_ns < 1'500'000'000) {
    try {
      frame_->stop();
    } catch (const DeviceError&) {  // not confirmed yet
    }
    turn();
    EXPECT_EQ(state_.fault_bits & frame::kHeartbeatLost, 0);
  }
  // And then it counts.
  EXPECT_TRUE(until([&] { return (state_.fault_bits & frame::kHeartbeatLost) != 0; }, 5.0));
}

/// What ails the controller is noticed in the round that has brought a sample.
TEST_P(Instron8800Condition, AFaultCostsNoSample) {
  ASSERT_NO_FATAL_FAILURE(be_moving());
  ASSERT_TRUE(takes(20));
  faults_.limit = true;
  ASSERT_TRUE(until([&] { return !faults_seen_.empty(); }));
  EXPECT_EQ(faults_seen_.front(), Fault::kRefused);
  EXPECT_EQ(state_.fault_bits & frame::kTravelLimit, 0) << "its words come before its bit";
  turn();
  EXPECT_NE(state_.fault_bits & frame::kTravelLimit, 0);
  ASSERT_TRUE(takes(taken_.size() + 20));
  EXPECT_THAT(faults_seen_, ::testing::SizeIs(1)) << last_what_;
  for (std::size_t i = 1; i < taken_.size(); ++i) ASSERT_EQ(taken_[i].sequence, taken_[i - 1].sequence + 1);
}

TEST_P(Instron8800, AStopStopsAndIsSeen) {
  ASSERT_NO_FATAL_FAILURE(be_moving());
  frame_->stop();
  EXPECT_TRUE(stands());
  turn();
  EXPECT_EQ(state_.motion, Motion::kStopped);
  EXPECT_EQ(frame_->statistics().actuator_off_sent, 0U);
}

TEST_P(Instron8800Condition, AStopThatDoesNothingIsFollowedByActuatorOff) {
  config_.stop_confirm_ms = 500;
  start();
  ASSERT_NO_FATAL_FAILURE(be_moving());
  faults_.stop.lost = -1;
  EXPECT_THROW(frame_->stop(), DeviceError);
  EXPECT_TRUE(until([&] { return faults_.actuator_off.load(); }));
  EXPECT_TRUE(stands());
  EXPECT_EQ(frame_->statistics().actuator_off_sent, 1U);
  EXPECT_TRUE(until([&] { return (state_.fault_bits & frame::kDriveFault) != 0; }));
  EXPECT_THROW(frame_->start_segment({8, 0.0F, 0.5F}), DeviceError);
}

TEST_P(Instron8800, AShortHangLosesSamplesAndNothingElse) {
  config_.response_timeout_ms = kShort_ms;
  start();
  ASSERT_NO_FATAL_FAILURE(be_moving());
  empty_polls_ns_.clear();
  faults_.hang_ms = 2 * kShort_ms;
  EXPECT_TRUE(until([&] { return !faults_seen_.empty(); }));
  // It waited in slices of 20 ms. The middle one: some may have met a machine that stood still.
  ASSERT_FALSE(empty_polls_ns_.empty());
  std::nth_element(empty_polls_ns_.begin(),
                   empty_polls_ns_.begin() + static_cast<std::ptrdiff_t>(empty_polls_ns_.size() / 2),
                   empty_polls_ns_.end());
  EXPECT_LT(empty_polls_ns_[empty_polls_ns_.size() / 2], 150'000'000);
  taken_.clear();
  EXPECT_TRUE(takes(30)) << last_what_;
  for (const auto fault : faults_seen_) EXPECT_EQ(fault, Fault::kTimeout);
  EXPECT_EQ(state_.motion, Motion::kMoving);
  EXPECT_EQ(state_.fault_bits, 0);
  const auto link = frame_->statistics().link;
  EXPECT_GE(link.late, 1U);
  EXPECT_GE(link.resyncs, 2U);
  expect_as_the_plant(taken_);  // in step
}

TEST_P(Instron8800, AStopGoesOutWhileTheControllerHangs) {
  ASSERT_NO_FATAL_FAILURE(be_moving());
  faults_.hang_ms = 600;
  EXPECT_TRUE(until([&] { return faults_.hang_ms.load() == 0; }));  // it has begun
  frame_->stop();                                                   // confirmed when the controller is back
  EXPECT_TRUE(stands());
  EXPECT_FALSE(faults_.actuator_off.load());
}

TEST_P(Instron8800, ALateAnswerIsNeverTheNextOnes) {
  config_.response_timeout_ms = kShort_ms;
  start();
  ASSERT_NO_FATAL_FAILURE(be_moving());
  for (int i = 0; i < 3; ++i) {
    faults_seen_.clear();
    // Another one, where the machine stood still and the answer was in time for the driver after all.
    EXPECT_TRUE(until([&] {
      if (faults_.late_ms.load() == 0) faults_.late_ms = kShort_ms + 80;
      return !faults_seen_.empty();
    }));
    faults_.late_ms = 0;
    taken_.clear();
    EXPECT_TRUE(takes(10)) << last_what_;
    expect_as_the_plant(taken_);
  }
  EXPECT_GE(frame_->statistics().link.late, 3U);
}

TEST_P(Instron8800Condition, GarbageAndLinesNobodyAskedForAreThrownAway) {
  ASSERT_NO_FATAL_FAILURE(be_moving());
  faults_.garbage = 1;
  EXPECT_TRUE(until([&] { return !faults_seen_.empty(); }));
  EXPECT_EQ(faults_seen_.back(), Fault::kProtocol);
  EXPECT_THAT(last_what_, HasSubstr("#"));
  const auto resyncs = frame_->statistics().link.resyncs;
  faults_.extra = 1;
  taken_.clear();
  EXPECT_TRUE(until([&] { return frame_->statistics().link.resyncs > resyncs; }));
  EXPECT_TRUE(takes(30)) << last_what_;
  expect_as_the_plant(taken_);
}

TEST_P(Instron8800, AnAnswerThatNeverComesEndsTheConnection) {
  config_.give_up_ms = 1500;
  config_.response_timeout_ms = 1000;
  start();
  ASSERT_NO_FATAL_FAILURE(be_moving());
  faults_.drop = -1;
  EXPECT_TRUE(until([&] { return !faults_seen_.empty() && faults_seen_.back() == Fault::kDisconnected; }));
  EXPECT_THAT(last_what_, HasSubstr("the controller hangs"));
  frame_->disconnect();
  faults_.drop = 0;
  faults_seen_.clear();
  frame_->connect();
  frame_->stop();
  EXPECT_TRUE(stands());
  taken_.clear();
  EXPECT_TRUE(takes(10)) << last_what_;
}

TEST_P(Instron8800Condition, ControlThatThePanelTookIsNotTakenBack) {
  ASSERT_NO_FATAL_FAILURE(be_moving());
  faults_.panel = true;
  EXPECT_TRUE(until([&] { return (state_.fault_bits & frame::kDriveFault) != 0; }));
  EXPECT_NE(state_.motion, Motion::kMoving);
  EXPECT_TRUE(stands());
  EXPECT_THAT(last_what_, HasSubstr("panel"));
  EXPECT_NO_THROW(frame_->stop());
  EXPECT_THROW(frame_->start_segment({8, 0.0F, 0.5F}), DeviceError);
  run_for(0.8);
  EXPECT_TRUE(faults_.panel.load());
  EXPECT_FALSE(faults_.actuator_off.load());  // no command went out that would have tripped it
  faults_.panel = false;                      // given back
  EXPECT_TRUE(until([&] { return state_.fault_bits == 0; }));
}

TEST_P(Instron8800Condition, AWatchdogThatIsOffStopsAndIsSwitchedOnAgain) {
  ASSERT_NO_FATAL_FAILURE(be_moving());
  faults_.watchdog_off = true;
  EXPECT_TRUE(until([&] { return !faults_seen_.empty(); }));
  EXPECT_THAT(last_what_, HasSubstr("watchdog"));
  EXPECT_TRUE(stands());
  EXPECT_TRUE(until([&] { return state_.fault_bits == frame::kDriveFault; }));
  EXPECT_TRUE(until([&] { return state_.fault_bits == 0; }));
  EXPECT_FALSE(faults_.watchdog_off.load());
  EXPECT_EQ(state_.motion, Motion::kDisabled);
}

TEST_P(Instron8800Condition, ALoopThatIsSilentIsStopped) {
  config_.heartbeat_timeout_ms = 1000;
  start();
  ASSERT_NO_FATAL_FAILURE(be_moving());
  beating_ = false;
  EXPECT_TRUE(until([&] { return (state_.fault_bits & frame::kHeartbeatLost) != 0; }));
  EXPECT_TRUE(stands());
  EXPECT_EQ(state_.motion, Motion::kStopped);
  EXPECT_FALSE(faults_.actuator_off.load());
}

TEST_P(Instron8800Condition, ConditionsOfTheControllerAreFaults) {
  ASSERT_NO_FATAL_FAILURE(be_moving());
  faults_.limit = true;
  EXPECT_TRUE(until([&] { return state_.fault_bits == frame::kTravelLimit; }));
  EXPECT_EQ(state_.motion, Motion::kLimit);
  EXPECT_THAT(last_what_, HasSubstr("travel limit"));
  faults_.limit = false;
  EXPECT_TRUE(until([&] { return state_.fault_bits == 0; }));
  {
    const auto visit = rig_->enter();
    rig_->interlock().estop_closed = false;
  }
  EXPECT_TRUE(until([&] { return state_.fault_bits == frame::kInterlockOpen; }));
  EXPECT_THAT(last_what_, HasSubstr("emergency stop"));
}

TEST_P(Instron8800Condition, ARampThatTheControllerChangesIsNotStarted) {
  frame_->connect();
  turn();
  faults_.clamp = true;
  EXPECT_THROW(
      {
        try {
          frame_->start_segment({1, 1.0F, 5.0F});
        } catch (const DeviceError& error) {
          EXPECT_EQ(error.fault(), Fault::kRefused);
          EXPECT_THAT(error.what(), HasSubstr("-> 1.000000 s; nothing was started"));
          throw;
        }
      },
      DeviceError);
  EXPECT_TRUE(stands());
  EXPECT_THROW(frame_->start_segment({2, 60.0F, 5.0F}), DeviceError);  // outside the channel's full scale
}

TEST_P(Instron8800Condition, AnotherTransducerIsNotThisFrame) {
  faults_.wrong_scale = true;
  try {
    frame_->connect();
    FAIL() << "a load cell of another full scale was taken";
  } catch (const DeviceError& error) {
    EXPECT_EQ(error.fault(), Fault::kIdentity);
    EXPECT_THAT(error.what(), HasSubstr("2500 N"));
  }
}

TEST_P(Instron8800, TheControllersWatchdogStopsAFrameWhoseComputerIsGone) {
  watchdog_s_ = 1.5;
  config_.watchdog_feed_ms = 100;
  start();
  ASSERT_NO_FATAL_FAILURE(be_moving());
  frame_.reset();  // no goodbye: link and process are gone. The destructor says nothing to the controller.
  const auto end_ns = clock_.now_ns() + static_cast<std::int64_t>(1e9 * kPatience_s);
  while (!faults_.actuator_off.load() && clock_.now_ns() < end_ns) {
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
  }
  EXPECT_TRUE(faults_.actuator_off.load());
  EXPECT_TRUE(faults_.panel.load());
  EXPECT_TRUE(stands());
  EXPECT_EQ(server_->watchdog_trips(), 1U);
}

INSTANTIATE_TEST_SUITE_P(Tcp, Instron8800, ::testing::Values(true));
INSTANTIATE_TEST_SUITE_P(Pty, Instron8800, ::testing::Values(false));
INSTANTIATE_TEST_SUITE_P(Tcp, Instron8800Condition, ::testing::Values(true));

TEST(Instron8800Numbers, AreReadAsTheyAreWritten) {
  using frame::parse_numbers;
  EXPECT_THAT(parse_numbers("Q", "1", 1), ::testing::ElementsAre(1.0));
  EXPECT_THAT(parse_numbers("Q", " +1.5E-3 , -2", 2), ::testing::ElementsAre(1.5e-3, -2.0));
  for (const auto* bad : {"", "abc", "1,", "1;2", "1 2", "nan", "inf", "1e999", "0x1F"}) {
    EXPECT_THROW((void)parse_numbers("Q", bad, 1), DeviceError) << bad;
  }
  EXPECT_THROW((void)parse_numbers("Q", "1", 2), DeviceError);
}

/// A heartbeat from before a stop is not passed on after it.
TEST_P(Instron8800Condition, AStopTakesBackAHeartbeatThatWaits) {
  watchdog_s_ = 1.0;
  config_.watchdog_feed_ms = 700;
  for (const double phase_s : {0.1, 0.3, 0.5, 0.65}) {
    beating_ = true;
    start();
    frame_->connect();
    run_for(0.7 + phase_s);
    beating_ = false;
    frame_->stop();
    const auto stopped_ns = clock_.now_ns();
    ASSERT_TRUE(until([&] { return server_->watchdog_trips() == 1; }));
    EXPECT_LT(1e-9 * static_cast<double>(clock_.now_ns() - stopped_ns), watchdog_s_ + 0.25) << phase_s;
    faults_.actuator_off = false;
  }
}

TEST(Instron8800Config, WantsAWatchdogThatIsOn) {
  const auto read = [](const std::string& more) {
    const auto document = base::TomlDocument::parse_text("transport = \"tcp\"\nhost = \"h\"\nport = 1\n" + more, "t");
    (void)frame::read_instron8800_config(document.root());
    return document.diagnostics().size();
  };
  EXPECT_EQ(read(""), 0U);
  EXPECT_EQ(read("watchdog_command = \"C904,0,0\""), 1U);
  EXPECT_EQ(read("watchdog_command = \"C904,1\"\nwatchdog_tested = true"), 0U);
  EXPECT_EQ(read("watchdog_command = \"C1,0\""), 1U);
  EXPECT_EQ(read("force_channel = 1"), 1U);
  EXPECT_EQ(read("give_up_ms = 100"), 1U);
}

}  // namespace
}  // namespace isorig::sim
