#pragma once
#include <string>
#include <vector>

#include "identify/diagnose/diagnosis.hpp"
#include "identify/report/figure.hpp"

/// A recording beside what models say of it, for figures.
namespace isorig::identify {

/// Readings that may be believed, with the force of both models at each.
struct SimulatedForce {
  std::vector<double> t_s, position_mm, velocity_mm_s, force_N, nominal_N, model_N;

  [[nodiscard]] std::vector<double> nominal_residual_N() const;  ///< measured minus simulated
  [[nodiscard]] std::vector<double> model_residual_N() const;
  [[nodiscard]] SimulatedForce between(double from_s, double to_s) const;
};

[[nodiscard]] SimulatedForce simulate(const Series& series, const std::vector<bool>& usable, const Diagnosis& d);

/// A stretch of time to look at closely.
struct Stretch {
  std::size_t series = 0;  ///< index into Study::series
  double from_s = 0.0, to_s = 0.0;
};
/// Where most of the excess stands; without any, round the fastest motion.
[[nodiscard]] Stretch stretch_to_show(const Study& study, const std::vector<SimulatedForce>& all);

/// What one part of the model does to the force: the model's force minus that of the model without the part (of a law
/// that takes the place of an arm: minus the nominal model's). `half_band_N`: its change when each number goes to the
/// ends of its 95 % interval, one at a time, added in squares.
struct Contribution {
  std::vector<double> t_s, position_mm, force_N, half_band_N;
};
[[nodiscard]] Contribution contribution(const Series& series, const Diagnosis& d, std::size_t part,
                                        const std::vector<NamedValue>& numbers);

/// y over x as a path in the order of time: means of equal stretches of it.
[[nodiscard]] report::Series path(const std::vector<double>& t_s, const std::vector<double>& x,
                                  const std::vector<double>& y, const std::string& label, int color,
                                  std::size_t stretches = 1200);

}  // namespace isorig::identify
