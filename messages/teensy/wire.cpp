#include "messages/teensy/wire.hpp"

#include "messages/teensy/crc32c.hpp"

namespace isorig::messages::teensy {
namespace {

class Writer {
 public:
  void u8(uint8_t value) noexcept { bytes_[size_++] = value; }
  void u16(uint16_t value) noexcept { little_endian(value, 2); }
  void u32(uint32_t value) noexcept { little_endian(value, 4); }
  void u64(uint64_t value) noexcept { little_endian(value, 8); }
  void text(const char (&value)[kTextSize]) noexcept {
    bool ended = false;
    for (size_t i = 0; i < kTextSize; ++i) {
      ended = ended || value[i] == '\0' || i + 1 == kTextSize;
      u8(ended ? uint8_t{0} : static_cast<uint8_t>(value[i]));
    }
  }
  [[nodiscard]] Frame frame(Type type) const noexcept {
    return make_frame(kProtocolVersion, static_cast<uint8_t>(type), bytes_, size_);
  }

 private:
  void little_endian(uint64_t value, unsigned width) noexcept {
    for (unsigned i = 0; i < width; ++i) u8(static_cast<uint8_t>(value >> (8U * i)));
  }
  uint8_t bytes_[kMaxBody] = {};
  size_t size_ = 0;
};

// Reads past the end give zero and make `complete()` false, so that a parser checks once, at its end.
class Reader {
 public:
  explicit Reader(const Packet& packet) noexcept : data_(packet.body), size_(packet.size) {}
  uint8_t u8() noexcept { return static_cast<uint8_t>(little_endian(1)); }
  uint16_t u16() noexcept { return static_cast<uint16_t>(little_endian(2)); }
  uint32_t u32() noexcept { return static_cast<uint32_t>(little_endian(4)); }
  uint64_t u64() noexcept { return little_endian(8); }
  void text(char (&out)[kTextSize]) noexcept {
    for (size_t i = 0; i < kTextSize; ++i) out[i] = static_cast<char>(u8());
    out[kTextSize - 1] = '\0';
  }
  [[nodiscard]] bool complete() const noexcept { return !overrun_ && at_ == size_; }

