#include "cli/campaign/control.hpp"

#include <algorithm>
#include <stdexcept>

#include "identify/fv/campaign.hpp"

namespace isorig::cli::pieces {
namespace {

std::string listed(const std::vector<std::string>& names) {
  std::string out;
  for (const std::string& name : names) out += (out.empty() ? "" : ", ") + name;
  return out;
}

}  // namespace

std::vector<std::string> controls_of(const Ask& ask) {
  if (ask.control.empty()) return {};
  return identify::control_specimens(ask.control);
}

std::vector<std::string> model_words(const Ask& ask, const std::vector<std::string>& controls,
                                     const std::string& specimen) {
  if (ask.control.empty()) return {"--model", ask.model};
  const identify::SpecimenName name = identify::parse_specimen(specimen);
  const auto there = [&](const std::string& one) { return std::ranges::find(controls, one) != controls.end(); };
  if (name.material == "Control" || there(specimen)) return {"--model", "slse1"};
  std::string control = "Control" + name.number;
  if (!there(control) && controls.size() == 1 && identify::parse_specimen(controls.front()).material != "Control")
    control = controls.front();
  if (!there(control))
    throw std::runtime_error("its specimen is '" + specimen + "', whose control would be " +
                             (name.number.empty() ? "the only specimen" : control) + " in " + ask.control +
                             ", which has " + listed(controls) +
                             ": name an fv.json with its control, or leave the recording out");
  return {"--model", "slse2", "--control", ask.control, "--control-specimen", control};
}

}  // namespace isorig::cli::pieces
