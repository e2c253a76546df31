// Every law of the catalogue against the same law written a second time (judge.hpp).
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <ostream>

#include "judge.hpp"

namespace isorig::test {

namespace {

double peak_of(const Curve& force) {
  double peak = 0.0;
  for (const double f : force) peak = std::fmax(peak, std::fabs(f));
  return peak;
}

struct Error {
  double largest = 0.0;
  double rms = 0.0;
};

Error error_of(const Curve& judged, const Curve& modelled, std::span<const std::size_t> rows) {
  Error out;
  double squares = 0.0, count = 0.0;
  for (std::size_t k = 0; k < rows.size(); ++k) {
    const double e = modelled[k] - judged[rows[k]];
    out.largest = std::fmax(out.largest, std::fabs(e));
    squares += e * e;
    count += 1.0;
  }
  out.rms = std::sqrt(squares / count);
  return out;
}

class EveryLaw : public testing::TestWithParam<Named> {
 protected:
  void SetUp() override {
    case_ = case_of(GetParam().physics->name, GetParam().law->name);
    ASSERT_NE(case_, nullptr) << "a law without a test: add it to cases.cpp and judge.cpp";
    ASSERT_NE(judge_of(case_->physics, case_->law), nullptr);
  }
  const Case* case_ = nullptr;
};

class LawOfStrokes : public EveryLaw {};
TEST_P(LawOfStrokes, IsExactOnStraightStrokes) {
  const Strokes path = strokes();
  const auto stride = static_cast<std::size_t>(std::lround(path.corner_s / path.track.step_s));
  for (const auto& parameters : case_->parameters) {
    const model::ModelSpec spec = model_of(*case_, parameters);
    const Curve judged = judged_force(spec, path.track);
    const double peak = peak_of(judged);
    ASSERT_GT(peak, 1e-4);
    for (const std::size_t s : {stride, stride / 10}) {
      const auto rows = every(path.track, s);
      EXPECT_LT(error_of(judged, model_force(spec, path.track, rows), rows).largest, case_->straight_error * peak)
          << "steps of " << static_cast<double>(s) * path.track.step_s << " s";
    }
  }
}

TEST_P(EveryLaw, ConvergesOnASmoothMotionAsItClaims) {
  const Track track = smooth_track();
  for (const auto& parameters : case_->parameters) {
    const model::ModelSpec spec = model_of(*case_, parameters);
    const Curve judged = judged_force(spec, track);
    const double peak = peak_of(judged);
    const auto error = [&](std::size_t stride) {
      const auto rows = every(track, stride);
      return error_of(judged, model_force(spec, track, rows), rows);
    };
    if (case_->order == 0.0) {
      EXPECT_LT(error(400).largest, 1e-6 * peak);
      continue;
    }
    // 40 ms and 10 ms: a fourth of the step, a sixteenth of a second-order error. Turning points fall between
    // instants at other phases each time, hence half of that.
    const double coarse = error(200).rms, fine = error(50).rms, floor = 1e-6 * peak;
    EXPECT_LT(fine, std::fmax(coarse / std::pow(4.0, case_->order) * 2.0, floor)) << "coarse " << coarse;
    if (case_->order >= 1) {
      EXPECT_LT(fine, 0.01 * peak);
    }
  }
}

class RateIndependentLaw : public EveryLaw {};
TEST_P(RateIndependentLaw, GivesTheSameForceAtTwiceTheSpeed) {
  Track track = smooth_track();
  std::ranges::fill(track.excess_psi, 0.0);
  const auto rows = every(track, 20);
  for (const auto& parameters : case_->parameters) {
    const model::ModelSpec spec = model_of(*case_, parameters);
    const Curve slow = model_force(spec, track, rows), fast = model_force(spec, faster(track, 2.0), rows);
    for (std::size_t k = 0; k < rows.size(); ++k) ASSERT_DOUBLE_EQ(slow[k], fast[k]) << "at " << track.t_s(rows[k]);
  }
}

/// From rest and unloaded, the work put in can only be stored or dissipated: never negative, at any time.
class PassiveLaw : public EveryLaw {};
TEST_P(PassiveLaw, NeverGivesBackMoreWorkThanItWasGiven) {
  for (unsigned seed = 1; seed <= 5; ++seed) {
    const Track track = closed_track(seed);
    const auto rows = every(track, 1);
    for (const auto& parameters : case_->parameters) {
      const Curve force = model_force(model_of(*case_, parameters), track, rows);
      double work = 0.0, dissipated_slack = 0.0;
      for (std::size_t i = 1; i < force.size(); ++i) {
        const double dx = track.position_mm[i] - track.position_mm[i - 1];
        work += 0.5 * (force[i] + force[i - 1]) * dx;
        // The trapezoid's own error where the force jumps within a step (a dashpot at a corner).
        dissipated_slack +=
            0.5 * std::fabs((force[i] - force[i - 1]) * dx) * (force[i] * force[i - 1] < 0.0 ? 1.0 : 1e-3);
        ASSERT_GT(work, -1e-9 - dissipated_slack) << "seed " << seed << " at " << track.t_s(i) << " s";
      }
      EXPECT_GT(work, 0.0);
    }
  }
}

std::vector<Named> laws_that(bool Case::*claim) {
  std::vector<Named> out;
  for (const Named& named : every_law()) {
    const Case* each = case_of(named.physics->name, named.law->name);
    if (each != nullptr && each->*claim) out.push_back(named);
  }
  return out;
}

constexpr auto kName = [](const auto& law) { return test_name(law.param); };
INSTANTIATE_TEST_SUITE_P(Catalogue, EveryLaw, testing::ValuesIn(every_law()), kName);
INSTANTIATE_TEST_SUITE_P(Catalogue, LawOfStrokes, testing::ValuesIn(laws_that(&Case::knows_corners)), kName);
INSTANTIATE_TEST_SUITE_P(Catalogue, RateIndependentLaw, testing::ValuesIn(laws_that(&Case::rate_independent)), kName);
INSTANTIATE_TEST_SUITE_P(Catalogue, PassiveLaw, testing::ValuesIn(laws_that(&Case::passive)), kName);

/// The list of cases holds no law that the catalogue has not.
TEST(Cases, AreOfTheCatalogue) {
  for (const Case& each : cases()) {
    const model::Physics* physics = model::find_physics(each.physics);
    ASSERT_NE(physics, nullptr) << each.physics;
    const model::Law* law = model::find_law(*physics, each.law);
    ASSERT_NE(law, nullptr) << each.physics << "/" << each.law;
    EXPECT_EQ(each.coefficients.size(), law->coefficients.size()) << each.law;
    for (const auto& parameters : each.parameters) EXPECT_EQ(parameters.size(), law->parameters.size()) << each.law;
  }
  EXPECT_EQ(cases().size(), every_law().size());
}

}  // namespace
}  // namespace isorig::test
