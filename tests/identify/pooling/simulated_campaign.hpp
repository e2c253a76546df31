#pragma once
#include <random>
#include <vector>

#include "identify/pooling/mixed_model.hpp"

namespace isorig::identify::pooling::testing {

/// A campaign with known parameters.
struct Truth {
  double level = 3.0, slope = 0.12;
  Scales scales{0.4, 0.02, 0.1, 0.08};
  double standard_error = 0.05;  ///< of a measurement, times 0.5 to 2
};

struct Layout {
  std::size_t actuators = 12;
  std::vector<double> pressures_psi{5, 10, 15, 20};
  std::size_t repetitions = 5;
  double missing = 0.0;  ///< share of the measurements that are not there
};

struct Simulated {
  std::vector<Measurement> measurements;
  std::vector<double> level, slope;  ///< of each actuator, at `reference_psi`; at a single pressure its cell is a part
  double reference_psi = 12.5;
};

inline Simulated simulate_campaign(const Truth& truth, const Layout& layout, std::uint64_t seed) {
  std::mt19937_64 random(seed);
  std::normal_distribution<double> normal;
  std::uniform_real_distribution<double> uniform;
  Simulated out;
  for (std::size_t i = 0; i < layout.actuators; ++i) {
    out.level.push_back(truth.level + truth.scales.level * normal(random));
    out.slope.push_back(truth.slope + truth.scales.slope * normal(random));
    for (const double pressure : layout.pressures_psi) {
      const double cell = truth.scales.cell * normal(random);
      if (layout.pressures_psi.size() == 1) out.level[i] += cell;
      for (std::size_t k = 0; k < layout.repetitions; ++k) {
        const double error = truth.standard_error * std::exp2(2.0 * uniform(random) - 1.0);
        const double value = out.level[i] + out.slope[i] * (pressure - out.reference_psi) +
                             (layout.pressures_psi.size() > 1 ? cell : 0.0) + truth.scales.repetition * normal(random) +
                             error * normal(random);
        if (uniform(random) >= layout.missing) out.measurements.push_back({i, pressure, value, error});
      }
    }
  }
  return out;
}

}  // namespace isorig::identify::pooling::testing
