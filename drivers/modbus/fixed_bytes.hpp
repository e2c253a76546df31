#pragma once
#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <stdexcept>

namespace isorig::modbus {

/// Bytes in a place of their own: a frame is polled two hundred times a second by a thread that allocates nothing
/// (docs/threads.md).
template <std::size_t kCapacity>
class FixedBytes {
 public:
  FixedBytes() = default;
  explicit FixedBytes(std::span<const std::uint8_t> bytes) { append(bytes); }

  [[nodiscard]] std::size_t size() const noexcept { return size_; }
  [[nodiscard]] bool empty() const noexcept { return size_ == 0; }
  [[nodiscard]] const std::uint8_t* data() const noexcept { return bytes_.data(); }
  [[nodiscard]] const std::uint8_t* begin() const noexcept { return data(); }
  [[nodiscard]] const std::uint8_t* end() const noexcept { return data() + size_; }
  [[nodiscard]] std::uint8_t operator[](std::size_t i) const noexcept { return bytes_[i]; }
  /// What is free behind the last byte; grow() takes what was written there along.
  [[nodiscard]] std::span<std::uint8_t> room() noexcept { return std::span(bytes_).subspan(size_); }

  void grow(std::size_t by) {
    if (by > kCapacity - size_) throw std::length_error("more bytes than any Modbus message has");
    size_ += by;
  }
  void push_back(std::uint8_t byte) { append({&byte, 1}); }
  void append(std::span<const std::uint8_t> bytes) {
    const std::size_t at = size_;
    grow(bytes.size());
    std::copy(bytes.begin(), bytes.end(), bytes_.begin() + static_cast<std::ptrdiff_t>(at));
  }
  void drop_front(std::size_t count) noexcept {
    std::copy(begin() + count, end(), bytes_.begin());
    size_ -= count;
  }
  void clear() noexcept { size_ = 0; }

 private:
  std::array<std::uint8_t, kCapacity> bytes_{};
  std::size_t size_ = 0;
};

}  // namespace isorig::modbus
