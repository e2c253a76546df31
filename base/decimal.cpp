#include "base/decimal.hpp"

#include <charconv>
#include <cmath>
#include <system_error>

#include "base/printable.hpp"

namespace isorig::base {

std::optional<double> decimal(std::string_view text, std::string& why) {
  constexpr std::string_view kBlank = " \t\r\n";
  const auto first = text.find_first_not_of(kBlank);
  if (first == std::string_view::npos) {
    why = "a number is missing";
    return std::nullopt;
  }
  text = text.substr(first, text.find_last_not_of(kBlank) - first + 1);
  const std::string shown = "\"" + printable(text.substr(0, 60)) + "\"";
  std::string_view digits = text;
  if (digits.size() > 1 && digits[0] == '+' && digits[1] != '-') digits.remove_prefix(1);
  double value = 0.0;
  const auto [stop, error] = std::from_chars(digits.data(), digits.data() + digits.size(), value);
  const std::string_view rest = digits.substr(static_cast<std::size_t>(stop - digits.data()));
  if (error == std::errc::invalid_argument) {
    why = shown + " is no number";
  } else if (rest.size() > 1 && rest[0] == ',' && rest[1] >= '0' && rest[1] <= '9') {
    why = shown + " has a comma in it; the decimal point is a point, and thousands are not parted";
  } else if (!rest.empty()) {
    why = shown + " has \"" + printable(rest.substr(0, 40)) + "\" behind the number; give the number alone";
  } else if (error != std::errc{} || !std::isfinite(value)) {
    why = shown + " is not a finite number";
  } else {
    return value;
  }
  return std::nullopt;
}

}  // namespace isorig::base
