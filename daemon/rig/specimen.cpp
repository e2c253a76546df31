#include "daemon/rig/specimen.hpp"

#include <algorithm>
#include <cmath>

#include "base/printable.hpp"
#include "base/toml_reader.hpp"

namespace isorig::daemon {
namespace {

Specimen read(const base::TomlDocument& document) {
  const auto root = document.root();
  root.ignore_rest();  // the model and the sheath are the simulation's business
  Specimen s;
  s.text = document.text();
  (void)root.choice_or("format", "isorig-specimen/1", {"isorig-specimen/1"});  // files of before have none
  s.name = root.string("name");
  if (const auto why = base::why_not_a_name(s.name); !why.empty() && root.type_of("name") == "string") {
    root.error("name", "`name` = \"" + s.name + "\" " + why);
  }
  const auto geometry = root.table("geometry");
  geometry.ignore_rest();
  s.rest_length_mm = geometry.number("initial_length_mm", base::kPositive);
  s.minimum_length_mm = geometry.number("minimum_length_mm", base::kPositive);
  s.minimum_length_psi = geometry.number_or("minimum_length_psi", s.minimum_length_psi, base::kPositive);
  s.contraction_exponent = geometry.number_or("contraction_exponent", s.contraction_exponent, base::kPositive);
  if (const auto measured = root.table_if("rest_lengths")) {
    s.measured_psi = measured->numbers("pressure_psi", base::kNonNegative);
    s.measured_mm = measured->numbers("length_mm", base::kPositive);
    if (s.measured_psi.size() != s.measured_mm.size() || s.measured_psi.empty()) {
      measured->error("length_mm", "`length_mm` needs as many values as `pressure_psi`, and at least one");
    } else if (!std::is_sorted(s.measured_psi.begin(), s.measured_psi.end(), std::less_equal<>())) {
      measured->error("pressure_psi", "`pressure_psi` has to increase from value to value");
    }
  }
  document.finish();
  return s;
}

}  // namespace

double Specimen::pressurized_rest_length_mm(double pressure_psi) const {
  if (!measured_psi.empty()) {
    const auto above = std::lower_bound(measured_psi.begin(), measured_psi.end(), pressure_psi);
    if (above == measured_psi.begin()) return measured_mm.front();
    if (above == measured_psi.end()) return measured_mm.back();
    const auto i = static_cast<std::size_t>(above - measured_psi.begin());
    const double share = (pressure_psi - measured_psi[i - 1]) / (measured_psi[i] - measured_psi[i - 1]);
    return measured_mm[i - 1] + share * (measured_mm[i] - measured_mm[i - 1]);
  }
  const double share = std::pow(std::max(0.0, pressure_psi) / minimum_length_psi, contraction_exponent);
  return rest_length_mm - (rest_length_mm - minimum_length_mm) * share;
}

Specimen load_specimen(const std::filesystem::path& path) {
  return read(base::TomlDocument::parse_file(path));
}

Specimen parse_specimen(const std::string& text, const std::string& name) {
  return read(base::TomlDocument::parse_text(text, name));
}

}  // namespace isorig::daemon
