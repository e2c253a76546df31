// What each law is there for, seen from outside: shifts, gaps, events, limits.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <numbers>
#include <random>

#include "judge.hpp"
#include "ways.hpp"

namespace isorig::test {
namespace {

class ExactLaw : public testing::TestWithParam<Case> {};
TEST_P(ExactLaw, DoesNotCareHowAStrokeIsDivided) {
  const Strokes path = strokes();
  const auto stride = static_cast<std::size_t>(std::lround(path.corner_s / path.track.step_s));
  const auto corners = every(path.track, stride);
  std::mt19937 random(11);
  std::vector<std::size_t> divided;
  for (std::size_t i = 0; i < path.track.size(); ++i)
    if (i % stride == 0 || random() % 17 == 0) divided.push_back(i);
  for (const auto& parameters : GetParam().parameters) {
    const model::ModelSpec spec = model_of(GetParam(), parameters);
    const Curve whole = model_force(spec, path.track, corners), parts = model_force(spec, path.track, divided);
    const double peak = std::fabs(*std::ranges::max_element(whole, {}, [](double f) { return std::fabs(f); }));
    for (std::size_t k = 0, c = 0; k < divided.size(); ++k) {
      if (divided[k] % stride != 0) continue;
      ASSERT_NEAR(parts[k], whole[c++], 1e-9 * peak) << "at " << path.track.t_s(divided[k]) << " s";
    }
  }
}
std::vector<Case> exact_laws() {
  std::vector<Case> out;
  std::ranges::copy_if(cases(), std::back_inserter(out), [](const Case& c) { return c.straight_error <= 1e-6; });
  return out;
}
INSTANTIATE_TEST_SUITE_P(Catalogue, ExactLaw, testing::ValuesIn(exact_laws()), [](const auto& law) {
  return std::string(law.param.physics) + "__" + std::string(law.param.law);
});

/// Over the whole range of its numbers, not only where the cases stand; instants of 2 and 50 ms.
TEST(PowerArm, KeepsItsClaim) {
  const Track track = strokes().track;
  for (const double exponent : {0.4, 0.7, 1.3, 2.5, 6.0}) {
    for (const double tau_s : {0.05, 0.5, 5.0, 500.0}) {
      const model::ModelSpec spec{"", {part("nonlinear_viscosity", "power_arm", {tau_s, exponent}, {1.0})}};
      const Curve judged = judged_force(spec, track);
      const double peak = *std::ranges::max_element(judged);
      for (const std::size_t stride : {2U, 50U}) {
        const auto rows = every(track, stride);
        const Curve force = model_force(spec, track, rows);
        double worst = 0.0;
        for (std::size_t k = 0; k < rows.size(); ++k) worst = std::fmax(worst, std::fabs(force[k] - judged[rows[k]]));
        EXPECT_LT(worst, std::fmax(1e-4 * peak, 5e-5))
            << "exponent " << exponent << ", tau " << tau_s << " s, " << stride << " ms";
      }
    }
  }
}

TEST(Friction, WorksAgainstTheMotionWithItsFullForce) {
  for (const Case& each : cases()) {
    if (each.physics != "coulomb_friction" && each.physics != "friction_with_pressure") continue;
    for (const auto& parameters : each.parameters) {
      const model::ModelSpec spec = model_of(each, parameters);
      for (const double speed_mm_s : {0.2, 8.0}) {
        const double seconds = 12.0 / speed_mm_s;
        const Track track = go(2e-3, {{12.0, seconds}, {-12.0, 2.0 * seconds}});
        const Curve force = all_rows(spec, track);
        double expected = each.coefficients[0];
        if (each.physics == "friction_with_pressure") expected *= track.nominal_pressure_psi;
        if (each.law.find("stribeck") != std::string_view::npos) {
          const double u = speed_mm_s / parameters[1];
          expected *= 1.0 + parameters[2] * std::exp(each.law == "stribeck" ? -u * u : -u);
        }
        if (each.law == "regularised") expected *= std::tanh(speed_mm_s / parameters[0]);
        // 12 mm are sixteen slip distances of the longest (0.3 mm x 2.5): exp(-16) is left.
        EXPECT_NEAR(force[force.size() / 3], expected, 1e-6 * expected) << each.law;
        EXPECT_NEAR(force.back(), -expected, 1e-6 * expected) << each.law;
      }
    }
  }
}

TEST(BoucWen, WithExponentOneAndNoGammaIsDahlsBristle) {
  const Track track = closed_track(6);
  const Curve dahl = all_rows({"", {part("coulomb_friction", "dahl", {0.05}, {0.8})}}, track);
  const Curve bouc_wen = all_rows({"", {part("coulomb_friction", "bouc_wen", {0.05, 1.0, 1.0}, {0.8})}}, track);
  for (std::size_t i = 0; i < dahl.size(); ++i) ASSERT_NEAR(bouc_wen[i], dahl[i], 1e-6) << i;
}

TEST(BoucWen, WithEqualBetaAndGammaUnloadsAlongAStraightLine) {
  const double delta_mm = 0.2;
  const Curve force = all_rows({"", {part("coulomb_friction", "bouc_wen_equal", {delta_mm, 3.0}, {0.8})}},
                               go(1e-2, {{5.0, 1.0}, {5.0 - delta_mm, 1.0}}));
  for (std::size_t i = 100; i < force.size(); ++i)
    EXPECT_NEAR(force[i], 0.8 * (1.0 - static_cast<double>(i - 100) / 100.0), 1e-6);
}

TEST(FrictionAsymmetry, AddsOneWayWhatItTakesTheOther) {
  const double fc = 0.8, d = 0.3;
  const model::ModelSpec spec{
      "", {part("coulomb_friction", "dahl", {0.02}, {fc}), part("friction_asymmetry", "sliding", {0.02}, {d})}};
  const Curve force = all_rows(spec, go(1e-2, {{1.0, 1.0}, {-1.0, 2.0}}));
  EXPECT_NEAR(force[100], fc + d, 1e-9);
  EXPECT_NEAR(force.back(), -(fc - d), 1e-9);
}

/// Instants 1 ms and 0.5 ms apart: a thousand and two thousand of them lie within the longest delay.
TEST(ForceDelay, IsAPureShift) {
  for (const double step_s : {5e-3, 1e-3, 5e-4}) {
    Track track = go(step_s, {{0.0, 4.0}});
    for (std::size_t i = 0; i < track.size(); ++i) track.position_mm[i] = std::sin(3.0 * track.t_s(i));
    for (const double delay_s : {0.0, 0.01, 0.3, 1.0}) {
      const model::ModelSpec spec{"", {spring(2.0), part("force_delay", "dead_time", {delay_s}, {})}};
      const Curve force = all_rows(spec, track);
      for (std::size_t i = 0; i < force.size(); ++i) {
        const double at_s = std::fmax(track.t_s(i) - delay_s, 0.0);
        ASSERT_NEAR(force[i], 2.0 * std::sin(3.0 * at_s), 1e-9) << "delay " << delay_s << " s, step " << step_s;
      }
    }
  }
}

TEST(ForceDelay, HasRoomForAllCoefficientsOfAModel) {
  Track track = go(1e-3, {{2.0, 2.0}});
  model::ModelSpec spec{"", {}};
  for (int i = 0; i < 32; ++i) spec.parts.push_back(spring(0.1 * i));
  spec.parts.push_back(part("force_delay", "dead_time", {1.0}, {}));
  const Curve force = all_rows(spec, track);
  EXPECT_NEAR(force[1500], 0.5 * 0.1 * (31 * 32 / 2), 1e-9);
}

/// A slip is the only step a model has: behind a spring it is a step of force.
TEST(ForceLag, AnswersAStepWithOneExponential) {
  const double tau_s = 0.05;
  const model::ModelSpec spec{
      "",
      {part("grip_slip", "event", {1.0, 0.5, 0.0}, {}), spring(2.0), part("force_lag", "first_order", {tau_s}, {})}};
  const Track track = go(1e-4, {{0.0, 2.0}});
  const Curve force = all_rows(spec, track);
  EXPECT_EQ(force[9998], 0.0);
  for (const double after_s : {0.02, 0.05, 0.2}) {
    const auto i = static_cast<std::size_t>(std::lround((1.0 + after_s) / track.step_s));
    // The step itself takes one instant: half of it, over tau, is what the answer may be early by.
    EXPECT_NEAR(force[i], -(1.0 - std::exp(-after_s / tau_s)), 0.5 * track.step_s / tau_s + 1e-9);
  }
}

/// After a reversal the force stands still over the whole gap, whatever the stiffness.
TEST(Backlash, HoldsTheForceOverItsGap) {
  for (const double stiffness : {0.5, 20.0}) {
    const double gap = 0.08;
    const model::ModelSpec spec{"", {part("crosshead_backlash", "play", {gap, 0.0}, {}), spring(stiffness)}};
    const Track track = go(1e-3, {{2.0, 2.0}, {0.0, 2.0}});
    const Curve force = all_rows(spec, track);
    double still_mm = 0.0;
    for (std::size_t i = 2001; i < force.size(); ++i)
      if (std::fabs(force[i] - force[2000]) < 1e-9) still_mm = 2.0 - track.position_mm[i];
    EXPECT_NEAR(still_mm, gap, 1.5e-3);  // one instant moves by 1 um
    // Extending it hangs back by half the gap, and nothing is off at the start.
    EXPECT_NEAR(force[2000], stiffness * (2.0 - 0.5 * gap), 1e-9);
    EXPECT_EQ(force[0], 0.0);
  }
}

/// Where the crosshead stands in the gap at first: at its end it follows at once, else after the rest.
TEST(Backlash, BeginsWhereItIsSaidTo) {
  for (const double start : {-1.0, -0.5, 0.0, 1.0}) {
    const model::ModelSpec spec{"", {part("crosshead_backlash", "play", {0.2, start}, {}), spring(1.0)}};
    const Track track = go(1e-3, {{1.0, 1.0}});
    EXPECT_NEAR(all_rows(spec, track).back(), 1.0 - 0.1 * (1.0 + start), 1e-9) << start;
  }
}

/// At a steady speed the crosshead hangs back by half the gap and by what the drag costs, and catches up with the
/// latter.
TEST(Backlash, HangsBackBehindACompliantContact) {
  const double gap = 0.2, tau_s = 0.05, speed = 2.0;
  const model::ModelSpec spec{"", {part("crosshead_backlash", "compliant", {gap, tau_s, 0.0}, {}), spring(3.0)}};
  const Track track = go(1e-3, {{4.0, 2.0}, {4.0, 0.5}});
  const Curve force = all_rows(spec, track);
  EXPECT_NEAR(force[1999], 3.0 * (track.position_mm[1999] - 0.5 * gap - speed * tau_s), 1e-9);
  EXPECT_NEAR(force[2000 + 100], 3.0 * (4.0 - 0.5 * gap - speed * tau_s * std::exp(-0.1 / tau_s)), 1e-9);
}

/// What is fixed to the crosshead feels the acceleration of x': from a standing start v e^(-t / tau) / tau.
TEST(Backlash, ACompliantContactSoftensTheAccelerationToo) {
  const double tau_s = 0.05, speed = 2.0, mass_kg = 3.0;
  const model::ModelSpec spec{"",
                              {part("crosshead_backlash", "compliant", {0.0, tau_s, 0.0}, {}),
                               part("fixture_inertia", "rigid", {}, {mass_kg})}};
  const Track track = go(1e-3, {{1.0, 0.5}});
  const Curve force = all_rows(spec, track);
  for (std::size_t i = 1; i < 500; i += 7)  // the corner at the start belongs to the first millisecond
    ASSERT_NEAR(force[i], 1e-3 * mass_kg * speed / tau_s * std::exp(-track.t_s(i) / tau_s), 1e-9);
}

/// A step that leaves a flank, crosses the gap and meets the other flank is as good as a hundred small ones.
TEST(Backlash, StepsAcrossItsGapExactly) {
  for (const double tau_s : {0.002, 0.03, 0.4}) {
    const model::ModelSpec spec{"", {part("crosshead_backlash", "compliant", {0.3, tau_s, -0.4}, {}), spring(1.0)}};
    const Track track = go(1e-3, {{2.0, 0.4}, {1.5, 0.1}, {1.9, 0.1}, {1.9, 0.2}, {-1.0, 0.5}, {0.0, 0.2}});
    const auto coarse = every(track, 100), fine = every(track, 1);
    const Curve by_hundreds = model_force(spec, track, coarse), one_by_one = model_force(spec, track, fine);
    for (std::size_t k = 0; k < coarse.size(); ++k)
      EXPECT_NEAR(by_hundreds[k], one_by_one[coarse[k]], 1e-12) << tau_s << " s, at " << track.t_s(coarse[k]) << " s";
  }
}

Track accelerated(const std::function<double(double)>& position_mm, double seconds) {
  Track track;
  for (int i = 0; i <= std::lround(seconds / track.step_s); ++i) {
    track.position_mm.push_back(position_mm(track.step_s * i));
    track.velocity_mm_s.push_back(0.0);
    track.excess_psi.push_back(0.0);
  }
  return track;
}

/// Behind an acceleration that rises straight the mass is late by 2 z / w, whatever the distance of the instants.
TEST(Fixture, OnASpringComesLate) {
  const double period_s = 0.05, damping = 0.5, mass_kg = 2.0, jerk_mm_s3 = 300.0;
  const model::ModelSpec spec{"", {part("fixture_inertia", "sprung", {period_s, damping}, {mass_kg})}};
  const Track track = accelerated([=](double t) { return jerk_mm_s3 * t * t * t / 6.0; }, 2.0);
  const double late_s = 2.0 * damping * period_s / (2.0 * std::numbers::pi);
  for (const std::size_t stride : {1U, 7U, 50U}) {
    const auto rows = every(track, stride);
    const Curve force = model_force(spec, track, rows);
    for (std::size_t k = 0; k < rows.size(); ++k) {  // the start has died away by e^-60 after 1 s
      const double t = track.t_s(rows[k]);
      if (t > 1.0 && t < 1.99) {
        ASSERT_NEAR(force[k], 1e-3 * mass_kg * jerk_mm_s3 * (t - late_s), 1e-6) << stride;
      }
    }
  }
}

/// After a jump of the acceleration it overshoots by exp(-pi z / sqrt(1 - z^2)).
TEST(Fixture, OnASpringRings) {
  const double damping = 0.1, mass_kg = 2.0, acceleration_mm_s2 = 40.0;
  const model::ModelSpec spec{"", {part("fixture_inertia", "sprung", {0.5, damping}, {mass_kg})}};
  const Track track =
      accelerated([=](double t) { return t < 0.2 ? 0.0 : 0.5 * acceleration_mm_s2 * (t - 0.2) * (t - 0.2); }, 2.0);
  const Curve force = model_force(spec, track, every(track, 1));
  const double most = *std::ranges::max_element(force) / (1e-3 * mass_kg * acceleration_mm_s2);
  // The jump takes a millisecond on either side, (w h)^2 / 6 of an overshoot, and the peak falls between instants.
  EXPECT_NEAR(most - 1.0, std::exp(-std::numbers::pi * damping / std::sqrt(1.0 - damping * damping)), 1e-4);
}

TEST(Slack, NeverPushesWhateverTheSpecimenIs) {
  std::mt19937 random(4);
  std::uniform_real_distribution<double> share(0.2, 2.0);
  for (unsigned seed = 1; seed <= 10; ++seed) {
    model::ModelSpec spec{"",
                          {part("slack", "unilateral", {}, {}), spring(2.5 * share(random)),
                           part("maxwell", "linear", {share(random)}, {2.0 * share(random)}),
                           part("coulomb_friction", "dahl", {0.05}, {share(random)}),
                           part("viscous_drag", "linear", {}, {share(random)})}};
    const Track track = closed_track(seed);
    const Curve force = all_rows(spec, track);
    EXPECT_GE(*std::ranges::min_element(force), 0.0);
    EXPECT_EQ(std::ranges::count(force, 0.0) > 0, true) << "never slack: the path shows nothing";
    // A tare is the sensor's, and may stand below zero.
    spec.parts.push_back(part("constant", "linear", {}, {-0.3}));
    const Curve tared = all_rows(spec, track);
    EXPECT_NEAR(*std::ranges::min_element(tared), -0.3, 1e-12);
  }
}

TEST(ZeroDrift, HasItsShapeAtRest) {
  const Track track = go(10.0, {{0.0, 7200.0}});
  const auto at = [&](std::string_view law, std::vector<double> p, std::vector<double> c, std::size_t row) {
    return all_rows({"", {part("zero_drift", law, std::move(p), std::move(c))}}, track)[row];
  };
  EXPECT_NEAR(at("linear", {}, {1.5}, 360), 1.5, 1e-12);  // an hour
  EXPECT_NEAR(at("settling", {600.0}, {0.4}, 60), 0.4 * (1.0 - std::exp(-1.0)), 1e-12);
  EXPECT_NEAR(at("settling", {600.0}, {0.4}, 720), 0.4, 1e-5);
  // Beyond what was recorded a wander holds its last value: -1, 1, -1 ...
  EXPECT_NEAR(at("wander", {3600.0}, {0.1, 0.2, 0.0, 0.0, 0.0, 0.3}, 720), -0.1 + 0.2 + 0.3, 1e-12);
}

TEST(GripSlip, IsAnEventThatRelaxesAndStays) {
  const double k = 2.5, arm = 2.0, tau_s = 0.8, slip_mm = 0.2;
  const auto model = [&](double recording_id) {
    return model::ModelSpec{"",
                            {spring(k), part("maxwell", "linear", {tau_s}, {arm}),
                             part("grip_slip", "event", {5.0, slip_mm, recording_id}, {})}};
  };
  const Track track = go(1e-3, {{0.0, 4.0}, {1.0, 0.2}, {1.0, 10.8}});
  const model::ModelSpec whole{"", {spring(k), part("maxwell", "linear", {tau_s}, {arm})}};
  const Curve without = all_rows(whole, track), with = all_rows(model(0.0), track);
  EXPECT_EQ(with[4999], without[4999]);
  EXPECT_NEAR(without[5000] - with[5000], (k + arm) * slip_mm, arm * slip_mm * track.step_s / tau_s);
  EXPECT_NEAR(without.back() - with.back(), k * slip_mm, arm * slip_mm * std::exp(-10.0 / tau_s) * 1.01);
  // The event belongs to that recording, and to no other one of the same length.
  EXPECT_EQ(all_rows(model(kTrackId), track), with);
  EXPECT_EQ(all_rows(model(kTrackId + 1.0), track), without);
}

TEST(CyclicSoftening, OfTheWholeSpecimenTakesItsShareOfEveryPart) {
  // Whatever the order of the parts in the file, and not of what the rig or the sensor adds.
  const double travel_mm = 4.0, share = 0.4;
  const Track track = go(1e-3, {{1.0, 1.0}, {-1.0, 2.0}, {0.5, 1.5}});
  const std::vector<model::Part> parts{part("cyclic_softening", "overall", {travel_mm, share}, {}), spring(2.5),
                                       part("maxwell", "linear", {0.8}, {2.0}), part("constant", "linear", {}, {0.7})};
  const Curve soft = all_rows({"", parts}, track), hard = all_rows({"", {parts[1], parts[2]}}, track);
  const double travelled = 1.0 + 2.0 + 1.5;
  EXPECT_NEAR(soft.back() - 0.7, hard.back() * (1.0 - share * (1.0 - std::exp(-travelled / travel_mm))), 1e-9);
  EXPECT_NEAR(soft[1] - 0.7, hard[1], 1e-3 * share / travel_mm * hard[1] * 1.01);
}

/// The spectrum's eight arms against a spectrum that is even, each arm standing for its share of the decades
/// on both sides of it: the relaxation of a step, over the times that the spectrum covers.
TEST(Spectrum, RipplesByLessThanOnePercentUpToThreeDecades) {
  for (const auto& [decades, ripple] : {std::pair{2.0, 0.01}, std::pair{3.0, 0.01}, std::pair{5.0, 0.03}}) {
    const double first_s = 0.1, half = 0.5 * decades / 7.0;
    const model::ModelSpec spec{"", {part("second_relaxation", "spectrum", {first_s, decades}, {1.0})}};
    const Track track = go(1e-3, {{1.0, 1e-3}, {1.0, 30.0}});
    const Curve force = all_rows(spec, track);
    for (std::size_t i = 20; i < force.size(); i += 7) {
      double even = 0.0;
      constexpr int kCount = 400;
      for (int k = 0; k < kCount; ++k) {
        const double decade = -half + (decades + 2.0 * half) * (k + 0.5) / kCount;
        even += std::exp(-track.t_s(i) / (first_s * std::pow(10.0, decade))) / kCount;
      }
      ASSERT_NEAR(force[i], even, ripple) << decades << " decades at " << track.t_s(i) << " s";
    }
  }
}

}  // namespace
}  // namespace isorig::test
