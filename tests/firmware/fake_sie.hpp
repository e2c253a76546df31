#pragma once
// A USB host and the device's interface engine, at the level of transactions: buffers that are not armed are
// answered with NAK, toggles are checked on both sides, each completed transaction moves on to the other
// bank.
#include <array>
#include <cstdint>
#include <cstring>
#include <deque>
#include <functional>
#include <optional>
#include <vector>

#include "firmware/usb_sie.hpp"

namespace isorig::firmware {

class FakeSie final : public UsbSie {
 public:
  using Bytes = std::vector<std::uint8_t>;

  /// `poll` is the device's turn, after each transaction.
  explicit FakeSie(std::function<void()> poll) : poll_(std::move(poll)) {}

  // The host's side.
  void bus_reset() {
    is_reset_ = true;
    tokens_.clear();
    banks_ = {};
    for (auto& endpoint : buffers_) endpoint = {};
    is_stalled_ = false;
    is_frozen_ = false;
    reset_toggles();
  }
  void reset_toggles() { out_toggle_ = in_toggle_ = false; }
  void frame_start() {
    is_frame_ = true;
    poll_();
  }
  void sleep() {
    is_sleep_ = true;
    poll_();
  }
  std::optional<Bytes> control_in(std::uint8_t type, std::uint8_t request, std::uint16_t value, std::uint16_t index,
                                  std::uint16_t length) {
    setup(type, request, value, index, length);
    Bytes all;
    while (all.size() < length) {
      const auto part = in(0);
      if (!part) return std::nullopt;
      all.insert(all.end(), part->begin(), part->end());
      if (part->size() < 64) break;
    }
    control_toggle_ = true;
    return out(0, {}) ? std::optional(all) : std::nullopt;
  }
  bool control_out(std::uint8_t type, std::uint8_t request, std::uint16_t value, std::uint16_t index,
                   const Bytes& data) {
    setup(type, request, value, index, static_cast<std::uint16_t>(data.size()));
    control_toggle_ = true;
    if (!data.empty() && !out(0, data)) return false;
    control_toggle_ = true;
    const auto status = in(0);
    return status && status->empty();
  }
  void setup(std::uint8_t type, std::uint8_t request, std::uint16_t value, std::uint16_t index, std::uint16_t length) {
    is_stalled_ = false;
    const Bytes packet = {type,
                          request,
                          static_cast<std::uint8_t>(value),
                          static_cast<std::uint8_t>(value >> 8),
                          static_cast<std::uint8_t>(index),
                          static_cast<std::uint8_t>(index >> 8),
                          static_cast<std::uint8_t>(length),
                          static_cast<std::uint8_t>(length >> 8)};
    is_frozen_ = true;
    complete_out(0, packet, Pid::kSetup);
    control_toggle_ = true;
  }
  bool bulk_out(const Bytes& data) {
    const bool is_taken = out(3, data);
    if (is_taken) out_toggle_ = !out_toggle_;
    return is_taken;
  }
  std::optional<Bytes> bulk_in() { return in(4); }

  /// An OUT transaction; false for NAK or STALL.
  bool out(std::uint8_t endpoint, const Bytes& data) {
    if (is_frozen_ || (endpoint == 0 && is_stalled_)) return false;
    Buffer& buffer = buffers_[endpoint][0][banks_[endpoint][0]];
    if (!buffer.is_armed) return false;
    const bool toggle = endpoint == 0 ? control_toggle_ : out_toggle_;
    if (endpoint == 0) control_toggle_ = !control_toggle_;
    if (buffer.is_data1 != toggle) {
      // Acknowledged and dropped. On endpoint 0 only the empty status packet may end so.
      if (endpoint != 0 || !data.empty()) ++toggle_errors;
      return true;
    }
    complete_out(endpoint, data, Pid::kOut);
    return true;
  }
  /// An IN transaction; nothing for NAK or STALL.
  std::optional<Bytes> in(std::uint8_t endpoint) {
    if (is_frozen_ || (endpoint == 0 && is_stalled_)) return std::nullopt;
    const std::uint8_t bank = banks_[endpoint][1];
    Buffer& buffer = buffers_[endpoint][1][bank];
    if (!buffer.is_armed) return std::nullopt;
    bool& toggle = endpoint == 0 ? control_toggle_ : in_toggle_;
    if (buffer.is_data1 != toggle) ++toggle_errors;
    toggle = !toggle;
    const Bytes data(buffer.bytes, buffer.bytes + buffer.size);
    buffer.is_armed = false;
    banks_[endpoint][1] ^= 1U;
    tokens_.push_back({endpoint, true, bank, Pid::kIn, buffer.size});
    poll_();
    return data;
  }

  // The device's side.
  bool take_token(Token& token) noexcept override {
    if (tokens_.empty()) return false;
    token = tokens_.front();
    tokens_.pop_front();
    return true;
  }
  bool take_reset() noexcept override { return std::exchange(is_reset_, false); }
  bool take_frame_start() noexcept override { return std::exchange(is_frame_, false); }
  bool take_sleep() noexcept override { return std::exchange(is_sleep_, false); }
  void arm(std::uint8_t endpoint, bool is_in, std::uint8_t bank, std::uint8_t* bytes, std::uint16_t size,
           bool is_data1) noexcept override {
    buffers_[endpoint][is_in ? 1 : 0][bank] = {true, bytes, size, is_data1};
  }
  void disarm(std::uint8_t endpoint, bool is_in, std::uint8_t bank) noexcept override {
    buffers_[endpoint][is_in ? 1 : 0][bank].is_armed = false;
  }
  void set_endpoint(std::uint8_t, Endpoint) noexcept override {}
  void set_address(std::uint8_t new_address) noexcept override { address = new_address; }
  void stall_control() noexcept override { is_stalled_ = true; }
  void resume_after_setup() noexcept override { is_frozen_ = false; }

  int address = 0;
  int toggle_errors = 0;

 private:
  struct Buffer {
    bool is_armed = false;
    std::uint8_t* bytes = nullptr;
    std::uint16_t size = 0;
    bool is_data1 = false;
  };

  void complete_out(std::uint8_t endpoint, const Bytes& data, Pid pid) {
    const std::uint8_t bank = banks_[endpoint][0];
    Buffer& buffer = buffers_[endpoint][0][bank];
    if (data.size() > buffer.size) {
      ++toggle_errors;
      return;
    }
    if (!data.empty()) std::memcpy(buffer.bytes, data.data(), data.size());
    buffer.is_armed = false;
    banks_[endpoint][0] ^= 1U;
    tokens_.push_back({endpoint, false, bank, pid, static_cast<std::uint16_t>(data.size())});
    poll_();
  }

  std::function<void()> poll_;
  std::deque<Token> tokens_;
  std::array<std::array<std::array<Buffer, 2>, 2>, 5> buffers_{};
  std::array<std::array<std::uint8_t, 2>, 5> banks_{};
  bool is_reset_ = false;
  bool is_frame_ = false;
  bool is_sleep_ = false;
  bool is_stalled_ = false;
  bool is_frozen_ = false;
  bool control_toggle_ = true;
  bool out_toggle_ = false;
  bool in_toggle_ = false;
};

}  // namespace isorig::firmware
