#include "model/words.hpp"

#include <algorithm>
#include <vector>

#include "model/catalogue.hpp"

namespace isorig::model {

std::string effect_words(std::string_view name) {
  if (const auto* physics = find_physics(name); physics != nullptr && !physics->traits.words.empty())
    return std::string(physics->traits.words);
  std::string out(name);
  std::ranges::replace(out, '_', ' ');
  return out;
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

}  // namespace isorig::model
