#include <iostream>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "cli/command.hpp"
#include "model/catalogue.hpp"
#include "model/effect_sheets.hpp"

/// isorig effects: what a model may lack, with unit, range and reason of every number.
namespace isorig::cli {
namespace {

using nlohmann::ordered_json;

struct EffectsOptions {
  std::vector<std::string> names;
  bool json = false;
  bool markdown = false;
};

ordered_json sheet_json(std::string_view name, const model::NumberSheet& sheet) {
  return {{"name", name},
          {"what", sheet.what},
          {"unit", sheet.unit},
          {"why_this_range", sheet.range},
          {"errors", sheet.errors}};
}

ordered_json law_json(const model::Law& law) {
  ordered_json parameters = ordered_json::array(), coefficients = ordered_json::array();
  for (const model::Parameter& p : law.parameters) {
    parameters.push_back(sheet_json(p.name, p.sheet));
    parameters.back().update({{"lower", p.lower}, {"upper", p.upper}, {"searched", !p.fixed}});
  }
  for (const model::Coefficient& c : law.coefficients) {
    coefficients.push_back(sheet_json(c.name, c.sheet));
    coefficients.back()["sign"] = model::range_text(c);
  }
  return {{"name", law.name}, {"formula", law.formula}, {"parameters", parameters}, {"coefficients", coefficients}};
}

ordered_json physics_json(const model::Physics& physics) {
  ordered_json laws = ordered_json::array();
  for (const model::Law& law : physics.laws) laws.push_back(law_json(law));
  return {{"name", physics.name},       {"acts_on", model::side_of(physics.stage)},
          {"what", physics.what},       {"source", physics.source},
          {"reveals", physics.reveals}, {"laws", laws}};
}

int effects(const EffectsOptions& options) {
  std::vector<const model::Physics*> chosen;
  for (const std::string& name : options.names) {
    const model::Physics* physics = model::find_physics(name);
    if (physics == nullptr || !model::is_effect(*physics)) {
      std::cerr << "isorig: there is no effect \"" << name << "\"; `isorig effects` lists them\n";
      return kUsage;
    }
    chosen.push_back(physics);
  }
  if (options.json) {
    if (chosen.empty()) chosen.assign(model::effects().begin(), model::effects().end());
    ordered_json all = ordered_json::array();
    for (const model::Physics* physics : chosen) all.push_back(physics_json(*physics));
    std::cout << all.dump(2) << '\n';
  } else if (!chosen.empty()) {
    for (const model::Physics* physics : chosen)
      std::cout << (physics == chosen.front() ? "" : "\n") << model::sheet_text(*physics);
  } else {
    std::cout << (options.markdown ? model::effect_sheets_document() : model::effects_table());
  }
  return kOk;
}

Command add_effects(CLI::App& app) {
  auto options = std::make_shared<EffectsOptions>();
  auto* sub =
      app.add_subcommand("effects", "What a model may lack: each effect with its laws, numbers, ranges and sources");
  sub->add_option("NAME", options->names, "Effects whose sheets to print; none: a line for each effect");
  auto* json = sub->add_flag("--json", options->json, "Sheets as JSON");
  sub->add_flag("--markdown", options->markdown, "The sheets of all effects: docs/effect-sheets.md")->excludes(json);
  return {sub, [options] { return effects(*options); }};
}

const Registration kEffects(31, add_effects);

}  // namespace
}  // namespace isorig::cli
