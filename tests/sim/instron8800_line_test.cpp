// One line lost, damaged, late or too many, at every question and command that the driver has: it is back in step
// within the age limit of a sample, takes no value for another, loses neither motion nor actuator, and stops when told
// to.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "instron8800_rig.hpp"

namespace isorig::sim {
namespace {

using drivers::DeviceError;
using drivers::Fault;
using frame::Motion;

class Instron8800Line : public Instron8800Rig, public ::testing::WithParamInterface<std::tuple<int, const char*>> {
 protected:
  void SetUp() override {
    Instron8800Rig::SetUp();
    config_.response_timeout_ms = 150;
    config_.watchdog_feed_ms = 100;
    start();
  }
  [[nodiscard]] int code() const { return std::get<0>(GetParam()); }
  [[nodiscard]] std::string kind() const { return std::get<1>(GetParam()); }
  void disturb() {
    faults_.at_code = code();
    if (kind() == "drop") faults_.drop = 1;
    if (kind() == "garbage") faults_.garbage = 1;
    if (kind() == "extra") faults_.extra = 1;
    if (kind() == "late") faults_.late_ms = 2 * config_.response_timeout_ms;
  }
  [[nodiscard]] bool pending() const { return faults_.drop + faults_.garbage + faults_.extra + faults_.late_ms > 0; }
  /// Until it works, as the daemon does; false when it never does.
  bool patiently(const std::function<void()>& call) {
    for (int attempt = 0; attempt < 20; ++attempt) {
      try {
        call();
        return true;
      } catch (const DeviceError& error) {
        last_what_ = error.what();
        turn();
        std::this_thread::sleep_for(std::chrono::milliseconds(5));  // the daemon's poll_period_ms
      }
    }
    return false;
  }
};

class Instron8800LineUnderway : public Instron8800Line {};

TEST_P(Instron8800LineUnderway, IsBackInStep) {
  ASSERT_NO_FATAL_FAILURE(be_moving());
  disturb();
  ASSERT_TRUE(until([&] { return !pending(); }));
  const auto gap_from_ns = clock_.now_ns();
  taken_.clear();
  EXPECT_TRUE(takes(20)) << last_what_;
  const double gap_s = 1e-9 * static_cast<double>(taken_.front().device_us * 1000 - gap_from_ns);
  std::printf("  Q%d %s: %.0f ms without a sample\n", code(), kind().c_str(), 1e3 * gap_s);
  EXPECT_LT(gap_s, 5.0);  // 0.2 s, and what a busy machine adds
  EXPECT_EQ(state_.motion, Motion::kMoving) << last_what_;
  EXPECT_EQ(state_.fault_bits, 0);
  EXPECT_FALSE(faults_.actuator_off.load());
  expect_as_the_plant(taken_);
  EXPECT_TRUE(patiently([&] { frame_->stop(); })) << last_what_;
  EXPECT_TRUE(stands());
}

TEST_P(Instron8800Line, AtConnectStartAndStop) {
  disturb();
  EXPECT_TRUE(patiently([&] { frame_->connect(); })) << last_what_;
  turn();
  disturb();
  const auto begin = [&] { frame_->start_segment({7, 10.0F, 0.5F}); };
  ASSERT_TRUE(patiently(begin)) << last_what_;
  EXPECT_TRUE(until([&] { return true_mm() > 0.02; }));
  disturb();
  EXPECT_TRUE(patiently([&] { frame_->stop(); })) << last_what_;
  EXPECT_TRUE(stands());
  EXPECT_FALSE(faults_.actuator_off.load());
  turn();
  taken_.clear();
  EXPECT_TRUE(takes(5)) << last_what_;
  for (const auto& s : taken_) ASSERT_NEAR(double{s.position_mm}, true_mm(), 0.05);
}

INSTANTIATE_TEST_SUITE_P(EveryQuestion, Instron8800LineUnderway,
                         ::testing::Combine(::testing::Values(1, 22, 23, 134, 307, 904, 909),
                                            ::testing::Values("drop", "garbage", "extra", "late")),
                         [](const auto& each) {
                           return "Q" + std::to_string(std::get<0>(each.param)) + std::get<1>(each.param);
                         });

INSTANTIATE_TEST_SUITE_P(EveryQuestion, Instron8800Line,
                         ::testing::Combine(::testing::Values(1, 4, 22, 23, 86, 134, 300, 307, 308, 904, 909),
                                            ::testing::Values("drop", "garbage", "extra", "late")),
                         [](const auto& each) {
                           return "Q" + std::to_string(std::get<0>(each.param)) + std::get<1>(each.param);
                         });

class Instron8800LostCommand : public Instron8800Line {};

TEST_P(Instron8800LostCommand, IsNoticed) {
  faults_.at_code = code();
  faults_.lose = 1;
  EXPECT_TRUE(patiently([&] { frame_->connect(); })) << last_what_;
  turn();
  faults_.lose = 1;
  ASSERT_TRUE(patiently([&] { frame_->start_segment({7, 10.0F, 0.5F}); })) << last_what_;
  EXPECT_TRUE(until([&] { return true_mm() > 0.02; }));
  faults_.lose = 1;
  (void)patiently([&] { frame_->stop(); });
  EXPECT_TRUE(until([&] { return state_.motion != Motion::kMoving; })) << "the stop was lost and nobody asked";
  EXPECT_TRUE(stands());
  EXPECT_FALSE(faults_.actuator_off.load()) << last_what_;
}

INSTANTIATE_TEST_SUITE_P(EveryCommand, Instron8800LostCommand,
                         ::testing::Combine(::testing::Values(1, 2, 4, 86, 904, 909), ::testing::Values("lose")),
                         [](const auto& each) { return "C" + std::to_string(std::get<0>(each.param)); });

class Instron8800Storm : public Instron8800Line {};

TEST_P(Instron8800Storm, IsOverWhenItIsOver) {
  watchdog_s_ = 1.5;
  start();
  ASSERT_NO_FATAL_FAILURE(be_moving());
  disturb();
  if (kind() == "drop") faults_.drop = -1;
  if (kind() == "garbage") faults_.garbage = -1;
  if (kind() == "extra") faults_.extra = 1000;
  faults_.at_code = 0;
  // Nothing is fed that cannot be asked for: its watchdog ends the ramp, and somebody has to go there.
  EXPECT_TRUE(until([&] { return faults_.actuator_off.load(); })) << last_what_;
  faults_.drop = faults_.garbage = faults_.extra = 0;
  EXPECT_TRUE(stands());
  faults_.actuator_off = false;  // at the console
  const auto over_ns = clock_.now_ns();
  EXPECT_TRUE(until([&] {
    if (!faults_seen_.empty() && faults_seen_.back() == Fault::kDisconnected) {
      faults_seen_.clear();
      frame_->disconnect();
      frame_->connect();
      frame_->stop();
    }
    return state_.fault_bits == 0 && taken_.size() > 5 && taken_.back().device_us * 1000 > over_ns;
  })) << last_what_;
  std::printf("  %s: well again %.1f s after it was over\n", kind().c_str(),
              1e-9 * static_cast<double>(clock_.now_ns() - over_ns));
  turn();
  frame_->start_segment({8, 0.0F, 1.0F});
  EXPECT_TRUE(until([&] { return state_.motion == Motion::kReached; }));
}

INSTANTIATE_TEST_SUITE_P(Every, Instron8800Storm,
                         ::testing::Combine(::testing::Values(0), ::testing::Values("drop", "garbage", "extra")),
                         [](const auto& each) { return std::string(std::get<1>(each.param)); });

}  // namespace
}  // namespace isorig::sim
