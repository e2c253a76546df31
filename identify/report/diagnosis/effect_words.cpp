#include "identify/report/diagnosis/effect_words.hpp"

#include <algorithm>
#include <array>
#include <utility>
#include <vector>

namespace isorig::identify {
namespace {

constexpr std::array<std::pair<std::string_view, std::string_view>, 27> kWords{{
    {"coulomb_friction", "dry friction"},
    {"strain_stiffening", "stiffening with strain"},
    {"second_relaxation", "a second relaxation"},
    {"nonlinear_viscosity", "viscosity that is not linear"},
    {"pressure_coupling", "a force that follows the pressure"},
    {"cyclic_softening", "softening with use"},
    {"force_lag", "a force reading that lags"},
    {"force_delay", "a force reading that comes late"},
    {"fixture_inertia", "inertia of the fixture"},
    {"zero_drift", "drift of the force's zero"},
    {"grip_slip", "slip in the grips"},
    {"crosshead_backlash", "play in the crosshead"},
    {"slack", "slack"},
    {"viscous_drag", "viscous drag"},
    {"friction_asymmetry", "friction that differs by direction"},
    {"friction_with_pressure", "friction that grows with pressure"},
    {"pressure_threshold", "a pressure below which nothing happens"},
    {"cell_nonlinearity", "a load cell that is not linear"},
    {"unsettled_start", "a specimen that had not settled at the start"},
    {"quasi_linear_viscoelasticity", "quasi-linear viscoelasticity"},
    {"directional_damping", "damping that differs by direction"},
    {"mullins_softening", "softening by the largest stretch so far"},
    {"permanent_set", "permanent set"},
    {"friction_with_load", "friction that grows with the load"},
    // Parts of nominal models.
    {"maxwell", "Maxwell arm"},
    {"constant", "force tare"},
    {"arm_start", "state of the arm at the start"},
}};

}  // namespace

std::string effect_words(std::string_view name) {
  const auto known = std::ranges::find(kWords, name, &std::pair<std::string_view, std::string_view>::first);
  if (known != kWords.end()) return std::string(known->second);
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

}  // namespace isorig::identify
