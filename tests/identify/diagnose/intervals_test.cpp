#include "identify/diagnose/fit/intervals.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <span>
#include <vector>

#include "concealed_specimen.hpp"
#include "identify/diagnose/noise/noise.hpp"
#include "model/catalogue.hpp"

namespace isorig::identify {
namespace {

using test::ConcealedSpecimen;

constexpr double kForceNoise_N = 0.02, kPositionNoise_mm = 4e-4;

struct Truth {
  std::string_view part, number;
  double value;
};

struct Estimate {
  double error = 0.0;
  double stated_sd = 0.0;
};

/// What was fitted against what is true, for each of `truths`.
std::vector<Estimate> estimates(messages::Recording recording, const model::Physics& effect, NoiseModel noise,
                                bool measure_noise, std::span<const Truth> truths) {
  const std::vector<std::vector<bool>> usable{std::vector<bool>(recording.frame.size(), true)};
  std::vector<Series> series{prepare_series("bench", std::move(recording), usable[0])};
  if (measure_noise) noise = instrument_noise(series, usable).noise;
  model::ModelSpec spec = model::nominal_model("slse1");
  spec.parts.push_back(model::make_part(effect, effect.laws[0]));
  Problem problem(series, noise);
  Fit fit = problem.fit(spec);
  if (measure_noise) {
    problem.set_noise(problem.estimate_noise(fit.spec));
    fit = problem.fit(fit.spec);
  }
  const auto stated = intervals(problem, fit.spec, Spread::kMoves);
  std::vector<Estimate> out;
  for (const Truth& truth : truths) {
    for (std::size_t p = 0; p < stated.size(); ++p) {
      if (fit.spec.parts[p].physics->name != truth.part) continue;
      for (const NamedValue& value : stated[p])
        if (value.name == truth.number) out.push_back({value.value - truth.value, (value.high - value.value) / 1.96});
    }
  }
  return out;
}

/// How many of `trials` may miss, each with probability `rate`, before that is rarer than 1 in 1000.
int most_misses(int trials, double rate) {
  double term = std::pow(1.0 - rate, trials), below = term;
  int misses = 0;
  while (below < 0.999) {
    ++misses;
    term *= rate / (1.0 - rate) * (trials - misses + 1) / misses;
    below += term;
  }
  return misses;
}

void expect_honest(const ConcealedSpecimen& concealed, std::string_view name, std::string_view number, double value) {
  const model::Physics& effect = *model::find_physics(name);
  const ConcealedSpecimen plant;
  const std::vector<Truth> truths{{name, number, value},
                                  {"spring", "stiffness_N_mm", plant.stiffness_N_mm},
                                  {"maxwell", "stiffness_N_mm", plant.arm_N_mm},
                                  {"maxwell", "time_constant_s", plant.arm_s}};
  ConcealedSpecimen quiet = concealed;
  quiet.force_noise_N = quiet.position_noise_mm = 0.0;
  quiet.force_step_N = 1e-9;
  const messages::Recording exact = test::record(quiet);
  const auto bias = estimates(exact, effect, {kForceNoise_N, 0.0, 1.0}, false, truths);
  ASSERT_EQ(bias.size(), truths.size());

  constexpr int kSeeds = 20;
  std::vector<double> squares(truths.size(), 0.0);
  std::vector<int> misses(truths.size(), 0);
  for (int seed = 1; seed <= kSeeds; ++seed) {
    std::mt19937 random(static_cast<unsigned>(seed));
    std::normal_distribution<double> normal;
    messages::Recording noisy = exact;
    for (std::size_t k = 0; k < noisy.frame.size(); ++k) {
      noisy.frame.force_N[k] += kForceNoise_N * normal(random);
      noisy.frame.position_mm[k] += kPositionNoise_mm * normal(random);
    }
    const auto fitted = estimates(std::move(noisy), effect, {}, true, truths);
    ASSERT_EQ(fitted.size(), truths.size());
    for (std::size_t i = 0; i < fitted.size(); ++i) {
      const double z = fitted[i].error / fitted[i].stated_sd;
      squares[i] += z * z;
      misses[i] += std::fabs(z) > 1.96 ? 1 : 0;
      // Without noise nothing is left but how motion and law are sampled and stepped.
      EXPECT_LT(std::fabs(bias[i].error), 0.2 * fitted[i].stated_sd)
          << truths[i].part << ' ' << truths[i].number << ", seed " << seed;
    }
  }
  // 0.1 % and 99.9 % of chi squared with 20 degrees of freedom: neither too narrow nor too wide.
  constexpr double kLeast = 5.92, kMost = 45.31;
  for (std::size_t i = 0; i < truths.size(); ++i) {
    EXPECT_LE(misses[i], most_misses(kSeeds, 0.05)) << truths[i].part << ' ' << truths[i].number;
    EXPECT_GT(squares[i], kLeast) << truths[i].part << ' ' << truths[i].number;
    EXPECT_LT(squares[i], kMost) << truths[i].part << ' ' << truths[i].number;
  }
}

/// Half of the time noise alone makes friction that is not there come out below zero, where its sign does not let it.
TEST(Intervals, OfACoefficientThatItsSignHoldsAtZeroSayHowFarItMayBe) {
  const std::vector<Truth> truths{{"coulomb_friction", "force_N", 0.0}};
  const model::Physics& friction = *model::find_physics("coulomb_friction");
  std::vector<double> free_sd, held_reach;
  for (unsigned seed = 1; seed <= 16; ++seed) {
    const auto fitted = estimates(test::record({.force_noise_N = kForceNoise_N, .seed = seed}), friction,
                                  {kForceNoise_N, 0.0, 1.0}, false, truths);
    ASSERT_EQ(fitted.size(), 1U);
    if (fitted[0].error > 0.0)
      free_sd.push_back(fitted[0].stated_sd);
    else
      held_reach.push_back(1.96 * fitted[0].stated_sd);
  }
  ASSERT_GE(held_reach.size(), 3U);
  ASSERT_GE(free_sd.size(), 3U);
  std::ranges::sort(free_sd);
  const double sd = free_sd[free_sd.size() / 2];
  // The further below zero it would be, the less is allowed above: at most what one at zero has, and at three standard
  // deviations below still sqrt(9 + 3.84) - 3 = 0.58. Presliding differs from fit to fit, and the error with it: half
  // as much.
  for (const double reach : held_reach) {
    EXPECT_GT(reach, 0.5 * 0.58 * sd);
    EXPECT_LT(reach, 1.5 * 1.96 * sd);
  }
}

TEST(Intervals, OfALagHoldTheTruthAsOftenAsStated) {
  expect_honest({.lag_s = 0.03}, "force_lag", "time_constant_s", 0.03);
}
TEST(Intervals, OfADelayHoldTheTruthAsOftenAsStated) {
  expect_honest({.delay_s = 0.02}, "force_delay", "delay_s", 0.02);
}

}  // namespace
}  // namespace isorig::identify
