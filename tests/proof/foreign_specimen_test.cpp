#include <gtest/gtest.h>

#include <numbers>

#include "foreign_drive.hpp"

/// Every law of the second generator's specimen against a closed form or a second writing.
namespace isorig::proof::foreign {
namespace {

/// Local errors of 1e-6 add up undamped over the hundred steps or so that a state takes to settle.
constexpr double kIntegrated = 1e-4;

TEST(ForeignFriction, DahlWithExponentTwoLoadsAlongARationalCurve) {
  const Drive d = ramp(2.0, 0.5);
  const Signal f = dahl_square(d, 3.0, 0.05);
  for (std::size_t i = 0; i < d.size(); ++i) {
    const double u = d.position_mm[i] / 0.05;  // dz/du = (1 - z)^2
    ASSERT_NEAR(f[i], 3.0 * u / (1.0 + u), 3.0 * kIntegrated);
  }
}

TEST(ForeignFriction, BoucWenWithExponentTwoLoadsAlongAHyperbolicTangent) {
  const Drive d = ramp(2.0, 0.3);
  const Signal f = bouc_wen(d, 3.0, 0.1, 2.0, 0.4);
  for (std::size_t i = 0; i < d.size(); ++i)
    ASSERT_NEAR(f[i], 3.0 * std::tanh(d.position_mm[i] / 0.1), 3.0 * kIntegrated);
}

TEST(ForeignFriction, LugreApproachesItsStribeckCurveExponentially) {
  for (const double v : {0.2, 5.0}) {
    const Drive d = ramp(v, 1.0);
    const Signal f = lugre_half(d, 2.0, 0.01, 0.5, 1.0);
    const double g = 1.0 + 0.5 * std::exp(-std::sqrt(v));
    for (std::size_t i = 0; i < d.size(); ++i) {
      const double left = std::exp(-d.position_mm[i] / (0.01 * g));
      // The bristle's damping (1 ms) adds its rate v left / delta.
      ASSERT_NEAR(f[i], 2.0 * (g * (1.0 - left) + 1e-3 * v * left / 0.01), 2.0 * kIntegrated * (1.0 + v)) << v;
    }
  }
}

TEST(ForeignFriction, StopsSaturateAtTheirOwnThresholds) {
  const Drive up = ramp(1.0, 2.0), down = ramp(-1.0, 2.0);
  EXPECT_NEAR(prandtl_ishlinskii(up, 3.0, 0.5, 0.3).back(), 3.0 * 1.3, 1e-9);
  EXPECT_NEAR(prandtl_ishlinskii(down, 3.0, 0.5, 0.3).back(), -3.0 * 0.7, 1e-9);
  // A stop's second writing: the stretch on a way up is the way, cut off.
  const Signal f = prandtl_ishlinskii(up, 3.0, 0.5, 0.3);
  for (std::size_t i = 0; i < up.size(); i += 50) {
    double sum = 0.0;
    for (int n = 0; n < 12; ++n) {
      const double r = 0.5 * std::pow((n + 0.5) / 12.0, 2.0);
      sum += 3.0 / 12.0 * std::min(up.position_mm[i], 1.3 * r) / r;
    }
    ASSERT_NEAR(f[i], sum, 1e-9);
  }
}

TEST(ForeignFriction, ArctangentIsHalfAtItsVelocityAndOddInIt) {
  EXPECT_NEAR(arctan_friction(ramp(0.3, 0.1), 2.0, 0.3).back(), 1.0, 1e-12);
  EXPECT_NEAR(arctan_friction(ramp(-0.3, 0.1), 2.0, 0.3).back(), -1.0, 1e-12);
  EXPECT_NEAR(arctan_friction(ramp(300.0, 0.01), 2.0, 0.3).back(), 2.0, 2e-3);  // 2 / pi * v0 / v short of it
}

TEST(ForeignFriction, CubicBristleUnderALoad) {
  const Drive d = ramp(1.0, 0.3);
  const Signal f = load_friction(d, 0.2, 0.1);
  for (std::size_t i = 0; i < d.size(); i += 10) {
    const double z = f[i] / (0.2 * 10.0);
    if (z > 0.99) break;  // x(z) is too steep to be compared
    const double root3 = std::numbers::sqrt3;
    const double x = -std::log(1.0 - z) / 3.0 + std::log(1.0 + z + z * z) / 6.0 +
                     (std::atan((2.0 * z + 1.0) / root3) - std::atan(1.0 / root3)) / root3;
    ASSERT_NEAR(0.1 * x, d.position_mm[i], 0.1 * kIntegrated / (1.0 - z * z * z));
  }
}

TEST(ForeignElasticity, BentSpringsHaveNeitherForceNorSlopeAtRest) {
  const double h = 1e-5;
  const auto check = [h](const char* law, auto&& force) {
    EXPECT_NEAR(force(0.0), 0.0, 1e-12) << law;
    EXPECT_NEAR((force(h) - force(-h)) / (2.0 * h), 0.0, 1e-4) << law;
  };
  check("fung_square", [](double x) { return fung_square_N(2.0, x, 3.0); });
  check("gent", [](double x) { return gent_N(2.0, x, 20.0, 0.4); });
  check("ogden", [](double x) { return ogden_N(2.0, x, 20.0, 6.0); });
  check("braid_lock", [](double x) { return braid_lock_N(2.0, x, 8.0); });
}

TEST(ForeignElasticity, EachIsItsOwnDefinition) {
  for (const double x : {-3.0, -0.5, 0.4, 2.0, 4.0}) {
    // Gent: derivative of -(k L^2 / 6) J ln(1 - J1 / J), by central differences (error h^2).
    const auto energy = [](double at) {
      const double s = 1.0 + at / 20.0, first = s * s + 2.0 / s - 3.0;
      return -2.0 * 400.0 / 6.0 * 0.4 * std::log(1.0 - first / 0.4);
    };
    const double h = 1e-4;
    EXPECT_NEAR(gent_N(2.0, x, 20.0, 0.4), (energy(x + h) - energy(x - h)) / (2.0 * h) - 2.0 * x, 1e-5);
    // Ogden with exponent 2 is neo-Hooke, and so is Gent that never locks.
    EXPECT_NEAR(ogden_N(2.0, x, 20.0, 2.0), gent_N(2.0, x, 20.0, 1e12), 1e-8);
    // Fung: the first two terms of the series leave k x (x / L)^6 / 6 and a little more.
    const double u = x / 10.0, series = 2.0 * x * (u * u + 0.5 * u * u * u * u);
    EXPECT_NEAR(fung_square_N(2.0, x, 10.0), series, 2.0 * std::abs(x) * std::pow(u, 6.0) / 5.0 + 1e-15);
    // The knee is one branch of F (F - k u) = (k w / 2)^2.
    const double f = hyperbolic_knee_N(2.0, x, 0.7, 0.3);
    EXPECT_NEAR(f * (f - 2.0 * (x - 0.7)), 0.09, 1e-9);
    EXPECT_NEAR(braid_lock_N(2.0, x, 8.0) * (8.0 - x), 2.0 * x * x, 1e-9);
  }
}

TEST(ForeignRelaxation, SpringpotIsAPowerOfTime) {
  for (const double alpha : {0.2, 0.5}) {
    const auto arms = springpot(alpha, 0.01, 3000.0);
    for (double t = 0.01; t <= 3000.0; t *= 3.0) {
      const double exact = std::pow(t, -alpha) / std::tgamma(1.0 - alpha);
      EXPECT_NEAR(relaxation_at(arms, t) / exact, 1.0, 3e-3) << alpha << ' ' << t;
    }
    // A ramp: v t^(1 - a) / Gamma(2 - a), less the dashpot of the rates beyond the last node's cell, which are left
    // out.
    const Drive d = ramp(1.5, 2.0);
    const Signal f = relax(d.t_s, d.position_mm, arms, 2.0);
    const double edge_1_s = std::pow(10.0, 0.125) / arms.back().time_s;
    const double left_out =
        std::sin(std::numbers::pi * alpha) / std::numbers::pi * std::pow(edge_1_s, alpha - 1.0) / (1.0 - alpha);
    const double whole = std::pow(2.0, 1.0 - alpha) / std::tgamma(2.0 - alpha);
    EXPECT_NEAR(f.back() / (2.0 * 1.5 * (whole - left_out)), 1.0, 3e-3);
  }
}

TEST(ForeignRelaxation, SpringpotAgreesWithGrunwaldAndLetnikov) {
  constexpr double kAlpha = 0.4;
  const Drive d = sine(1.0, 0.5, 2);
  const Signal f = relax(d.t_s, d.position_mm, springpot(kAlpha, 0.001, 100.0), 1.0);
  std::vector<double> weight{1.0};
  for (std::size_t j = 1; j < d.size(); ++j)
    weight.push_back(weight.back() * (static_cast<double>(j) - 1.0 - kAlpha) / static_cast<double>(j));
  for (std::size_t i = 500; i < d.size(); i += 500) {
    double sum = 0.0;
    for (std::size_t j = 0; j <= i; ++j) sum += weight[j] * d.position_mm[i - j];
    // First order in the step of 1 ms, beside the 0.3 % of the spectrum.
    EXPECT_NEAR(f[i], sum / std::pow(1e-3, kAlpha), 1e-2) << d.t_s[i];
  }
}

TEST(ForeignRelaxation, SpectraRelaxAsTheirNamesSay) {
  const auto stretched = kohlrausch_half(2.0);
  for (double t = 2e-3; t < 100.0; t *= 2.0)
    EXPECT_NEAR(relaxation_at(stretched, t), std::exp(-std::sqrt(t / 2.0)), 2e-3) << t;
  const auto broad = log_normal(2.0, 0.6);
  for (const double t : {0.0, 0.1, 1.0, 10.0}) {
    double sum = 0.0, weights = 0.0;
    for (double at = -4.0; at <= 4.0; at += 1e-3) {
      const double w = std::exp(-0.5 * at * at / 0.36);
      sum += w * std::exp(-t / (2.0 * std::pow(10.0, at)));
      weights += w;
    }
    EXPECT_NEAR(relaxation_at(broad, t), sum / weights, 1e-3) << t;  // nodes end at 3.5 deviations: 5e-4 of the weight
  }
}

TEST(ForeignDashpot, FlowsInvertTheirForces) {
  constexpr double kEta = 3.0;
  for (const double force_N : {-7.0, -0.3, 0.0, 1e-4, 0.5, 4.0}) {
    const auto agrees = [force_N](double f) { EXPECT_NEAR(f, force_N, 1e-9 * (1.0 + std::abs(force_N))); };
    agrees(2.0 * std::asinh(eyring(kEta, 2.0)(force_N) * kEta / 2.0));
    double v = cross(kEta, 0.5, 0.6)(force_N);
    agrees(kEta * v / (1.0 + std::pow(std::abs(v) / 0.5, 0.6)));
    v = carreau(kEta, 0.5, 0.4)(force_N);
    agrees(kEta * v * std::pow(1.0 + v * v / 0.25, -0.3));
    v = papanastasiou(kEta, 0.8, 0.05)(force_N);
    agrees(kEta * v + std::copysign(0.8 * (1.0 - std::exp(-std::abs(v) / 0.05)), v));
  }
}

TEST(ForeignDashpot, ArmsApproachTheForceOfTheirRateAndTheLinearArm) {
  constexpr double kStiffness = 2.0, kTau = 0.3, kEta = kStiffness * kTau, kRate = 1.5;
  const Drive d = ramp(kRate, 6.0);
  EXPECT_NEAR(arm_force(d, kStiffness, eyring(kEta, 0.4)).back(), 0.4 * std::asinh(kRate * kEta / 0.4), kIntegrated);
  EXPECT_NEAR(arm_force(d, kStiffness, papanastasiou(kEta, 0.3, 0.1)).back(), kEta * kRate + 0.3, kIntegrated);
  const Signal linear = arm_force(d, kStiffness, eyring(kEta, 1e6));
  for (std::size_t i = 0; i < d.size(); i += 100)
    ASSERT_NEAR(linear[i], kEta * kRate * (1.0 - std::exp(-d.t_s[i] / kTau)), kIntegrated);
}

/// A spring of 2 N/mm at elongations from 5 mm.
Drive loaded(Drive d) {
  d.stiffness_N_mm = 2.0;
  for (std::size_t i = 0; i < d.size(); ++i) d.elastic_N[i] = 2.0 * (5.0 + d.position_mm[i]);
  return d;
}

TEST(ForeignSoftening, FollowsItsHistory) {
  const Drive d = loaded(sine(2.0, 0.25, 2));  // up by 2, down by 4, back, twice
  const Signal pseudo = ogden_roxburgh(d, 0.2, 10.0);
  const Signal damage = simo_damage(d, 0.2, 1.5);
  for (std::size_t i = 0; i < d.size(); i += 20) {
    const double f = d.elastic_N[i], now = f * f / 4.0;
    if (d.t_s[i] <= 1.0) {
      ASSERT_EQ(pseudo[i], 0.0);  // first loading is the virgin curve
      const double x = d.position_mm[i] / 1.5;
      if (x > 0.0) {
        ASSERT_NEAR(damage[i], -0.2 * f * (1.0 - (1.0 - std::exp(-x)) / x), 1e-9);
      }
    } else {
      ASSERT_NEAR(pseudo[i], -0.2 * std::erf((49.0 - now) / 10.0) * f, 1e-9);
      const double x = 2.0 / 1.5;
      ASSERT_NEAR(damage[i] / f, -0.2 * (1.0 - (1.0 - std::exp(-x)) / x), 1e-9);
    }
  }
  // Up: 2 / 2 (7^2 - 5^2) = 24 N mm; a whole cycle turns over twice 2 / 2 (7^2 - 3^2) = 80.
  const Signal lost = miehe_damage(d, 0.2, 50.0);
  EXPECT_NEAR(lost[1000], -0.2 * (1.0 - std::exp(-24.0 / 50.0)) * 14.0, 1e-6);
  EXPECT_NEAR(lost.back(), -0.2 * (1.0 - std::exp(-160.0 / 50.0)) * 10.0, 1e-6);
}

TEST(ForeignEnergy, WhatDissipatesTakesWorkFromEveryCycle) {
  constexpr double kHz = 0.5;
  const Drive d = sine(1.0, kHz, 4);
  const std::vector<std::pair<const char*, Signal>> laws{
      {"dahl_square", dahl_square(d, 2.0, 0.05)},
      {"bouc_wen", bouc_wen(d, 2.0, 0.05, 2.0, 0.4)},
      {"lugre_half", lugre_half(d, 2.0, 0.05, 0.5, 1.0)},
      {"prandtl_ishlinskii", prandtl_ishlinskii(d, 2.0, 0.4, 0.4)},
      {"arctan_friction", arctan_friction(d, 2.0, 0.05)},
      {"load_friction", load_friction(d, 0.2, 0.05)},
      {"springpot", relax(d.t_s, d.position_mm, springpot(0.3, 0.01, 1000.0), 1.0)},
      {"log_normal", relax(d.t_s, d.position_mm, log_normal(0.5, 0.5), 1.0)},
      {"kohlrausch_half", relax(d.t_s, d.position_mm, kohlrausch_half(0.5), 1.0)},
      {"eyring", arm_force(d, 2.0, eyring(0.8, 0.3))},
      {"cross", arm_force(d, 2.0, cross(0.8, 0.5, 0.6))},
      {"carreau", arm_force(d, 2.0, carreau(0.8, 0.5, 0.4))},
      {"papanastasiou", arm_force(d, 2.0, papanastasiou(0.8, 0.3, 0.05))},
      {"one_way_damping", one_way_damping(d, 0.5)},
      {"snapping_truss", snapping_truss(d, 6.0, 0.0, 0.3)},
      {"bladder_contact", bladder_contact(d, 2.0, 0.0, 0.2)},
  };
  for (const auto& [law, force_N] : laws) EXPECT_GT(work_of_last_cycle(d, force_N, kHz), 1e-3) << law;
  // Coulomb friction of 2 N over 4 mm of way, less what presliding spares.
  EXPECT_NEAR(work_of_last_cycle(d, laws[1].second, kHz), 8.0, 8.0 * 0.1);
  EXPECT_NEAR(work_of_last_cycle(d, laws[13].second, kHz),
              0.5 * 0.5 * std::pow(2.0 * std::numbers::pi * kHz, 2.0) / kHz * 0.5, 1e-4);
}

}  // namespace
}  // namespace isorig::proof::foreign
