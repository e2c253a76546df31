#include "identify/pooling/mixed_model.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <cmath>
#include <cstdio>
#include <ostream>
#include <stdexcept>

#include "simulated_campaign.hpp"

namespace isorig::identify::pooling {
namespace {

using testing::Layout;
using testing::simulate_campaign;
using testing::Truth;

bool holds(const Estimate& estimate, double truth) {
  return estimate.low95 <= truth && truth <= estimate.high95;
}

struct Counted {
  double level = 0.0, slope = 0.0, own_level = 0.0, own_slope = 0.0;  ///< shares of intervals that hold the truth
  double half_width = 0.0;
};

Counted coverage(const Truth& truth, const Layout& layout, std::size_t campaigns, std::uint64_t seed) {
  Counted out;
  const auto each = 1.0 / static_cast<double>(campaigns), each_own = each / static_cast<double>(layout.actuators);
  for (std::size_t n = 0; n < campaigns; ++n) {
    const auto made = simulate_campaign(truth, layout, seed + n);
    const Pooled p = pool_quantity(made.measurements, layout.actuators);
    const double away = p.mean_pressure_psi - made.reference_psi;
    if (holds(p.level, truth.level + truth.slope * away)) out.level += each;
    if (p.slope && holds(*p.slope, truth.slope)) out.slope += each;
    if (p.slope) out.half_width += 0.5 * (p.slope->high95 - p.slope->low95) * each;
    for (std::size_t i = 0; i < layout.actuators; ++i) {
      if (holds(p.actuators[i].level, made.level[i] + made.slope[i] * away)) out.own_level += each_own;
      if (p.actuators[i].slope && holds(*p.actuators[i].slope, made.slope[i])) out.own_slope += each_own;
    }
  }
  return out;
}

/// A count of intervals that hold 95 % of the time lies above this in all but one of a thousand such tests.
double least_share(std::size_t campaigns) {
  return 0.95 - 3.09 * std::sqrt(0.95 * 0.05 / static_cast<double>(campaigns));
}

struct Case {
  const char* name;
  Truth truth;
  Layout layout;
  std::size_t campaigns;
};

void PrintTo(const Case& of, std::ostream* out) {
  *out << of.name;
}

std::vector<Case> cases() {
  Truth usual, alike, apart;
  alike.scales = {0.05, 0.0, 0.0, 0.0};  // one physics, and next to no difference between actuators
  apart.scales = {1.0, 0.1, 0.02, 0.02};
  return {
      {"usual_4x4x5", usual, {4, {5, 10, 15, 20}, 5, 0.0}, 400},
      {"usual_4x4x5_a_third_missing", usual, {4, {5, 10, 15, 20}, 5, 0.33}, 400},
      {"usual_4x1x3", usual, {4, {10}, 3, 0.0}, 600},
      {"usual_4x2x1", usual, {4, {5, 20}, 1, 0.0}, 600},
      {"apart_4x3x1", apart, {4, {5, 10, 20}, 1, 0.0}, 600},
      {"alike_4x3x2", alike, {4, {5, 10, 15}, 2, 0.0}, 400},
      {"usual_12x1x3", usual, {12, {10}, 3, 0.0}, 600},
      {"usual_12x4x1_a_fifth_missing", usual, {12, {5, 10, 15, 20}, 1, 0.2}, 600},
      {"usual_12x4x5_a_third_missing", usual, {12, {5, 10, 15, 20}, 5, 0.33}, 300},
      {"alike_12x3x2", alike, {12, {5, 10, 15}, 2, 0.2}, 300},
      {"apart_12x3x2", apart, {12, {5, 10, 15}, 2, 0.2}, 300},
      {"usual_100x4x1", usual, {100, {5, 10, 15, 20}, 1, 0.2}, 300},
      {"usual_100x3x2", usual, {100, {5, 10, 15}, 2, 0.2}, 150},
  };
}

class Coverage : public ::testing::TestWithParam<Case> {};

/// From below alone: intervals of a few actuators whose spread cannot be told from zero are wider than they need be.
TEST_P(Coverage, OfNinetyFivePerCentIntervals) {
  const Case& c = GetParam();
  const Counted found = coverage(c.truth, c.layout, c.campaigns, 20261124);
  std::printf("%-30s level %.3f slope %.3f own level %.3f own slope %.3f\n", c.name, found.level, found.slope,
              found.own_level, found.own_slope);
  const double least = least_share(c.campaigns);
  EXPECT_GE(found.level, least);
  // The actuators of a campaign share its estimates of the scales: their intervals count as one each campaign.
  EXPECT_GE(found.own_level, least);
  if (c.layout.pressures_psi.size() > 1) {
    EXPECT_GE(found.slope, least);
    EXPECT_GE(found.own_slope, least);
  }
}

INSTANTIATE_TEST_SUITE_P(Layouts, Coverage, ::testing::ValuesIn(cases()),
                         [](const auto& of) { return std::string(of.param.name); });

/// With the scales known, the interval of the slope of twelve actuators would be 1.96 times this wide.
TEST(MixedModel, IntervalsAreNotWiderThanTheyNeedBe) {
  const Truth truth;
  const Layout layout{12, {5, 10, 15, 20}, 5, 0.0};
  const double cells = 125.0;  // sum over the pressures of (p - mean)^2
  // E[se^2] of an error that is 0.05 times 2^u, u even between -1 and 1: 0.05^2 (4 - 1/4) / (2 ln 4).
  const double error = 0.05 * 0.05 * 3.75 / (2.0 * std::log(4.0));
  const double within =
      truth.scales.cell * truth.scales.cell + (truth.scales.repetition * truth.scales.repetition + error) / 5.0;
  const double known = std::sqrt((truth.scales.slope * truth.scales.slope + within / cells) / 12.0);
  const Counted found = coverage(truth, layout, 100, 77);
  // Student's t of eleven degrees of freedom is 2.20 wide; a tenth more for the prior.
  EXPECT_LT(found.half_width, 1.1 * 2.20 * known);
  EXPECT_GT(found.half_width, 1.96 * known * 0.95);
}

TEST(MixedModel, ScalesAreFound) {
  const Truth truth;
  const auto made = simulate_campaign(truth, {100, {5, 10, 15, 20}, 5, 0.1}, 3);
  const Pooled p = pool_quantity(made.measurements, 100);
  EXPECT_TRUE(holds(p.level_sd, truth.scales.level)) << p.level_sd.low95 << ' ' << p.level_sd.high95;
  EXPECT_TRUE(holds(p.slope_sd, truth.scales.slope)) << p.slope_sd.low95 << ' ' << p.slope_sd.high95;
  EXPECT_TRUE(holds(p.cell_sd, truth.scales.cell)) << p.cell_sd.low95 << ' ' << p.cell_sd.high95;
  EXPECT_TRUE(holds(p.repetition_sd, truth.scales.repetition)) << p.repetition_sd.low95;
}

TEST(MixedModel, ASlopeIsTestedAgainstNone) {
  Truth flat;
  flat.slope = 0.0;
  const Layout layout{12, {5, 10, 15, 20}, 2, 0.0};
  int wrong = 0, found = 0;
  constexpr int kCampaigns = 60;
  for (std::uint64_t n = 0; n < kCampaigns; ++n) {
    const auto none = simulate_campaign(flat, layout, 500 + n), some = simulate_campaign({}, layout, 500 + n);
    if (*pool_quantity(none.measurements, 12).log_evidence_of_slope > 0.0) ++wrong;
    if (*pool_quantity(some.measurements, 12).log_evidence_of_slope > 3.0) ++found;
  }
  EXPECT_LE(wrong, 6);  // evidence of more than one for what is not there: less than one in ten
  EXPECT_EQ(found, kCampaigns);
}

/// Actuators that differ by 0.3, nothing that grows, each at one pressure.
TEST(MixedModel, ASlopeIsNotWhatTheActuatorsDifferBy) {
  Truth flat;
  flat.slope = 0.0;
  flat.scales = {0.3, 0.0, 0.02, 0.02};
  const auto at = [&](std::vector<double> pressure_of_actuator, std::uint64_t seed) {
    std::vector<Measurement> out;
    for (const Measurement& m :
         simulate_campaign(flat, {pressure_of_actuator.size(), {5, 10, 15, 20}, 2, 0.0}, seed).measurements)
      if (m.pressure_psi == pressure_of_actuator[m.actuator]) out.push_back(m);
    return pool_quantity(out, pressure_of_actuator.size());
  };
  for (const std::vector<double>& apart : {std::vector<double>{5, 15}, {5, 10, 15}, {5, 10, 15, 20}, {5, 5, 15}}) {
    const Pooled p = at(apart, 7);
    EXPECT_FALSE(p.slope) << apart.size();
    EXPECT_FALSE(p.log_evidence_of_slope);
    EXPECT_GT(p.level_sd.value, 0.05) << "what they differ by is theirs";
  }
  // Two to a pressure tell. One interval in twenty excludes zero; 3.09 standard deviations above five of a hundred are
  // 11.7.
  int wrong = 0;
  constexpr int kCampaigns = 100;
  for (std::uint64_t n = 0; n < kCampaigns; ++n) {
    const Pooled p = at({5, 5, 15, 15}, 900 + n);
    ASSERT_TRUE(p.slope);
    if (p.slope->low95 * p.slope->high95 > 0.0 && *p.log_evidence_of_slope > std::log(3.0)) ++wrong;
  }
  EXPECT_LE(wrong, 11);
}

/// What one actuator alone says is drawn towards the others, the more the less it says.
TEST(MixedModel, ShrinksWhatIsUncertain) {
  auto made = simulate_campaign({}, {12, {5, 10, 15, 20}, 3, 0.0}, 9);
  std::erase_if(made.measurements, [](const Measurement& m) { return m.actuator == 3; });
  made.measurements.push_back({3, 10.0, 9.0, 2.0});
  const Pooled p = pool_quantity(made.measurements, 13);
  EXPECT_EQ(p.actuators[3].measurements, 1U);
  EXPECT_GT(p.actuators[3].unpooled_level, 8.0);
  EXPECT_LT(p.actuators[3].level.value, 4.5);
  EXPECT_TRUE(std::isnan(p.actuators[12].unpooled_level));  // never measured: what is expected of a new actuator
  EXPECT_NEAR(p.actuators[12].level.value, p.level.value, 1e-6);
  EXPECT_GT(p.actuators[12].level.standard_error, p.level_sd.value);
}

TEST(MixedModel, UnitsDoNotMatter) {
  const auto made = simulate_campaign({}, {6, {5, 10, 20}, 2, 0.2}, 4);
  auto scaled = made.measurements;
  for (Measurement& m : scaled) {
    m.value = 1e-4 * m.value + 7.0;
    m.standard_error *= 1e-4;
    m.pressure_psi *= 6.894757;
  }
  const Pooled a = pool_quantity(made.measurements, 6), b = pool_quantity(scaled, 6);
  EXPECT_NEAR(b.level.value, 1e-4 * a.level.value + 7.0, 1e-9);
  EXPECT_NEAR(b.slope->low95, 1e-4 * a.slope->low95 / 6.894757, 1e-4 * 1e-4 * a.slope->standard_error);
  // Rounding may end an axis of the grid a node earlier: what is beyond its end is below a ten thousandth.
  EXPECT_NEAR(*b.log_evidence_of_slope, *a.log_evidence_of_slope, 1e-3);
}

TEST(MixedModel, OneMeasurementIsTakenAsItIs) {
  const std::vector<Measurement> one{{0, 10.0, 2.0, 0.5}};
  const Pooled p = pool_quantity(one, 1);
  EXPECT_NEAR(p.level.value, 2.0, 1e-12);
  EXPECT_NEAR(p.level.standard_error, 0.5, 1e-9);
  EXPECT_FALSE(p.slope);
}

TEST(MixedModel, RefusesWhatIsNoMeasurement) {
  EXPECT_THROW((void)pool_quantity({}, 1), std::invalid_argument);
  const std::vector<Measurement> exact{{0, 10.0, 2.0, 0.0}}, nan{{0, 10.0, std::nan(""), 1.0}},
      other{{2, 10.0, 1.0, 1.0}};
  EXPECT_THROW((void)pool_quantity(exact, 1), std::invalid_argument);
  EXPECT_THROW((void)pool_quantity(nan, 1), std::invalid_argument);
  EXPECT_THROW((void)pool_quantity(other, 1), std::invalid_argument);
}

double seconds_to_pool(const Layout& layout) {
  const auto made = simulate_campaign({}, layout, 8);
  const auto start = std::chrono::steady_clock::now();
  (void)pool_quantity(made.measurements, layout.actuators);
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

/// Bounds for a busy machine, ten times what was measured: a square in the number of recordings would break them.
TEST(MixedModel, IsQuick) {
  const double usual = seconds_to_pool({100, {5, 10, 15, 20}, 5, 0.0});
  const double large = seconds_to_pool({500, {5, 10, 15, 20}, 5, 0.0});
  std::printf("2000 recordings %.3f s, 10000 recordings %.3f s\n", usual, large);
  EXPECT_LT(usual, 1.5);
  EXPECT_LT(large, 7.5);
}

}  // namespace
}  // namespace isorig::identify::pooling
