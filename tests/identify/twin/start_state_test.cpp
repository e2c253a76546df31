#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <string>
#include <vector>

#include "identify/twin/twin.hpp"
#include "model/catalogue.hpp"

namespace isorig::identify::twin {
namespace {

constexpr double kSpring_N_mm = 1.5, kNoise_N = 0.01, kPeriod_s = 0.005, kSettled_s = 15.0;

struct Arm {
  double stiffness_N_mm, time_constant_s, held_N;
};

/// A spring with the arms of one law, as a diagnosis writes it; what it has seen holds a day.
model::ModelSpec spec_of(const std::string& part, int numbers) {
  std::string covariance;
  for (int i = 0; i < numbers; ++i)
    for (int j = 0; j <= i; ++j) covariance += i == j ? "1e-12," : "0,";
  return model::parse_model(R"(format = "isorig-model/1"
name = "relaxing"
part = [
  { physics = "spring", law = "linear", stiffness_N_mm = 1.5 },
  { physics = "second_relaxation", )" +
                                part + R"( },
]
[seen]
position_mm = [-3, 3]
rate_mm_s = 20
travel_mm = 1e9
pressure_psi = [4, 6]
duration_s = 1e6
error_N = 0.01
covariance = [)" + covariance + R"(]
nominal = [{ physics = "spring", law = "linear", stiffness_N_mm = 1.5 }]
)",
                            "relaxing.toml");
}

struct Case {
  std::string part;
  int numbers;  ///< that are fitted, the spring's among them
  std::vector<Arm> arms;
};

std::vector<Case> cases() {
  std::vector<Case> out{
      {R"(law = "arm", time_constant_s = 20.0, stiffness_N_mm = 0.8)", 3, {{0.8, 20.0, 2.0}}},
      {R"(law = "two_arms", time_constant_s = 0.3, slow_time_constant_s = 30.0, stiffness_N_mm = 0.5, )"
       R"(slow_stiffness_N_mm = 0.8)",
       5,
       {{0.5, 0.3, 1.0}, {0.8, 30.0, 2.0}}},
      {R"(law = "spectrum", shortest_time_s = 0.1, decades = 3.0, stiffness_N_mm = 1.6)", 4, {}}};
  // Eight arms, even in log tau, that share the stiffness.
  for (int i = 0; i < 8; ++i) out.back().arms.push_back({0.2, 0.1 * std::pow(10.0, 3.0 * i / 7.0), 0.25});
  return out;
}

/// Strokes of 1 mm at 1 mm/s after 15 s at rest, of a muscle whose arms hold a force when the twin begins. Arms are
/// stepped by dz/dt = v - z / tau at constant v, by the fourth-order method of Runge and Kutta in steps of at most
/// tau / 20, whose error is (1/20)^5 / 120 of a step: nothing beside the noise.
void feed(Twin& twin, std::vector<Arm> arms, double seconds) {
  std::mt19937_64 random{11};
  std::normal_distribution<double> normal;
  double last_mm = 0.0;
  for (long k = 0; static_cast<double>(k) * kPeriod_s < seconds; ++k) {
    const double t_s = static_cast<double>(k) * kPeriod_s;
    const double phase = std::fmod(std::max(0.0, t_s - kSettled_s), 2.0);
    const double x_mm = phase < 1.0 ? phase : 2.0 - phase;
    const double rate_mm_s = (x_mm - last_mm) / kPeriod_s;
    last_mm = x_mm;
    double force_N = kSpring_N_mm * (x_mm + 1.0) + kNoise_N * normal(random);
    for (Arm& arm : arms) {
      const int parts = static_cast<int>(std::ceil(20.0 * kPeriod_s / arm.time_constant_s));
      const double h = kPeriod_s / parts;
      const auto slope = [&](double force) { return arm.stiffness_N_mm * rate_mm_s - force / arm.time_constant_s; };
      for (int i = 0; k > 0 && i < parts; ++i) {
        const double a = slope(arm.held_N), b = slope(arm.held_N + h / 2 * a), c = slope(arm.held_N + h / 2 * b),
                     d = slope(arm.held_N + h * c);
        arm.held_N += h / 6 * (a + 2 * b + 2 * c + d);
      }
      force_N += arm.held_N;
    }
    const auto mono_ns = std::llround(1e9 * t_s);
    twin.pressure(mono_ns, 5.0);
    (void)twin.frame({mono_ns, x_mm, force_N, 2, true}, t_s >= kSettled_s);
  }
}

model::Reference reference() {
  model::Reference out;
  out.elongation_at_zero_mm = 1.0;
  out.nominal_pressure_psi = 5.0;
  return out;
}

TEST(StartState, WhatFillingLeftInEveryArmOfALawIsLearntBeforeTheFirstMove) {
  for (const Case& each : cases()) {
    Twin twin(spec_of(each.part, each.numbers), reference());
    feed(twin, each.arms, 100.0);
    EXPECT_FALSE(twin.parting()) << each.part;
    ASSERT_GT(twin.judged(), 15'000U) << each.part;
    // The model is right and its error the noise: 95 % +- 0.2 % (binomial, of 16,900), and no less when the error of
    // the start state widens the band. The window of 0.15 s over which motion is told from noise rounds the turns off,
    // 0.1 s of each second at most, by less than the noise.
    const double share = static_cast<double>(twin.covered()) / static_cast<double>(twin.judged());
    EXPECT_GT(share, 0.93) << each.part;
  }
}

TEST(StartState, AnArmThatTheModelDoesNotHavePartsFromIt) {
  // The same muscle beside a model whose slow arm is as fast as the other: the load of 2 N is no longer explained.
  Case two = cases()[1];
  Twin twin(spec_of(R"(law = "arm", time_constant_s = 0.3, stiffness_N_mm = 0.5)", 3), reference());
  feed(twin, two.arms, 30.0);
  EXPECT_TRUE(twin.parting());
}

TEST(StartState, DecaysThatAreNearlyAlikeAreToldApartNoFurtherThanTheReadingsDo) {
  // Two arms of 30 s and 30.00001 s: their sum is known to about the noise over the root of the readings, and each of
  // them hardly better than the prior, which their difference at 60 s, 1e-7 of a force, keeps below 1e-6 N.
  auto spec =
      spec_of(R"(law = "two_arms", time_constant_s = 30.0, slow_time_constant_s = 30.00001, stiffness_N_mm = 0.4, )"
              R"(slow_stiffness_N_mm = 0.4)",
              5);
  StartState start(spec);
  EXPECT_NEAR(start.at(0.0).error_N, StartState::kPrior_N * std::sqrt(2.0), 1e-12);
  for (int k = 0; k < 3000; ++k) start.learn(kPeriod_s * k, 2.0 * std::exp(-kPeriod_s * k / 30.0));
  for (const double at_s : {0.0, 15.0, 60.0}) {
    EXPECT_NEAR(start.at(at_s).force_N, 2.0 * std::exp(-at_s / 30.0), 1e-4) << at_s;
    // sum of x^2 over the 15 s: 3000 (1 - exp(-1)) = 1896 readings' worth.
    EXPECT_NEAR(start.at(at_s).error_N, kNoise_N / std::sqrt(1896.0) * std::exp(-at_s / 30.0), 1e-6) << at_s;
  }
}

}  // namespace
}  // namespace isorig::identify::twin
