#include "webserver/words/diagnosis_words.hpp"

#include <string>
#include <string_view>
#include <utility>

#include "model/catalogue.hpp"
#include "model/words.hpp"

namespace isorig::web {
namespace {

using nlohmann::json;

std::string_view text_of(const json& object, const char* key) {
  const auto found = object.find(key);
  return found != object.end() && found->is_string() ? std::string_view(found->get_ref<const std::string&>())
                                                     : std::string_view();
}

void in_words(json& text) {
  if (text.is_string()) text = model::in_words(text.get_ref<const std::string&>());
}

/// What is said of the whole diagnosis: sentences in which names stand as the files have them.
void sentences_in_words(json& diagnosis) {
  for (const char* key : {"warnings", "notes"}) {
    if (const auto found = diagnosis.find(key); found != diagnosis.end() && found->is_array())
      for (auto& sentence : *found) in_words(sentence);
  }
  for (const auto& [key, of] :
       {std::pair{"cannot_judge", "why"}, {"cannot_judge", "record"}, {"not_modelled", "why"}}) {
    const auto found = diagnosis.find(key);
    if (found != diagnosis.end() && found->is_object() && found->contains(of)) in_words((*found)[of]);
  }
  if (const auto found = diagnosis.find("inseparable"); found != diagnosis.end() && found->is_array()) {
    for (auto& pair : *found)
      if (pair.is_object() && pair.contains("text")) in_words(pair["text"]);
  }
  if (const auto found = diagnosis.find("text"); found != diagnosis.end()) in_words(*found);
}

}  // namespace

void put_in_words(json& list) {
  const auto diagnoses = list.find("diagnoses");
  if (diagnoses == list.end() || !diagnoses->is_array()) return;
  for (auto& diagnosis : *diagnoses) {
    if (diagnosis.is_object()) sentences_in_words(diagnosis);
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
        const auto unit = model::unit_of(*law, key);
        if (unit.empty() || !value.is_object()) continue;
        value["words"] = model::number_words(key, unit);
        if (unit != "1") value["unit"] = model::unit_words(unit);
      }
    }
  }
}

}  // namespace isorig::web