 private:
  uint64_t little_endian(unsigned width) noexcept {
    if (size_ - at_ < width) {
      overrun_ = true;
      return 0;
    }
    uint64_t value = 0;
    for (unsigned i = 0; i < width; ++i) value |= static_cast<uint64_t>(data_[at_++]) << (8U * i);
    return value;
  }
  const uint8_t* data_;
  size_t size_;
  size_t at_ = 0;
  bool overrun_ = false;
};

void write(Writer& writer, const Limits& limits) noexcept {
  writer.u16(limits.pressure_max_raw);
  writer.u16(limits.fill_allowance_permille);
  writer.u32(limits.fill_max_ms);
}

void read(Reader& reader, Limits& limits) noexcept {
  limits.pressure_max_raw = reader.u16();
  limits.fill_allowance_permille = reader.u16();
  limits.fill_max_ms = reader.u32();
}

bool is_current(const Packet& packet, Type type) noexcept {
  return packet.version == kProtocolVersion && packet.is(type);
}

}  // namespace

Frame make_frame(uint8_t version, uint8_t type, const uint8_t* body, size_t size) noexcept {
  Frame frame;
  if (size > kMaxBody) return frame;
  uint8_t payload[kMaxPayload];
  payload[0] = version;
  payload[1] = type;
  for (size_t i = 0; i < size; ++i) payload[kHeaderSize + i] = body[i];
  const uint32_t crc = crc32c(payload, kHeaderSize + size);
  for (size_t i = 0; i < kCrcSize; ++i) payload[kHeaderSize + size + i] = static_cast<uint8_t>(crc >> (8U * i));
  frame.size = cobs_encode(payload, kHeaderSize + size + kCrcSize, frame.bytes);
  frame.bytes[frame.size++] = 0;
  return frame;
}

Frame encode(const IdentityRequest& message) noexcept {
  Writer writer;
  writer.u32(message.session);
  return writer.frame(Type::kIdentityRequest);
}

Frame encode(const TimeSyncRequest& message) noexcept {
  Writer writer;
  writer.u32(message.cookie);
  return writer.frame(Type::kTimeSyncRequest);
}

Frame encode(const ValveCommand& message) noexcept {
  Writer writer;
  writer.u32(message.sequence);
  writer.u16(message.fill_permille);
  writer.u16(message.vent_permille);
  writer.u16(message.validity_ms);
  return writer.frame(Type::kValveCommand);
}

Frame encode(const Heartbeat& message) noexcept {
  Writer writer;
  writer.u32(message.counter);
  return writer.frame(Type::kHeartbeat);
}

Frame encode(const Limits& message) noexcept {
  Writer writer;
  write(writer, message);
  return writer.frame(Type::kLimits);
}

Frame encode(const LimitsReply& message) noexcept {
  Writer writer;
  write(writer, message.limits);
  writer.u8(message.accepted);
  return writer.frame(Type::kLimitsReply);
}

Frame encode(const Identity& message) noexcept {
  Writer writer;
  writer.u32(message.session);
  writer.u32(message.sample_rate_mhz);
  writer.u16(message.watchdog_ms);
  writer.u64(message.device_us);
  writer.u32(message.next_sequence);
  writer.text(message.model);
  writer.text(message.serial);
  writer.text(message.firmware);
  return writer.frame(Type::kIdentity);
}

Frame encode(const TimeSyncReply& message) noexcept {
  Writer writer;
  writer.u32(message.cookie);
  writer.u64(message.device_rx_us);
  writer.u64(message.device_tx_us);
  return writer.frame(Type::kTimeSyncReply);
}

Frame encode(const Status& message) noexcept {
  Writer writer;
  writer.u64(message.device_us);
  writer.u32(message.dropped);
  writer.u32(message.rejected);
  writer.u32(message.corrupt);
  writer.u32(message.command_sequence);
  writer.u16(message.self_vents);
  writer.u16(message.fill_permille);
  writer.u16(message.vent_permille);
  writer.u8(message.flags);
  writer.u8(static_cast<uint8_t>(message.cause));
  writer.u16(message.fill_used_ms);
  return writer.frame(Type::kStatus);
}

Frame encode(const Samples& message) noexcept {
  Writer writer;
  const uint8_t count = message.count <= kMaxSamples ? message.count : static_cast<uint8_t>(kMaxSamples);
  writer.u8(count);
  for (size_t i = 0; i < count; ++i) {
    writer.u32(message.items[i].sequence);
    writer.u32(message.items[i].device_us);
    writer.u32(message.items[i].raw_word);
  }
  return writer.frame(Type::kSamples);
}

Frame encode(const SyncEdge& message) noexcept {
  Writer writer;
  writer.u64(message.device_us);
  writer.u32(message.count);
  writer.u8(message.level);
  return writer.frame(Type::kSyncEdge);
}

bool parse(const Packet& packet, IdentityRequest& out) noexcept {
  Reader reader(packet);
  out.session = reader.u32();
  return packet.is(Type::kIdentityRequest) && reader.complete();
}

bool parse(const Packet& packet, TimeSyncRequest& out) noexcept {
  Reader reader(packet);
  out.cookie = reader.u32();
  return is_current(packet, Type::kTimeSyncRequest) && reader.complete();
}

bool parse(const Packet& packet, ValveCommand& out) noexcept {
  Reader reader(packet);
  out.sequence = reader.u32();
  out.fill_permille = reader.u16();
  out.vent_permille = reader.u16();
  out.validity_ms = reader.u16();
  return is_current(packet, Type::kValveCommand) && reader.complete();
}

bool parse(const Packet& packet, Heartbeat& out) noexcept {
  Reader reader(packet);
  out.counter = reader.u32();
  return is_current(packet, Type::kHeartbeat) && reader.complete();
}

bool parse(const Packet& packet, Limits& out) noexcept {
  Reader reader(packet);
  read(reader, out);
  return is_current(packet, Type::kLimits) && reader.complete();
}

bool parse(const Packet& packet, LimitsReply& out) noexcept {
  Reader reader(packet);
  read(reader, out.limits);
  out.accepted = reader.u8();
  return is_current(packet, Type::kLimitsReply) && reader.complete() && out.accepted <= 1;
}

bool parse(const Packet& packet, Identity& out) noexcept {
  Reader reader(packet);
  out.session = reader.u32();
  out.sample_rate_mhz = reader.u32();
  out.watchdog_ms = reader.u16();
  out.device_us = reader.u64();
  out.next_sequence = reader.u32();
  reader.text(out.model);
  reader.text(out.serial);
  reader.text(out.firmware);
  return packet.is(Type::kIdentity) && reader.complete();
}

bool parse(const Packet& packet, TimeSyncReply& out) noexcept {
  Reader reader(packet);
  out.cookie = reader.u32();
  out.device_rx_us = reader.u64();
  out.device_tx_us = reader.u64();
  return is_current(packet, Type::kTimeSyncReply) && reader.complete() && out.device_rx_us <= out.device_tx_us;
}

bool parse(const Packet& packet, Status& out) noexcept {
  Reader reader(packet);
  out.device_us = reader.u64();
  out.dropped = reader.u32();
  out.rejected = reader.u32();
  out.corrupt = reader.u32();
  out.command_sequence = reader.u32();
  out.self_vents = reader.u16();
  out.fill_permille = reader.u16();
  out.vent_permille = reader.u16();
  out.flags = reader.u8();
  const uint8_t cause = reader.u8();
  out.cause = static_cast<VentCause>(cause);
  out.fill_used_ms = reader.u16();
  return is_current(packet, Type::kStatus) && reader.complete() && cause < kVentCauses;
}

bool parse(const Packet& packet, Samples& out) noexcept {
  if (!is_current(packet, Type::kSamples)) return false;
  Reader reader(packet);
  out.count = reader.u8();
  if (out.count == 0 || out.count > kMaxSamples) return false;
  for (size_t i = 0; i < out.count; ++i) {
    out.items[i].sequence = reader.u32();
    out.items[i].device_us = reader.u32();
    out.items[i].raw_word = reader.u32();
  }
  return reader.complete();
}

bool parse(const Packet& packet, SyncEdge& out) noexcept {
  Reader reader(packet);
  out.device_us = reader.u64();
  out.count = reader.u32();
  out.level = reader.u8();
  return is_current(packet, Type::kSyncEdge) && reader.complete() && out.level <= 1;
}

}  // namespace isorig::messages::teensy
