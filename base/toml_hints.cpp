#include "base/toml_hints.hpp"

#include <algorithm>
#include <array>
#include <span>

namespace isorig::base {
namespace {

struct Unit {
  std::string_view from, to, factor;
};

/// As keys write them. 1 psi = 6.894757293168 kPa and 1 lbf = 4.4482216152605 N (NIST SP 811, 2008, appendix B.8).
constexpr std::array<Unit, 17> kUnits{{{"kPa", "psi", "0.1450377"},
                                       {"Pa", "psi", "0.0001450377"},
                                       {"hPa", "psi", "0.01450377"},
                                       {"MPa", "psi", "145.0377"},
                                       {"bar", "psi", "14.50377"},
                                       {"mbar", "psi", "0.01450377"},
                                       {"um", "mm", "0.001"},
                                       {"cm", "mm", "10"},
                                       {"m", "mm", "1000"},
                                       {"in", "mm", "25.4"},
                                       {"in_min", "mm_s", "0.4233333"},
                                       {"ms", "s", "0.001"},
                                       {"min", "s", "60"},
                                       {"h", "s", "3600"},
                                       {"kN", "N", "1000"},
                                       {"mN", "N", "0.001"},
                                       {"lbf", "N", "4.448222"}}};
/// What a value is counted per: 60 mm/min are 1 mm/s.
constexpr std::array<Unit, 3> kPer{{{"ms", "s", "1000"}, {"min", "s", "0.01666667"}, {"h", "s", "0.0002777778"}}};
/// In front of a time they make it what the value is counted per: `velocity_mm_min` beside `timeout_min`.
constexpr std::array<std::string_view, 5> kCounted{{"mm", "psi", "N", "L", "per"}};

std::string_view factor_in(std::span<const Unit> table, std::string_view from, std::string_view to) {
  const auto unit = std::ranges::find_if(table, [&](const Unit& u) { return u.from == from && u.to == to; });
  return unit == table.end() ? std::string_view() : unit->factor;
}

/// Longer lines are no numbers that somebody typed.
constexpr std::size_t kLongestLine = 1000;
constexpr std::string_view kDigits = "0123456789";

std::string point_hint(const std::string& whole, const std::string& fraction) {
  return "; a number has a decimal point: " + whole + "." + fraction + ", not " + whole + "," + fraction;
}

}  // namespace

std::string decimal_comma_hint(std::string_view text, std::size_t line) {
  for (; line > 1 && !text.empty(); --line) text.remove_prefix(std::min(text.find('\n'), text.size() - 1) + 1);
  const std::string one(text.substr(0, std::min(text.find('\n'), kLongestLine)));
  // Behind an equals sign: within brackets a comma parts the numbers of a list.
  for (auto equals = one.find('='); equals != std::string::npos; equals = one.find('=', equals + 1)) {
    std::string_view rest = std::string_view(one).substr(equals + 1);
    const auto skip = [&rest](std::string_view any) {
      const auto length = std::min(rest.find_first_not_of(any), rest.size());
      const auto skipped = rest.substr(0, length);
      rest.remove_prefix(length);
      return std::string(skipped);
    };
    skip(" \t");
    const std::string sign = rest.starts_with('-') || rest.starts_with('+') ? std::string(rest.substr(0, 1)) : "";
    rest.remove_prefix(sign.size());
    const std::string whole = skip(kDigits);
    if (whole.empty() || !rest.starts_with(',')) continue;
    rest.remove_prefix(1);
    const std::string fraction = skip(kDigits);
    skip(" \t");
    if (fraction.empty() || (!rest.empty() && std::string_view(",}#\r").find(rest.front()) == std::string_view::npos))
      continue;
    return point_hint(sign + whole, fraction);
  }
  return {};
}

std::string unit_hint(std::string_view key, std::string_view meant) {
  const auto parts = std::ranges::mismatch(key, meant);
  const auto same = static_cast<std::size_t>(parts.in1 - key.begin());
  const auto stem = key.substr(0, same).rfind('_');
  if (stem == std::string_view::npos) return {};
  const auto from = key.substr(stem + 1), to = meant.substr(stem + 1);
  const auto before = key.substr(0, stem);
  const bool is_per = std::ranges::find(kCounted, before.substr(before.rfind('_') + 1)) != kCounted.end();
  auto factor = factor_in(is_per ? std::span<const Unit>(kPer) : std::span<const Unit>(kUnits), from, to);
  // kPa_s for psi_s: both are counted per the same.
  const auto per_from = from.find('_'), per_to = to.find('_');
  if (factor.empty() && per_from != from.npos && per_to != to.npos && from.substr(per_from) == to.substr(per_to))
    factor = factor_in(kUnits, from.substr(0, per_from), to.substr(0, per_to));
  if (factor.empty()) return {};
  return " Its unit is another: multiply the number by " + std::string(factor);
}

}  // namespace isorig::base
