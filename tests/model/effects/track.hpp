#pragma once
#include <cstddef>
#include <span>
#include <vector>

#include "model/composed.hpp"

namespace isorig::test {

/// A motion by its values on a fine even grid, straight between them. The rest of the folder judges the
/// catalogue on it; nothing here or there calls the catalogue's stepping.
struct Track {
  double step_s = 1e-3;
  double elongation_at_zero_mm = 0.0;
  double nominal_pressure_psi = 15.0;
  std::vector<double> position_mm;
  std::vector<double> velocity_mm_s;  ///< at the grid point; of the stroke that ends there, at a corner
  std::vector<double> excess_psi;

  [[nodiscard]] std::size_t size() const { return position_mm.size(); }
  [[nodiscard]] double t_s(std::size_t i) const { return static_cast<double>(i) * step_s; }
  /// By central differences: the grid is fine enough for every motion used here.
  [[nodiscard]] double acceleration_mm_s2(std::size_t i) const;
};

/// Ramp, hold, ramp back, hold, reversals of 0.3, 0.05 and 0.02 mm, a slow triangle: straight strokes whose
/// corners all lie on multiples of `corner_s`.
struct Strokes {
  Track track;
  double corner_s = 0.1;
};
[[nodiscard]] Strokes strokes();

/// Two sines that share no period; starts at 0 with a velocity. Velocities are analytic.
[[nodiscard]] Track smooth_track();

/// Random strokes of 0.01 to 2 mm at 0.1 to 10 mm/s that end where they began.
[[nodiscard]] Track closed_track(unsigned seed);

/// The same places, passed `factor` times as fast.
[[nodiscard]] Track faster(Track track, double factor);

/// The recording id that every track is run under.
inline constexpr double kTrackId = 4711.0;

/// The force of the catalogue's model at the grid points `rows` (the first must be 0), one instant each.
[[nodiscard]] std::vector<double> model_force(const model::ModelSpec& spec, const Track& track,
                                              std::span<const std::size_t> rows);
/// Every `stride`-th grid point.
[[nodiscard]] std::vector<std::size_t> every(const Track& track, std::size_t stride);

}  // namespace isorig::test
