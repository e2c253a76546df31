#pragma once
#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <filesystem>
#include <functional>
#include <stdexcept>
#include <thread>

#include "drivers/api/error.hpp"
#include "drivers/clock/real_clock.hpp"
#include "drivers/frame/instron8800_frame.hpp"
#include "sim/rig.hpp"
#include "sim/wire/frame/instron8800_controller.hpp"
#include "sim/wire/frame/instron8800_server.hpp"
#include "tree.hpp"

namespace isorig::sim {

/// How long anything is waited for, and the time-outs of what is not tested: a machine that stands still for a second
/// does not reach them.
inline constexpr double kPatience_s = 20.0;
/// A time-out that is tested.
inline constexpr int kShort_ms = 600;

class Instron8800Rig : public ::testing::Test {
 protected:
  void SetUp() override {
    config_.response_timeout_ms = 5000;
    config_.give_up_ms = 20'000;
    config_.start_confirm_ms = 5000;
    config_.stop_confirm_ms = 5000;
    config_.heartbeat_timeout_ms = 5000;
    config_.gap_us = 200;
    config_.quiet_ms = 30;
    config_.position_full_scale_mm = 50.0;
    config_.force_full_scale_N = 250.0;
    config_.reading_age_max_ms = 1.2;
    start();
  }

  /// With what config_ and watchdog_s_ say by now. The controller's switches change only while none runs: its thread
  /// may still have a line of the last connection before it, and a command that finds the panel in control trips.
  void start() {
    frame_.reset();
    server_.reset();
    faults_.panel = faults_.watchdog_off = true;  // a controller that was just switched on
    truth_.clear();
    auto sim = load_sim(test::source_path("/config/rigs/sim-8800.toml"));
    sim.frame.request = sim.frame.reply = {0.0, 0.0, 0.0, 0.0};
    sim.frame.heartbeat_timeout_s = kPatience_s;  // the crosshead's, behind the controller: not what is tested
    RigOptions live;
    live.start_ns = clock_.now_ns();
    live.clock = &clock_;
    live.threaded = true;
    live.keep_truth = true;
    rig_ = std::make_unique<Rig>(sim, load_specimen(sim.specimen), live);
    auto options = options_;
    options.tcp = tcp_;
    options.watchdog_s = watchdog_s_;
    link_ = (std::filesystem::path(::testing::TempDir()) / ("8800-" + std::to_string(::getpid()))).string();
    options.pty_link = link_;
    server_ = std::make_unique<Instron8800Server>(options, rig_->frame(), faults_);
    config_.tcp = tcp_;
    config_.port = server_->port();
    config_.tty = link_;
    frame_ = std::make_unique<frame::Instron8800Frame>(config_, clock_);
  }

  /// As the daemon's I/O thread: heartbeat, poll; what it throws is kept.
  void turn() {
    try {
      if (beating_) frame_->heartbeat(++beat_);
      const auto before_ns = clock_.now_ns();
      const auto poll = frame_->poll(samples_);
      if (poll.samples == 0) empty_polls_ns_.push_back(clock_.now_ns() - before_ns);
      state_ = poll.state;
      for (std::size_t i = 0; i < poll.samples; ++i) taken_.push_back(samples_[i]);
    } catch (const drivers::DeviceError& error) {
      faults_seen_.push_back(error.fault());
      last_what_ = error.what();
    }
  }
  bool until(const std::function<bool()>& condition, double seconds = kPatience_s) {
    const auto end_ns = clock_.now_ns() + static_cast<std::int64_t>(1e9 * seconds);
    while (!condition()) {
      if (clock_.now_ns() > end_ns) return false;
      turn();
    }
    return true;
  }
  void run_for(double seconds) {
    (void)until([] { return false; }, seconds);
  }
  bool takes(std::size_t samples) {
    return until([&] { return taken_.size() > samples; });
  }
  [[nodiscard]] double true_mm() { return rig_->truth().position_mm; }

  /// The plant at a sample's time.
  [[nodiscard]] Truth plant_at(const frame::Sample& sample) {
    const auto at_ns = sample.device_us * 1000;
    clock_.sleep_until_ns(at_ns + Rig::kStep_ns);  // its step may not be over
    const auto steps = rig_->take_truth();
    truth_.insert(truth_.end(), steps.begin(), steps.end());
    const auto after = std::lower_bound(truth_.begin(), truth_.end(), at_ns,
                                        [](const Truth& t, std::int64_t ns) { return t.mono_ns < ns; });
    if (after == truth_.begin() || after == truth_.end())
      throw std::out_of_range("a sample from outside the plant's time");
    const auto& before = *(after - 1);
    const double part = static_cast<double>(at_ns - before.mono_ns) / static_cast<double>(Rig::kStep_ns);
    Truth plant = before;
    plant.position_mm += part * (after->position_mm - before.position_mm);
    plant.force_N += part * (after->force_N - before.force_N);
    return plant;
  }
  /// On a ramp of 0.5 mm/s: neither an old value for a new one nor a force for a position.
  void expect_as_the_plant(const std::vector<frame::Sample>& samples) {
    for (const auto& s : samples) {
      const auto plant = plant_at(s);
      ASSERT_NEAR(double{s.position_mm}, plant.position_mm, 0.0015 + 0.55e-6 * double{s.bound_us});
      ASSERT_NEAR(double{s.force_N}, plant.force_N, 0.1 + 5e-6 * double{s.bound_us});
    }
  }

  /// Underway at 0.5 mm/s, for a fault to hit.
  void be_moving() {
    frame_->connect();
    turn();
    frame_->start_segment({7, 10.0F, 0.5F});
    ASSERT_TRUE(until([&] { return true_mm() > 0.1; }));
    ASSERT_EQ(state_.motion, frame::Motion::kMoving);
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
  Instron8800Server::Options options_;
  bool tcp_ = true;
  double watchdog_s_ = kPatience_s;
  std::vector<Truth> truth_;
  std::unique_ptr<frame::Instron8800Frame> frame_;
  std::string link_;
  std::array<frame::Sample, 16> samples_{};
  std::vector<frame::Sample> taken_;
  std::vector<drivers::Fault> faults_seen_;
  std::string last_what_;
  frame::State state_;
  std::uint16_t beat_ = 0;
  bool beating_ = true;
  std::vector<std::int64_t> empty_polls_ns_;
};

}  // namespace isorig::sim
