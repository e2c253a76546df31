#pragma once
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "identify/fv/ramps.hpp"
#include "messages/recording.hpp"

namespace isorig::identify {

/// Fit of standard linear solids to the whole force record, which uses what the paper throws away: the
/// relaxation after every ramp, the returns, the preconditioning.
///
///     F(t) = a + k x(t) + sum_j c_j s_j(t),      ds_j/dt = dx/dt - gamma_j s_j,      s_j(0) = 0
///
/// x in mm, F in N. The motion between two samples is taken as linear and stepped exactly (model/slse.hpp has
/// the same step). Only the gammas are nonlinear: variable projection (Golub and Pereyra 1973, with Kaufman's
/// Jacobian) eliminates a, k and the c_j, so that one pass over the samples gives residual and slopes, reduced to a few
/// rows by QR, and several starts cost little. Needs a record that begins at steady state.
///
/// Not identifiable from this: a compliance in series with the specimen (it turns one standard linear solid
/// into another one exactly), so the parameters are those of specimen and load train together.

/// Why the search stopped.
enum class SeriesStop {
  kConverged,       ///< neither the sum of squares nor a gamma changes any more
  kAtBounds,        ///< the same, with a gamma at the edge of what the record can show
  kIterationLimit,  ///< it was still gaining
  kFailed,          ///< no step lowered the sum of squares, or a number was not finite
};
[[nodiscard]] std::string_view name_of(SeriesStop stop) noexcept;

struct SeriesArm {
  Estimate stiffness_N_mm;  ///< c_j
  Estimate gamma_per_s;
  double kappa = 0.0;  ///< c_j / k
};

struct SeriesFit {
  std::size_t samples = 0;
  Estimate offset_N;            ///< a: force at the unpressurized rest length
  Estimate stiffness_N_mm;      ///< k
  std::vector<SeriesArm> arms;  ///< fastest first
  double rms_N = 0.0;
  double r_squared = 0.0;
  /// Lag-1 correlation of the residual between neighbouring samples: near 0 when the model explains the
  /// record.
  double residual_correlation = 0.0;
  double effective_samples = 0.0;
  double bic = 0.0;     ///< with the effective number of samples
  int evaluations = 0;  ///< passes over all samples
  SeriesStop stop = SeriesStop::kIterationLimit;
  std::vector<std::string> statements;
};

struct SeriesOptions {
  /// Starts are tried on about this many samples; the best goes on with all.
  std::size_t search_samples = 6000;
  /// One start of one's own instead (one gamma per arm), likewise.
  std::vector<double> start_gamma_per_s{};
};

/// `arms` 1 or 2. Throws std::invalid_argument for other numbers, lengths that differ or fewer than 20
/// samples, std::domain_error when the sums of squares are not finite.
[[nodiscard]] SeriesFit fit_series(std::span<const double> t_s, std::span<const double> position_mm,
                                   std::span<const double> force_N, int arms, const SeriesOptions& options = {});

/// The model's force at every sample.
[[nodiscard]] std::vector<double> predict_series(const SeriesFit& fit, std::span<const double> t_s,
                                                 std::span<const double> position_mm);

}  // namespace isorig::identify
