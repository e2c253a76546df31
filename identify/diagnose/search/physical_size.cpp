#include "identify/diagnose/search/physical_size.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

#include "identify/diagnose/deciding/deciding.hpp"

namespace isorig::identify {
namespace {

/// Force of a law that follows the pressure, once the pressure has stood there for long.
double settled_force_N(const model::Part& part, const model::Reference& reference, double excess_pressure_psi,
                       double elongation_mm) {
  model::Instant held;
  held.excess_pressure_psi = excess_pressure_psi;
  held.elongation_mm = elongation_mm;
  held.position_mm = elongation_mm - reference.elongation_at_zero_mm;
  const auto process = part.law->make(part.parameters, reference);
  process->reset(held);
  std::vector<double> columns(part.coefficients.size());
  process->force(held, columns.data());
  double force_N = 0.0;
  for (std::size_t i = 0; i < columns.size(); ++i) force_N += columns[i] * part.coefficients[i];
  return force_N;
}

}  // namespace

bool beyond_physical_size(const model::ModelSpec& spec, std::span<const Series> series) {
  double pressure_psi = 0.0, largest_N = 0.0;
  for (const Series& each : series) {
    pressure_psi = std::max(pressure_psi, each.excitation.reference.nominal_pressure_psi);
    largest_N = std::max(largest_N, each.excitation.reference.largest_force_N);
  }
  if (!(pressure_psi > 0.0 && largest_N > 0.0)) return false;
  const double allowed_N = deciding().pressure_force_ratio * largest_N;
  for (const model::Part& part : spec.parts) {
    if (!part.physics->traits.driven_by_pressure || !part.law->make) continue;
    for (const Series& each : series) {
      const model::Reference& reference = each.excitation.reference;
      const auto added_N = [&](double position_mm) {
        const double elongation_mm = position_mm + reference.elongation_at_zero_mm;
        return settled_force_N(part, reference, pressure_psi, elongation_mm) -
               settled_force_N(part, reference, 0.0, elongation_mm);
      };
      const double lowest_N = added_N(reference.lowest_position_mm);
      const double highest_N = added_N(reference.highest_position_mm);
      if (std::max({std::fabs(lowest_N), std::fabs(highest_N), std::fabs(highest_N - lowest_N)}) > allowed_N)
        return true;
    }
  }
  return false;
}

}  // namespace isorig::identify
