#pragma once
#include <Eigen/Core>
#include <string_view>
#include <vector>

#include "messages/recording.hpp"
#include "proof/fit/nominal.hpp"

namespace isorig::proof {

/// One form of one effect as columns of a linear regression: what it would add to the force.
struct Variant {
  std::string_view effect;
  int first = 0;  ///< column in Library::columns
  int count = 1;
  bool searched = false;  ///< one of several values of a nonlinear parameter: costs one more in a BIC
};

/// Columns for one recording: the nominal model, its change with each time constant, then the variants.
/// Simple on purpose: raw positions, coarse grids of parameters, linear in everything else.
struct Library {
  Eigen::MatrixXd columns;
  int base = 0;  ///< columns of the nominal model
  std::vector<Variant> variants;
};

/// `slip_at_s`: time of the step of grip_slip in this recording; infinite for none.
[[nodiscard]] Library build_library(const messages::Recording& recording, const NominalFit& nominal, double slip_at_s);

/// When a step in the residual would explain most of it.
[[nodiscard]] double likeliest_step_s(const messages::FrameSamples& frame, const Eigen::VectorXd& residual_N);

/// Position at earlier times, for regressions on lagged inputs.
[[nodiscard]] Eigen::MatrixXd lagged_columns(const messages::Recording& recording);

}  // namespace isorig::proof
