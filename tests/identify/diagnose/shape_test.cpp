#include "identify/diagnose/explain/shape.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>

#include "concealed_specimen.hpp"
#include "identify/diagnose/fit/series.hpp"
#include "model/catalogue.hpp"
#include "model/elements.hpp"

namespace isorig::identify {
namespace {

constexpr double kNoise_N = 0.02;
constexpr NoiseModel kWhite{kNoise_N, 0.0, 1.0};

/// A session, and the shape of one law with given numbers beside the paper's model.
class ShapeOfAnEffect : public testing::Test {
 protected:
  Shape draw(std::string_view effect, std::string_view law, std::vector<double> parameters,
             std::vector<double> coefficients) {
    const model::Physics& physics = *model::find_physics(effect);
    spec_ = model::nominal_model("slse1");
    spec_.parts[0].coefficients = {2.5};
    spec_.parts[1].parameters = {0.8};
    spec_.parts[1].coefficients = {2.0};
    model::Part part = model::make_part(physics, *model::find_law(physics, law));
    part.parameters = std::move(parameters);
    part.coefficients = std::move(coefficients);
    spec_.parts.push_back(std::move(part));
    return shape_of(problem_, spec_, physics);
  }

  std::vector<Series> series_{
      prepare_series("bench", test::record(test::ConcealedSpecimen{.force_noise_N = kNoise_N, .seed = 3}), {})};
  Problem problem_{series_, kWhite};
  model::ModelSpec spec_;
};

// The laws themselves are the judge: each shape is compared with its equation, written out here.

TEST_F(ShapeOfAnEffect, FrictionOverTheVelocity) {
  const Shape shape = draw("coulomb_friction", "regularised", {0.5}, {0.8});
  EXPECT_EQ(shape.of, "rate_mm_s");
  ASSERT_EQ(shape.x.size(), 31U);
  for (std::size_t i = 0; i < shape.x.size(); ++i)
    EXPECT_NEAR(shape.y[i], 0.8 * std::tanh(shape.x[i] / 0.5), 1e-9) << shape.x[i];
}

TEST_F(ShapeOfAnEffect, StiffeningOverThePosition) {
  const Shape shape = draw("strain_stiffening", "cubic", {}, {0.04});
  EXPECT_EQ(shape.of, "position_mm");
  EXPECT_NEAR(shape.x.back() - shape.x.front(), 8.0, 0.1) << "the triangle of +-4 mm";
  for (std::size_t i = 0; i < shape.x.size(); ++i)
    EXPECT_NEAR(shape.y[i], 0.04 * std::pow(shape.x[i], 3), 1e-9) << shape.x[i];
}

TEST_F(ShapeOfAnEffect, DriftOverTheTime) {
  const Shape shape = draw("zero_drift", "linear", {}, {3.0});
  EXPECT_EQ(shape.of, "time_s");
  for (std::size_t i = 0; i < shape.x.size(); ++i) EXPECT_NEAR(shape.y[i], 3.0 * shape.x[i] / 3600.0, 1e-9);
}

TEST_F(ShapeOfAnEffect, ALoadCellThatBendsOverTheLoad) {
  const Shape shape = draw("cell_nonlinearity", "quadratic", {2.0}, {});
  EXPECT_EQ(shape.of, "load_N");
  for (std::size_t i = 0; i < shape.x.size(); ++i) EXPECT_NEAR(shape.y[i], 2e-3 * shape.x[i] * shape.x[i], 1e-9);
}

TEST_F(ShapeOfAnEffect, InertiaOverTheAcceleration) {
  const Shape shape = draw("fixture_inertia", "rigid", {}, {0.5});
  EXPECT_EQ(shape.of, "acceleration_mm_s2");
  EXPECT_GT(shape.x.back(), 0.0);
  for (std::size_t i = 0; i < shape.x.size(); ++i) EXPECT_NEAR(shape.y[i], 0.5e-3 * shape.x[i], 1e-9);
}

TEST_F(ShapeOfAnEffect, SofteningOverTheTravel) {
  const Shape shape = draw("cyclic_softening", "tangent", {15.0}, {-0.4});
  EXPECT_EQ(shape.of, "travel_mm");
  ASSERT_GT(shape.x.size(), 5U);
  // At the upper turns, a quarter of the range above the middle.
  const double top_mm = shape.y.back() / (0.4 * std::expm1(-shape.x.back() / 15.0));
  EXPECT_GT(top_mm, 0.5);
  for (std::size_t i = 0; i < shape.x.size(); ++i)
    EXPECT_NEAR(shape.y[i], -0.4 * top_mm * -std::expm1(-shape.x[i] / 15.0), 0.4 * top_mm * 1e-6) << shape.x[i];
}

TEST_F(ShapeOfAnEffect, ASecondRelaxationAfterAStep) {
  const Shape shape = draw("second_relaxation", "arm", {4.0}, {1.5});
  EXPECT_EQ(shape.of, "time_since_step_s");
  EXPECT_TRUE(std::ranges::is_sorted(shape.x));
  // After the ramp the arm's force decays by its time constant, from one instant to any other.
  const auto end = std::ranges::max_element(shape.y) - shape.y.begin();
  for (std::size_t i = static_cast<std::size_t>(end); i < shape.x.size(); ++i)
    EXPECT_NEAR(shape.y[i], shape.y[end] * std::exp(-(shape.x[i] - shape.x[end]) / 4.0), 1e-9) << shape.x[i];
}

TEST_F(ShapeOfAnEffect, EveryLawHasAShapeWithABandAboutIt) {
  for (const model::Physics* effect : model::effects()) {
    for (const model::Law& law : effect->laws) {
      model::Part part = model::make_part(*effect, law);
      std::vector<double> coefficients;
      for (const auto& coefficient : law.coefficients)
        coefficients.push_back(coefficient.sign == model::Sign::kNonPositive ? -0.1 : 0.1);
      const Shape shape = draw(effect->name, law.name, part.parameters, coefficients);
      SCOPED_TRACE(std::string(effect->name) + " " + std::string(law.name));
      EXPECT_FALSE(shape.of.empty());
      ASSERT_GE(shape.x.size(), 2U);
      ASSERT_EQ(shape.y.size(), shape.x.size());
      ASSERT_EQ(shape.low95.size(), shape.x.size());
      ASSERT_EQ(shape.high95.size(), shape.x.size());
      for (std::size_t i = 0; i < shape.x.size(); ++i) {
        EXPECT_TRUE(std::isfinite(shape.x[i]) && std::isfinite(shape.y[i]));
        EXPECT_LE(shape.low95[i], shape.y[i]);
        EXPECT_GE(shape.high95[i], shape.y[i]);
      }
    }
  }
}

TEST_F(ShapeOfAnEffect, TheBandIsThatOfItsNumber) {
  // One free number: a force of friction whose covariance C makes the band 1.96 sqrt(C) |tanh|.
  const model::Physics& friction = *model::find_physics("coulomb_friction");
  (void)draw("coulomb_friction", "regularised", {0.5}, {0.8});
  for (model::Part& part : spec_.parts) part.fixed = part.physics != &friction;
  const Shape shape = shape_of(problem_, spec_, friction);
  const Eigen::MatrixXd c = covariance(problem_, spec_, Spread::kMoves);
  ASSERT_EQ(c.rows(), 2) << "its force and its velocity";
  for (std::size_t i = 0; i < shape.x.size(); ++i) {
    const double u = shape.x[i] / 0.5, by_force = std::tanh(u),
                 by_velocity = -0.8 / std::pow(std::cosh(u), 2) * u / 0.5;
    // The parameter comes first; a forward difference of 1e-3 of the number errs by half of that of its curvature.
    const double variance =
        by_velocity * by_velocity * c(0, 0) + 2.0 * by_velocity * by_force * c(0, 1) + by_force * by_force * c(1, 1);
    EXPECT_NEAR(shape.high95[i] - shape.y[i], 1.96 * std::sqrt(variance), 2e-3 * 1.96 * std::sqrt(c(1, 1)) + 1e-12);
  }
}

TEST_F(ShapeOfAnEffect, ANumberThatMovesNoForceHasNoPartInTheBand) {
  // An arm without stiffness: its time constant could be anything, and the band of the friction does not know of it.
  const model::Physics& friction = *model::find_physics("coulomb_friction");
  (void)draw("coulomb_friction", "regularised", {0.5}, {0.8});
  spec_.parts[1].coefficients = {0.0};
  const Shape shape = shape_of(problem_, spec_, friction);
  ASSERT_EQ(shape.x.size(), 31U);
  for (std::size_t i = 0; i < shape.x.size(); ++i) {
    ASSERT_TRUE(std::isfinite(shape.high95[i])) << shape.x[i];
    if (shape.x[i] != 0.0) {
      EXPECT_GT(shape.high95[i], shape.y[i]) << shape.x[i];
    }
  }
}

TEST(FormulaText, HasTheNumbersWithTheirUnits) {
  const model::Physics& friction = *model::find_physics("coulomb_friction");
  const model::Law& law = *model::find_law(friction, "regularised");
  EXPECT_EQ(formula_text(law, std::vector<NamedValue>{{"velocity_mm_s", 0.5, 0.4, 0.6}, {"force_N", 0.8123456, 0, 1}}),
            "F = Fc tanh(v / v0), Fc = 0.8123 N, v0 = 0.5 mm/s");
}

}  // namespace
}  // namespace isorig::identify
