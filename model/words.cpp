#include "model/words.hpp"

#include <algorithm>
#include <cctype>
#include <map>
#include <vector>

#include "model/catalogue.hpp"

namespace isorig::model {
namespace {

std::string spaced(std::string_view name) {
  std::string out(name);
  std::ranges::replace(out, '_', ' ');
  return out;
}

/// Units of the numbers of all laws, by the numbers' names.
const std::map<std::string, std::string_view, std::less<>>& units_by_name() {
  static const auto units = [] {
    std::map<std::string, std::string_view, std::less<>> out;
    for (const auto list : {elements(), effects()}) {
      for (const Physics* physics : list) {
        for (const Law& law : physics->laws) {
          for (const Parameter& p : law.parameters) out.emplace(p.name, p.sheet.unit);
          for (const Coefficient& c : law.coefficients) out.emplace(c.name, c.sheet.unit);
        }
      }
    }
    return out;
  }();
  return units;
}

/// Without the number of its part ("slip_mm_2").
std::string_view without_count(std::string_view key) {
  const auto end = key.find_last_not_of("0123456789");
  return end != std::string_view::npos && end + 1 < key.size() && key[end] == '_' ? key.substr(0, end) : key;
}

bool is_name(char c) {
  return std::isalnum(static_cast<unsigned char>(c)) != 0 || c == '_';
}

/// A name, or several joined by '+'.
std::string words_of_token(std::string_view token) {
  if (token.find_first_of("_+") == std::string_view::npos) return std::string(token);
  bool all = true;
  for (std::size_t from = 0; from <= token.size();) {
    const std::size_t to = std::min(token.find('+', from), token.size());
    all = all && find_physics(token.substr(from, to - from)) != nullptr;
    from = to + 1;
  }
  if (all) return explanation_words(token);
  const auto& units = units_by_name();
  auto unit = units.find(token);
  if (unit == units.end()) unit = units.find(without_count(token));
  return unit == units.end() ? std::string(token) : number_words(token, unit->second);
}

}  // namespace

std::string effect_words(std::string_view name) {
  if (const auto* physics = find_physics(name); physics != nullptr && !physics->traits.words.empty())
    return std::string(physics->traits.words);
  return spaced(name);
}

std::string explanation_words(std::string_view key) {
  if (key == "nominal" || key.empty()) return "nothing missing";
  std::vector<std::string> parts;
  for (std::size_t from = 0; from <= key.size();) {
    const std::size_t to = std::min(key.find('+', from), key.size());
    parts.push_back(effect_words(key.substr(from, to - from)));
    from = to + 1;
  }
  std::string out;
  for (std::size_t i = 0; i < parts.size(); ++i)
    out += (i == 0 ? "" : i + 1 < parts.size() ? ", " : " and ") + parts[i];
  return out;
}

std::string number_words(std::string_view key, std::string_view unit) {
  // "N/mm/psi" stands in a name as _N_mm_psi, and "mm/psi" as _mm_per_psi where something else is divided by it.
  std::string suffix = "_", spelt = "_";
  for (const char c : unit) {
    suffix += c == '/' || c == ' ' ? '_' : c;
    spelt += c == '/' ? "_per_" : c == ' ' ? "_" : std::string(1, c);
  }
  const auto bare = [&](std::string_view name) {
    if (unit.empty() || unit == "1") return name;
    for (const std::string& ending : {suffix, spelt})
      if (name.ends_with(ending)) return name.substr(0, name.size() - ending.size());
    return name;
  };
  if (const auto whole = bare(key); whole.size() < key.size()) return spaced(whole);
  const auto name = without_count(key);
  return spaced(bare(name)) + spaced(key.substr(name.size()));
}

std::string_view unit_of(const Law& law, std::string_view number) {
  for (const std::string_view name : {number, without_count(number)}) {
    for (const Parameter& p : law.parameters)
      if (p.name == name) return p.sheet.unit;
    for (const Coefficient& c : law.coefficients)
      if (c.name == name) return c.sheet.unit;
  }
  return {};
}

std::string unit_words(std::string_view unit) {
  if (unit == "1") return {};
  std::string out;
  for (const char c : unit) out += c == '2' ? "²" : c == '3' ? "³" : std::string(1, c);
  return out;
}

std::string in_words(std::string_view text) {
  std::string out;
  for (std::size_t at = 0; at < text.size();) {
    std::size_t end = at;
    while (end < text.size() &&
           (is_name(text[end]) || (text[end] == '+' && end > at && end + 1 < text.size() && is_name(text[end + 1]))))
      ++end;
    if (end == at) {
      out += text[at++];
      continue;
    }
    out += words_of_token(text.substr(at, end - at));
    at = end;
  }
  return out;
}

}  // namespace isorig::model
