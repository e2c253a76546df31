// Controllers of the family differ, and nobody has published which one is how: each dialect is found out or refused in
// words, and a connection that fails leaves the panel in control.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "instron8800_rig.hpp"

namespace isorig::sim {
namespace {

using drivers::DeviceError;
using drivers::Fault;
using frame::Motion;
using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;
using Watchdog = Instron8800Server::Options::Watchdog;

class Instron8800Dialect : public Instron8800Rig {
 protected:
  /// The words of the connection that has to fail.
  std::string refused() {
    try {
      frame_->connect();
    } catch (const DeviceError& error) {
      EXPECT_EQ(error.fault(), Fault::kIdentity) << error.what();
      return error.what();
    }
    ADD_FAILURE() << "connected";
    return {};
  }
  bool arrives(float target_mm, float velocity_mm_s, std::uint16_t id = 1) {
    frame_->start_segment({id, target_mm, velocity_mm_s});
    return until([&] { return state_.segment_id == id && state_.motion != Motion::kMoving; }) &&
           state_.motion == Motion::kReached;
  }
  bool panel_has_control() {
    return until([&] { return faults_.panel.load(); });
  }
};

TEST_F(Instron8800Dialect, TheWatchdogsFormIsFoundOutByAsking) {
  for (const auto& [form, command] :
       {std::pair{Watchdog::kTwoNumbers, "C904,1,0 (read back)"}, {Watchdog::kOneNumber, "C904,1 (read back)"}}) {
    options_.watchdog = form;
    start();
    EXPECT_THAT(frame_->connect().firmware, HasSubstr(command));
    EXPECT_FALSE(faults_.watchdog_off.load());
    run_for(0.8);  // fed, and still on
    EXPECT_FALSE(faults_.watchdog_off.load());
    EXPECT_THAT(faults_seen_, ::testing::IsEmpty()) << last_what_;
    EXPECT_TRUE(arrives(0.5F, 2.0F));
    frame_->disconnect();
  }
}

TEST_F(Instron8800Dialect, AWatchdogThatCannotBeAskedIsRefusedUntilSomebodyHasTriedIt) {
  options_.watchdog = Watchdog::kNotAsked;
  config_.response_timeout_ms = kShort_ms;
  for (const bool answers : {true, false}) {
    options_.answers_unknown = answers;
    config_.watchdog_tested = false;
    start();
    EXPECT_THAT(refused(), AllOf(HasSubstr(answers ? "Q904 is answered by \"None of" : "Q904 is not answered"),
                                 HasSubstr("watchdog_tested")));
    EXPECT_TRUE(faults_.panel.load()) << "control was taken for nothing";
    EXPECT_TRUE(faults_.watchdog_off.load());

    config_.watchdog_tested = true;
    watchdog_s_ = 2.0;
    start();
    EXPECT_THAT(frame_->connect().firmware, HasSubstr("C904,1 (cannot be read back)"));
    run_for(3.0);
    EXPECT_EQ(server_->watchdog_trips(), 0U) << "it was not fed";
    EXPECT_THAT(faults_seen_, ::testing::IsEmpty()) << last_what_;
    watchdog_s_ = kPatience_s;
  }
}

TEST_F(Instron8800Dialect, ACommandThatIsAnsweredIsTheOneThatIsBlamed) {
  options_.watchdog = Watchdog::kOneNumber;
  options_.answers_unknown = true;
  config_.watchdog_command = "C904,1,0";
  start();
  EXPECT_THAT(refused(), AllOf(HasSubstr("\"C904,1,0\" is a command and was answered"), Not(HasSubstr("Q909"))));
  EXPECT_TRUE(panel_has_control()) << "control was not given back";
  EXPECT_FALSE(faults_.actuator_off.load());
}

TEST_F(Instron8800Dialect, AConnectionThatFailsGivesControlBack) {
  options_.watchdog = Watchdog::kOneNumber;
  config_.watchdog_command = "C904,1,0";  // not known, and nothing is said of it
  start();
  EXPECT_THAT(refused(), HasSubstr("watchdog is not on (Q904)"));
  EXPECT_TRUE(panel_has_control());
  EXPECT_FALSE(faults_.actuator_off.load()) << "a command went out without control";
}

TEST_F(Instron8800Dialect, AnActuatorThatIsOffAtConnectIsSaid) {
  faults_.actuator_off = true;
  frame_->connect();
  turn();
  EXPECT_TRUE(until([&] { return !faults_seen_.empty(); }));
  EXPECT_EQ(faults_seen_.front(), Fault::kRefused);
  EXPECT_THAT(last_what_, HasSubstr("the actuator is off: find out why, then switch it on at the console"));
  EXPECT_TRUE(until([&] { return state_.fault_bits == frame::kDriveFault; }));
  // After a disturbance of the line it is said again, or the last word would be the disturbance's.
  faults_.garbage = 1;
  EXPECT_TRUE(until([&] { return faults_seen_.size() >= 3; }));
  EXPECT_THAT(last_what_, HasSubstr("the actuator is off"));
  faults_.actuator_off = false;
  EXPECT_TRUE(until([&] { return state_.fault_bits == 0; }));
  turn();
  EXPECT_TRUE(arrives(0.2F, 2.0F));
}

TEST_F(Instron8800Dialect, TargetsBelowZeroAreTakenOrRefusedInWords) {
  frame_->connect();
  turn();
  EXPECT_TRUE(arrives(-0.5F, 2.0F, 1));
  EXPECT_NEAR(true_mm(), -0.5, 0.02);
  for (const bool answers : {true, false}) {
    options_.takes_sign = false;
    options_.answers_unknown = answers;
    start();
    frame_->connect();
    turn();
    try {
      frame_->start_segment({2, -0.5F, 2.0F});
      ADD_FAILURE() << "a target below zero was started";
    } catch (const DeviceError& error) {
      EXPECT_EQ(error.fault(), Fault::kRefused);
      EXPECT_THAT(error.what(), AllOf(HasSubstr("C4,1,-0.01"), HasSubstr("takes no target below the zero")));
    }
    EXPECT_TRUE(stands());
    EXPECT_TRUE(arrives(0.5F, 2.0F, 3)) << "and the others it takes: " << last_what_;
  }
}

TEST_F(Instron8800Dialect, ARampThatEndsWhenItArrivesIsReached) {
  options_.ends_ramps = true;
  start();
  frame_->connect();
  turn();
  EXPECT_TRUE(arrives(0.5F, 1.0F)) << static_cast<int>(state_.motion);
  EXPECT_NEAR(true_mm(), 0.5, 0.02);
  EXPECT_THAT(faults_seen_, ::testing::IsEmpty()) << last_what_;
}

TEST_F(Instron8800Dialect, ARampThatDoesNotKeepItsTimeIsReachedAndSaid) {
  options_.ends_ramps = true;
  options_.ramp_of_scale_per_s = 0.02;  // 1 mm/s
  start();
  frame_->connect();
  turn();
  EXPECT_TRUE(arrives(1.0F, 0.2F)) << "position = target, and called stopped short of it";
  EXPECT_TRUE(until([&] { return !faults_seen_.empty(); }));
  EXPECT_THAT(last_what_, HasSubstr("does not keep to the ramp time"));
}

TEST_F(Instron8800Dialect, WhatMovesAtConnectIsStoppedAndSeenToStand) {
  ASSERT_NO_FATAL_FAILURE(be_moving());
  frame_ = std::make_unique<frame::Instron8800Frame>(config_, clock_);  // the daemon was killed, and is back
  frame_->connect();
  EXPECT_GT(true_mm(), 0.1);
  frame_->stop();
  EXPECT_TRUE(stands());
}

}  // namespace
}  // namespace isorig::sim
