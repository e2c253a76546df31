// The 8800 driver against the emulated controller with the simulated rig behind it, over TCP and a pseudo-terminal.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <chrono>
#include <cmath>
#include <filesystem>
#include <functional>
#include <optional>
#include <thread>

#include "drivers/error.hpp"
#include "drivers/frame/instron8800_frame.hpp"
#include "sim/frame/instron8800_controller.hpp"
#include "sim/frame/instron8800_server.hpp"
#include "sim/rig.hpp"

namespace isorig::sim {
namespace {

using ::testing::HasSubstr;
using drivers::DeviceError;
using drivers::Fault;
using frame::Motion;

class Instron8800 : public ::testing::TestWithParam<bool> {
 protected:
  void SetUp() override { start({}); }

  void start(Instron8800Server::Options options) {
    frame_.reset();
    server_.reset();
    auto sim = load_sim(ISORIG_SOURCE_DIR "/config/rigs/sim-8800.toml");
    sim.frame.request = sim.frame.reply = {0.0, 0.0, 0.0, 0.0};
    RigOptions live;
    live.start_ns = clock_.now_ns();
    live.clock = &clock_;
    live.threaded = true;
    rig_ = std::make_unique<Rig>(sim, load_specimen(sim.specimen), live);
    options.tcp = GetParam();
    link_ = (std::filesystem::path(::testing::TempDir()) / ("8800-" + std::to_string(::getpid()))).string();
    options.pty_link = link_;
    server_ = std::make_unique<Instron8800Server>(options, rig_->frame(), faults_);
    config_.tcp = GetParam();
    config_.port = server_->port();
    config_.tty = link_;
    config_.response_timeout_ms = 250;
    config_.give_up_ms = 1500;
    config_.gap_us = 200;
    config_.quiet_ms = 30;
    config_.position_full_scale_mm = 50.0;
    config_.force_full_scale_N = 250.0;
    config_.reading_age_max_ms = 1.2;
    config_.heartbeat_timeout_ms = 800;
    frame_ = std::make_unique<frame::Instron8800Frame>(config_, clock_);
  }

  /// As the daemon's I/O thread: heartbeat, poll; what it throws is kept.
  void turn() {
    try {
      if (beating_) frame_->heartbeat(++beat_);
      const auto before_ns = clock_.now_ns();
      const auto poll = frame_->poll(samples_);
      longest_poll_ns_ = std::max(longest_poll_ns_, clock_.now_ns() - before_ns);
      state_ = poll.state;
      for (std::size_t i = 0; i < poll.samples; ++i) taken_.push_back(samples_[i]);
    } catch (const DeviceError& error) {
      faults_seen_.push_back(error.fault());
      last_what_ = error.what();
    }
  }
  bool until(double seconds, const std::function<bool()>& condition) {
    const auto end_ns = clock_.now_ns() + static_cast<std::int64_t>(1e9 * seconds);
    while (!condition()) {
      if (clock_.now_ns() > end_ns) return false;
      turn();
    }
    return true;
  }
  void run_for(double seconds) {
    (void)until(seconds, [] { return false; });
  }
  [[nodiscard]] double true_mm() { return rig_->truth().position_mm; }

  /// Underway at 0.5 mm/s, for a fault to hit.
  void be_moving() {
    frame_->connect();
    turn();
    frame_->start_segment({7, 4.0F, 0.5F});
    run_for(0.3);
    ASSERT_EQ(state_.motion, Motion::kMoving);
    ASSERT_GT(true_mm(), 0.05);
    taken_.clear();
    faults_seen_.clear();
  }
  [[nodiscard]] bool stands() {
    const double here = true_mm();
    std::this_thread::sleep_for(std::chrono::milliseconds(300));
    return std::abs(true_mm() - here) < 0.02;  // underway it would be 0.15
  }

