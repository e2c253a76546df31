#include "webserver/number_units.hpp"

#include <string>
#include <string_view>

#include "model/catalogue.hpp"

namespace isorig::web {
namespace {

using nlohmann::json;

std::string_view text_of(const json& object, const char* key) {
  const auto found = object.find(key);
  return found != object.end() && found->is_string() ? std::string_view(found->get_ref<const std::string&>())
                                                     : std::string_view();
}

/// "1" of a ratio; empty: the law has no number of that name.
std::string_view unit_in(const model::Law& law, std::string_view number) {
  for (const auto& p : law.parameters) {
    if (p.name == number) return p.sheet.unit;
  }
  for (const auto& c : law.coefficients) {
    if (c.name == number) return c.sheet.unit;
  }
  return {};
}

/// The second, third ... of a part with several has its number behind its name ("stiffness_N_mm_2").
std::string_view without_count(std::string_view key) {
  const auto end = key.find_last_not_of("0123456789");
  return end != std::string_view::npos && end + 1 < key.size() && key[end] == '_' ? key.substr(0, end) : key;
}

}  // namespace

void add_units(json& list) {
  const auto diagnoses = list.find("diagnoses");
  if (diagnoses == list.end() || !diagnoses->is_array()) return;
  for (auto& diagnosis : *diagnoses) {
    const auto missing = diagnosis.find("missing");
    if (missing == diagnosis.end() || !missing->is_array()) continue;
    for (auto& effect : *missing) {
      if (!effect.is_object()) continue;
      // A diagnosis of an output other than force names no law: its numbers are in that output's unit.
      const auto* physics = model::find_physics(text_of(effect, "effect"));
      const auto* law = physics == nullptr ? nullptr : model::find_law(*physics, text_of(effect, "law"));
      const auto numbers = effect.find("parameters");
      if (law == nullptr || numbers == effect.end() || !numbers->is_object()) continue;
      for (auto& [key, value] : numbers->items()) {
        auto unit = unit_in(*law, key);
        if (unit.empty()) unit = unit_in(*law, without_count(key));
        if (!unit.empty() && unit != "1" && value.is_object()) value["unit"] = std::string(unit);
      }
    }
  }
}

}  // namespace isorig::web
