#include "identify/diagnose/search/physical_size.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
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

/// The most that it adds, at the ends of the travel or as their difference, were the pressure to rise by so much.
double pressure_adds_N(const model::Part& part, const model::Reference& reference, double pressure_psi) {
  const auto added_N = [&](double position_mm) {
    const double elongation_mm = position_mm + reference.elongation_at_zero_mm;
    return settled_force_N(part, reference, pressure_psi, elongation_mm) -
           settled_force_N(part, reference, 0.0, elongation_mm);
  };
  const double lowest_N = added_N(reference.lowest_position_mm);
  const double highest_N = added_N(reference.highest_position_mm);
  return std::max({std::fabs(lowest_N), std::fabs(highest_N), std::fabs(highest_N - lowest_N)});
}

/// What a law of the time alone changes by over a recording.
double drifts_by_N(const model::Part& part, const model::Reference& reference) {
  constexpr int kPlaces = 100;
  const auto process = part.law->make(part.parameters, reference);
  model::Instant now;
  process->reset(now);
  std::vector<double> columns(part.coefficients.size());
  double lowest_N = std::numeric_limits<double>::infinity(), highest_N = -lowest_N;
  for (int k = 0; k <= kPlaces; ++k) {
    now.t_s = reference.duration_s * k / kPlaces;
    process->force(now, columns.data());
    double force_N = 0.0;
    for (std::size_t i = 0; i < columns.size(); ++i) force_N += columns[i] * part.coefficients[i];
    lowest_N = std::min(lowest_N, force_N);
    highest_N = std::max(highest_N, force_N);
  }
  return highest_N - lowest_N;
}

/// Largest of all recordings.
struct Sizes {
  double pressure_psi = 0.0, force_N = 0.0;
};

Sizes sizes_of(std::span<const Series> series) {
  Sizes largest;
  for (const Series& each : series) {
    largest.pressure_psi = std::max(largest.pressure_psi, each.excitation.reference.nominal_pressure_psi);
    largest.force_N = std::max(largest.force_N, each.excitation.reference.largest_force_N);
  }
  return largest;
}

bool is_drift_of_the_channel(const model::Part& part) {
  return part.physics->stage == model::Stage::kSensor && part.law->traits.counts == model::Counts::kTime;
}

}  // namespace

bool beyond_physical_size(const model::ModelSpec& spec, std::span<const model::Physics* const> effects,
                          std::span<const Series> series) {
  const auto [pressure_psi, largest_N] = sizes_of(series);
  if (!(largest_N > 0.0)) return false;
  const auto beyond = [&](const model::Part& part, const model::Reference& reference) {
    if (!part.law->make) return false;
    if (is_drift_of_the_channel(part)) return drifts_by_N(part, reference) > deciding().drift_force_ratio * largest_N;
    return part.physics->traits.driven_by_pressure && pressure_psi > 0.0 &&
           pressure_adds_N(part, reference, pressure_psi) > deciding().pressure_force_ratio * largest_N;
  };
  return std::ranges::any_of(spec.parts, [&](const model::Part& part) {
    if (std::ranges::find(effects, part.physics) == effects.end()) return false;
    return std::ranges::any_of(series, [&](const Series& each) { return beyond(part, each.excitation.reference); });
  });
}

bool beyond_physical_size(const model::Table& of_pressure, std::span<const Series> series) {
  const auto [pressure_psi, largest_N] = sizes_of(series);
  if (!(largest_N > 0.0 && pressure_psi > 0.0) || of_pressure.values.size() < 2) return false;
  const auto [low, high] = std::ranges::minmax(of_pressure.values);
  const double seen_psi = of_pressure.step * static_cast<double>(of_pressure.values.size() - 1);
  return (high - low) * pressure_psi > deciding().pressure_force_ratio * largest_N * seen_psi;
}

}  // namespace isorig::identify
