#include "base/printable.hpp"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstdio>

namespace isorig::base {
namespace {

struct CodePoint {
  std::uint32_t value = 0;
  std::size_t bytes = 0;  ///< 0: not UTF-8
};

/// RFC 3629: no overlong forms, no surrogates, nothing above U+10FFFF.
CodePoint decode(std::string_view text) {
  const auto lead = static_cast<unsigned char>(text[0]);
  if (lead < 0x80) return {lead, 1};
  const std::size_t bytes = lead >= 0xf0 ? 4 : lead >= 0xe0 ? 3 : 2;
  if (lead < 0xc2 || lead > 0xf4 || text.size() < bytes) return {};
  std::uint32_t value = lead & (0xffU >> (bytes + 1));
  for (std::size_t i = 1; i < bytes; ++i) {
    const auto next = static_cast<unsigned char>(text[i]);
    if ((next & 0xc0U) != 0x80) return {};
    value = value << 6U | (next & 0x3fU);
  }
  const bool overlong = value < (bytes == 4 ? 0x10000U : bytes == 3 ? 0x800U : 0x80U);
  if (overlong || value > 0x10ffff || (value >= 0xd800 && value <= 0xdfff)) return {};
  return {value, bytes};
}

/// Unicode's Cc, Zl and Zp, and of Cf what hides or reorders text.
bool hidden(std::uint32_t c) {
  return c < 0x20 || (c >= 0x7f && c <= 0x9f) || c == 0xad || c == 0x61c || c == 0x180e ||
         (c >= 0x200b && c <= 0x200f) || (c >= 0x2028 && c <= 0x202e) || (c >= 0x2060 && c <= 0x206f) || c == 0xfeff ||
         (c >= 0xfff9 && c <= 0xfffb) || (c >= 0xe0000 && c <= 0xe007f);
}

std::string escaped(std::string_view text, bool keep_lines) {
  std::string out;
  out.reserve(text.size());
  char code[16];
  while (!text.empty()) {
    const auto [c, bytes] = decode(text);
    if (bytes == 0) {
      std::snprintf(code, sizeof code, "\\x%02x", static_cast<unsigned char>(text[0]));
      out += code;
      text.remove_prefix(1);
      continue;
    }
    if (!hidden(c) || (keep_lines && (c == '\n' || c == '\t'))) {
      out += text.substr(0, bytes);
    } else if (c == '\n' || c == '\r' || c == '\t') {
      out += c == '\n' ? "\\n" : c == '\r' ? "\\r" : "\\t";
    } else {
      std::snprintf(code, sizeof code, c > 0xffff ? "\\U%08x" : "\\u%04x", c);
      out += code;
    }
    text.remove_prefix(bytes);
  }
  return out;
}

}  // namespace

std::string printable(std::string_view text) {
  return escaped(text, false);
}

std::string printable_lines(std::string_view text) {
  return escaped(text, true);
}

std::string why_not_arguments(int argc, const char* const* argv) {
  for (int i = 1; i < argc; ++i) {
    if (auto shown = printable(argv[i]); shown != argv[i]) {
      return "the argument \"" + shown +
             "\" holds a control character, a mark that hides or turns text, or bytes that are not UTF-8; write it "
             "plainly";
    }
  }
  return {};
}

std::string why_not_a_name(std::string_view name) {
  constexpr std::size_t kLongest = 64;
  const auto allowed = [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '-' || c == '_' ||
           c == '.';
  };
  const std::string rule = "; it has to be 1 to 64 of the letters A-Z a-z, digits and - _ . since it names files";
  if (name.empty()) return "is empty" + rule;
  if (name.size() > kLongest) return "has " + std::to_string(name.size()) + " bytes" + rule;
  if (name.front() == '.' || name.front() == '-') {
    return std::string("begins with `") + name.front() + "`, which hides a file or looks like an option" + rule;
  }
  const auto bad = std::find_if_not(name.begin(), name.end(), allowed);
  if (bad == name.end()) return {};
  auto rest = name.substr(static_cast<std::size_t>(bad - name.begin()));
  const auto bytes = std::max<std::size_t>(1, decode(rest).bytes);
  return "holds `" + printable(rest.substr(0, bytes)) + "`" + rule;
}

}  // namespace isorig::base
