#include "identify/pooling/outliers.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <cstdio>

#include "simulated_campaign.hpp"

namespace isorig::identify::pooling {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;
using testing::Layout;
using testing::simulate_campaign;
using testing::Simulated;
using ::testing::UnorderedElementsAre;

constexpr std::size_t kActuators = 12;
const Layout kLayout{kActuators, {5, 10, 15, 20}, 3, 0.1};

Outliers look(const Simulated& made, std::size_t actuators = kActuators) {
  const Pooled pooled = pool_quantity(made.measurements, actuators);
  return find_outliers(made.measurements, pooled, {actuators, made.measurements.size()});
}

std::vector<std::size_t> indices(const std::vector<Outlier>& of) {
  std::vector<std::size_t> out;
  out.reserve(of.size());
  for (const Outlier& one : of) out.push_back(one.index);
  return out;
}

void shift(Simulated& made, std::size_t actuator, double level, double slope = 0.0) {
  for (Measurement& m : made.measurements)
    if (m.actuator == actuator) m.value += level + slope * (m.pressure_psi - made.reference_psi);
}

TEST(Outliers, AShiftedActuatorIsNamedWithItsDistance) {
  auto made = simulate_campaign({}, kLayout, 21);
  shift(made, 6, 4.0);
  const Outliers found = look(made);
  ASSERT_THAT(indices(found.actuators), ElementsAre(6));
  const Outlier& one = found.actuators.front();
  EXPECT_GT(one.probability, 0.9);
  EXPECT_FALSE(one.slope);
  // Ten of the spreads of 0.4 that actuators have, give or take its own place among them, and what eleven know of it.
  EXPECT_NEAR(one.difference, 4.0, 3.0 * 0.4);
  EXPECT_GT(one.deviations, 5.0);
  EXPECT_THAT(found.recordings, IsEmpty());
}

TEST(Outliers, AnActuatorThatTurnsTheOtherWayIsNamedByItsSlope) {
  auto made = simulate_campaign({}, kLayout, 22);
  shift(made, 2, 0.0, -0.3);
  const Outliers found = look(made);
  ASSERT_THAT(indices(found.actuators), ElementsAre(2));
  EXPECT_TRUE(found.actuators.front().slope);
  EXPECT_NEAR(found.actuators.front().difference, -0.3, 3.0 * 0.02 + 0.05);
}

/// Two equally far off widen the spread so much that neither alone looks far.
TEST(Outliers, TwoThatHideEachOtherAreBothNamed) {
  auto made = simulate_campaign({}, kLayout, 23);
  shift(made, 1, 4.0);
  shift(made, 9, 4.2);
  EXPECT_THAT(indices(look(made).actuators), UnorderedElementsAre(1, 9));
  auto opposed = simulate_campaign({}, kLayout, 24);
  shift(opposed, 1, 4.0);
  shift(opposed, 9, -4.0);
  EXPECT_THAT(indices(look(opposed).actuators), UnorderedElementsAre(1, 9));
}

TEST(Outliers, ASingleRecordingIsNamedAndItsActuatorIsNot) {
  auto made = simulate_campaign({}, kLayout, 25);
  made.measurements[40].value += 2.0;
  const Outliers found = look(made);
  ASSERT_THAT(indices(found.recordings), ElementsAre(40));
  EXPECT_NEAR(found.recordings.front().difference, 2.0, 4.0 * 0.13);
  EXPECT_GT(found.recordings.front().deviations, 5.0);
  EXPECT_THAT(found.actuators, IsEmpty());
}

/// A slip of the decimal point, or of a unit: the further off, the surer.
TEST(Outliers, WhoIsOffByAnyAmountIsNamed) {
  for (const double spreads : {10.0, 100.0, 1000.0}) {
    auto actuator = simulate_campaign({}, kLayout, 27);
    shift(actuator, 6, 0.4 * spreads);
    EXPECT_THAT(indices(look(actuator).actuators), ElementsAre(6)) << spreads;
    auto slope = simulate_campaign({}, kLayout, 27);
    shift(slope, 6, 0.0, 0.02 * spreads);
    EXPECT_THAT(indices(look(slope).actuators), ElementsAre(6)) << spreads;
    auto recording = simulate_campaign({}, kLayout, 27);
    recording.measurements[40].value += 0.13 * spreads;
    const Outliers found = look(recording);
    EXPECT_THAT(indices(found.recordings), ElementsAre(40)) << spreads;
    EXPECT_THAT(found.actuators, IsEmpty()) << spreads;
  }
}

TEST(Outliers, TwoRecordingsOfOneCellAreNamed) {
  auto made = simulate_campaign({}, {kActuators, {5, 10, 15, 20}, 5, 0.0}, 26);
  made.measurements[100].value += 2.0;
  made.measurements[101].value += 2.1;
  EXPECT_THAT(indices(look(made).recordings), UnorderedElementsAre(100, 101));
}

/// Before any data even odds that all belong: of campaigns in which all do, far fewer than that may name somebody.
TEST(Outliers, NobodyIsNamedWhereAllBelong) {
  int named_actuators = 0, named_recordings = 0;
  constexpr int kCampaigns = 60;
  for (std::uint64_t n = 0; n < kCampaigns; ++n) {
    const Outliers found = look(simulate_campaign({}, kLayout, 900 + n));
    if (!found.actuators.empty()) ++named_actuators;
    if (!found.recordings.empty()) ++named_recordings;
  }
  std::printf("of %d campaigns without outliers, %d name an actuator and %d a recording\n", kCampaigns, named_actuators,
              named_recordings);
  // 5 % on average would be more than 7 of 60 once in a hundred such tests.
  EXPECT_LE(named_actuators, 7);
  EXPECT_LE(named_recordings, 7);
}

TEST(Outliers, ThreeActuatorsAreTooFewToSayWhoIsOff) {
  auto made = simulate_campaign({}, {3, {5, 20}, 2, 0.0}, 27);
  shift(made, 1, 9.0);
  EXPECT_THAT(look(made, 3).actuators, IsEmpty());
}

TEST(Outliers, AHundredActuatorsAreQuick) {
  auto made = simulate_campaign({}, {100, {5, 10, 15, 20}, 5, 0.0}, 28);
  shift(made, 50, 5.0);
  const Pooled pooled = pool_quantity(made.measurements, 100);
  const auto start = std::chrono::steady_clock::now();
  const Outliers found = find_outliers(made.measurements, pooled, {100, 2000});
  const double took = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  std::printf("outliers of 2000 recordings: %.3f s\n", took);
  EXPECT_THAT(indices(found.actuators), ElementsAre(50));
  EXPECT_LT(took, 10.0);
}

}  // namespace
}  // namespace isorig::identify::pooling
