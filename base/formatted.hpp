#pragma once
#include <array>
#include <cstdarg>
#include <cstdio>
#include <string>

namespace isorig::base {

/// printf into a string (at most 511 bytes), for sentences with numbers in them.
[[gnu::format(printf, 1, 2)]] inline std::string formatted(const char* format, ...) {
  std::array<char, 512> buffer{};
  va_list values;
  va_start(values, format);
  std::vsnprintf(buffer.data(), buffer.size(), format, values);
  va_end(values);
  return buffer.data();
}

}  // namespace isorig::base
