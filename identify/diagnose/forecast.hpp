#pragma once
#include <functional>
#include <span>
#include <string>
#include <vector>

#include "identify/diagnose/fit/fit.hpp"
#include "identify/diagnose/fit/running_forecast.hpp"
#include "identify/diagnose/guard/pressure_coverage.hpp"

namespace isorig::identify {

/// A force predicted row by row, with the band that 95 % of the readings should lie in.
struct Forecast {
  std::vector<double> force_N, low95_N, high95_N;  ///< the band is empty for a model without [seen]
  std::vector<double> outside;                     ///< 1 where the model leaves what it has seen
  std::vector<std::string> notes;                  ///< what it leaves, by how much, with the range; for people
};

/// Simulates a model on a recording's motion and pressure (fit/running_forecast.hpp, row by row).
///
/// What the model has beyond its nominal one fades outside of what it has seen (fit/fading.hpp): with d the distance
/// and w the weight there, F the model's force and F0 the nominal one's, the band is
///
///     +- (1.96 sqrt((1 + d)^2 s^2 + J C J') + (1 - w) |F - F0|)
///
/// with s the rms of readings left out of the fit, noise included, C the covariance of the fitted numbers
/// (intervals.hpp) and J the change of F by them. s grows with d by a convention, not by a law.
/// In the times of `unread` a model that reads the pressure is the nominal one, and the band as wide as the two are
/// apart. `on_progress`, where there is one, is told now and then which part of the rows is done.
[[nodiscard]] Forecast forecast(const model::ModelSpec& spec, const Excitation& excitation,
                                const std::function<void(double fraction)>& on_progress = {},
                                const std::vector<UnreadPressure>& unread = {});

/// unread_pressure() as far as this model minds: nothing where it reads no gauge, and the whole recording where that
/// has none.
[[nodiscard]] std::vector<UnreadPressure> unread_by(const model::ModelSpec& spec, const messages::Recording& recording);

/// The row by row lower triangle of a symmetric matrix.
[[nodiscard]] std::vector<double> lower_triangle(const Eigen::MatrixXd& matrix);

}  // namespace isorig::identify
