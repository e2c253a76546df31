#pragma once
#include <chrono>
#include <cstdint>
#include <span>
#include <utility>
#include <vector>

#include "drivers/api/frame.hpp"
#include "drivers/config/register_map.hpp"
#include "sim/wire/faults.hpp"
#include "sim/wire/frame/register_image.hpp"

namespace isorig::sim {

/// The frame behind a gateway, as its registers show it: what it measures goes into the registers, what a client writes
/// there moves it. No wire: ModbusServer asks it for each request.
class GatewayFrame {
 public:
  static constexpr int kNoAnswer = -1;  ///< beside the exceptions

  /// Connects the backend. Throws its DeviceError.
  GatewayFrame(const modbus::RegisterMap& map, frame::Device& backend, FrameWireFaults& faults);
  ~GatewayFrame() { backend_.disconnect(); }
  GatewayFrame(const GatewayFrame&) = delete;
  GatewayFrame& operator=(const GatewayFrame&) = delete;

  /// Polls the backend into the registers.
  void refresh();
  /// Acts on what a client writes. Returns the exception to answer with, kNoAnswer, or 0.
  int act(std::uint16_t address, std::span<const std::uint16_t> words);
  [[nodiscard]] RegisterImage& image() noexcept { return image_; }

  /// What a fault of the stop command does to the answers.
  [[nodiscard]] std::chrono::steady_clock::time_point silent_until() const noexcept { return silent_until_; }
  [[nodiscard]] bool take_cut() noexcept { return std::exchange(cut_, false); }
  [[nodiscard]] int take_late_ms() noexcept { return std::exchange(answer_late_ms_, 0); }

 private:
  void restart();
  void add_sample(frame::Sample sample);
  /// The exception to answer a stop with that is not taken, or kNoAnswer; 0 when nothing keeps it from being taken.
  int spoil_stop();

  const modbus::RegisterMap& map_;
  frame::Device& backend_;
  FrameWireFaults& faults_;
  RegisterImage image_;
  frame::Identity identity_;
  std::vector<frame::Sample> samples_;
  double device_us_ = 0.0;
  // What the frame counts from since it was started.
  std::uint32_t first_sequence_ = 0, next_sequence_ = 0;
  std::int64_t started_us_ = 0;
  std::chrono::steady_clock::time_point silent_until_{};
  bool cut_ = false;        // the connection that the request came by
  int answer_late_ms_ = 0;  // of the request at hand
};

}  // namespace isorig::sim
