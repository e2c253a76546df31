#include "messages/foreign/decoded_text.hpp"

#include <algorithm>
#include <array>
#include <cstdint>

#include "messages/recording.hpp"

namespace isorig::foreign {
namespace {

using Fault = messages::RecordingFault;

void append_utf8(std::string& out, std::uint32_t code) {
  const auto add = [&](std::uint32_t byte) { out += static_cast<char>(byte); };
  if (code < 0x80) return add(code);
  if (code < 0x800) {
    add(0xC0 | code >> 6U);
  } else if (code < 0x10000) {
    add(0xE0 | code >> 12U);
    add(0x80 | (code >> 6U & 0x3FU));
  } else {
    add(0xF0 | code >> 18U);
    add(0x80 | (code >> 12U & 0x3FU));
    add(0x80 | (code >> 6U & 0x3FU));
  }
  add(0x80 | (code & 0x3FU));
}

std::string from_utf16(std::string_view bytes, bool little, const std::filesystem::path& file) {
  std::string out;
  std::size_t line = 1;
  const auto unit = [&](std::size_t at) {
    const auto low = static_cast<std::uint8_t>(bytes[at + (little ? 0 : 1)]);
    const auto high = static_cast<std::uint8_t>(bytes[at + (little ? 1 : 0)]);
    return static_cast<std::uint32_t>(high) << 8U | low;
  };
  for (std::size_t at = 0; at < bytes.size(); at += 2) {
    if (at + 1 >= bytes.size())
      throw messages::RecordingError(Fault::kTruncated, file, line,
                                     "the file ends in the middle of a character (UTF-16)");
    std::uint32_t code = unit(at);
    if (code >= 0xD800 && code < 0xE000) {
      const bool pair = code < 0xDC00 && at + 3 < bytes.size() && unit(at + 2) >= 0xDC00 && unit(at + 2) < 0xE000;
      if (!pair)
        throw messages::RecordingError(Fault::kFormat, file, line,
                                       "half a character stands here (UTF-16): the file is damaged");
      code = 0x10000 + ((code - 0xD800) << 10U) + (unit(at + 2) - 0xDC00);
      at += 2;
    }
    if (code == '\n') ++line;
    append_utf8(out, code);
  }
  return out;
}

/// RFC 3629, without a look at overlong forms: what instruments write has none.
bool is_utf8(std::string_view bytes) {
  for (std::size_t i = 0; i < bytes.size();) {
    const auto byte = static_cast<std::uint8_t>(bytes[i++]);
    const int more = byte < 0x80                   ? 0
                     : byte >= 0xC2 && byte < 0xE0 ? 1
                     : byte >= 0xE0 && byte < 0xF0 ? 2
                     : byte >= 0xF0 && byte < 0xF5 ? 3
                                                   : -1;
    if (more < 0) return false;
    for (int k = 0; k < more; ++k, ++i) {
      if (i >= bytes.size() || (static_cast<std::uint8_t>(bytes[i]) & 0xC0U) != 0x80U) return false;
    }
  }
  return true;
}

/// What Windows-1252 has at 0x80 to 0x9F (Unicode's mapping table CP1252.TXT); all else is Latin-1.
constexpr std::array<std::uint16_t, 32> kWindows1252{0x20AC, 0x81,   0x201A, 0x0192, 0x201E, 0x2026, 0x2020, 0x2021,
                                                     0x02C6, 0x2030, 0x0160, 0x2039, 0x0152, 0x8D,   0x017D, 0x8F,
                                                     0x90,   0x2018, 0x2019, 0x201C, 0x201D, 0x2022, 0x2013, 0x2014,
                                                     0x02DC, 0x2122, 0x0161, 0x203A, 0x0153, 0x9D,   0x017E, 0x0178};

}  // namespace

DecodedText decode(std::string_view bytes, const std::filesystem::path& file) {
  if (bytes.starts_with("\xEF\xBB\xBF")) return {std::string(bytes.substr(3)), "UTF-8"};
  if (bytes.starts_with("\xFF\xFE")) return {from_utf16(bytes.substr(2), true, file), "UTF-16LE"};
  if (bytes.starts_with("\xFE\xFF")) return {from_utf16(bytes.substr(2), false, file), "UTF-16BE"};
  const auto beginning = bytes.substr(0, 64);
  const auto zeros = [&](std::size_t from) {
    std::size_t count = 0;
    for (std::size_t i = from; i < beginning.size(); i += 2) count += beginning[i] == '\0' ? 1 : 0;
    return count;
  };
  const std::size_t half = beginning.size() / 2;
  if (half >= 2 && zeros(1) > half / 2 && zeros(0) == 0) return {from_utf16(bytes, true, file), "UTF-16LE"};
  if (half >= 2 && zeros(0) > half / 2 && zeros(1) == 0) return {from_utf16(bytes, false, file), "UTF-16BE"};
  if (const auto zero = bytes.find('\0'); zero != std::string_view::npos) {
    const auto line = 1 + std::count(bytes.begin(), bytes.begin() + static_cast<std::ptrdiff_t>(zero), '\n');
    throw messages::RecordingError(Fault::kFormat, file, static_cast<std::size_t>(line),
                                   "a zero byte: this is no text file, or a damaged one; export it as CSV");
  }
  if (is_utf8(bytes)) return {std::string(bytes), "UTF-8"};
  std::string out;
  for (const char c : bytes) {
    const auto byte = static_cast<std::uint8_t>(c);
    append_utf8(out, byte >= 0x80 && byte < 0xA0 ? kWindows1252[byte - 0x80] : byte);
  }
  return {out, "Windows-1252"};
}

}  // namespace isorig::foreign
