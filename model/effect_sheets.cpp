#include "model/effect_sheets.hpp"

#include <algorithm>
#include <vector>

#include "base/number_text.hpp"
#include "model/catalogue.hpp"

namespace isorig::model {
namespace {

std::string& add(std::string& list, std::string_view name) {
  return (list += list.empty() ? "" : ", ") += name;
}

/// Numbers that share a sheet and a range, whatever their names and laws.
struct Entry {
  std::vector<std::string_view> names;
  std::vector<std::string_view> laws;
  std::string range;
  NumberSheet sheet;
};

void remember(std::vector<std::string_view>& list, std::string_view name) {
  if (std::ranges::find(list, name) == list.end()) list.push_back(name);
}

void collect(std::vector<Entry>& entries, std::string_view name, std::string_view law, std::string range,
             const NumberSheet& sheet) {
  const auto same = std::ranges::find_if(entries, [&](const Entry& e) {
    return e.sheet.what == sheet.what && e.sheet.unit == sheet.unit && e.range == range;
  });
  Entry& entry = same == entries.end() ? entries.emplace_back(Entry{{}, {}, std::move(range), sheet}) : *same;
  remember(entry.names, name);
  remember(entry.laws, law);
}

std::vector<Entry> numbers_of(const Physics& physics) {
  std::vector<Entry> entries;
  for (const Law& law : physics.laws) {
    for (const Parameter& p : law.parameters) {
      const std::string range = range_text(p) + (p.fixed ? ", given and not searched" : "");
      collect(entries, p.name, law.name, range, p.sheet);
    }
    for (const Coefficient& c : law.coefficients)
      collect(entries, c.name, law.name, std::string(range_text(c)), c.sheet);
  }
  return entries;
}

std::string laws_of(const Physics& physics) {
  std::string laws;
  for (const Law& law : physics.laws) add(laws, law.name);
  return laws;
}

}  // namespace

std::string range_text(const Parameter& parameter) {
  constexpr int kDigits = 16;  // of the largest recording id
  return base::number_text(parameter.lower, kDigits) + " to " + base::number_text(parameter.upper, kDigits);
}

std::string_view range_text(const Coefficient& coefficient) noexcept {
  switch (coefficient.sign) {
    case Sign::kFree:
      return "either sign";
    case Sign::kNonNegative:
      return "not negative";
    case Sign::kNonPositive:
      return "not positive";
  }
  return "";
}

std::string sheet_text(const Physics& physics) {
  std::string text = "## " + std::string(physics.name) + "\n\n";
  text += std::string(physics.what) + " Acts on the " + std::string(side_of(physics.stage)) + ".\n\n";
  text += "Source: " + std::string(physics.source) + "\n\n";
  text += "What shows it: " + std::string(physics.reveals) + "\n\n";
  for (const Law& law : physics.laws)
    text += "- law `" + std::string(law.name) + "`: `" + std::string(law.formula) + "`\n";
  for (const Entry& entry : numbers_of(physics)) {
    std::string names, laws;
    for (const std::string_view name : entry.names) add(names, "`" + std::string(name) + "`");
    for (const std::string_view law : entry.laws) add(laws, law);
    text += "\n**" + names + "** [" + std::string(entry.sheet.unit) + "], " + entry.range;
    if (entry.laws.size() < physics.laws.size()) text += " (" + laws + ")";
    text += "\n- " + std::string(entry.sheet.what) + "\n- Range: " + std::string(entry.sheet.range) +
            "\n- Errors: " + std::string(entry.sheet.errors) + "\n";
  }
  return text;
}

std::string effects_table() {
  std::string text = "| effect | acts on | laws |\n|---|---|---|\n";
  for (const Physics* physics : effects())
    text += "| `" + std::string(physics->name) + "` | " + std::string(side_of(physics->stage)) + " | " +
            laws_of(*physics) + " |\n";
  return text;
}

std::string effect_sheets_document() {
  std::string text =
      "# The sheets of the effects\n\n"
      "Written by `isorig effects --markdown` from the files in `model/effects/`; a test compares the two, so change "
      "it there and "
      "write it again. How effects work and how to add one: [effects.md](effects.md).\n\n"
      "A number that enters the force linearly has a sign and no range; every other one has a range that the fit "
      "searches. Each "
      "reason says whether physics, the instrument or numerics sets it. \"The rig\" has 5 mm of travel to either side, "
      "0.005 to "
      "10 mm/s and 1 kHz.\n\n";
  text += effects_table();
  for (const Physics* physics : effects()) text += "\n" + sheet_text(*physics);
  return text;
}

}  // namespace isorig::model
