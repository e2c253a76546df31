#pragma once
// The USBFS module at the level of its registers and its buffer descriptors in RAM, and the host on the other
// end of the cable.
#include <array>
#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <optional>
#include <vector>

namespace isorig::firmware {

class K66Usb {
 public:
  using Bytes = std::vector<std::uint8_t>;

  std::function<std::uint32_t(std::uint32_t)> read_memory;
  std::function<void(std::uint32_t, std::uint32_t)> write_memory;
  /// Lets the program run for a while.
  std::function<void(std::uint64_t us)> run_us;

  // Registers, by offset.
  std::uint32_t read(std::uint32_t offset) {
    if (offset == 0x80) return flags_ & inten_;
    if (offset == 0x90) return tokens_.empty() ? 0 : tokens_.front();
    if (offset == 0x94) return control_;
    return registers_[offset];
  }
  void write(std::uint32_t offset, std::uint8_t value) {
    registers_[offset] = value;
    if (offset == 0x84) inten_ = value;
    if (offset == 0x94) {
      control_ = value;  // also clears TXSUSPENDTOKENBUSY
      if ((value & 0x02U) != 0) banks_ = {};
    }
    if (offset == 0x80) {
      if ((value & flags_ & kToken) != 0) tokens_.pop_front();
      flags_ = static_cast<std::uint8_t>(flags_ & ~value);
      if (!tokens_.empty()) flags_ |= kToken;
    }
  }
  [[nodiscard]] bool is_attached() const { return (register_at(0x108) & 0x10U) != 0 && (control_ & 1U) != 0; }
  [[nodiscard]] int address() const { return register_at(0x98) & 0x7F; }

