#pragma once
#include <stddef.h>
#include <stdint.h>

namespace isorig::firmware {

/// USB packets that wait for the host. A frame goes in whole or not at all, as packets of its own, so that
/// its last, partial packet ends a bulk transfer and is delivered at once; a frame that fills its packets is
/// ended by an empty one (USB 2.0, 5.8.3). Packets stay in place until they are acknowledged.
class PacketQueue {
 public:
  static constexpr size_t kPacketSize = 64;
  /// 1 KiB, twice what a Teensy's usual USB stack holds: some 15 ms at 2 kHz before samples are dropped.
  static constexpr size_t kPackets = 16;

  struct Packet {
    alignas(4) uint8_t bytes[kPacketSize];
    uint8_t size;
  };

  [[nodiscard]] bool push(const uint8_t* bytes, size_t size) noexcept {
    const size_t needed = size / kPacketSize + 1;
    if (needed > kPackets - count_) return false;
    for (size_t i = 0; i < needed; ++i) {
      Packet& packet = packets_[(first_ + count_) % kPackets];
      const size_t left = size - i * kPacketSize;
      packet.size = static_cast<uint8_t>(left < kPacketSize ? left : kPacketSize);
      for (size_t k = 0; k < packet.size; ++k) packet.bytes[k] = bytes[i * kPacketSize + k];
      ++count_;
    }
    return true;
  }

  [[nodiscard]] size_t count() const noexcept { return count_; }
  /// The packet `ahead` places behind the oldest.
  [[nodiscard]] Packet& at(size_t ahead) noexcept { return packets_[(first_ + ahead) % kPackets]; }
  void pop() noexcept {
    first_ = (first_ + 1) % kPackets;
    --count_;
  }
  /// Forgets all but the oldest `count`.
  void keep(size_t count) noexcept {
    if (count_ > count) count_ = count;
  }

 private:
  Packet packets_[kPackets] = {};
  size_t first_ = 0;
  size_t count_ = 0;
};

}  // namespace isorig::firmware
