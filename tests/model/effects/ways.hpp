#pragma once
#include <cmath>
#include <string_view>
#include <utility>
#include <vector>

#include "judge.hpp"

/// Parts by name and ways by strokes, for tests that look at one law from outside.
namespace isorig::test {

inline model::Part part(std::string_view physics, std::string_view law, std::vector<double> parameters,
                        std::vector<double> coefficients) {
  const model::Physics* found = model::find_physics(physics);
  model::Part out = model::make_part(*found, *model::find_law(*found, law));
  out.parameters = std::move(parameters);
  out.coefficients = std::move(coefficients);
  return out;
}

inline model::Part spring(double stiffness_N_mm) {
  return part("spring", "linear", {}, {stiffness_N_mm});
}

inline Curve all_rows(const model::ModelSpec& spec, const Track& track) {
  return model_force(spec, track, every(track, 1));
}

/// Strokes of (target, seconds) at `step_s`.
inline Track go(double step_s, const std::vector<std::pair<double, double>>& way) {
  Track track;
  track.step_s = step_s;
  track.position_mm.push_back(0.0);
  track.velocity_mm_s.push_back(0.0);
  for (const auto& [to_mm, seconds] : way) {
    const double from_mm = track.position_mm.back();
    const auto count = static_cast<int>(std::lround(seconds / step_s));
    for (int i = 1; i <= count; ++i) {
      track.position_mm.push_back(from_mm + (to_mm - from_mm) * i / count);
      track.velocity_mm_s.push_back((to_mm - from_mm) / seconds);
    }
  }
  track.excess_psi.assign(track.size(), 0.0);
  return track;
}

}  // namespace isorig::test
