#include <gtest/gtest.h>

#include <algorithm>
#include <string>
#include <vector>

#include "identify/diagnose/diagnosis.hpp"
#include "model/composed.hpp"
#include "proof/foreign_laws/case.hpp"

namespace isorig::proof::foreign {
namespace {

// The laws of the catalogue leave 26 noises squared a row at best here. The likeliest pair (softening and inertia,
// under the noise of its own residual) leaves nine times the squares of the right one.
TEST(ForeignDiagnosis, ATripleIsNamedWholeWhoseLikeliestPairLeavesMost) {
  const Case drawn =
      draw_case(20261127, 37, {Category::kTriple, Trap::kNone, {"log_normal", "sprung_mass", "thermostat"}, 1.0});
  std::vector recordings{record(drawn, Part::kTrain, 20261127).recording};
  const identify::Diagnosis diagnosis =
      identify::diagnose(std::move(recordings), {"train"}, model::nominal_model(drawn.nominal), {}).diagnosis;
  std::vector<std::string> named;
  for (const identify::MissingEffect& missing : diagnosis.missing) {
    named.emplace_back(missing.effect->name);
    EXPECT_GT(missing.probability, 0.85) << missing.effect->name;
  }
  std::ranges::sort(named);
  EXPECT_EQ(named, (std::vector<std::string>{"fixture_inertia", "second_relaxation", "zero_drift"}));
}

// Heat that diffuses into the load cell is neither a line nor an exponential of time, but nearly the sum of both.
TEST(ForeignDiagnosis, ADriftOfAnotherFormulaIsOneName) {
  const Case drawn = draw_case(20261131, 43, {Category::kSingle, Trap::kNone, {"diffusing_heat"}, 0.5});
  std::vector recordings{record(drawn, Part::kTrain, 20261131).recording};
  const identify::Diagnosis diagnosis =
      identify::diagnose(std::move(recordings), {"train"}, model::nominal_model(drawn.nominal), {}).diagnosis;
  ASSERT_EQ(diagnosis.missing.size(), 1U)
      << diagnosis.missing.front().formula << ", " << diagnosis.missing.back().formula;
  EXPECT_EQ(diagnosis.missing[0].effect->name, "zero_drift");
  EXPECT_GT(diagnosis.missing[0].probability, 0.9);
}

}  // namespace
}  // namespace isorig::proof::foreign
