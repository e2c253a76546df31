#include "identify/diagnose/deciding/deciding.hpp"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <stdexcept>

#include "base/nearest.hpp"
#include "base/number_text.hpp"

namespace isorig::identify {

namespace deciding_detail {
constinit DecidingNumbers in_force{};
}

namespace {

#define BY_HAND "chosen by hand; nothing derives it"
#define ISORIG_NUMBER(name, value, unit, least, most, what, derivation) \
  DecidingNumber{#name, value, unit, least, most, false, what, derivation, &DecidingNumbers::name, nullptr},
#define ISORIG_COUNT(name, value, unit, least, most, what, derivation) \
  DecidingNumber{#name, value, unit, least, most, true, what, derivation, nullptr, &DecidingNumbers::name},
constexpr std::array kNumbers{
#include "identify/diagnose/deciding/numbers.inc"
};
#undef ISORIG_COUNT
#undef ISORIG_NUMBER
#undef BY_HAND

std::string number(double value) {
  return base::number_text(value, 6);
}

/// Names that may have been meant: those that hold the word, then those that few letters part from it.
std::string near_names(std::string_view word) {
  constexpr std::size_t kMost = 5;
  std::vector<std::pair<std::size_t, std::string_view>> near;
  for (const DecidingNumber& one : kNumbers) {
    const bool holds = word.size() >= 3 && one.name.find(word) != std::string_view::npos;
    const std::size_t distance = holds ? 0 : base::edit_distance(word, one.name);
    if (distance <= word.size() / 2) near.emplace_back(distance, one.name);
  }
  std::ranges::stable_sort(near, {}, &std::pair<std::size_t, std::string_view>::first);
  if (near.size() > kMost) near.resize(kMost);
  std::string text;
  for (const auto& [distance, name] : near) text += (text.empty() ? "" : ", ") + std::string(name);
  return text;
}

}  // namespace

double DecidingNumber::in_force() const noexcept {
  return whole ? static_cast<double>(deciding_detail::in_force.*count) : deciding_detail::in_force.*number;
}

std::span<const DecidingNumber> deciding_numbers() noexcept {
  return kNumbers;
}

void decide(std::string_view assignment) {
  constexpr const char* kAll = "; `isorig diagnose --deciding` lists all";
  const std::size_t equals = assignment.find('=');
  if (equals == std::string_view::npos)
    throw std::invalid_argument("\"" + std::string(assignment) + "\" is not NAME=VALUE" + kAll);
  const std::string_view name = assignment.substr(0, equals), text = assignment.substr(equals + 1);
  const auto found = std::ranges::find(kNumbers, name, &DecidingNumber::name);
  if (found == kNumbers.end()) {
    const std::string near = near_names(name);
    throw std::invalid_argument("no number \"" + std::string(name) + "\" decides a diagnosis" +
                                (near.empty() ? "" : "; near it: " + near) + kAll);
  }
  double value = 0.0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc{} || end != text.data() + text.size() || !std::isfinite(value))
    throw std::invalid_argument(std::string(name) + ": \"" + std::string(text) + "\" is no finite number");
  if (value < found->least || value > found->most)
    throw std::invalid_argument(std::string(name) + ": " + std::string(text) + " is not within " +
                                number(found->least) + " to " + number(found->most));
  if (!found->whole) {
    deciding_detail::in_force.*(found->number) = value;
    return;
  }
  if (value != std::floor(value))
    throw std::invalid_argument(std::string(name) + ": " + std::string(text) + " is no whole number");
  deciding_detail::in_force.*(found->count) = static_cast<std::size_t>(value);
}

void decide_as_stated() noexcept {
  deciding_detail::in_force = {};
}

std::vector<Decided> decided() {
  std::vector<Decided> out;
  for (const DecidingNumber& one : kNumbers)
    if (one.in_force() != one.stated) out.push_back({one.name, one.in_force(), one.stated});
  return out;
}

std::string decided_text(std::span<const Decided> changed) {
  std::string list;
  for (const Decided& one : changed)
    list += (list.empty() ? "" : ", ") + std::string(one.name) + " = " + number(one.value) +
            " (stated: " + number(one.stated) + ")";
  return list.empty() ? list : "Decided by other numbers than the stated ones: [" + list + "].";
}

}  // namespace isorig::identify
