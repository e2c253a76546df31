#include "identify/diagnose/fit/evaluator.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "concealed_specimen.hpp"
#include "identify/diagnose/fit/fit.hpp"
#include "model/catalogue.hpp"
#include "model/effects/effects.hpp"

namespace isorig::identify {
namespace {

/// What an evaluator gives, with all that it kept from other parameters, is what the running model gives.
TEST(Evaluator, KeepsNothingThatMoved) {
  messages::Recording recording = test::record_other({.friction_N = 0.3, .lag_s = 0.02});
  std::vector<bool> usable(recording.frame.size(), true);
  const std::vector<Series> series{prepare_series("bench", std::move(recording), usable)};
  const NoiseModel noise{0.02, 0.01, 1.0};
  const Whitener whitener(series, noise);
  const Problem problem(series, noise);
  RowMatrix target = problem.target();
  whitener.apply(target);
  const Eigen::VectorXd whitened = target.col(0);

  for (const model::Physics* effect : model::effects()) {
    for (const model::Law& law : effect->laws) {
      model::ModelSpec spec = model::nominal_model("slse1");
      for (const auto* beside : {&model::effect::force_lag(), &model::effect::crosshead_backlash()})
        if (beside != effect) spec.parts.push_back(model::make_part(*beside, beside->laws[0]));
      spec.parts.push_back(model::make_part(*effect, law));
      for (std::size_t i = 0; i < law.parameters.size(); ++i)
        if (law.parameters[i].traits.starts_are_shares_of_largest_force)
          spec.parts.back().parameters[i] *= series[0].excitation.reference.largest_force_N;
      Evaluator evaluator(series, whitener, whitened);
      Eigen::VectorXd residual;
      model::ModelSpec first = spec;
      (void)evaluator.solve(first, residual);
      evaluator.keep();
      for (std::size_t p = 0; p < spec.parts.size(); ++p) {
        for (std::size_t i = 0; i < spec.parts[p].parameters.size(); ++i) {
          const auto& parameter = spec.parts[p].law->parameters[i];
          if (parameter.fixed) continue;
          model::ModelSpec moved = first;
          double& value = moved.parts[p].parameters[i];
          value = std::clamp(value * 1.1 + 1e-3, parameter.lower, parameter.upper);
          const double squares = evaluator.solve(moved, residual);
          RowMatrix left = problem.target() - problem.predict(moved);
          whitener.apply(left);
          // Slack and a curved cell bend with the very coefficients that are solved for, in a few passes.
          const bool bends = effect->name == "slack" || effect->name == "cell_nonlinearity";
          EXPECT_NEAR(squares, left.squaredNorm(), (bends ? 1e-3 : 1e-8) * left.squaredNorm() + 1e-6)
              << effect->name << ' ' << law.name << ", " << parameter.name;
        }
      }
    }
  }
}

/// A ceiling bends the force by the very coefficients that are solved for. Solving has settled when the model that it
/// returns predicts the residual that it returns.
TEST(Evaluator, SettlesAtTheCornerOfACeiling) {
  constexpr double kSharpness = 12.0;
  const model::Physics& cell = model::effect::cell_nonlinearity();
  for (const double share : {0.85, 0.9, 0.95}) {
    messages::Recording recording = test::record_other({.friction_N = 0.3});
    double largest_N = 0.0;
    for (const double force_N : recording.frame.force_N) largest_N = std::max(largest_N, std::fabs(force_N));
    const double ceiling_N = share * largest_N;
    for (double& force_N : recording.frame.force_N)
      force_N /= std::pow(1.0 + std::pow(std::fabs(force_N) / ceiling_N, kSharpness), 1.0 / kSharpness);
    std::vector<bool> usable(recording.frame.size(), true);
    const std::vector<Series> series{prepare_series("bench", std::move(recording), usable)};
    const NoiseModel noise{0.02, 0.0, 1.0};
    const Whitener whitener(series, noise);
    const Problem problem(series, noise);
    RowMatrix target = problem.target();
    whitener.apply(target);
    const Eigen::VectorXd whitened = target.col(0);

    model::ModelSpec spec = problem.fit(model::nominal_model("slse1"), 10).spec;
    spec.parts.push_back(model::make_part(cell, *model::find_law(cell, "ceiling")));
    spec.parts.back().parameters = {1.1 * ceiling_N, kSharpness};
    Evaluator evaluator(series, whitener, whitened);
    Eigen::VectorXd residual;
    const double squares = evaluator.solve(spec, residual);
    RowMatrix left = problem.target() - problem.predict(spec);
    whitener.apply(left);
    EXPECT_NEAR(squares, left.squaredNorm(), 1e-8 * left.squaredNorm()) << share;
  }
}

}  // namespace
}  // namespace isorig::identify
