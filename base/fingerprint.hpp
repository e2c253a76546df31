#pragma once
#include <cstdint>
#include <cstdio>
#include <string>
#include <string_view>

namespace isorig::base {

/// 64 bits of FNV-1a as 16 hexadecimal digits: tells whether a text is the same, nothing more. Whoever wants to can
/// make two texts with the same.
[[nodiscard]] inline std::string fingerprint(std::string_view text) {
  std::uint64_t hash = 14695981039346656037ULL;
  for (const char c : text) hash = (hash ^ static_cast<unsigned char>(c)) * 1099511628211ULL;
  char out[17];
  std::snprintf(out, sizeof out, "%016llx", static_cast<unsigned long long>(hash));
  return out;
}

}  // namespace isorig::base
