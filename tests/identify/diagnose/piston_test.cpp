// A piston that is pushed to and fro without a rest, its position read by a laser that jumps: what is left is mostly
// the law's own error, and the numbers have to be those of least squares all the same, and their intervals those by
// which the strokes disagree.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <random>

#include "identify/diagnose/diagnosis.hpp"
#include "identify/diagnose/fit/intervals.hpp"
#include "model/catalogue.hpp"
#include "model/elements.hpp"

namespace isorig::identify {
namespace {

constexpr double kFriction_N = 6.5, kOffset_N = 2.7, kStep_s = 0.01;

struct Piston {
  double presliding_mm = 0.3;
  double wander_N = 0.0;   ///< friction that goes up and down over the stroke
  double strokes_N = 0.0;  ///< standard deviation of the friction from stroke to stroke
  double white_N = 0.15, coloured_N = 0.0;
  int jumps = 0;  ///< single readings of the position that are off by 0.2 to 0.5 mm
  unsigned seed = 1;
};

/// 41 mm out at 10.9 mm/s and back at 14.4 mm/s, 64 s, 100 Hz: the pace of a pneumatic cylinder on a test rig.
messages::Recording record(const Piston& p) {
  std::mt19937_64 random(p.seed);
  std::normal_distribution<double> normal;
  std::uniform_real_distribution<double> uniform;
  messages::Recording r;
  r.metadata.rest_length_mm = 100.0;
  double x = 0.0, before = 0.0, bristle = 0.0, coloured = 0.0, direction = 1.0;
  double of_stroke_N = kFriction_N + p.strokes_N * normal(random);
  const double phase = 2.0 * std::numbers::pi * uniform(random), decay = std::exp(-kStep_s / 0.6);
  for (double t = 0.0; t < 64.0; t += kStep_s) {
    x += (direction > 0.0 ? 10.9 : -14.4) * kStep_s;
    if ((direction > 0.0 && x >= 38.0) || (direction < 0.0 && x <= -3.0)) {
      direction = -direction;
      of_stroke_N = kFriction_N + p.strokes_N * normal(random);
    }
    const double moved = x - before, sign = moved > 0.0 ? 1.0 : -1.0;
    before = x;
    bristle = sign + (bristle - sign) * std::exp(-std::fabs(moved) / p.presliding_mm);
    coloured = decay * coloured + p.coloured_N * std::sqrt(1.0 - decay * decay) * normal(random);
    r.frame.t_s.push_back(t);
    r.frame.position_mm.push_back(x + 0.02 * normal(random));
    r.frame.force_N.push_back(kOffset_N + of_stroke_N * bristle +
                              p.wander_N * std::sin(2.0 * std::numbers::pi * x / 35.0 + phase) * sign + coloured +
                              p.white_N * normal(random));
  }
  for (int k = 0; k < p.jumps; ++k)
    r.frame.position_mm[10 + static_cast<std::size_t>(uniform(random) * 6000.0)] +=
        (uniform(random) < 0.5 ? -1.0 : 1.0) * (0.2 + 0.3 * uniform(random));
  return r;
}

model::ModelSpec rod() {
  model::ModelSpec spec;
  spec.name = "rod";
  spec.parts.push_back(model::make_part(model::element::constant(), model::element::constant().laws.front()));
  return spec;
}

/// Under the noise of its own residual this fit ended at 5.7 N with 1.19 N rms left: it followed the differences
/// between readings, which the jumps make, and left the friction.
TEST(Piston, ItsFrictionIsThatOfLeastSquaresThoughTheLaserJumps) {
  const messages::Recording r = record({.wander_N = 1.0, .coloured_N = 0.3, .jumps = 120, .seed = 7});
  const Diagnosis d = diagnose({r}, {"piston"}, rod(), {}).diagnosis;
  ASSERT_FALSE(d.missing.empty());
  EXPECT_EQ(d.missing.front().effect->name, "coulomb_friction");
  const auto& numbers = d.missing.front().parameters;
  const auto force = std::ranges::find(numbers, "force_N", &NamedValue::name);
  ASSERT_NE(force, numbers.end());
  // The wander has a mean of up to 0.14 N over a stroke of 41 mm, of which 35 are whole periods; the coloured noise,
  // 0.3 N for 0.6 s, one of 0.04 N (standard error) over 64 s, and three of these may add.
  EXPECT_NEAR(force->value, kFriction_N, 0.14 + 3.0 * 0.04);
  // Left out, it takes its 6.5 N with it, and the offset moves by its mean: 3.8 s out and 2.8 s back, 0.9 N.
  EXPECT_NEAR(d.missing.front().size_N, kFriction_N + 0.9, 0.5);
  // Left are the wander (0.71 N rms) and noise (0.34 N). A tenth more for the 120 of 6400 readings that jump: the
  // bristle of the law, with its 0.3 mm, follows some of them.
  EXPECT_LT(d.model_errors.train_rmse_N, 1.1 * std::hypot(0.71, std::hypot(0.3, 0.15)));
}

/// At numbers of least squares the gradients under another noise do not add up to zero. What all strokes have in
/// common, the error of the law at the turning points where the laser jumps, then looks like strokes that disagree.
TEST(Piston, StrokesDisagreeAboutTheSquaresThatWereMinimised) {
  const std::vector<Series> series{
      prepare_series("piston", record({.wander_N = 1.0, .coloured_N = 0.3, .jumps = 120, .seed = 7}), {})};
  model::ModelSpec spec = rod();
  const model::Physics& friction = *model::find_physics("coulomb_friction");
  spec.parts.push_back(model::make_part(friction, *model::find_law(friction, "dahl")));
  const NoiseModel plain{0.15, 0.0, 1.0};
  spec = Problem(series, plain).fit(spec).spec;
  const Problem wandering(series, {0.15, 3.0, 10.0});
  const auto width = [&](const std::optional<NoiseModel>& fitted_under) {
    const auto values = intervals(wandering, spec, Spread::kMoves, fitted_under).back();
    const NamedValue& force = *std::ranges::find(values, "force_N", &NamedValue::name);
    return force.high - force.low;
  };
  EXPECT_GT(width({}), 3.0 * width(plain));
}

/// Friction that differs from stroke to stroke by 0.5 N: its mean over some 18 strokes is known to 0.12 N, which no
/// curvature of the squares tells.
TEST(Piston, AnIntervalIsAsWideAsTheStrokesDisagree) {
  constexpr int kSeeds = 20;
  double squares = 0.0, by_noise = 0.0;
  for (unsigned seed = 1; seed <= kSeeds; ++seed) {
    const std::vector<Series> series{prepare_series("piston", record({.strokes_N = 0.5, .seed = seed}), {})};
    model::ModelSpec spec = rod();
    const model::Physics& friction = *model::find_physics("coulomb_friction");
    spec.parts.push_back(model::make_part(friction, *model::find_law(friction, "dahl")));
    const Problem problem(series, {0.15, 0.0, 1.0});
    spec = problem.fit(spec).spec;
    const auto force_of = [&](const std::vector<std::vector<NamedValue>>& values) {
      return *std::ranges::find(values.back(), "force_N", &NamedValue::name);
    };
    const NamedValue stated = force_of(intervals(problem, spec, Spread::kMoves));
    const double z = (stated.value - kFriction_N) / ((stated.high - stated.value) / 1.96);
    squares += z * z;
    const NamedValue narrow = force_of(intervals(problem, spec, Spread::kNoise));
    const double other = (narrow.value - kFriction_N) / ((narrow.high - narrow.value) / 1.96);
    by_noise += other * other;
    // A coloured noise for the curvature does not change what the strokes of a least-squares fit disagree by.
    const Problem coloured(series, {0.15, 0.5, 1.0});
    const NamedValue other_noise = force_of(intervals(coloured, spec, Spread::kMoves, problem.noise()));
    EXPECT_GE(other_noise.high - other_noise.low, 0.999 * (stated.high - stated.low));
    EXPECT_LE(other_noise.high - other_noise.low, 1.5 * (stated.high - stated.low));
  }
  // 0.1 % and 99.9 % of chi squared with 20 degrees of freedom.
  EXPECT_GT(squares, 5.92);
  EXPECT_LT(squares, 45.31);
  EXPECT_GT(by_noise, 45.31) << "without the strokes the interval would be too narrow";
}

}  // namespace
}  // namespace isorig::identify
