#pragma once
#include <algorithm>
#include <deque>
#include <limits>
#include <mutex>
#include <optional>
#include <utility>
#include <vector>

#include "drivers/api/clock.hpp"
#include "drivers/api/frame.hpp"

namespace isorig::sim {

/// A frame that does what the test says, sample by sample, on a virtual clock. Locked: the emulator's thread
/// and the test's both use it.
class FakeFrame final : public frame::Device {
 public:
  explicit FakeFrame(double rate_Hz) : rate_Hz_(rate_Hz), period_us_(static_cast<std::int64_t>(1e6 / rate_Hz)) {}

  /// What sample `sequence` reads; exact in float and in steps of 10 nm and 1 mN.
  static float position_mm(std::uint32_t sequence) { return static_cast<float>(sequence % 4096) / 32.0F - 50.0F; }
  static float force_N(std::uint32_t sequence) { return 100.0F - static_cast<float>(sequence % 1000) / 8.0F; }

  /// `count` more samples, and the time they take.
  void advance(std::uint32_t count) {
    const std::lock_guard lock(mutex_);
    take(count);
  }
  /// `count` samples that nobody reads in time: counted and gone.
  void skip(std::uint32_t count) {
    const std::lock_guard lock(mutex_);
    take(count);
    pending_.erase(pending_.end() - count, pending_.end());
  }
  void set_next(std::uint32_t sequence, std::int64_t device_us) {
    const std::lock_guard lock(mutex_);
    pending_.clear();
    next_ = sequence;
    device_us_ = device_us;
  }
  /// Every poll of the emulator finds so many samples more.
  void advance_on_poll(std::uint32_t count) {
    const std::lock_guard lock(mutex_);
    on_poll_ = count;
  }
  void make_next_sample_invalid() {
    const std::lock_guard lock(mutex_);
    invalid_ = true;
  }
  void clamp_target_mm(float limit) {
    const std::lock_guard lock(mutex_);
    clamp_mm_ = limit;
  }
  void refuse_segments(bool refuse) {
    const std::lock_guard lock(mutex_);
    refuse_ = refuse;
  }
  std::uint32_t last_sequence() {
    const std::lock_guard lock(mutex_);
    return next_ - 1;
  }
  std::int64_t device_us() {
    const std::lock_guard lock(mutex_);
    return device_us_;
  }
  frame::State state() {
    const std::lock_guard lock(mutex_);
    return state_;
  }
  void set_fault_bits(std::uint16_t bits) {
    const std::lock_guard lock(mutex_);
    state_.fault_bits = bits;
  }
  std::vector<frame::Segment> started() {
    const std::lock_guard lock(mutex_);
    return started_;
  }
  int stops() {
    const std::lock_guard lock(mutex_);
    return stops_;
  }
  clock::VirtualClock& clock() { return clock_; }

  frame::Identity connect() override { return {"isorig", "fake frame", "F-0042", "1.0", rate_Hz_, 1}; }
  void disconnect() noexcept override {}
  frame::Poll poll(std::span<frame::Sample> out) override {
    const std::lock_guard lock(mutex_);
    take(on_poll_);
    frame::Poll result;
    result.samples = std::min(out.size(), pending_.size());
    std::copy_n(pending_.begin(), result.samples, out.begin());
    pending_.erase(pending_.begin(), pending_.begin() + static_cast<std::ptrdiff_t>(result.samples));
    result.state = state_;
    result.has_exchange = true;
    result.exchange.device_rx_us = result.exchange.device_tx_us = static_cast<double>(device_us_);
    return result;
  }
  void start_segment(const frame::Segment& segment) override {
    const std::lock_guard lock(mutex_);
    if (refuse_) throw drivers::DeviceError(drivers::Fault::kRefused, "the fake frame refuses");
    started_.push_back(segment);
    state_.motion = frame::Motion::kMoving;
    state_.segment_id = segment.id;
    state_.target_mm = std::min(segment.target_mm, clamp_mm_);
    state_.velocity_mm_s = segment.velocity_mm_s;
  }
  void stop() override {
    const std::lock_guard lock(mutex_);
    ++stops_;
    state_.motion = frame::Motion::kStopped;
  }
  void heartbeat(std::uint16_t counter) override {
    const std::lock_guard lock(mutex_);
    state_.heartbeat_echo = counter;
  }

 private:
  void take(std::uint32_t count) {
    for (std::uint32_t i = 0; i < count; ++i) {
      device_us_ += period_us_;
      pending_.push_back({next_, device_us_, position_mm(next_), force_N(next_)});
      if (std::exchange(invalid_, false)) pending_.back().force_N = std::numeric_limits<float>::quiet_NaN();
      ++next_;
    }
    clock_.sleep_until_ns(clock_.now_ns() + std::int64_t{count} * period_us_ * 1000);
  }

  const double rate_Hz_;
  const std::int64_t period_us_;
  std::mutex mutex_;
  clock::VirtualClock clock_{1'000'000'000};
  std::deque<frame::Sample> pending_;
  std::uint32_t next_ = 1;
  std::int64_t device_us_ = 0;
  std::uint32_t on_poll_ = 0;
  bool invalid_ = false;
  bool refuse_ = false;
  float clamp_mm_ = 1e9F;
  frame::State state_;
  std::vector<frame::Segment> started_;
  int stops_ = 0;
};

}  // namespace isorig::sim
