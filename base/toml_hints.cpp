#include "base/toml_hints.hpp"

#include <algorithm>
#include <array>
#include <regex>

namespace isorig::base {
namespace {

struct Unit {
  std::string_view from, to, factor;
};

/// As keys write them. 1 psi = 6.894757293168 kPa and 1 lbf = 4.4482216152605 N (NIST SP 811, 2008, appendix B.8).
constexpr std::array<Unit, 22> kUnits{{{"kPa", "psi", "0.1450377"},
                                       {"Pa", "psi", "0.0001450377"},
                                       {"hPa", "psi", "0.01450377"},
                                       {"MPa", "psi", "145.0377"},
                                       {"bar", "psi", "14.50377"},
                                       {"mbar", "psi", "0.01450377"},
                                       {"kPa_s", "psi_s", "0.1450377"},
                                       {"bar_s", "psi_s", "14.50377"},
                                       {"um", "mm", "0.001"},
                                       {"cm", "mm", "10"},
                                       {"m", "mm", "1000"},
                                       {"in", "mm", "25.4"},
                                       {"m_s", "mm_s", "1000"},
                                       {"cm_s", "mm_s", "10"},
                                       {"mm_min", "mm_s", "0.01666667"},
                                       {"in_min", "mm_s", "0.4233333"},
                                       {"ms", "s", "0.001"},
                                       {"min", "s", "60"},
                                       {"h", "s", "3600"},
                                       {"kN", "N", "1000"},
                                       {"mN", "N", "0.001"},
                                       {"lbf", "N", "4.448222"}}};

/// Longer lines are no numbers that somebody typed.
constexpr std::size_t kLongestLine = 1000;

}  // namespace

std::string decimal_comma_hint(std::string_view text, std::size_t line) {
  for (; line > 1 && !text.empty(); --line) text.remove_prefix(std::min(text.find('\n'), text.size() - 1) + 1);
  const std::string one(text.substr(0, std::min(text.find('\n'), kLongestLine)));
  // Behind an equals sign: within brackets a comma parts the numbers of a list.
  static const std::regex kCommaNumber("=\\s*([+-]?\\d+),(\\d+)\\s*($|[,}#\\r])");
  std::smatch number;
  if (!std::regex_search(one, number, kCommaNumber)) return {};
  return "; a number has a decimal point: " + number.str(1) + "." + number.str(2) + ", not " + number.str(1) + "," +
         number.str(2);
}

std::string unit_hint(std::string_view key, std::string_view meant) {
  const auto parts = std::ranges::mismatch(key, meant);
  const auto same = static_cast<std::size_t>(parts.in1 - key.begin());
  const auto stem = key.substr(0, same).rfind('_');
  if (stem == std::string_view::npos) return {};
  const auto from = key.substr(stem + 1), to = meant.substr(stem + 1);
  const auto* unit = std::ranges::find_if(kUnits, [&](const Unit& u) { return u.from == from && u.to == to; });
  if (unit == kUnits.end()) return {};
  return " Its unit is another: multiply the number by " + std::string(unit->factor);
}

}  // namespace isorig::base
