// What the page of a diagnosis shows beyond what the diagnosis itself says: the shape of an effect with its band, and
// names that people use.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cctype>
#include <cmath>

#include "concealed_specimen.hpp"
#include "identify/diagnosis_report/lead.hpp"
#include "identify/diagnosis_report/simulated_force.hpp"
#include "model/catalogue.hpp"
#include "model/number_sheet.hpp"
#include "model/words.hpp"

namespace isorig::identify {
namespace {

/// slse1 with a bristle of 0.5 N and 0.03 mm beside it.
Diagnosis with_friction() {
  Diagnosis d;
  d.nominal = model::nominal_model("slse1");
  d.model = d.nominal;
  const model::Physics* friction = model::find_physics("coulomb_friction");
  model::Part part = model::make_part(*friction, *model::find_law(*friction, "dahl"));
  for (std::size_t i = 0; i < part.law->parameters.size(); ++i)
    if (part.law->parameters[i].name == "presliding_mm") part.parameters[i] = 0.03;
  for (std::size_t i = 0; i < part.law->coefficients.size(); ++i)
    if (part.law->coefficients[i].name == "force_N") part.coefficients[i] = 0.5;
  d.model.parts.push_back(part);
  return d;
}

const Series& recorded() {
  static const Series series = prepare_series("one", test::record({}), {});
  return series;
}

TEST(DiagnosisReport, TheShapeOfAnEffectIsItsForceAndItsBandThatOfItsNumbers) {
  const Diagnosis d = with_friction();
  const Series& series = recorded();
  const Contribution c = contribution(series, d, d.model.parts.size() - 1, {{"force_N", 0.5, 0.4, 0.65}});
  ASSERT_EQ(c.force_N.size(), series.excitation.instants.size());
  double most = 0.0;
  for (std::size_t k = 0; k < c.force_N.size(); ++k) {
    most = std::max(most, std::abs(c.force_N[k]));
    // A coefficient: the force goes with it, and the farther end of the interval counts. (0.65 - 0.5) / 0.5.
    EXPECT_NEAR(c.half_band_N[k], 0.3 * std::abs(c.force_N[k]), 1e-9) << k;
  }
  // Strokes of millimetres slide the bristle of 0.03 mm fully: 1 - exp(-2 mm / 0.03 mm).
  EXPECT_NEAR(most, 0.5, 1e-6);
}

TEST(DiagnosisReport, TwoNumbersAddInSquaresAndOnesOutOfRangeAreLeftOut) {
  const Diagnosis d = with_friction();
  const Series& series = recorded();
  const std::size_t part = d.model.parts.size() - 1;
  const NamedValue force{"force_N", 0.5, 0.4, 0.6}, sliding{"presliding_mm", 0.03, 0.02, 0.045};
  const NamedValue open{"presliding_mm", 0.03, -INFINITY, 50.0};  // no interval that the law could stand on
  const auto one = contribution(series, d, part, {force}), other = contribution(series, d, part, {sliding}),
             both = contribution(series, d, part, {force, sliding}), none = contribution(series, d, part, {open});
  double widest = 0.0;
  for (std::size_t k = 0; k < one.force_N.size(); ++k) {
    EXPECT_NEAR(both.half_band_N[k], std::hypot(one.half_band_N[k], other.half_band_N[k]), 1e-12);
    EXPECT_EQ(none.half_band_N[k], 0.0);
    widest = std::max(widest, other.half_band_N[k]);
  }
  EXPECT_GT(widest, 0.01) << "right after a turn the presliding distance matters";
}

TEST(DiagnosisReport, BothModelsAreSimulatedWhereReadingsMayBeBelieved) {
  const Diagnosis d = with_friction();
  const Series& series = recorded();
  std::vector<bool> usable(series.recording.frame.size(), true);
  usable[10] = usable[11] = false;
  const SimulatedForce f = simulate(series, usable, d);
  EXPECT_EQ(f.t_s.size(), usable.size() - 2);
  EXPECT_EQ(f.force_N[9], series.recording.frame.force_N[9]);
  EXPECT_EQ(f.force_N[10], series.recording.frame.force_N[12]);
  const auto c = contribution(series, d, d.model.parts.size() - 1, {});
  const auto before = f.nominal_residual_N(), after = f.model_residual_N();
  for (const std::size_t k : {0UL, 500UL, before.size() - 1}) {
    const std::size_t row = k < 10 ? k : k + 2;
    EXPECT_NEAR(before[k] - after[k], c.force_N[row], 1e-9);
  }
  const auto part = f.between(f.t_s[100], f.t_s[200]);
  EXPECT_EQ(part.t_s.size(), 101U);
}

TEST(DiagnosisReport, APathIsOfMeansInTheOrderOfTime) {
  std::vector<double> t, x, y;
  for (int i = 0; i < 10000; ++i) {
    t.push_back(0.001 * i);
    x.push_back(std::sin(0.001 * i));
    y.push_back(i % 2 == 0 ? 1.0 : -1.0);
  }
  const auto line = path(t, x, y, "loop", 3, 100);
  EXPECT_LE(line.x.size(), 101U);
  EXPECT_FALSE(std::is_sorted(line.x.begin(), line.x.end())) << "there and back";
  // A hundred readings of +-1 in each stretch, one more or less at its ends.
  for (std::size_t i = 0; i + 1 < line.y.size(); ++i) EXPECT_NEAR(line.y[i], 0.0, 0.02);
}

class Lead : public testing::Test {
 protected:
  Lead() {
    d_.noise_source = NoiseSource::kRests;
    d_.noise_N = 0.01;
    d_.nominal_errors.train_rmse_N = 0.5;
    d_.model_errors.train_rmse_N = 0.02;
    d_.unexplained = 0.03;
  }
  void add(std::string_view effect, double probability) {
    MissingEffect& one = d_.missing.emplace_back();
    one.effect = model::find_physics(effect);
    one.probability = probability;
  }
  Diagnosis d_;
};

TEST_F(Lead, ANameThatIsLikelierThanNotIsLackingAndAnotherOnePerhaps) {
  d_.verdict = Verdict::kMissingPhysics;
  add("coulomb_friction", 0.93);
  add("force_lag", 0.31);
  EXPECT_EQ(
      lead_text(d_, "Here. "),
      "The model lacks dry friction; perhaps a force reading that lags (0.31) as well. Here. The residual of the "
      "nominal model is 0.5 N rms, with what it lacks 0.02 N; the force channel's own noise is 0.01 N. 3 % of what "
      "the nominal model misses stays unexplained.");
  d_.missing.front().probability = 0.45;
  d_.model_share = 0.9;
  EXPECT_THAT(lead_text(d_, ""), testing::HasSubstr("0.5 N rms, with 90 % of what it lacks 0.02 N; "));
  d_.model_share = 1.0;
  EXPECT_THAT(lead_text(d_, ""),
              testing::StartsWith("The model lacks something, and no name for it is likelier than not; "
                                  "the nearest is dry friction (0.45) and a force reading that lags"));
}

TEST_F(Lead, UnknownPhysicsLacksNoNameThatIsNotLikelier) {
  d_.verdict = Verdict::kUnknownPhysics;
  add("slack", 0.21);
  d_.not_modelled.why = "it predicts worse";
  d_.model_errors = d_.nominal_errors;
  d_.unexplained = 1.33;
  EXPECT_EQ(
      lead_text(d_, ""),
      "Something is left that no effect of the catalogue explains; the nearest is slack (0.21). The residual of the "
      "nominal model is 0.5 N rms, and nothing of what it lacks is modelled; the force channel's own noise is 0.01 "
      "N. Nothing of what the nominal model misses is explained.");
  d_.missing.front().probability = 0.8;
  EXPECT_THAT(lead_text(d_, ""),
              testing::StartsWith("The model lacks slack, and something that the catalogue does not know. "));
}

TEST(DiagnosisReport, EveryEffectHasANameThatPeopleUse) {
  for (const model::Physics* effect : model::effects()) {
    const std::string words = model::effect_words(effect->name);
    EXPECT_THAT(words, ::testing::Not(::testing::HasSubstr("_")));
    std::string spaced(effect->name);
    std::ranges::replace(spaced, '_', ' ');
    const bool already_one = effect->name == "slack" || effect->name == "permanent_set" ||
                             effect->name == "viscous_drag" || effect->name == "quasi_linear_viscoelasticity";
    if (already_one) continue;
    EXPECT_NE(words, spaced) << "say in the `words` of its traits what people call it";
  }
  EXPECT_EQ(model::explanation_words("nominal"), "nothing missing");
  EXPECT_EQ(model::explanation_words("coulomb_friction"), "dry friction");
  EXPECT_EQ(model::explanation_words("coulomb_friction+slack"), "dry friction and slack");
  EXPECT_EQ(model::explanation_words("coulomb_friction+slack+table of position"),
            "dry friction, slack and table of position");
}

TEST(DiagnosisReport, EveryNumberOfAnEffectHasWordsForASentence) {
  for (const model::Physics* effect : model::effects())
    for (const model::Law& law : effect->laws) {
      std::vector<std::string_view> names;
      for (const auto& p : law.parameters) names.push_back(p.name);
      for (const auto& c : law.coefficients) names.push_back(c.name);
      for (const std::string_view name : names) {
        SCOPED_TRACE(std::string(effect->name) + "." + std::string(name));
        const auto* sheet = model::sheet_of(law, name);
        ASSERT_NE(sheet, nullptr);
        const std::string words = model::meaning_of(sheet);
        EXPECT_GE(words.size(), 8u);
        EXPECT_FALSE(std::isupper(static_cast<unsigned char>(words.at(0)))) << words;
        EXPECT_THAT(words, ::testing::Not(::testing::AnyOf(::testing::HasSubstr("_"), ::testing::EndsWith("."),
                                                           ::testing::HasSubstr(";"))));
        EXPECT_NE(model::unit_behind(sheet), " 1");
      }
      EXPECT_EQ(model::sheet_of(law, "no_such_number"), nullptr);
    }
  EXPECT_EQ(model::meaning_of(nullptr), "");
  EXPECT_EQ(model::unit_behind(nullptr), "");
}

}  // namespace
}  // namespace isorig::identify
