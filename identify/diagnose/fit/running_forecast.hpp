#pragma once
#include <string>
#include <vector>

#include "identify/diagnose/fit/fading.hpp"
#include "identify/diagnose/fit/free_parameters.hpp"

namespace isorig::identify {

/// A force predicted with its band, one instant at a time: what forecast() does to a whole recording, for a caller
/// whose recording has no end yet. Laws of force and band: forecast.hpp. It runs the model once for every number that
/// was fitted, and once more for the nominal model.
class RunningForecast {
 public:
  /// Throws std::invalid_argument when [seen] does not belong to the model (unfit_seen).
  RunningForecast(const model::ModelSpec& spec, const model::Reference& reference, const ReadingNoise& noise);

  void reset(const model::Instant& first) noexcept;

  struct Row {
    double force_N = 0.0;
    double half_N = 0.0;  ///< of the 95 % band; 0 for a model without [seen], which has none
    bool outside = false;
  };
  /// `unread`: of a pressure that the model reads and nobody did; there it is the nominal model.
  [[nodiscard]] Row step(const model::Instant& now, bool unread = false);

  /// What the model left of its ranges so far; for people.
  [[nodiscard]] std::vector<std::string> notes() const;

 private:
  model::RunningModel model_;
  double error_N_ = 0.0;
  /// Of a recording that was not fitted, where those that were have zeros of their own; else 0.
  double zero_variance_N2_ = 0.0;
  std::vector<model::RunningModel> nominal_;  ///< one, or none without [seen]
  std::vector<model::RunningModel> moved_;    ///< one for every fitted number, moved by its difference_step
  Eigen::MatrixXd covariance_;                ///< in units of those steps
  Eigen::VectorXd change_N_;
  std::vector<Fading> fading_;  ///< one, or none without [seen]
};

/// Why `spec.seen` does not belong to `spec`; "" when it does.
[[nodiscard]] std::string unfit_seen(const model::ModelSpec& spec);

}  // namespace isorig::identify
