#pragma once
#include <stddef.h>
#include <stdint.h>

#include "messages/teensy/cobs.hpp"

/// The messages between the host and the Teensy. docs/wire-teensy.md has them byte by byte.
///
/// A frame is COBS(version, type, body, CRC-32C of all before it), then a zero. All numbers little-endian and
/// written byte by byte: no struct layout, alignment or host order enters the wire.
/// Freestanding (the firmware compiles these files): only <stddef.h> and <stdint.h>.
namespace isorig::messages::teensy {

/// 2: limits, without which the device does not fill; the cause in Status. A device of version 1 knew neither and is
/// refused.
inline constexpr uint8_t kProtocolVersion = 2;

/// Payload (version, type, body, CRC) of at most 254 bytes: COBS then costs exactly one byte, and the longest
/// frame with its zero is 256 bytes, four full-speed USB packets.
inline constexpr size_t kMaxPayload = 254;
inline constexpr size_t kHeaderSize = 2;
inline constexpr size_t kCrcSize = 4;
inline constexpr size_t kMaxBody = kMaxPayload - kHeaderSize - kCrcSize;
inline constexpr size_t kMaxFrame = kMaxPayload + 2;  ///< one code byte and the ending zero
static_assert(kMaxFrame == 256);

/// Host to device below 0x40, device to host from 0x40 on, so that a frame echoed by a tty that is still in
/// cooked mode is recognised as not meant for its reader.
enum class Type : uint8_t {
  kIdentityRequest = 0x01,
  kTimeSyncRequest = 0x02,
  kValveCommand = 0x03,
  kHeartbeat = 0x04,
  kLimits = 0x05,
  kIdentity = 0x41,
  kTimeSyncReply = 0x42,
  kStatus = 0x43,
  kSamples = 0x44,
  kSyncEdge = 0x45,
  kLimitsReply = 0x46,
};

/// Opens a session: the device answers with Identity and Status, and accepts any next command sequence.
struct IdentityRequest {
  uint32_t session = 0;  ///< echoed; a host picks a new one each time
};

struct TimeSyncRequest {
  uint32_t cookie = 0;  ///< echoed, so that a late reply is matched with its own request
};

/// Duties of the two valves. One of them is zero; the device refuses (and counts) anything else.
struct ValveCommand {
  uint32_t sequence = 0;       ///< newer than the last accepted one (serial arithmetic), else ignored
  uint16_t fill_permille = 0;  ///< 0..1000
  uint16_t vent_permille = 0;  ///< 0..1000
  uint16_t validity_ms = 0;    ///< both valves close when no newer command came by then; 1..10000
};

/// Feeds the device's watchdog. Nothing else does: a thread that still sends valve commands proves less than
/// the real-time loop that lets heartbeats through.
struct Heartbeat {
  uint32_t counter = 0;
};

/// What the device keeps to without its host (fill_guard.hpp). To be set in every session before anything is filled.
struct Limits {
  uint16_t pressure_max_raw = 0;         ///< counts of the ELVH; a greater reading vents
  uint16_t fill_allowance_permille = 0;  ///< duty of the fill valve that may flow for ever
  uint32_t fill_max_ms = 0;              ///< full-duty time above it; 0: no cap (the supply valve of a regulator)

