#pragma once
#include <cstdint>
#include <span>

namespace isorig::messages {

/// CRC-32C (Castagnoli; RFC 3720, B.4): finds every change of up to 32 consecutive bits, and in messages of up to
/// 177 kB (Koopman, DSN 2002) every change of up to three bits. `before` continues an earlier checksum.
[[nodiscard]] std::uint32_t crc32c(std::span<const std::uint8_t> bytes, std::uint32_t before = 0) noexcept;

}  // namespace isorig::messages
