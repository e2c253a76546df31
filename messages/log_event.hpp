#pragma once
#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>

/// What an LCM event log (lcm-logger's format) is made of: events of a 28-byte big-endian header (sync word, event
/// number, time in us, channel length, data length), the channel and the data.
///
/// In a recording the last four bytes of the data are the CRC-32C of all bytes of the event before them. LCM's tools
/// take them for a part of the message, and its decoders do not look at what follows a message.
namespace isorig::messages {

inline constexpr std::uint32_t kLogSyncWord = 0xEDA1DA01;
inline constexpr std::size_t kLogHeaderBytes = 28;
inline constexpr std::size_t kLogChecksumBytes = 4;

/// How much a log holds, and a fingerprint of it.
struct LogTally {
  std::int64_t events = 0;
  std::int64_t bytes = 0;
  std::uint32_t checksum = 0;  ///< CRC-32C over the events' checksums, in their order
  bool operator==(const LogTally&) const = default;
};

void add_to(LogTally& tally, std::size_t event_bytes, std::uint32_t event_checksum) noexcept;

template <typename T>
std::uint8_t* put_big_endian(std::uint8_t* to, T value) noexcept {
  for (int shift = static_cast<int>(sizeof(T)) * 8 - 8; shift >= 0; shift -= 8) {
    *to++ = static_cast<std::uint8_t>(static_cast<std::uint64_t>(value) >> static_cast<unsigned>(shift));
  }
  return to;
}

inline std::uint64_t big_endian(const std::uint8_t* bytes, std::size_t n) noexcept {
  std::uint64_t value = 0;
  for (std::size_t i = 0; i < n; ++i) value = value << 8U | bytes[i];
  return value;
}

}  // namespace isorig::messages