  // The host.
  void bus_reset() {
    tokens_.clear();
    flags_ = kReset;
    reset_toggles();
    run_us(1'000);
  }
  void reset_toggles() { toggles_ = {}; }
  void frame_start() {
    flags_ |= kFrameStart;
    run_us(1'000);
  }
  std::optional<Bytes> control_in(std::uint8_t type, std::uint8_t request, std::uint16_t value, std::uint16_t index,
                                  std::uint16_t length) {
    if (!setup(type, request, value, index, length)) return std::nullopt;
    Bytes all;
    while (all.size() < length) {
      const auto part = in(0);
      if (!part) return std::nullopt;
      all.insert(all.end(), part->begin(), part->end());
      if (part->size() < 64) break;
    }
    toggles_[0][0] = true;
    return out(0, {}) ? std::optional(all) : std::nullopt;
  }
  bool control_out(std::uint8_t type, std::uint8_t request, std::uint16_t value, std::uint16_t index,
                   const Bytes& data) {
    if (!setup(type, request, value, index, static_cast<std::uint16_t>(data.size()))) return false;
    if (!data.empty() && !out(0, data)) return false;
    toggles_[0][1] = true;
    const auto status = in(0);
    return status && status->empty();
  }
  bool setup(std::uint8_t type, std::uint8_t request, std::uint16_t value, std::uint16_t index, std::uint16_t length) {
    const Bytes packet = {type, request, low(value), high(value), low(index), high(index), low(length), high(length)};
    toggles_[0] = {false, true};
    if (!transact_out(0, packet, 0xD)) return false;
    toggles_[0] = {true, true};
    return true;
  }
  bool out(std::uint8_t endpoint, const Bytes& data) { return transact_out(endpoint, data, 0x1); }
  /// Asks again while the device answers NAK, up to `patience_us`.
  std::optional<Bytes> in(std::uint8_t endpoint, std::uint64_t patience_us = 5'000) {
    for (std::uint64_t waited = 0; waited <= patience_us; waited += kRetry_us) {
      if (is_stalled(endpoint)) return std::nullopt;
      const unsigned bank = banks_[endpoint][1];
      const std::uint32_t at = descriptor(endpoint, true, bank);
      const std::uint32_t word = read_memory(at);
      if (!is_ready(endpoint, 0x04) || (word & kOwn) == 0) {
        run_us(kRetry_us);
        continue;
      }
      bool& toggle = toggles_[endpoint][1];
      if (((word & kData1) != 0) != toggle) ++toggle_errors;
      toggle = !toggle;
      const std::uint32_t size = word >> 16 & 0x3FFU;
      const std::uint32_t buffer = read_memory(at + 4);
      Bytes data;
      for (std::uint32_t i = 0; i < size; ++i) {
        data.push_back(static_cast<std::uint8_t>(read_memory((buffer + i) & ~3U) >> 8 * ((buffer + i) & 3U)));
      }
      complete(endpoint, true, bank, 0x9, size);
      return data;
    }
    return std::nullopt;
  }

  int toggle_errors = 0;

 private:
  static constexpr std::uint8_t kReset = 0x01, kFrameStart = 0x04, kToken = 0x08, kStall = 0x80;
  static constexpr std::uint32_t kOwn = 0x80, kData1 = 0x40, kDts = 0x08;
  static constexpr std::uint64_t kRetry_us = 20;

  static std::uint8_t low(std::uint16_t v) { return static_cast<std::uint8_t>(v); }
  static std::uint8_t high(std::uint16_t v) { return static_cast<std::uint8_t>(v >> 8); }
  [[nodiscard]] std::uint8_t register_at(std::uint32_t offset) const {
    const auto found = registers_.find(offset);
    return found == registers_.end() ? 0 : found->second;
  }
  [[nodiscard]] std::uint32_t descriptor(std::uint8_t endpoint, bool is_in, unsigned bank) const {
    const std::uint32_t table = static_cast<std::uint32_t>(register_at(0x9C) & 0xFEU) << 8 |
                                static_cast<std::uint32_t>(register_at(0xB0)) << 16 |
                                static_cast<std::uint32_t>(register_at(0xB4)) << 24;
    return table + (endpoint * 4U + (is_in ? 2U : 0U) + bank) * 8U;
  }
  [[nodiscard]] bool is_ready(std::uint8_t endpoint, std::uint8_t direction) const {
    const std::uint8_t bits = register_at(0xC0 + 4U * endpoint);
    return is_attached() && (control_ & 0x20U) == 0 && tokens_.size() < 4 && (bits & direction) != 0 &&
           (bits & 0x01U) != 0;
  }
  bool is_stalled(std::uint8_t endpoint) {
    if ((register_at(0xC0 + 4U * endpoint) & 0x02U) == 0) return false;
    flags_ |= kStall;
    run_us(kRetry_us);
    return true;
  }
  bool transact_out(std::uint8_t endpoint, const Bytes& data, std::uint32_t pid) {
    for (int tries = 0; tries < 250; ++tries) {
      if (pid != 0xD && is_stalled(endpoint)) return false;
      const unsigned bank = banks_[endpoint][0];
      const std::uint32_t at = descriptor(endpoint, false, bank);
      const std::uint32_t word = read_memory(at);
      if (!is_ready(endpoint, 0x08) || (word & kOwn) == 0) {
        run_us(kRetry_us);
        continue;
      }
      bool& toggle = toggles_[endpoint][0];
      const bool is_match = pid == 0xD || (word & kDts) == 0 || ((word & kData1) != 0) == toggle;
      toggle = !toggle;
      if (!is_match) {  // acknowledged and dropped; on endpoint 0 only an empty status packet may end so
        if (endpoint != 0 || !data.empty()) ++toggle_errors;
        return true;
      }
      const std::uint32_t buffer = read_memory(at + 4);
      for (std::uint32_t i = 0; i < data.size(); ++i) {
        const std::uint32_t where = (buffer + i) & ~3U;
        const unsigned shift = 8 * ((buffer + i) & 3U);
        write_memory(where, (read_memory(where) & ~(0xFFU << shift)) | static_cast<std::uint32_t>(data[i]) << shift);
      }
      if (pid == 0xD) control_ |= 0x20U;
      complete(endpoint, false, bank, pid, static_cast<std::uint32_t>(data.size()));
      return true;
    }
    return false;
  }
  void complete(std::uint8_t endpoint, bool is_in, unsigned bank, std::uint32_t pid, std::uint32_t size) {
    write_memory(descriptor(endpoint, is_in, bank), size << 16 | pid << 2);
    banks_[endpoint][is_in ? 1 : 0] ^= 1U;
    tokens_.push_back(static_cast<std::uint8_t>(endpoint << 4 | (is_in ? 8 : 0) | bank << 2));
    flags_ |= kToken;
    run_us(kRetry_us);
  }

  std::map<std::uint32_t, std::uint8_t> registers_;
  std::deque<std::uint8_t> tokens_;
  std::array<std::array<std::uint8_t, 2>, 16> banks_{};
  std::array<std::array<bool, 2>, 16> toggles_{};
  std::uint8_t flags_ = 0;
  std::uint8_t inten_ = 0;
  std::uint8_t control_ = 0;
};

}  // namespace isorig::firmware