  friend constexpr bool operator==(const Limits&, const Limits&) noexcept = default;
};

/// The limits in force, as the device has them.
struct LimitsReply {
  Limits limits;
  uint8_t accepted = 0;  ///< 1: they are those of the request; 0: the request was refused
};

inline constexpr size_t kTextSize = 24;  ///< zero-padded ASCII; 23 characters and a zero at most

struct Identity {
  uint32_t session = 0;
  uint32_t sample_rate_mhz = 0;  ///< nominal, millihertz
  uint16_t watchdog_ms = 0;      ///< after this long without a heartbeat it vents
  uint64_t device_us = 0;        ///< device clock when sent, 64 bit
  uint32_t next_sequence = 0;    ///< of the next sample
  char model[kTextSize] = {};
  char serial[kTextSize] = {};
  char firmware[kTextSize] = {};
};

/// Both stamps are whole microseconds rounded down, 64 bit: a device that was never reset does not wrap.
struct TimeSyncReply {
  uint32_t cookie = 0;
  uint64_t device_rx_us = 0;
  uint64_t device_tx_us = 0;
};

/// Why the device vented by itself.
enum class VentCause : uint8_t {
  kNone = 0,
  kHeartbeat = 1,     ///< heartbeats stopped
  kPressureHigh = 2,  ///< a reading above Limits::pressure_max_raw
  kFillTime = 3,      ///< the fill valve was open for longer than Limits::fill_max_ms
  kSensorSilent = 4,  ///< while filling: nothing from the sensor that can be believed
  kSensorStuck = 5,   ///< while filling: one and the same count
};
inline constexpr uint8_t kVentCauses = 6;

enum StatusFlag : uint8_t {
  kStatusSelfVented = 1U << 0U,      ///< latched, see DeviceCore
  kStatusCommandExpired = 1U << 1U,  ///< validity ran out: both valves closed
  kStatusHasLimits = 1U << 2U,       ///< of this session
};

/// Sent ten times a second and at once when a flag changes.
struct Status {
  uint64_t device_us = 0;
  uint32_t dropped = 0;           ///< samples discarded because the host stalled, since start
  uint32_t rejected = 0;          ///< commands out of range, or refused: latched, no limits, no heartbeats
  uint32_t corrupt = 0;           ///< frames received that failed COBS, CRC, version or length
  uint32_t command_sequence = 0;  ///< of the last accepted valve command
  uint16_t self_vents = 0;        ///< how often it vented by itself, since start
  uint16_t fill_permille = 0;     ///< applied now
  uint16_t vent_permille = 0;
  uint8_t flags = 0;
  VentCause cause = VentCause::kNone;  ///< of the last time it vented by itself
  uint16_t fill_used_ms = 0;           ///< of Limits::fill_max_ms
};

struct Sample {
  uint32_t sequence = 0;   ///< counts conversions; wraps at 2^32
  uint32_t device_us = 0;  ///< low 32 bits of the device clock at the conversion; wraps each 71.58 min
  uint32_t raw_word = 0;   ///< as the ELVH sent it (messages/elvh.hpp)
};

inline constexpr size_t kSampleSize = 12;
inline constexpr size_t kMaxSamples = (kMaxBody - 1) / kSampleSize;
static_assert(kMaxSamples == 20);

struct Samples {
  uint8_t count = 0;  ///< 1..kMaxSamples
  Sample items[kMaxSamples];
};

/// The sync line changed at a known device time; the host sees the same edge on a GPIO.
struct SyncEdge {
  uint64_t device_us = 0;
  uint32_t count = 0;
  uint8_t level = 0;  ///< 0 or 1, after the edge
};

/// The full device time whose low 32 bits are `low_us`, nearest to `reference_us`: right as long as the two
/// are less than 35.8 min apart. Every Identity, Status and TimeSyncReply is such a reference.
[[nodiscard]] constexpr int64_t extend_us(uint32_t low_us, int64_t reference_us) noexcept {
  return reference_us + static_cast<int32_t>(low_us - static_cast<uint32_t>(reference_us));
}

struct Frame {
  uint8_t bytes[kMaxFrame] = {};
  size_t size = 0;  ///< with the ending zero
};

[[nodiscard]] Frame encode(const IdentityRequest& message) noexcept;
[[nodiscard]] Frame encode(const TimeSyncRequest& message) noexcept;
[[nodiscard]] Frame encode(const ValveCommand& message) noexcept;
[[nodiscard]] Frame encode(const Heartbeat& message) noexcept;
[[nodiscard]] Frame encode(const Limits& message) noexcept;
[[nodiscard]] Frame encode(const Identity& message) noexcept;
[[nodiscard]] Frame encode(const TimeSyncReply& message) noexcept;
[[nodiscard]] Frame encode(const Status& message) noexcept;
[[nodiscard]] Frame encode(const Samples& message) noexcept;
[[nodiscard]] Frame encode(const SyncEdge& message) noexcept;
[[nodiscard]] Frame encode(const LimitsReply& message) noexcept;

/// A packet whose COBS and CRC were right. `body` points into the decoder and is good until the next byte.
struct Packet {
  uint8_t version = 0;
  uint8_t type = 0;
  const uint8_t* body = nullptr;
  size_t size = 0;

  [[nodiscard]] constexpr bool is(Type wanted) const noexcept { return type == static_cast<uint8_t>(wanted); }
};

/// Each returns false, and leaves `out` undefined, when version, type, length or a field is not as specified.
/// IdentityRequest and Identity keep their form in every version and are read in any, so that a host can say
/// which version the other side speaks.
[[nodiscard]] bool parse(const Packet& packet, IdentityRequest& out) noexcept;
[[nodiscard]] bool parse(const Packet& packet, TimeSyncRequest& out) noexcept;
[[nodiscard]] bool parse(const Packet& packet, ValveCommand& out) noexcept;
[[nodiscard]] bool parse(const Packet& packet, Heartbeat& out) noexcept;
[[nodiscard]] bool parse(const Packet& packet, Limits& out) noexcept;
[[nodiscard]] bool parse(const Packet& packet, Identity& out) noexcept;
[[nodiscard]] bool parse(const Packet& packet, TimeSyncReply& out) noexcept;
[[nodiscard]] bool parse(const Packet& packet, Status& out) noexcept;
[[nodiscard]] bool parse(const Packet& packet, Samples& out) noexcept;
[[nodiscard]] bool parse(const Packet& packet, SyncEdge& out) noexcept;
[[nodiscard]] bool parse(const Packet& packet, LimitsReply& out) noexcept;

/// Wraps any payload (version, type, body) as a frame; `encode` and tests use it.
[[nodiscard]] Frame make_frame(uint8_t version, uint8_t type, const uint8_t* body, size_t size) noexcept;

}  // namespace isorig::messages::teensy
