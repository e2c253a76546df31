#pragma once
#include <cstdint>

#include "drivers/api/pressure.hpp"
#include "messages/elvh.hpp"

namespace isorig::bench {

/// Sensor and valves without physics, behind the emulated Teensy: conversions on true time, each telling in
/// its value when it was made; commands are remembered.
class TeensyBackend final : public pressure::Device {
 public:
  explicit TeensyBackend(const clock::Clock& clock) : clock_(clock), next_us_(clock.now_ns() / 1000) {}
  void set_limits(const pressure::FillLimits&) override {}
  pressure::Identity connect() override { return {}; }
  void disconnect() noexcept override {}
  pressure::Poll poll(std::span<pressure::Sample> out, std::span<clock::Exchange>, std::int64_t) override {
    pressure::Poll result;
    while (result.samples < out.size() && next_us_ * 1000 <= clock_.now_ns()) {
      out[result.samples++] = {sequence_++, next_us_, word(next_us_)};
      next_us_ += period_us;
    }
    return result;
  }
  void command(const pressure::Command& command) override { valves = command; }
  void heartbeat() override { ++heartbeats; }
  void request_time_sync() override {}

  static std::uint32_t word(std::int64_t true_us) {
    return messages::encode_elvh(10.0 + 0.005 * static_cast<double>(true_us / 1000 % 1000), 25.0);
  }

  std::int64_t period_us = 1000;
  pressure::Command valves;
  int heartbeats = 0;

 private:
  const clock::Clock& clock_;
  std::int64_t next_us_;
  std::uint32_t sequence_ = 0;
};

}  // namespace isorig::bench
