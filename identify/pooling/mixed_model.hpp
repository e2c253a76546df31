#pragma once
#include <optional>
#include <span>
#include <vector>

#include "identify/pooling/variance_model.hpp"

namespace isorig::identify::pooling {

/// 97.5 % point of the normal distribution.
inline constexpr double kZ95 = 1.959964;

struct Estimate {
  double value = 0.0;
  double standard_error = 0.0;
  double low95 = 0.0, high95 = 0.0;
};

/// A quantity pooled over actuators, pressures and repetitions.
struct Pooled {
  double mean_pressure_psi = 0.0;
  Estimate level;                 ///< mu: of the mean actuator at the mean pressure
  std::optional<Estimate> slope;  ///< beta, per psi; none at a single pressure, or where no actuator was at two
  /// ln of the evidence for a common slope over that for none, the slopes of single actuators allowed in both. The
  /// slope's prior is normal about zero, as wide as would by itself make the whole scatter of the values.
  std::optional<double> log_evidence_of_slope;
  /// The standard deviations of the model, each a posterior mean with its interval; zero where nothing shows it.
  Estimate level_sd, slope_sd, cell_sd, repetition_sd;

  struct Actuator {
    std::size_t measurements = 0;
    Estimate level;                 ///< its own, shrunk towards the others
    std::optional<Estimate> slope;  ///< likewise, per psi
    double unpooled_level = 0.0;    ///< from its own measurements alone, with its standard error; NaN without any
    double unpooled_error = 0.0;
  };
  std::vector<Actuator> actuators;
  Scales scales;  ///< posterior means, for who goes on with them
};

/// Priors: flat on mu and beta; half-normal on each standard deviation, its scale three times the scatter of the values
/// about one straight line (`slope`: over the standard deviation of the pressure), so that it says the order of
/// magnitude and nothing else and four actuators do not come out with a variance of zero (Gelman 2006). The restricted
/// likelihood is integrated over the standard deviations on a grid: intervals contain what is not known of them, which
/// does for few actuators what the corrections of Knapp & Hartung 2003 or Kenward & Roger 1997 do.
///
/// Throws std::invalid_argument as VarianceModel does.
[[nodiscard]] Pooled pool_quantity(std::span<const Measurement> measurements, std::size_t actuators);

/// ln of the half-normal priors of the scales that can be shown, with their common scale `scatter`; the same that
/// pool_quantity takes.
[[nodiscard]] double log_prior(const VarianceModel& model, const Scales& scales);

}  // namespace isorig::identify::pooling
