#pragma once
#include <span>
#include <string>
#include <vector>

#include "identify/diagnose/fit/fit.hpp"
#include "identify/diagnose/fit/intervals.hpp"

namespace isorig::identify {

/// The force that an effect adds, drawn over the variable that it depends on, with the band of its numbers.
struct Shape {
  std::string of;  ///< "rate_mm_s", "position_mm", "time_s", "time_since_step_s", "pressure_psi", "travel_mm",
                   ///< "load_N", "acceleration_mm_s2"
  std::vector<double> x;
  std::vector<double> y;  ///< N
  std::vector<double> low95, high95;
};

/// Both models are put through the same motion, within the ranges of position, velocity, pressure, travel, acceleration
/// and duration of the recordings, and
///
///     y      = F(whole model) - F(model without the parts of the effect)
///     band   = y +- 1.96 sqrt((J C J')_ii)
///
/// with C the covariance of all fitted numbers (fit/intervals.hpp) and J the change of y by them, to first order. The
/// motion is that of the effect's trait `shape_of` (model/process.hpp):
///
/// | trait | motion | drawn over |
/// |---|---|---|
/// | kPosition | once from the lowest to the highest position, a tenth of the fastest velocity | position |
/// | kLoop | there and back, a tenth of the fastest velocity | position, back after there |
/// | kRate | half the range at each of 31 velocities, the force at its end | velocity |
/// | kTime | at rest in the middle for as long as the longest recording | time |
/// | kStep | a ramp of a twentieth of the range at the fastest velocity, then rest | time since the ramp began |
/// | kPressure | a tenth of the range while the pressure rises from the lowest to the highest | pressure |
/// | kTravel | half the range to and fro at the fastest velocity, the force at its upper turns | travel |
/// | kLoad | as kPosition | force without the effect |
/// | kAcceleration | at rest in the middle, told an acceleration up to the 99th percentile of the recordings' |
/// acceleration |
///
/// A law that stands in the place of an arm (LawTraits::replaces_arm) is drawn whole. Of recordings in which nothing
/// moves the motions have no length: x and y are then empty.
[[nodiscard]] Shape shape_of(const Problem& problem, const model::ModelSpec& spec, const model::Physics& effect,
                             const std::optional<NoiseModel>& fitted_under = {});

/// The law's equation with its numbers: "F = Fc tanh(v / v0), Fc = 0.81 N, v0 = 0.5 mm/s". A number without a symbol in
/// the equation (the recording of an event) is left out.
[[nodiscard]] std::string formula_text(const model::Law& law, std::span<const NamedValue> numbers);

}  // namespace isorig::identify
