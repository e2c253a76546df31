#include "base/number_text.hpp"

#include <algorithm>
#include <array>
#include <charconv>

namespace isorig::base {
namespace {

constexpr int kMostDigits = 17;  // more say nothing about a double

}  // namespace

std::string number_text(double value, int digits) {
  std::array<char, 32> text{};  // "-1.2345678901234567e-308" is the longest
  const auto end = std::to_chars(text.data(), text.data() + text.size(), value, std::chars_format::general,
                                 std::clamp(digits, 1, kMostDigits));
  return {text.data(), end.ptr};
}

std::string exact_number_text(double value) {
  std::array<char, 32> text{};
  return {text.data(), std::to_chars(text.data(), text.data() + text.size(), value).ptr};
}

}  // namespace isorig::base
