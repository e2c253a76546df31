// A grip may slip more than once in a recording: as many slips are named as there are, each with its time and size, a
// slip that creeps with its time constant, and steps are not taken for what makes the force fall gradually.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <set>
#include <string>
#include <vector>

#include "concealed_specimen.hpp"
#include "identify/diagnose/diagnosis.hpp"
#include "model/number_sheet.hpp"

namespace isorig::identify {
namespace {

Diagnosis diagnose_bench(const test::ConcealedSpecimen& bench) {
  return diagnose({test::record(bench)}, {"bench"}, model::nominal_model("slse1"), {}).diagnosis;
}

struct Slip {
  double time_s = 0.0, slip_mm = 0.0, low_mm = 0.0, high_mm = 0.0;
};

/// In the order of time.
std::vector<Slip> slips_of(const MissingEffect& missing) {
  std::vector<Slip> out;
  for (const NamedValue& value : missing.parameters) {
    out.resize(std::max(out.size(), static_cast<std::size_t>(value.part)));
    Slip& slip = out[static_cast<std::size_t>(value.part) - 1];
    if (value.name == "time_s") slip.time_s = value.value;
    if (value.name != "slip_mm") continue;
    slip.slip_mm = value.value;
    slip.low_mm = value.low;
    slip.high_mm = value.high;
  }
  std::ranges::sort(out, {}, &Slip::time_s);
  return out;
}

const MissingEffect* named(const Diagnosis& d, std::string_view name) {
  const auto found = std::ranges::find_if(d.missing, [&](const auto& m) { return m.effect->name == name; });
  return found == d.missing.end() ? nullptr : &*found;
}

const test::ConcealedSpecimen kThree{
    .slip_mm = 0.1, .slip_s = 300.0, .further_slips = {{520.0, 0.06}, {700.0, 0.08}}, .seed = 3};

TEST(SeveralSlips, AreFoundWithTheirTimesAndSizes) {
  const Diagnosis d = diagnose_bench(kThree);
  EXPECT_EQ(d.verdict, Verdict::kMissingPhysics);
  ASSERT_EQ(d.missing.size(), 1U);
  ASSERT_EQ(d.missing[0].effect->name, "grip_slip");
  EXPECT_GT(d.missing[0].probability, 0.9);
  const std::vector<Slip> slips = slips_of(d.missing[0]);
  ASSERT_EQ(slips.size(), 3U);
  const double times_s[] = {300.0, 520.0, 700.0}, sizes_mm[] = {0.1, 0.06, 0.08};
  for (std::size_t i = 0; i < 3; ++i) {
    // Readings in the holds come five times a second.
    EXPECT_NEAR(slips[i].time_s, times_s[i], 0.3);
    // Twice the half width of the 95 % interval is four standard deviations.
    EXPECT_NEAR(slips[i].slip_mm, sizes_mm[i], slips[i].high_mm - slips[i].low_mm);
    EXPECT_LT(slips[i].high_mm - slips[i].low_mm, 0.01);
  }
  EXPECT_LT(d.model_errors.train_rmse_N, 1.1 * d.noise_N);
}

TEST(SeveralSlips, AreWrittenUnderNamesOfTheirOwn) {
  const Diagnosis d = diagnose_bench(kThree);
  ASSERT_EQ(d.missing.size(), 1U);
  std::set<std::string> keys;
  for (const NamedValue& value : d.missing[0].parameters) keys.insert(value.key());
  EXPECT_EQ(keys, (std::set<std::string>{"time_s", "slip_mm", "time_s_2", "slip_mm_2", "time_s_3", "slip_mm_3"}));
  EXPECT_EQ(std::ranges::count(d.missing[0].formula, ';'), 2) << d.missing[0].formula;
  EXPECT_EQ(std::ranges::count_if(d.model.parts, [](const auto& part) { return part.physics->name == "grip_slip"; }),
            3);
}

TEST(SeveralSlips, LeaveAnotherEffectItsShare) {
  test::ConcealedSpecimen bench = kThree;
  bench.softening_N_mm = 0.15;
  const Diagnosis d = diagnose_bench(bench);
  const MissingEffect* slip = named(d, "grip_slip");
  ASSERT_NE(slip, nullptr);
  EXPECT_NE(named(d, "cyclic_softening"), nullptr);
  EXPECT_EQ(slips_of(*slip).size(), 3U);
}

TEST(CreepingSlip, IsFoundWithItsTimeConstant) {
  const double half_life_s = 5.0;
  const Diagnosis d = diagnose_bench({.slip_mm = 0.1, .slip_s = 300.0, .slip_creep_s = half_life_s, .seed = 8});
  ASSERT_EQ(d.missing.size(), 1U);
  ASSERT_EQ(d.missing[0].effect->name, "grip_slip");
  EXPECT_EQ(d.missing[0].law, "creep");
  EXPECT_GT(d.missing[0].probability, 0.9);
  for (const NamedValue& value : d.missing[0].parameters) {
    const double truth = value.name == "slip_mm"           ? 0.1
                         : value.name == "time_constant_s" ? half_life_s / std::numbers::ln2
                                                           : 300.0;
    // Twice the half width of the 95 % interval is four standard deviations; readings in a hold come every 0.2 s.
    EXPECT_NEAR(value.value, truth, value.high - value.low + (value.name == "time_s" ? 0.2 : 0.0)) << value.name;
    EXPECT_LT(value.high - value.low, value.name == "time_s" ? 2.0 : 0.2 * truth) << value.name;
  }
}

TEST(CreepingSlip, IsNotSeenInASuddenOne) {
  const Diagnosis d = diagnose_bench({.slip_mm = 0.1, .slip_s = 300.0, .seed = 9});
  ASSERT_EQ(d.missing.size(), 1U);
  EXPECT_EQ(d.missing[0].law, "event");
}

TEST(CreepingSlip, StandsBesideASuddenOne) {
  const Diagnosis d = diagnose_bench(
      {.slip_mm = 0.1, .slip_s = 300.0, .slip_creep_s = 5.0, .further_slips = {{520.0, 0.08}}, .seed = 10});
  ASSERT_EQ(d.missing.size(), 1U);
  ASSERT_EQ(d.missing[0].effect->name, "grip_slip");
  const std::vector<Slip> slips = slips_of(d.missing[0]);
  ASSERT_EQ(slips.size(), 2U) << d.missing[0].formula;
  EXPECT_NEAR(slips[0].slip_mm, 0.1, slips[0].high_mm - slips[0].low_mm);
  EXPECT_NEAR(slips[1].slip_mm, 0.08, slips[1].high_mm - slips[1].low_mm);
  EXPECT_NEAR(slips[1].time_s, 520.0, 0.3);
  EXPECT_EQ(d.missing[0].law, "event + creep");
  for (const NamedValue& value : d.missing[0].parameters) {
    EXPECT_NE(model::sheet_of(*value.law, value.name), nullptr) << value.key();
    EXPECT_EQ(value.law->name, value.part == 1 ? "event" : "creep") << value.key();
  }
  std::multiset<std::string> laws;
  for (const auto& part : d.model.parts)
    if (part.physics->name == "grip_slip") laws.insert(std::string(part.law->name));
  EXPECT_EQ(laws, (std::multiset<std::string>{"creep", "event"}));
}

/// An afterslip of 80 um for each e-fold of (1 + t / 1 s), in steps of a tenth: no law writes it, several events
/// describe it. Those of its tail creep for long; no model is handed out with a number at the end of its range.
TEST(CreepingSlip, AnAfterslipByTheLogarithmIsModelled) {
  test::ConcealedSpecimen bench{.slip_mm = 0.008, .slip_s = 300.0, .seed = 11};
  for (int i = 1; i < 69; ++i) bench.further_slips.push_back({300.0 + std::expm1(0.1 * i), 0.008});
  const Diagnosis d = diagnose_bench(bench);
  ASSERT_NE(named(d, "grip_slip"), nullptr);
  EXPECT_GT(named(d, "grip_slip")->probability, 0.9);
  EXPECT_TRUE(std::ranges::any_of(d.model.parts, [](const auto& part) { return part.physics->name == "grip_slip"; }));
  EXPECT_LT(d.model_errors.train_rmse_N, 0.1 * d.nominal_errors.train_rmse_N);
}

TEST(SeveralSlips, AreNotTakenForWhatFallsGradually) {
  for (const test::ConcealedSpecimen& bench :
       {test::ConcealedSpecimen{.softening_N_mm = 0.15, .seed = 4},
        test::ConcealedSpecimen{.mullins_N_mm = 0.3, .seed = 5}, test::ConcealedSpecimen{.drift_N_h = -2.0, .seed = 6},
        test::ConcealedSpecimen{.set_N_mm = 0.05, .seed = 7}}) {
    const Diagnosis d = diagnose_bench(bench);
    EXPECT_EQ(named(d, "grip_slip"), nullptr) << "seed " << bench.seed;
  }
}

/// Nothing tells a slip in the first stroke from the state that friction began in; one later is a slip.
TEST(Slips, BesideFrictionOneInTheFirstStrokeIsDoubted) {
  for (const bool first : {true, false}) {
    const messages::Recording recording =
        test::record({.friction_N = 0.8, .slip_mm = 0.3, .slip_s = first ? 60.0 : 400.0, .seed = 31});
    DiagnosisOptions options;
    options.threads = 2;
    const Diagnosis d = diagnose({recording}, {"bench"}, model::nominal_model("slse1"), options).diagnosis;
    const auto slip = std::ranges::find(d.missing, "grip_slip", [](const MissingEffect& m) { return m.effect->name; });
    ASSERT_NE(slip, d.missing.end()) << first;
    const bool said = std::ranges::any_of(d.notes, [](const std::string& note) {
      return note.find("lies before the motion turns round for the first time") != std::string::npos;
    });
    EXPECT_EQ(said, first);
    EXPECT_EQ(slip->probability > 0.5, !first) << slip->probability;
  }
}

}  // namespace
}  // namespace isorig::identify
