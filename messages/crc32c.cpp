#include "messages/crc32c.hpp"

#include <isa-l/crc.h>

#include <array>

#include "messages/log_event.hpp"

namespace isorig::messages {

std::uint32_t crc32c(std::span<const std::uint8_t> bytes, std::uint32_t before) noexcept {
  // ISA-L leaves out the inversion before and after, and takes no const although it only reads.
  return ~crc32_iscsi(const_cast<std::uint8_t*>(bytes.data()), static_cast<int>(bytes.size()), ~before);
}

void add_to(LogTally& tally, std::size_t event_bytes, std::uint32_t event_checksum) noexcept {
  std::array<std::uint8_t, kLogChecksumBytes> bytes{};
  put_big_endian(bytes.data(), event_checksum);
  tally.checksum = crc32c(bytes, tally.checksum);
  tally.bytes += static_cast<std::int64_t>(event_bytes);
  ++tally.events;
}

}  // namespace isorig::messages
