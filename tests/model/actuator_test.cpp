#include "model/actuator.hpp"

#include <gtest/gtest.h>

#include <stdexcept>

namespace isorig::model {
namespace {

ActuatorParameters parameters() {
  ActuatorParameters p;
  p.initial_length_mm = 94.3;
  p.minimum_length_mm = 70.3;
  p.contraction_exponent = 2.0;
  p.mesh_diameter_mm = 10.0;
  p.braid_angle_deg = 35.0;
  p.pressure_psi = {5.0, 10.0, 15.0, 20.0};
  p.mckibben = {{110, 130, 152, 170}, {1.9, 0.85, 0.64, 0.54}, {0.14, 0.18, 0.21, 0.23}};
  p.sheath = {{0.9, 0.6, 0.4, 0.3}, {3.0, 2.6, 2.3, 2.1}, {0.05, 0.05, 0.055, 0.06}};
  return p;
}

TEST(PressureTable, PassesTheNodesWithoutKinksOrOvershoot) {
  const std::vector<double> nodes{5, 10, 15, 20};
  const std::vector<double> kappa{1.9, 0.85, 0.64, 0.54};
  const PressureTable table(nodes, {kappa, {1, 3, 2, 2}});
  PressureTable::Values v;
  for (std::size_t i = 0; i < nodes.size(); ++i) {
    table.evaluate(nodes[i], v);
    EXPECT_DOUBLE_EQ(v[0], kappa[i]);
    PressureTable::Values before;
    PressureTable::Values after;
    table.evaluate(nodes[i] - 1e-4, before);
    table.evaluate(nodes[i] + 1e-4, after);
    EXPECT_NEAR(v[0] - before[0], after[0] - v[0], 1e-7) << "kink at " << nodes[i];
  }
  double last = 1.9;
  for (double psi = -1.0; psi < 30.0; psi += 0.01) {
    table.evaluate(psi, v);
    EXPECT_LE(v[0], last + 1e-12);
    EXPECT_GE(v[1], 1.0 - 1e-12);
    EXPECT_LE(v[1], 3.0 + 1e-12);
    last = v[0];
  }
  table.evaluate(0.0, v);
  EXPECT_DOUBLE_EQ(v[0], 1.9);
  table.evaluate(40.0, v);
  EXPECT_DOUBLE_EQ(v[0], 0.54);
  EXPECT_THROW(PressureTable(std::vector<double>{5, 5}, {{1, 2}}), std::invalid_argument);
  EXPECT_THROW(PressureTable(nodes, {{1, 2}}), std::invalid_argument);
  EXPECT_THROW(PressureTable({}, {}), std::invalid_argument);
}

TEST(Braid, IsTheGeometryOfInextensibleThreads) {
  const Braid braid(94.3, 10.0, 35.0);
  EXPECT_NEAR(braid.volume_mm3(94.3), 94.3 * 78.539816339744831, 1e-6);
  for (const double length_mm : {60.0, 70.3, 94.3, 100.0}) {
    const double h = 1e-3;
    const double numeric = (braid.volume_mm3(length_mm + h) - braid.volume_mm3(length_mm - h)) / (2.0 * h);
    EXPECT_NEAR(braid.slope_mm2(length_mm), numeric, 1e-6);
  }
  // Largest volume where cos(angle) = 1/sqrt(3): 54.7 degrees.
  EXPECT_NEAR(braid.slope_mm2(braid.thread_mm() / std::sqrt(3.0)), 0.0, 1e-9);
}

TEST(Actuator, StrainIsRelativeToThePressurizedRestLength) {
  const Actuator actuator(parameters());
  EXPECT_DOUBLE_EQ(actuator.rest_length_mm(0.0), 94.3);
  EXPECT_DOUBLE_EQ(actuator.rest_length_mm(-0.1), 94.3);
  EXPECT_NEAR(actuator.rest_length_mm(20.0), 70.3, 1e-12);
  EXPECT_NEAR(actuator.rest_length_mm(5.0), 94.3 - 24.0 / 16.0, 1e-12);
  EXPECT_NEAR(actuator.strain(2.0, 20.0), (96.3 - 70.3) / 70.3, 1e-15);
  EXPECT_NEAR(actuator.strain(-1.5, 5.0), 0.0, 1e-15);
  auto other = parameters();
  other.contraction_exponent = 1.8;
  EXPECT_NEAR(Actuator(other).rest_length_mm(10.0), 94.3 - 24.0 * std::pow(0.5, 1.8), 1e-12);
}

TEST(Actuator, RampAtConstantPressureIsTheTwoElementClosedForm) {
  Actuator actuator(parameters());
  const double psi = 10.0;
  const double start_N = actuator.settle(0.0, psi);
  const double rest_mm = 94.3 - 24.0 / 4.0;
  const double e0 = (94.3 - rest_mm) / rest_mm;
  EXPECT_NEAR(start_N, 130.0 * 1.6 * e0, 1e-10);
  double force_N = 0.0;
  for (int i = 1; i <= 200; ++i) force_N = actuator.step(0.01 * i, psi, 0.001);
  const double v = 10.0 / rest_mm;
  const double e = e0 + 2.0 / rest_mm;
  const double mckibben_N = 130.0 * e - 130.0 * 0.85 * v / 0.18 * std::expm1(-0.18 * 0.2);
  const double sheath_N = 78.0 * e - 78.0 * 2.6 * v / 0.05 * std::expm1(-0.05 * 0.2);
  EXPECT_NEAR(force_N, mckibben_N + sheath_N, 1e-9);
}

TEST(Actuator, ARecordAtOnceIsItsStepsOneByOne) {
  for (const bool sheath : {true, false}) {
    ActuatorParameters p = parameters();
    if (!sheath) p.sheath = {};
    Actuator one_by_one(p), at_once(p);
    std::vector<double> position_mm, pressure_psi, expected_N;
    for (int i = 0; i < 200; ++i) {
      position_mm.push_back(0.05 * (i % 37));
      pressure_psi.push_back(i < 100 ? 10.0 : i < 150 ? 10.0 + 0.01 * i : 20.0);  // held, moving, held
      expected_N.push_back(one_by_one.step(position_mm.back(), pressure_psi.back(), 1e-3));
    }
    // In two pieces: what is left behind is the state that the next step needs.
    std::vector<double> force_N(200);
    const std::span all(force_N);
    at_once.step_all(std::span(position_mm).first(120), std::span(pressure_psi).first(120), 1e-3, all.first(120));
    EXPECT_EQ(at_once.force_N(), expected_N[119]);
    at_once.step_all(std::span(position_mm).subspan(120), std::span(pressure_psi).subspan(120), 1e-3, all.subspan(120));
    EXPECT_EQ(force_N, expected_N);
    EXPECT_EQ(at_once.step(1.0, 20.0, 2e-3), one_by_one.step(1.0, 20.0, 2e-3));
    at_once.step_all({}, {}, 1e-3, {});
    EXPECT_EQ(at_once.force_N(), one_by_one.force_N());
  }
}

TEST(Actuator, FillingStretchesTheElementsRoundAShorterRestLength) {
  Actuator actuator(parameters());
  actuator.settle(0.0, 0.0);
  double force_N = 0.0;
  for (int i = 1; i <= 2000; ++i) force_N = actuator.step(0.0, 0.01 * i, 0.001);
  const double relaxed_N = Actuator(parameters()).settle(0.0, 20.0);
  EXPECT_GT(force_N, 1.2 * relaxed_N);  // the arms are still loaded
  for (int i = 0; i < 300; ++i) force_N = actuator.step(0.0, 20.0, 1.0);
  EXPECT_NEAR(force_N, relaxed_N, 1e-4);
}

TEST(Actuator, RefusesParametersThatMakeNone) {
  auto p = parameters();
  p.minimum_length_mm = 95.0;
  EXPECT_THROW(Actuator{p}, std::invalid_argument);
  p = parameters();
  p.sheath.kappa.pop_back();
  EXPECT_THROW(Actuator{p}, std::invalid_argument);
  p = parameters();
  p.braid_angle_deg = 90.0;
  EXPECT_THROW(Actuator{p}, std::invalid_argument);
}

TEST(Actuator, BeyondItsTableItPullsInProportionToThePressure) {
  Actuator actuator(parameters());
  const double at_25_N = actuator.settle(0.0, 25.0);
  EXPECT_NEAR(actuator.settle(0.0, 25.0 + 1e-9), at_25_N, 1e-6);
  // The sheath has no pressure in it: with it the whole grows less than the McKibben alone.
  ActuatorParameters bare = parameters();
  bare.sheath = {};
  Actuator plain(bare);
  const double plain_25_N = plain.settle(0.0, 25.0);
  for (const double psi : {30.0, 45.0, 60.0, 90.0}) {
    EXPECT_NEAR(plain.settle(0.0, psi), plain_25_N * psi / 25.0, 1e-9) << psi;
    EXPECT_GT(actuator.settle(0.0, psi), at_25_N);
    EXPECT_LT(actuator.settle(0.0, psi), at_25_N * psi / 25.0);
    EXPECT_EQ(actuator.rest_length_mm(psi), actuator.rest_length_mm(25.0));
  }
  EXPECT_LT(plain.settle(0.0, 45.0), 300.0);  // newtons, where the bare power law gave millions
}

}  // namespace
}  // namespace isorig::model
