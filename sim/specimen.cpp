#include "sim/specimen.hpp"

#include "base/toml_reader.hpp"

namespace isorig::sim {
namespace {

model::SlseByPressure read_element(const base::TomlTable& table, std::string_view stiffness, std::size_t pressures) {
  model::SlseByPressure out;
  const auto read = [&](std::string_view key, base::Range range) {
    std::vector<double> values = table.numbers(key, range);
    if (table.has(key) && values.size() != pressures) {
      table.error(key, "needs one value for each of the " + std::to_string(pressures) +
                           " pressures in pressure_psi, has " + std::to_string(values.size()));
    }
    return values;
  };
  out.stiffness = read(stiffness, base::kPositive);
  out.kappa = read("kappa", base::kNonNegative);
  out.gamma_1_s = read("gamma_1_s", base::kPositive);
  return out;
}

}  // namespace

Specimen load_specimen(const std::filesystem::path& path) {
  const auto document = base::TomlDocument::parse_file(path);
  const base::TomlTable root = document.root();
  Specimen s;
  (void)root.choice_or("format", "isorig-specimen/1", {"isorig-specimen/1"});  // files of before have none
  s.name = root.string("name");
  s.sheath_material = root.string_or("sheath_material", "");
  s.sheath_diameter_mm = root.number_or("sheath_diameter_mm", 0.0, base::kNonNegative);

  model::ActuatorParameters& a = s.actuator;
  if (root.has("rest_lengths")) root.table("rest_lengths").ignore_rest();  // measured ones are the daemon's business
  const base::TomlTable geometry = root.table("geometry");
  a.initial_length_mm = geometry.number("initial_length_mm", base::kPositive);
  s.initial_length_std_mm = geometry.number_or("initial_length_std_mm", 0.0, base::kNonNegative);
  a.minimum_length_mm = geometry.number("minimum_length_mm", base::kPositive);
  s.minimum_length_std_mm = geometry.number_or("minimum_length_std_mm", 0.0, base::kNonNegative);
  if (a.minimum_length_mm > a.initial_length_mm) {
    geometry.error("minimum_length_mm", "must not exceed initial_length_mm");
  }
  a.minimum_length_psi = geometry.number_or("minimum_length_psi", 20.0, base::kPositive);
  a.contraction_exponent = geometry.number_or("contraction_exponent", 1.85, base::kPositive);
  a.mesh_diameter_mm = geometry.number("mesh_diameter_mm", base::kPositive);
  a.braid_angle_deg = geometry.number("braid_angle_deg", {1.0, 89.0});

  const base::TomlTable model = root.table("model");
  a.pressure_psi = model.numbers("pressure_psi", base::kNonNegative);
  for (std::size_t i = 1; i < a.pressure_psi.size(); ++i) {
    if (a.pressure_psi[i] <= a.pressure_psi[i - 1]) {
      model.error("pressure_psi", "must increase from value to value");
      break;
    }
  }
  if (model.has("pressure_psi") && a.pressure_psi.empty()) model.error("pressure_psi", "needs at least one pressure");
  a.mckibben = read_element(model.table("mckibben"), "k1_N", a.pressure_psi.size());
  if (const auto sheath = model.table_if("sheath")) {
    a.sheath = read_element(*sheath, "beta", a.pressure_psi.size());
  }
  document.finish();
  return s;
}

}  // namespace isorig::sim
