#pragma once
#include <stddef.h>
#include <stdint.h>

#include "messages/teensy/crc32c.hpp"
#include "messages/teensy/wire.hpp"

namespace isorig::messages::teensy {

/// Cuts a byte stream into packets. Any bytes may arrive, in chunks of any size: damage costs the frame it is
/// in, never the next one, and is counted. Bounded memory, no allocation, O(1) per byte.
class Decoder {
 public:
  struct Counters {
    uint32_t packets = 0;
    uint32_t malformed = 0;  ///< COBS wrong or shorter than the shortest payload
    uint32_t bad_crc = 0;
    uint32_t oversize = 0;  ///< no zero within the longest frame: the rest is skipped up to the next zero

    [[nodiscard]] constexpr uint32_t errors() const noexcept { return malformed + bad_crc + oversize; }
  };

  /// Calls `handle(const Packet&)` for each packet that `byte`s complete.
  template <class Handler>
  void feed(const uint8_t* bytes, size_t size, Handler&& handle) noexcept(noexcept(handle(Packet{}))) {
    for (size_t i = 0; i < size; ++i) {
      Packet packet;
      if (push(bytes[i], packet)) handle(packet);
    }
  }

  /// Takes one byte; true when it completed a packet.
  bool push(uint8_t byte, Packet& packet) noexcept {
    if (byte != 0) {
      if (size_ < sizeof buffer_) {
        buffer_[size_++] = byte;
      } else {
        is_oversize_ = true;
      }
      return false;
    }
    const bool is_done = finish(packet);
    size_ = 0;
    is_oversize_ = false;
    is_synchronised_ = true;
    return is_done;
  }

  /// Forgets a half-received frame (after reopening a port). What comes before the next zero may be the tail
  /// of a frame: it is taken if it is whole, and not counted as an error if it is not.
  void resynchronise() noexcept {
    size_ = 0;
    is_oversize_ = false;
    is_synchronised_ = false;
  }

  [[nodiscard]] const Counters& counters() const noexcept { return counters_; }

 private:
  bool finish(Packet& packet) noexcept {
    if (size_ == 0) return false;  // zeros in a row: senders may flush a line with them
    if (is_oversize_) return reject(counters_.oversize);
    const size_t length = cobs_decode(buffer_, size_, buffer_);
    if (length == kCobsInvalid || length < kHeaderSize + kCrcSize) return reject(counters_.malformed);
    const size_t crc_at = length - kCrcSize;
    uint32_t sent_crc = 0;
    for (size_t i = 0; i < kCrcSize; ++i) sent_crc |= static_cast<uint32_t>(buffer_[crc_at + i]) << (8U * i);
    if (crc32c(buffer_, crc_at) != sent_crc) return reject(counters_.bad_crc);
    ++counters_.packets;
    packet.version = buffer_[0];
    packet.type = buffer_[1];
    packet.body = buffer_ + kHeaderSize;
    packet.size = crc_at - kHeaderSize;
    return true;
  }

  bool reject(uint32_t& counter) noexcept {
    if (is_synchronised_) ++counter;
    return false;
  }

  uint8_t buffer_[kMaxFrame - 1] = {};
  size_t size_ = 0;
  bool is_oversize_ = false;
  bool is_synchronised_ = false;
  Counters counters_;
};

}  // namespace isorig::messages::teensy
