// What people are told in place of the catalogue's names.
#include "model/words.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "model/catalogue.hpp"

namespace isorig::model {
namespace {

TEST(Words, EveryNumberOfTheCatalogueHasANameWithoutItsUnit) {
  const auto check = [](std::string_view of, std::string_view name, std::string_view unit) {
    const std::string words = number_words(name, unit);
    EXPECT_THAT(words, ::testing::Not(::testing::HasSubstr("_")));
    EXPECT_FALSE(words.empty());
    if (unit == "1") return;
    // A unit in the sheet is the one in the name: what is left is shorter.
    EXPECT_LT(words.size(), name.size()) << of << " has " << name << " in " << unit;
    EXPECT_EQ(number_words(std::string(name) + "_2", unit), words + " 2");
  };
  for (const auto list : {elements(), effects()})
    for (const Physics* physics : list)
      for (const Law& law : physics->laws) {
        if (is_empirical(*physics)) continue;
        for (const Parameter& p : law.parameters)
          if (!p.fixed) check(physics->name, p.name, p.sheet.unit);
        for (const Coefficient& c : law.coefficients) check(physics->name, c.name, c.sheet.unit);
      }
}

TEST(Words, ASentenceIsReadWithoutIdentifiers) {
  EXPECT_EQ(in_words("If coulomb_friction+slack is true, force_lag is not."),
            "If dry friction and slack is true, " + effect_words("force_lag") + " is not.");
  EXPECT_EQ(in_words("force_N of coulomb_friction stands at the end of its range (0.5 N)"),
            "force of dry friction stands at the end of its range (0.5 N)");
  // Words, numbers, files and what the catalogue does not know stay as they are.
  for (const char* text : {"a constant mass on a spring, 1e+3 and 2+3", "see model.toml and next_experiment.toml",
                           "cell_of_somebody+slack", "", "a + b, _"})
    EXPECT_EQ(in_words(text), text);
  EXPECT_EQ(unit_words("N/mm2"), "N/mm²");
  EXPECT_EQ(unit_words("1"), "");
}

}  // namespace
}  // namespace isorig::model