  clock::RealClock clock_;
  Instron8800Faults faults_;
  std::unique_ptr<Rig> rig_;
  std::unique_ptr<Instron8800Server> server_;
  frame::Instron8800Config config_;
  std::unique_ptr<frame::Instron8800Frame> frame_;
  std::string link_;
  std::array<frame::Sample, 16> samples_{};
  std::vector<frame::Sample> taken_;
  std::vector<Fault> faults_seen_;
  std::string last_what_;
  frame::State state_;
  std::uint16_t beat_ = 0;
  bool beating_ = true;
  std::int64_t longest_poll_ns_ = 0;
};

/// What does not depend on what carries the lines.
class Instron8800Condition : public Instron8800 {};

TEST_P(Instron8800, ConnectsTakesControlAndSwitchesTheWatchdogOn) {
  const auto identity = frame_->connect();
  EXPECT_EQ(identity.maker, "Instron");
  EXPECT_GT(identity.sample_rate_hz, 50.0);
  EXPECT_FALSE(faults_.panel.load());
  EXPECT_FALSE(faults_.watchdog_off.load());
  run_for(1.0);
  EXPECT_THAT(faults_seen_, ::testing::IsEmpty()) << last_what_;
  EXPECT_EQ(state_.fault_bits, 0);
  EXPECT_GT(taken_.size(), 50U);
  for (std::size_t i = 1; i < taken_.size(); ++i) {
    EXPECT_EQ(taken_[i].sequence, taken_[i - 1].sequence + 1);
    EXPECT_GT(taken_[i].device_us, taken_[i - 1].device_us);
  }
  frame_->disconnect();
  EXPECT_TRUE(until(2.0, [&] { return faults_.panel.load(); }));  // handed back, in order
  EXPECT_FALSE(faults_.actuator_off.load());
}

TEST_P(Instron8800, EverySampleLiesWithinItsBoundOfTheRamp) {
  frame_->connect();
  turn();
  const auto began_ns = clock_.now_ns();
  frame_->start_segment({1, 4.0F, 5.0F});
  const auto lead_in_ns = clock_.now_ns() - began_ns;
  std::vector<Truth> truth;
  EXPECT_TRUE(until(5.0, [&] {
    truth.push_back(rig_->truth());
    return state_.motion == Motion::kReached;
  }));
  const auto took_s = 1e-9 * static_cast<double>(clock_.now_ns() - began_ns);
  EXPECT_NEAR(true_mm(), 4.0, 0.01);
  EXPECT_EQ(state_.segment_id, 1);
  EXPECT_NEAR(state_.target_mm, 4.0, 1e-3);
  EXPECT_NEAR(state_.velocity_mm_s, 5.0, 5e-3);
  EXPECT_GT(took_s, 0.8);
  EXPECT_LT(took_s, 0.8 + 0.6);
  std::size_t compared = 0;
  double worst_mm = 0.0, worst_bound_us = 0.0;
  for (const auto& s : taken_) {
    const auto at_ns = s.device_us * 1000;
    const auto after = std::find_if(truth.begin(), truth.end(), [&](const Truth& t) { return t.mono_ns >= at_ns; });
    if (after == truth.begin() || after == truth.end()) continue;
    const auto& b = *(after - 1);
    const auto span_ns = static_cast<double>(after->mono_ns - b.mono_ns);
    if (span_ns <= 0.0 || span_ns > 12e6) continue;  // this thread was not there
    const double expected = b.position_mm + (after->position_mm - b.position_mm) * static_cast<double>(at_ns - b.mono_ns) / span_ns;
    const double error_mm = std::abs(double{s.position_mm} - expected);
    // 0.2 um of noise, and the curve between two looks at the truth: 600 mm/s^2.
    EXPECT_LT(error_mm, 0.0015 + 5.5e-6 * double{s.bound_us} + 600.0 * std::pow(span_ns * 1e-9, 2) / 4.0);
    worst_mm = std::max(worst_mm, error_mm);
    worst_bound_us = std::max(worst_bound_us, double{s.bound_us});
    ++compared;
  }
  EXPECT_GT(compared, 30U);
  std::printf("  %zu samples compared on a 5 mm/s ramp: worst %.4f mm, worst bound %.0f us; lead-in %.1f ms, reached after %.3f s\n",
              compared, worst_mm, worst_bound_us, 1e-6 * static_cast<double>(lead_in_ns), took_s);
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
  ASSERT_NO_FATAL_FAILURE(be_moving());
  faults_.ignore_stop = true;
  EXPECT_THROW(frame_->stop(), DeviceError);
  EXPECT_TRUE(until(2.0, [&] { return faults_.actuator_off.load(); }));
  EXPECT_TRUE(stands());
  EXPECT_EQ(frame_->statistics().actuator_off_sent, 1U);
  EXPECT_TRUE(until(2.0, [&] { return (state_.fault_bits & frame::kDriveFault) != 0; }));
  EXPECT_THROW(frame_->start_segment({8, 0.0F, 0.5F}), DeviceError);
}

TEST_P(Instron8800, AShortHangLosesSamplesAndNothingElse) {
  ASSERT_NO_FATAL_FAILURE(be_moving());
  faults_.hang_ms = 700;
  longest_poll_ns_ = 0;
  EXPECT_TRUE(until(3.0, [&] { return !faults_seen_.empty(); }));
  taken_.clear();
  EXPECT_TRUE(until(3.0, [&] { return taken_.size() > 30; })) << last_what_;
  for (const auto fault : faults_seen_) EXPECT_EQ(fault, Fault::kTimeout);
  EXPECT_EQ(state_.motion, Motion::kMoving);
  EXPECT_EQ(state_.fault_bits, 0);
  const auto link = frame_->statistics().link;
  EXPECT_EQ(link.late, 1U);
  EXPECT_GE(link.resyncs, 2U);
  // In step: a force is not taken for a position, nor an old one for a new one.
  for (const auto& s : taken_) EXPECT_NEAR(double{s.position_mm}, true_mm(), 0.3);
  EXPECT_LT(longest_poll_ns_, 300'000'000);  // 20 ms, quiet times, and what a busy machine adds
}

TEST_P(Instron8800, AStopGoesOutWhileTheControllerHangs) {
  ASSERT_NO_FATAL_FAILURE(be_moving());
  faults_.hang_ms = 600;
  std::this_thread::sleep_for(std::chrono::milliseconds(50));
  frame_->stop();  // confirmed when the controller is back
  EXPECT_TRUE(stands());
  EXPECT_FALSE(faults_.actuator_off.load());
}

TEST_P(Instron8800, ALateAnswerIsNeverTheNextOnes) {
  ASSERT_NO_FATAL_FAILURE(be_moving());
  for (int i = 0; i < 3; ++i) {
    faults_seen_.clear();
    faults_.late_ms = 330;
    EXPECT_TRUE(until(3.0, [&] { return !faults_seen_.empty(); }));
    taken_.clear();
    EXPECT_TRUE(until(3.0, [&] { return taken_.size() > 10; })) << last_what_;
    for (const auto& s : taken_) {
      ASSERT_NEAR(double{s.position_mm}, true_mm(), 0.3);
      ASSERT_LT(std::abs(double{s.force_N}), 20.0);
    }
  }
  EXPECT_EQ(frame_->statistics().link.late, 3U);
}

TEST_P(Instron8800Condition, GarbageAndLinesNobodyAskedForAreThrownAway) {
  ASSERT_NO_FATAL_FAILURE(be_moving());
  faults_.garbage = 1;
  EXPECT_TRUE(until(3.0, [&] { return !faults_seen_.empty(); }));
  EXPECT_EQ(faults_seen_.back(), Fault::kProtocol);
  EXPECT_THAT(last_what_, HasSubstr("#"));
  const auto resyncs = frame_->statistics().link.resyncs;
  faults_.extra = 1;
  taken_.clear();
  EXPECT_TRUE(until(3.0, [&] { return taken_.size() > 30; })) << last_what_;
  EXPECT_GT(frame_->statistics().link.resyncs, resyncs);
  for (const auto& s : taken_) ASSERT_NEAR(double{s.position_mm}, true_mm(), 0.3);
}

TEST_P(Instron8800, AnAnswerThatNeverComesEndsTheConnection) {
  ASSERT_NO_FATAL_FAILURE(be_moving());
  faults_.drop = -1;
  EXPECT_TRUE(until(4.0, [&] { return !faults_seen_.empty() && faults_seen_.back() == Fault::kDisconnected; }));
  EXPECT_THAT(last_what_, HasSubstr("the controller hangs"));
  frame_->disconnect();
  faults_.drop = 0;
  faults_seen_.clear();
  frame_->connect();
  frame_->stop();
  EXPECT_TRUE(stands());
  taken_.clear();
  EXPECT_TRUE(until(3.0, [&] { return taken_.size() > 10; })) << last_what_;
}

TEST_P(Instron8800Condition, ControlThatThePanelTookIsNotTakenBack) {
  ASSERT_NO_FATAL_FAILURE(be_moving());
  faults_.panel = true;
  EXPECT_TRUE(until(2.0, [&] { return (state_.fault_bits & frame::kDriveFault) != 0; }));
  EXPECT_NE(state_.motion, Motion::kMoving);
  EXPECT_TRUE(stands());
  EXPECT_THAT(last_what_, HasSubstr("panel"));
  EXPECT_NO_THROW(frame_->stop());
  EXPECT_THROW(frame_->start_segment({8, 0.0F, 0.5F}), DeviceError);
  run_for(0.8);
  EXPECT_TRUE(faults_.panel.load());
  EXPECT_FALSE(faults_.actuator_off.load());  // no command went out that would have tripped it
  faults_.panel = false;                      // given back
  EXPECT_TRUE(until(2.0, [&] { return state_.fault_bits == 0; }));
}

TEST_P(Instron8800Condition, AWatchdogThatIsOffStopsAndIsSwitchedOnAgain) {
  ASSERT_NO_FATAL_FAILURE(be_moving());
  faults_.watchdog_off = true;
  EXPECT_TRUE(until(2.0, [&] { return !faults_seen_.empty(); }));
  EXPECT_THAT(last_what_, HasSubstr("watchdog"));
  EXPECT_TRUE(stands());
  EXPECT_TRUE(until(2.0, [&] { return state_.fault_bits == frame::kDriveFault; }));
  EXPECT_TRUE(until(2.0, [&] { return state_.fault_bits == 0; }));
  EXPECT_FALSE(faults_.watchdog_off.load());
  EXPECT_EQ(state_.motion, Motion::kDisabled);
}

TEST_P(Instron8800Condition, ALoopThatIsSilentIsStopped) {
  ASSERT_NO_FATAL_FAILURE(be_moving());
  beating_ = false;
  EXPECT_TRUE(until(3.0, [&] { return (state_.fault_bits & frame::kHeartbeatLost) != 0; }));
  EXPECT_TRUE(stands());
  EXPECT_EQ(state_.motion, Motion::kStopped);
  EXPECT_FALSE(faults_.actuator_off.load());
}

TEST_P(Instron8800Condition, ConditionsOfTheControllerAreFaults) {
  ASSERT_NO_FATAL_FAILURE(be_moving());
  faults_.limit = true;
  EXPECT_TRUE(until(2.0, [&] { return state_.fault_bits == frame::kTravelLimit; }));
  EXPECT_EQ(state_.motion, Motion::kLimit);
  EXPECT_THAT(last_what_, HasSubstr("travel limit"));
  faults_.limit = false;
  EXPECT_TRUE(until(2.0, [&] { return state_.fault_bits == 0; }));
  {
    const auto visit = rig_->enter();
    rig_->interlock().estop_closed = false;
  }
  EXPECT_TRUE(until(2.0, [&] { return state_.fault_bits == frame::kInterlockOpen; }));
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
  Instron8800Server::Options options;
  options.watchdog_s = 0.7;
  start(options);
  ASSERT_NO_FATAL_FAILURE(be_moving());
  frame_.reset();  // no goodbye: link and process are gone. The destructor says nothing to the controller.
  const auto end = std::chrono::steady_clock::now() + std::chrono::seconds(4);
  while (!faults_.actuator_off.load() && std::chrono::steady_clock::now() < end) {
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

TEST(Instron8800Config, WantsAWatchdogThatIsOn) {
  const auto read = [](const std::string& more) {
    const auto document = base::TomlDocument::parse_text("transport = \"tcp\"\nhost = \"h\"\nport = 1\n" + more, "t");
    (void)frame::read_instron8800_config(document.root());
    return document.diagnostics().size();
  };
  EXPECT_EQ(read(""), 0U);
  EXPECT_EQ(read("watchdog_command = \"C904,0,0\""), 1U);
  EXPECT_EQ(read("watchdog_command = \"C1,0\""), 1U);
  EXPECT_EQ(read("force_channel = 1"), 1U);
  EXPECT_EQ(read("give_up_ms = 100"), 1U);
}

}  // namespace
}  // namespace isorig::sim
