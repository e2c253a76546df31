#include "identify/diagnose/verdict.hpp"

#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "identify/diagnose/diagnosis_notes.hpp"
#include "model/catalogue.hpp"
#include "model/words.hpp"

namespace isorig::identify {
namespace {

/// A case a line, on both sides of every limit. 3000 rows: a fifth is 600; two standard deviations of the sum of 3000
/// squares of unit noise are 155.
TEST(Verdict, ChangesAtEachOfItsLimits) {
  struct Case {
    const char* what;
    Explained explained;
    double unexplained;
    Verdict verdict;
  };
  constexpr auto kConsistent = Verdict::kConsistent, kMissing = Verdict::kMissingPhysics,
                 kUnknown = Verdict::kUnknownPhysics, kCannotJudge = Verdict::kCannotJudge;
  const std::vector<Case> cases{
      {"noise alone", {.excess_before = 0.0, .excess_left = 0.0, .rows = 3000}, 0.0, kConsistent},
      {"less than noise", {.excess_before = -50.0, .excess_left = -50.0, .rows = 3000}, 0.0, kConsistent},
      {"all explained",
       {.excess_before = 1e5, .excess_left = 0.0, .rows = 3000, .has_named_effect = true},
       0.0,
       kMissing},
      {"12 % left",
       {.excess_before = 1e4, .excess_left = 1200.0, .rows = 3000, .has_named_effect = true},
       0.12,
       kMissing},
      {"more than 12 % left",
       {.excess_before = 1e4, .excess_left = 1201.0, .rows = 3000, .has_named_effect = true},
       0.1201,
       kUnknown},
      {"nothing named, structure", {.excess_before = 1e5, .excess_left = 601.0, .rows = 3000}, 0.00601, kUnknown},
      {"nothing named, a fifth of the rows",
       {.excess_before = 1e5, .excess_left = 600.0, .rows = 3000},
       0.006,
       kConsistent},
      {"few rows, 400 squares", {.excess_before = 400.0, .excess_left = 400.0, .rows = 100}, 1.0, kConsistent},
      {"few rows, more", {.excess_before = 401.0, .excess_left = 401.0, .rows = 100}, 1.0, kUnknown},
      {"named, much left of little",
       {.excess_before = 1000.0, .excess_left = 500.0, .rows = 3000, .has_named_effect = true},
       0.5,
       kMissing},
      {"nothing named, structure that may be noise",
       {.excess_before = 1e5, .excess_left = 601.0, .rows = 3000, .is_noise_for_all_that_rests_say = true},
       0.00601,
       kCannotJudge},
      {"nothing named, less than structure",
       {.excess_before = 1e5, .excess_left = 600.0, .rows = 3000, .is_noise_for_all_that_rests_say = true},
       0.006,
       kConsistent},
      {"named, what is left may be noise",
       {.excess_before = 1e4,
        .excess_left = 1201.0,
        .rows = 3000,
        .has_named_effect = true,
        .is_noise_for_all_that_rests_say = true},
       0.1201,
       kUnknown},
      {"described by a table",
       {.excess_before = 1e5, .excess_left = 0.0, .rows = 3000, .has_named_effect = true, .is_described = true},
       0.0,
       kUnknown},
  };
  for (const Case& each : cases) {
    EXPECT_NEAR(unexplained_share(each.explained), each.unexplained, 1e-12) << each.what;
    EXPECT_EQ(verdict_of(each.explained), each.verdict) << each.what;
  }
}

TEST(Verdict, ALevelThatIsNotFromRestsAllowsForChance) {
  Explained explained{.excess_before = 1e4, .excess_left = 1300.0, .rows = 3000, .has_named_effect = true};
  EXPECT_EQ(verdict_of(explained), Verdict::kUnknownPhysics);
  explained.noise_from_rests = false;
  EXPECT_NEAR(unexplained_share(explained), (1300.0 - 154.919333848) / 1e4, 1e-9);
  EXPECT_EQ(verdict_of(explained), Verdict::kMissingPhysics);
  explained.excess_left = 100.0;
  EXPECT_EQ(unexplained_share(explained), 0.0);
}

TEST(Notes, ANameThatItsSubstituteLimitsIsSaidWithIt) {
  Diagnosis d;
  d.missing.resize(2);
  d.missing[0].effect = model::find_physics("permanent_set");
  d.missing[0].weight = 0.54;
  d.missing[0].substitute = model::find_physics("mullins_softening");
  d.missing[1].effect = model::find_physics("force_lag");
  Fit nominal;
  nominal.stop = Stop::kConverged;
  add_notes({}, nominal, d);
  ASSERT_EQ(d.notes.size(), 1U);
  EXPECT_NE(d.notes[0].find(model::effect_words("mullins_softening") + " in the place of " +
                            model::effect_words("permanent_set")),
            std::string::npos)
      << d.notes[0];
  EXPECT_NE(d.notes[0].find("0.54"), std::string::npos) << d.notes[0];
}

}  // namespace
}  // namespace isorig::identify
