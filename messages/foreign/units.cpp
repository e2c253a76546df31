#include <algorithm>

#include "messages/elvh.hpp"
#include "messages/foreign/column_names.hpp"
#include "messages/foreign/mapping.hpp"

namespace isorig::foreign {
namespace {

constexpr double kInch_mm = 25.4, kPoundForce_N = 4.4482216152605, kGravity_m_s2 = 9.80665;
constexpr double kPsi_Pa = kPoundForce_N / (kInch_mm * kInch_mm * 1e-6);

constexpr Unit kUnits[] = {
    {"s", Field::kTime, 1.0},
    {"ms", Field::kTime, 1e-3},
    {"us", Field::kTime, 1e-6},
    {"min", Field::kTime, 60.0},
    {"h", Field::kTime, 3600.0},
    {kClock, Field::kTime, 1.0},
    {"mm", Field::kPosition, 1.0},
    {"cm", Field::kPosition, 10.0},
    {"m", Field::kPosition, 1e3},
    {"um", Field::kPosition, 1e-3},
    {"in", Field::kPosition, kInch_mm},
    {"ft", Field::kPosition, 12.0 * kInch_mm},
    {"N", Field::kForce, 1.0},
    {"mN", Field::kForce, 1e-3},
    {"kN", Field::kForce, 1e3},
    {"lbf", Field::kForce, kPoundForce_N},
    {"kgf", Field::kForce, kGravity_m_s2},
    {"gf", Field::kForce, 1e-3 * kGravity_m_s2},
    {"psi", Field::kPressure, 1.0},
    {"Pa", Field::kPressure, 1.0 / kPsi_Pa},
    {"kPa", Field::kPressure, 1e3 / kPsi_Pa},
    {"MPa", Field::kPressure, 1e6 / kPsi_Pa},
    {"mbar", Field::kPressure, 1e2 / kPsi_Pa},
    {"bar", Field::kPressure, 1e5 / kPsi_Pa},
    {"mmHg", Field::kPressure, 133.322387415 / kPsi_Pa},  // conventional, ISO 80000-4
    {"elvh_counts", Field::kPressure, messages::kElvhPsiPerCount, messages::kElvhOffsetCounts},
};

/// Other spellings. Case matters in some (mN, MN): only whole words stand here.
constexpr std::pair<std::string_view, std::string_view> kSpellings[] = {
    {"sec", "s"},        {"second", "s"},     {"seconds", "s"},        {"sek", "s"},        {"Sek", "s"},
    {"millis", "ms"},    {"msec", "ms"},      {"micros", "us"},        {"\xC2\xB5s", "us"}, {"\xCE\xBCs", "us"},
    {"\xC2\xB5m", "um"}, {"\xCE\xBCm", "um"}, {"inch", "in"},          {"inches", "in"},    {"\"", "in"},
    {"lb", "lbf"},       {"lbs", "lbf"},      {"kg", "kgf"},           {"kp", "kgf"},       {"Sec", "s"},
    {"hPa", "mbar"},     {"N/mm2", "MPa"},    {"N/mm\xC2\xB2", "MPa"},
};

}  // namespace

std::string_view name_of(Field field) {
  constexpr std::string_view kNames[] = {"time", "position", "force", "pressure"};
  return kNames[static_cast<std::size_t>(field)];
}

std::string_view unit_of(Field field) {
  constexpr std::string_view kNames[] = {"s", "mm", "N", "psi"};
  return kNames[static_cast<std::size_t>(field)];
}

std::optional<Field> field_of(std::string_view name) {
  const auto* found = std::ranges::find(kFields, name, [](Field field) { return name_of(field); });
  return found == kFields.end() ? std::nullopt : std::optional<Field>(*found);
}

std::optional<messages::Output> output_of(std::string_view name) {
  using messages::Output;
  for (const Output output : {Output::kForce, Output::kPosition, Output::kPressure})
    if (name == messages::name_of(output)) return output;
  return std::nullopt;
}

std::optional<Unit> find_unit(std::string_view text) {
  std::string_view exact = text;
  for (const auto& [other, name] : kSpellings)
    if (text == other) exact = name;
  if (small(text).starts_with("hh:mm")) exact = kClock;
  if (const auto* found = std::ranges::find(kUnits, exact, &Unit::name); found != std::end(kUnits)) return *found;
  // A recording has gauge pressure: "barg", "kPa gauge" and "psi (g)" say no more.
  for (const std::string_view gauge : {" gauge", " (g)", "(g)", " g", "g"}) {
    if (!small(text).ends_with(gauge)) continue;
    const auto unit = find_unit(text.substr(0, text.size() - gauge.size()));
    if (unit && unit->field == Field::kPressure) return unit;
  }
  // "BAR", "KPa": of a pressure the case says nothing, but between mega and milli.
  const auto* alike = std::ranges::find_if(kUnits, [name = small(text)](const Unit& unit) {
    return unit.field == Field::kPressure && unit.name != "MPa" && small(unit.name) == name;
  });
  return alike == std::end(kUnits) ? std::nullopt : std::optional<Unit>(*alike);
}

std::string units_of(Field field) {
  std::string text;
  for (const Unit& unit : kUnits)
    if (unit.field == field) text += (text.empty() ? "" : ", ") + std::string(unit.name);
  return text;
}

}  // namespace isorig::foreign
