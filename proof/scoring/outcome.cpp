#include "proof/scoring/outcome.hpp"

#include <algorithm>
#include <functional>
#include <nlohmann/json.hpp>
#include <stdexcept>

#include "base/text_file.hpp"
#include "messages/csv.hpp"
#include "proof/generator/effects.hpp"
#include "proof/sealed.hpp"

namespace isorig::proof {
namespace {
using Json = nlohmann::json;
}

bool names_effect(const Label& label, std::size_t i, const std::string& claimed) {
  return label.effects[i] == claimed ||
         (i < label.accepted.size() && std::ranges::count(label.accepted[i], claimed) > 0);
}

bool right_name(const Label& label, const std::string& claimed) {
  for (std::size_t i = 0; i < label.effects.size(); ++i)
    if (names_effect(label, i, claimed)) return true;
  return std::ranges::count(label.background, claimed) > 0;
}

Outcome read_diagnosis(const std::filesystem::path& file) {
  try {
    const Json json = Json::parse(base::read_text_file(file));
    Outcome outcome;
    outcome.verdict = json.at("verdict").get<std::string>();
    for (const Json& one : json.at("missing"))
      outcome.missing.push_back({one.at("effect").get<std::string>(), one.at("probability").get<double>()});
    for (const Json& one : json.value("alternatives", Json::array()))
      outcome.alternatives.push_back(
          {one.at("effects").get<std::vector<std::string>>(), one.value("probability", 0.0)});
    return outcome;
  } catch (const Json::exception& error) {
    throw std::runtime_error(file.string() + ": " + error.what());
  }
}

namespace {

/// A text whose root has a list of objects under "cases": each is given to `take` and forgotten. Returns the rest, so
/// that ten thousand labels are never there as JSON at once.
Json parse_case_by_case(const std::string& text, const std::function<void(const Json&)>& take) {
  constexpr int kDepthOfACase = 2;  // the root, its list
  Json rest = Json::parse(text, [&](int depth, Json::parse_event_t event, Json& parsed) {
    if (depth != kDepthOfACase || event != Json::parse_event_t::object_end) return true;
    take(parsed);
    return false;
  });
  (void)rest.at("cases");  // throws where there is none
  return rest;
}

}  // namespace

std::string laws_of_labels(const std::string& text) {
  return parse_case_by_case(text, [](const Json&) {}).value("laws", "catalogue");
}

std::vector<Label> parse_labels(const std::string& text) {
  std::vector<Label> labels;
  parse_case_by_case(text, [&labels](const Json& one) {
    Label label;
    label.name = one.at("case");
    label.category = one.at("category");
    label.nominal = one.at("nominal");
    label.trap = one.at("trap");
    label.noise_N = one.at("noise_N");
    label.residual_over_noise = one.at("residual_over_noise");
    label.truth_sha256 = one.at("truth_sha256");
    for (const Json& effect : one.at("effects")) {
      label.effects.push_back(effect.at("effect"));
      label.size = effect.at("size");
      if (!effect.contains("law")) continue;  // the first generator has one law for each effect
      label.laws.push_back(effect.at("law"));
      label.accepted.push_back(effect.at("accepted"));
    }
    for (const Json& faint : one.value("background", Json::array())) {
      label.background.push_back(faint.at("effect"));
      for (const Json& name : faint.at("accepted")) label.background.push_back(name);
    }
    labels.push_back(std::move(label));
  });
  return labels;
}

namespace {

std::string keys_of(const Json& json) {
  std::string keys;
  for (const auto& [key, value] : json.items()) keys += (keys.empty() ? "" : ", ") + key;
  return keys;
}

/// The first of the names that is there.
const Json* find_any(const Json& object, std::initializer_list<const char*> names) {
  for (const char* name : names)
    if (const auto found = object.find(name); found != object.end()) return &*found;
  return nullptr;
}

void add_effects(const Json& json, std::vector<std::string>& effects) {
  if (json.is_null()) return;
  if (json.is_string()) {
    if (const std::string name = json; !name.empty() && name != "none" && name != "null") effects.push_back(name);
  } else if (json.is_array()) {
    for (const Json& one : json) add_effects(one, effects);
  } else if (json.is_object()) {
    const Json* name = find_any(json, {"effect", "name", "kind"});
    if (name == nullptr) throw std::runtime_error("an effect without a name; its keys: " + keys_of(json));
    add_effects(*name, effects);
  }
}

/// What others call their kinds is theirs; what has none of the thirteen names nobody can be asked to name.
std::string foreign_category(const Json& json, const std::vector<std::string>& effects) {
  if (effects.empty()) return "null";
  const Json* given = find_any(json, {"kind", "category"});
  const std::string kind = given != nullptr && given->is_string() ? given->get<std::string>() : "";
  const auto has_name = [](const std::string& effect) {
    return std::ranges::find(named_effects(), effect, &EffectKind::name) != named_effects().end();
  };
  if (kind == "outside" || kind == "out_of_catalogue" || !std::ranges::all_of(effects, has_name))
    return "out_of_catalogue";
  if (effects.size() > 1) return "pair";
  return kind == "background" ? kind : "single";
}

Label foreign_label(const std::string& name, const Json& json) {
  Label label;
  label.name = name;
  const Json* nominal = find_any(json, {"nominal", "model", "nominal_model"});
  const Json* effects = find_any(json, {"effects", "concealed", "missing", "effect", "hidden", "labels"});
  const Json* noise = find_any(json, {"noise_N", "white_noise_N", "noise_sd_N", "sigma_N", "noise_std_N", "noise"});
  if (nominal == nullptr || effects == nullptr || noise == nullptr || !noise->is_number())
    throw std::runtime_error(name + ": nominal model, effects or noise not found; its keys: " + keys_of(json));
  label.nominal = nominal->get<std::string>();
  label.noise_N = noise->get<double>();
  add_effects(*effects, label.effects);
  label.category = foreign_category(json, label.effects);
  return label;
}

}  // namespace

std::vector<Label> parse_foreign_labels(const std::string& text) {
  const Json json = Json::parse(text);
  const Json* cases = json.is_object() && json.contains("cases") ? &json.at("cases") : &json;
  std::vector<Label> labels;
  if (cases->is_array()) {
    for (const Json& one : *cases) {
      const Json* name = find_any(one, {"case", "name", "id"});
      if (name == nullptr) throw std::runtime_error("a case without a name; its keys: " + keys_of(one));
      labels.push_back(foreign_label(name->get<std::string>(), one));
    }
  } else {
    for (const auto& [name, one] : cases->items())
      if (one.is_object()) labels.push_back(foreign_label(name, one));
  }
  if (labels.empty()) throw std::runtime_error("no cases in the labels; keys: " + keys_of(json));
  std::ranges::sort(labels, {}, &Label::name);
  return labels;
}

double prediction_rmse_N(const std::filesystem::path& prediction, const std::vector<double>& reference_N) {
  std::vector<double> t_s, force_N, low95_N, high95_N, outside;
  std::vector<messages::CsvColumn> columns{{"t_s", &t_s}, {"force_N", &force_N}};
  // A model that knows what it was fitted to is predicted with its band.
  const std::string text = messages::read_whole_file(prediction);
  if (std::string_view(text).substr(0, text.find('\n')).find("low95_N") != std::string_view::npos) {
    columns.push_back({"low95_N", &low95_N});
    columns.push_back({"high95_N", &high95_N});
    columns.push_back({"outside", &outside});
  }
  messages::read_number_csv(prediction, columns);
  if (force_N.size() != reference_N.size())
    throw std::runtime_error(prediction.string() + ": " + std::to_string(force_N.size()) + " rows, not " +
                             std::to_string(reference_N.size()));
  double sum = 0.0;
  for (std::size_t i = 0; i < force_N.size(); ++i) sum += (force_N[i] - reference_N[i]) * (force_N[i] - reference_N[i]);
  return std::sqrt(sum / static_cast<double>(force_N.size()));
}

}  // namespace isorig::proof
