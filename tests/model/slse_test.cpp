#include "model/slse.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <limits>
#include <random>
#include <vector>

namespace isorig::model {
namespace {

constexpr SlseParameters kUrethane{60.0, 180.0, 0.05};
constexpr SlseParameters kMcKibben{130.0, 110.0, 0.18};
constexpr SlseParameters kFast{40.0, 5.0, 2.5};

TEST(Relaxation, IsAccurateFromTinyToHugeSteps) {
  for (double exponent = -18.0; exponent <= 3.0; exponent += 0.013) {
    const double z = std::pow(10.0, exponent);
    const long double lost = -std::expm1(-static_cast<long double>(z));
    const Relaxation r = relaxation(z);
    const auto gain = static_cast<double>(lost / static_cast<long double>(z));
    const auto decay = static_cast<double>(std::exp(-static_cast<long double>(z)));
    ASSERT_NEAR(r.gain, gain, 1e-15 * gain) << z;
    ASSERT_NEAR(r.decay, decay, 1e-15 * std::max(decay, z < 1.0 ? 1.0 : decay)) << z;
  }
  EXPECT_EQ(relaxation(0.0).decay, 1.0);
  EXPECT_EQ(relaxation(0.0).gain, 1.0);
  const Relaxation never = relaxation(std::numeric_limits<double>::infinity());
  EXPECT_EQ(never.decay, 0.0);
  EXPECT_EQ(never.gain, 0.0);
}

TEST(Slse, RampAndHoldMatchTheClosedForm) {
  // F(t) = k1 (e0 + v t) + k2 v / gamma (1 - e^-gamma t) from steady state, then k1 e + peak arm * e^-gamma
  // t.
  for (const SlseParameters& p : {kUrethane, kMcKibben, kFast}) {
    for (const double rate_1_s : {0.14, -0.14, 1e-4}) {
      const double start = 0.07;
      const double ramp_s = 0.2;
      Slse slse{p};
      slse.settle(start);
      for (int i = 1; i <= 200; ++i) {
        const double t = 0.001 * i;
        const double expected =
            p.k1_N * (start + rate_1_s * t) - p.k2_N * rate_1_s / p.gamma_1_s * std::expm1(-p.gamma_1_s * t);
        ASSERT_NEAR(slse.step(start + rate_1_s * t, 0.001), expected, 1e-11);
      }
      const double end = start + rate_1_s * ramp_s;
      const double arm_N = p.k2_N * slse.arm_strain();
      for (const double t : {0.5, 30.0, 1000.0}) {
        Slse hold = slse;
        EXPECT_NEAR(hold.step(end, t), p.k1_N * end + arm_N * std::exp(-p.gamma_1_s * t), 1e-11);
      }
    }
  }
}

TEST(Slse, AgreesWithAFineRungeKuttaOnAnArbitraryPath) {
  const std::vector<std::pair<double, double>> path{{0.3, 0.02}, {1.7, -0.015}, {0.01, 0.4}, {20.0, 0.0}, {5.0, -0.01}};
  for (const SlseParameters& p : {kUrethane, kMcKibben, kFast}) {
    Slse slse{p};
    slse.settle(0.05);
    double strain = 0.05;
    double arm = 0.0;
    for (const auto& [seconds, rate] : path) {
      const int steps = 20000;
      const double h = seconds / steps;
      const double v = rate;
      const auto slope = [&](double e2) { return v - p.gamma_1_s * e2; };
      for (int i = 0; i < steps; ++i) {
        const double a = slope(arm);
        const double b = slope(arm + 0.5 * h * a);
        const double c = slope(arm + 0.5 * h * b);
        const double d = slope(arm + h * c);
        arm += h / 6.0 * (a + 2.0 * b + 2.0 * c + d);
      }
      strain += rate * seconds;
      EXPECT_NEAR(slse.step(strain, seconds), p.k1_N * strain + p.k2_N * arm, 1e-10);
    }
  }
}

TEST(Slse, SplittingARampChangesNothing) {
  std::mt19937 engine(5);
  std::uniform_real_distribution<double> uniform(0.0, 1.0);
  for (const SlseParameters& p : {kUrethane, kMcKibben, kFast}) {
    for (int trial = 0; trial < 200; ++trial) {
      const double seconds = std::pow(10.0, 6.0 * uniform(engine) - 4.0);
      const double end = 0.05 * (2.0 * uniform(engine) - 1.0);
      Slse whole{p};
      whole.settle_ramp(0.01, 0.003);
      Slse split = whole;
      const double expected = whole.step(end, seconds);
      std::vector<double> cuts{0.0, 1.0};
      for (int i = 0; i < 7; ++i) cuts.push_back(uniform(engine));
      std::sort(cuts.begin(), cuts.end());
      for (std::size_t i = 1; i < cuts.size(); ++i) {
        if (cuts[i] == cuts[i - 1]) continue;
        split.step(0.01 + cuts[i] * (end - 0.01), (cuts[i] - cuts[i - 1]) * seconds);
      }
      ASSERT_NEAR(split.force_N(), expected, 1e-11) << seconds;
    }
  }
}

TEST(Slse, SteadyStatesStaySteady) {
  Slse rest{kMcKibben};
  rest.settle(0.1);
  EXPECT_DOUBLE_EQ(rest.force_N(), 13.0);
  EXPECT_DOUBLE_EQ(rest.step(0.1, 1e4), 13.0);

  Slse ramp{kMcKibben};
  ramp.settle_ramp(0.0, 0.01);
  for (int i = 1; i <= 10; ++i) {
    // An endless ramp: the damper carries eta v.
    EXPECT_NEAR(ramp.step(0.01 * i, 1.0), kMcKibben.k1_N * 0.01 * i + kMcKibben.eta_N_s() * 0.01, 1e-12);
  }
}

TEST(SlseStack, ForcesAdd) {
  SlseStack stack;
  ASSERT_TRUE(stack.add(kMcKibben));
  ASSERT_TRUE(stack.add(kUrethane));
  stack.settle(0.05);
  Slse a{kMcKibben};
  Slse b{kUrethane};
  a.settle(0.05);
  b.settle(0.05);
  EXPECT_DOUBLE_EQ(stack.step(0.08, 0.3), a.step(0.08, 0.3) + b.step(0.08, 0.3));
  EXPECT_TRUE(stack.add(kFast));
  EXPECT_TRUE(stack.add(kFast));
  EXPECT_FALSE(stack.add(kFast));
  EXPECT_EQ(stack.size(), SlseStack::kMaxElements);
}

}  // namespace
}  // namespace isorig::model
