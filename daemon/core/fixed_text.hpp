#pragma once
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <string_view>

namespace isorig::daemon {

/// Of a full buffer: ends in three points, behind a whole character of UTF-8, so that nobody takes half a path for one.
template <std::size_t N>
void mark_cut(char (&text)[N]) noexcept {
  if constexpr (N > 8) {
    std::size_t at = N - 4;
    while (at > 0 && (static_cast<unsigned char>(text[at]) & 0xC0U) == 0x80U) --at;
    for (std::size_t i = 0; i < 3; ++i) text[at++] = '.';
    text[at] = '\0';
  }
}

/// Copies as much as fits, and marks what does not; always NUL-terminated.
template <std::size_t N>
void copy_text(char (&to)[N], std::string_view text) noexcept {
  const std::size_t n = text.size() < N - 1 ? text.size() : N - 1;
  for (std::size_t i = 0; i < n; ++i) to[i] = text[i];
  to[n] = '\0';
  if (n < text.size()) mark_cut(to);
}

/// Builds a message in a fixed buffer without locale, allocation or printf, for the real-time loop.
/// Cut at the end of the buffer, and marked so; always NUL-terminated.
template <std::size_t N>
class FixedText {
 public:
  explicit FixedText(char (&buffer)[N]) noexcept : buffer_(buffer) { buffer_[0] = '\0'; }

  FixedText& operator<<(std::string_view text) noexcept {
    for (const char c : text) put(c);
    return *this;
  }
  FixedText& operator<<(std::int64_t value) noexcept {
    if (value < 0) put('-');
    digits(value < 0 ? 0 - static_cast<std::uint64_t>(value) : static_cast<std::uint64_t>(value));
    return *this;
  }
  FixedText& operator<<(std::uint32_t value) noexcept { return *this << static_cast<std::int64_t>(value); }
  /// Three decimals, rounded; not a number and what does not fit 18 digits are named.
  FixedText& operator<<(double value) noexcept {
    if (std::isnan(value)) return *this << "nan";
    if (std::abs(value) > 1e15) return *this << (value > 0 ? "inf" : "-inf");
    if (value < 0) put('-');
    const auto thousandths = static_cast<std::uint64_t>(std::llround(std::abs(value) * 1000.0));
    digits(thousandths / 1000);
    put('.');
    const auto fraction = thousandths % 1000;
    put(static_cast<char>('0' + fraction / 100));
    put(static_cast<char>('0' + fraction / 10 % 10));
    put(static_cast<char>('0' + fraction % 10));
    return *this;
  }

 private:
  void put(char c) noexcept {
    if (used_ + 1 < N) {
      buffer_[used_++] = c;
      buffer_[used_] = '\0';
    } else if (!cut_) {
      cut_ = true;
      mark_cut(buffer_);
    }
  }
  void digits(std::uint64_t value) noexcept {
    char reversed[20];
    int count = 0;
    do {
      reversed[count++] = static_cast<char>('0' + value % 10);
      value /= 10;
    } while (value != 0);
    while (count > 0) put(reversed[--count]);
  }

  char (&buffer_)[N];
  std::size_t used_ = 0;
  bool cut_ = false;
};

}  // namespace isorig::daemon
