#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "base/number_text.hpp"
#include "identify/diagnose/design/design.hpp"
#include "model/words.hpp"

namespace isorig::identify {

using base::number_text;
using model::explanation_words;
using nlohmann::ordered_json;

std::string Design::separates() const {
  std::string out;
  for (std::size_t i = 0; i < tied.size(); ++i)
    out += (i == 0 ? "" : i + 1 < tied.size() ? ", " : " from ") + explanation_words(tied[i].key);
  return out;
}

void describe_inseparable(Design& design) {
  std::vector<Inseparable> joined;
  for (const Inseparable& one : design.inseparable) {
    const auto other = std::ranges::find_if(
        joined, [&](const Inseparable& j) { return j.first == one.second && j.second == one.first; });
    const std::string truth = explanation_words(design.tied[one.first].key);
    const std::string rival = explanation_words(design.tied[one.second].key);
    if (other != joined.end()) {
      other->distance = std::max(other->distance, one.distance);
      other->text = "No candidate experiment within the limits separates ";
      other->text.append(rival).append(" from ").append(truth);
      other->text.append(": the best separates them by ").append(number_text(other->distance, 2));
      other->text.append(" whitened squares, and ").append(number_text(design.enough, 3));
      other->text += " are required. They are to be taken as one explanation.";
    } else {
      joined.push_back(one);
      std::string& text = joined.back().text = "If the truth is ";
      text.append(truth).append(", ").append(rival).append(" predicts every candidate experiment nearly as well: ");
      text.append("the best of them separates the two by ").append(number_text(one.distance, 2));
      text.append(" whitened squares, and ").append(number_text(design.enough, 3)).append(" are required.");
    }
  }
  design.inseparable = std::move(joined);
}

ordered_json experiment_json(const Design& design) {
  if (!design.experiment) return nullptr;
  const Experiment& e = *design.experiment;
  ordered_json out{{"name", e.name},
                   {"text", e.text},
                   {"protocol", "next_experiment.toml"},
                   {"duration_s", e.duration_s},
                   {"distance", e.distance},
                   {"enough", design.enough},
                   {"reaches_it", e.enough}};
  out["separates"] = ordered_json::array();
  for (const auto& rival : design.tied) out["separates"].push_back(rival.key);
  out["expected"] = ordered_json::array();
  for (const Distance& d : e.distances)
    out["expected"].push_back(
        {{"if", design.tied[d.truth].key}, {"then", design.tied[d.rival].key}, {"leaves", std::min(d.expected, 1e12)}});
  out["considered"] = design.considered;
  out["others"] = ordered_json::array();
  for (const Runner& r : design.others)
    out["others"].push_back({{"text", r.text}, {"duration_s", r.duration_s}, {"distance", r.distance}});
  return out;
}

ordered_json inseparable_json(const Design& design) {
  ordered_json out = ordered_json::array();
  for (const Inseparable& i : design.inseparable)
    out.push_back({{"explanations", {design.tied[i.first].key, design.tied[i.second].key}},
                   {"distance", std::min(i.distance, 1e12)},
                   {"text", i.text}});
  return out;
}

}  // namespace isorig::identify
