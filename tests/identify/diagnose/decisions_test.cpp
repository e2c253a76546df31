// What decides which effects are named: weighing, the discount of small effects, simpler laws, degrees of freedom,
// tables. Each with a truth that was put in.
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <random>

#include "concealed_specimen.hpp"
#include "identify/diagnose/fit/many_starts.hpp"
#include "identify/diagnose/noise/effective_dof.hpp"
#include "identify/diagnose/noise/noise.hpp"
#include "identify/diagnose/search/calibration.hpp"
#include "identify/diagnose/search/empirical.hpp"
#include "identify/diagnose/search/events.hpp"
#include "identify/diagnose/search/parsimony.hpp"
#include "identify/diagnose/search/physical_size.hpp"
#include "identify/diagnose/search/practical_significance.hpp"
#include "identify/diagnose/search/repeated_evidence.hpp"
#include "identify/diagnose/search/resolution.hpp"
#include "identify/diagnose/search/select.hpp"
#include "identify/diagnose/search/substitutes.hpp"
#include "identify/diagnose/search/without_effect.hpp"
#include "model/catalogue.hpp"

namespace isorig::identify {
namespace {

using test::ConcealedSpecimen;

const model::Physics& effect(std::string_view name) {
  return *model::find_physics(name);
}

/// One recording of the bench, its noise and a search in it.
struct Searched {
  explicit Searched(messages::Recording recording)
      : series{prepare_series("bench", std::move(recording), {})},
        search(series, instrument_noise(series, {}).weighing, 2) {}

  /// The nominal model and these laws beside it, fitted.
  [[nodiscard]] Hypothesis with(std::initializer_list<std::pair<std::string_view, std::string_view>> laws) const {
    Hypothesis out;
    out.fit.spec = model::nominal_model("slse1");
    for (const auto& [name, law] : laws) {
      out.effects.push_back(&effect(name));
      out.fit.spec.parts.push_back(model::make_part(effect(name), *model::find_law(effect(name), law)));
    }
    out.fit = search.fit_from(out.fit.spec, 30);
    search.settle(out, false);
    return out;
  }

  std::vector<Series> series;
  Search search;
};

// --- settle ----------------------------------------------------------------------------------------------------

/// A fit that stopped far from its optimum, which the fits under the noise of its residual then find: its squares are
/// those of the optimum, since explanations are compared by them.
TEST(Settle, ComparesByTheSquaresOfTheBetterOfTwoPlaces) {
  const Searched s(test::record(ConcealedSpecimen{}));
  Hypothesis stopped;
  model::ModelSpec spec = model::nominal_model("slse1");
  for (model::Part& part : spec.parts)
    if (part.physics->name == "maxwell") part.parameters[0] = 60.0;  // s; 0.8 s is concealed
  stopped.fit = s.search.fit_from(spec, 0);
  const double far = stopped.fit.chi2, near = s.search.fit_from(spec, 30).chi2;
  ASSERT_GT(far, 2.0 * near) << "the start is no poor place";
  s.search.settle(stopped, false);
  EXPECT_LT(stopped.ls_chi2, 1.01 * near);
  // What is compared is what these numbers leave.
  EXPECT_NEAR(squares_of(s.search.instrument_problem(), stopped.ls_spec), stopped.ls_chi2, 1e-6 * stopped.ls_chi2);
}

// --- count_arms --------------------------------------------------------------------------------------------------

/// slse1 has one arm. A law in its place and a linear arm beside it: the linear arm is the nominal model's, and what is
/// left when the law goes is that model. With one linear arm more a relaxation is missing, too.
TEST(CountArms, AsManyLinearArmsAsTheNominalModelHasAreItsOwn) {
  const Searched on(test::record({.second_arm_N_mm = 1.2, .second_arm_s = 6.0, .power = 1.8}));
  const Hypothesis nominal = on.search.nominal(model::nominal_model("slse1"));
  const auto &viscosity = effect("nonlinear_viscosity"), &relaxation = effect("second_relaxation");
  const auto arms = [](const model::ModelSpec& spec) {
    return std::ranges::count(spec.parts, std::string_view("maxwell"),
                              [](const model::Part& part) { return part.physics->name; });
  };
  Hypothesis both = nominal;
  std::erase_if(both.fit.spec.parts, [](const model::Part& part) { return part.physics->name == "maxwell"; });
  for (const auto& [physics, law] : {std::pair{&viscosity, "power_arm"}, std::pair{&relaxation, "arm"}}) {
    both.effects.push_back(physics);
    both.fit.spec.parts.push_back(model::make_part(*physics, *model::find_law(*physics, law)));
  }
  sort_as_in_catalogue(both.effects);
  both.fit = on.search.fit_from(both.fit.spec, 30);
  on.search.settle(both, false);
  Hypothesis more = both, unknown = both;
  count_arms(both);
  EXPECT_EQ(both.key(), "nonlinear_viscosity");
  for (const auto& [spec, before] : {std::pair{both.fit.spec, more.fit.spec}, {both.ls_spec, more.ls_spec}}) {
    EXPECT_EQ(arms(spec), 1);
    EXPECT_FALSE(spec.has("second_relaxation"));
    const double squares = squares_of(on.search.instrument_problem(), before);
    EXPECT_NEAR(squares_of(on.search.instrument_problem(), spec), squares, 1e-6 * squares);
  }
  EXPECT_EQ(on.search.without(both, viscosity).key(), "nominal");
  EXPECT_EQ(arms(on.search.without(both, viscosity).fit.spec), 1);
  // In the place of the arm, it is restored.
  const Hypothesis in_place = on.search.without(more, relaxation);
  ASSERT_EQ(arms(in_place.fit.spec), 0);
  EXPECT_EQ(arms(on.search.without(in_place, viscosity).fit.spec), 1);

  more.fit.spec.parts.push_back(model::make_part(*nominal.fit.spec.parts[1].physics, *nominal.fit.spec.parts[1].law));
  ASSERT_EQ(arms(more.fit.spec), 1);
  count_arms(more);
  EXPECT_EQ(more.key(), "second_relaxation+nonlinear_viscosity");
  unknown.nominal_arms.reset();
  count_arms(unknown);
  EXPECT_EQ(unknown.key(), "second_relaxation+nonlinear_viscosity");
}

// --- substitutes -----------------------------------------------------------------------------------------------

/// Eight further effects were tried beside the leader and none beside its rival: together they have 0.93 of the weight,
/// and the two sets that differ in one name are five to one.
TEST(Substitutes, WhatWasTriedBesideTheLeaderMakesItNoSurerThanTheComparison) {
  Selection s;
  const auto add = [&](std::vector<const model::Physics*> effects, double weight) {
    Hypothesis h;
    h.effects = std::move(effects);
    s.pool.push_back(std::move(h));
    s.weight.push_back(weight);
  };
  const auto &set = effect("permanent_set"), &softening = effect("mullins_softening"), &lag = effect("force_lag");
  add({}, 0.0);
  add({&set, &lag}, 0.35);
  add({&softening, &lag}, 0.07);
  for (const char* more : {"zero_drift", "grip_slip", "slack", "coulomb_friction", "fixture_inertia", "viscous_drag",
                           "force_delay", "second_relaxation"})
    add({&set, &lag, &effect(more)}, 0.58 / 8.0);
  s.best = 1;
  s.weighed = s.weight;
  count_weights(s);
  ASSERT_NEAR(s.probability.at(&set), 0.93, 1e-9);
  EXPECT_NEAR(best_substitute(s, set).share, 0.35 / 0.42, 1e-12);
  EXPECT_EQ(best_substitute(s, set).effect, &softening);
  // Discounted, all that was tried beside the leader is the leader's own weight.
  s.weight = {0.0, 0.93, 0.07};
  s.weight.resize(s.pool.size(), 0.0);
  EXPECT_NEAR(best_substitute(s, set).share, 0.35 / 0.42, 1e-12);
  EXPECT_EQ(best_substitute(s, lag).effect, nullptr) << "nothing was tried in its place";
}

/// A rival that the strokes disagree about, or that is too small, is none any more, though it was the likelier one.
TEST(Substitutes, WhatADiscountTookFromARivalDoesNotCountForIt) {
  Selection s;
  s.pool.resize(3);
  s.pool[1].effects = {&effect("permanent_set")};
  s.pool[2].effects = {&effect("zero_drift")};
  s.weighed = {0.0, 0.3, 0.7};
  s.weight = {0.699, 0.3, 0.001};
  s.best = 1;
  EXPECT_NEAR(best_substitute(s, effect("permanent_set")).share, 0.3 / 0.301, 1e-12);
}

/// The recordings prefer a set of three by nine nats, and two of the three were too small to count: how the remaining
/// one and its substitute compare where both leave much says nothing.
TEST(Substitutes, TheLargerSetThatHandedOverItsWeightIsCompared) {
  Selection s;
  s.pool.resize(5);
  const auto &slack = effect("slack"), &drift = effect("zero_drift"), &lag = effect("force_lag");
  s.pool[1].effects = {&slack};
  s.pool[2].effects = {&effect("cyclic_softening")};
  s.pool[3].effects = {&slack, &drift, &lag};
  s.pool[4].effects = {&effect("cyclic_softening"), &drift, &lag};
  s.weighed = {0.0, 1e-4, 9e-3, 0.8, 0.19};
  s.weight = {0.0, 0.8001, 9e-3, 0.0, 0.19};
  s.best = 1;
  EXPECT_NEAR(best_substitute(s, slack).share, 0.8 / 0.99, 1e-12);
  EXPECT_EQ(best_substitute(s, slack).effect, &effect("cyclic_softening"));
  // Preferred by less than an effect costs (3 nats): the chosen set stands for itself.
  s.weighed[1] = 0.05;
  EXPECT_NEAR(best_substitute(s, slack).share, 0.05 / 0.059, 1e-12);
}

/// A rival is the same explanation but for one name: no larger or smaller set, no other table.
TEST(Substitutes, AnotherNumberOfEffectsOrATableIsNoSubstitute) {
  Selection s;
  s.pool.resize(4);
  s.pool[1].effects = {&effect("permanent_set")};
  s.pool[2].effects = {&effect("mullins_softening"), &effect("force_lag")};
  s.pool[3].effects = {&effect("mullins_softening")};
  s.pool[3].empirical = "position";
  s.weight = s.weighed = {0.1, 0.4, 0.3, 0.2};
  s.best = 1;
  EXPECT_EQ(best_substitute(s, effect("permanent_set")).effect, nullptr);
  EXPECT_EQ(best_substitute(s, effect("permanent_set")).share, 1.0);
}

// --- weigh -----------------------------------------------------------------------------------------------------

/// Hypotheses of which only the numbers that are weighed are set: the noise is known, so that its scale is 1.
class Weigh : public testing::Test {
 protected:
  Weigh() : searched_(test::record_other({})) {
    options_.least_noise_scale = options_.most_noise_scale = 1.0;
    nominal_ = searched_.search.nominal(model::nominal_model("slse1"));
    rows_ = static_cast<double>(nominal_.fit.rows);
  }
  /// `excess`: squares beyond those of the noise.
  void add(std::initializer_list<std::string_view> names, double evidence, double excess) {
    Hypothesis h = nominal_;
    for (const auto name : names) h.effects.push_back(&effect(name));
    h.evidence = evidence;
    h.ls_chi2 = rows_ + excess;
    selection_.pool.push_back(std::move(h));
  }
  [[nodiscard]] double odds(std::size_t of, std::size_t against) const {
    return selection_.weight[of] / selection_.weight[against];
  }
  void weigh_all() { weigh(selection_, searched_.search, options_); }

  Searched searched_;
  SelectionOptions options_;
  Hypothesis nominal_;
  double rows_ = 0.0;
  Selection selection_;
};

TEST_F(Weigh, TheMilderOfLikelihoodAndVarianceDecidesAndAnEffectPaysItsPrior) {
  add({}, -100.0, 8.0);
  add({"force_lag"}, -96.0, 0.0);
  weigh_all();
  // Likelihood: 4. Variances with 12 degrees: 6 ln(1 + 8/40) = 1.09, the milder. Against it the prior of 3.
  EXPECT_NEAR(odds(1, 0), std::exp(6.0 * std::log(1.2) - 3.0), 1e-9);
  EXPECT_EQ(selection_.best, 0u);
  EXPECT_NEAR(selection_.weight[0] + selection_.weight[1], 1.0, 1e-12);
  EXPECT_DOUBLE_EQ(selection_.probability.at(&effect("force_lag")), selection_.weight[1]);

  selection_ = {};
  add({}, -100.0, 4000.0);
  add({"force_lag"}, -96.0, 0.0);
  weigh_all();
  // Now the likelihood is the milder: 4 - 3 = 1.
  EXPECT_NEAR(odds(1, 0), std::exp(1.0), 1e-9);
  EXPECT_EQ(selection_.best, 1u);
}

TEST_F(Weigh, WhereEvenTheBestLeavesMuchAHugeLikelihoodIsNoProof) {
  add({}, -9000.0, 90000.0);
  add({"force_lag"}, -1000.0, 10000.0);
  add({"force_delay"}, -1200.0, 10500.0);
  weigh_all();
  EXPECT_NEAR(odds(1, 2), std::exp(6.0 * std::log1p(500.0 / 10040.0)), 1e-6);
  EXPECT_GT(selection_.weight[2], 0.3) << "200 in log-likelihood, and still a rival";
  EXPECT_LT(selection_.weight[0], 1e-4);
}

TEST_F(Weigh, AnUnusualEffectCostsTwoMore) {
  ASSERT_TRUE(effect("viscous_drag").traits.unusual);
  ASSERT_FALSE(effect("force_lag").traits.unusual);
  add({}, -500.0, 3000.0);
  add({"force_lag"}, -100.0, 0.0);
  add({"viscous_drag"}, -100.0, 0.0);
  weigh_all();
  EXPECT_NEAR(odds(1, 2), std::exp(2.0), 1e-9);
}

// --- discount_insignificant_effects ------------------------------------------------------------------------------

/// Friction of 0.8 N, and a drift whose size decides: what it moves the force by against 8 % of the friction and two
/// noises.
double probability_of_drift(double drift_N_h) {
  const Searched on(test::record_other({.friction_N = 0.8, .drift_N_h = drift_N_h, .seed = 3}));
  Selection selection;
  selection.pool.push_back(on.search.nominal(model::nominal_model("slse1")));
  selection.pool.push_back(on.with({{"coulomb_friction", "dahl"}}));
  selection.pool.push_back(on.with({{"coulomb_friction", "dahl"}, {"zero_drift", "linear"}}));
  selection.weight = {0.0, 0.1, 0.9};
  selection.excess = {1e4, 0.0, 0.0};
  selection.best = 2;
  discount_insignificant_effects(selection, on.search, {});
  EXPECT_NEAR(selection.probability.at(&effect("coulomb_friction")), 1.0, 1e-9);
  return selection.probability.at(&effect("zero_drift"));
}

TEST(InsignificantEffects, AFaintDriftBesideFrictionIsDisbelievedAndALargeOneStays) {
  EXPECT_LT(probability_of_drift(0.2), 0.1);
  EXPECT_GT(probability_of_drift(15.0), 0.85);
}

TEST(InsignificantEffects, AForceIsMetByAnotherWhereBothStand) {
  Eigen::VectorXd everywhere = Eigen::VectorXd::Constant(400, -0.3), at_corners = Eigen::VectorXd::Zero(400);
  at_corners.head(4).setConstant(20.0);
  EXPECT_NEAR(meeting_share(everywhere, at_corners), 0.1, 1e-12) << "a hundredth of the bins";
  EXPECT_NEAR(meeting_share(0.1 * at_corners, at_corners), 1.0, 1e-12);
  EXPECT_NEAR(meeting_share(everywhere, everywhere), 1.0, 1e-12);
  // No more than all of it: a short force inside a long one.
  EXPECT_NEAR(meeting_share(at_corners, everywhere + at_corners), 1.0, 1e-12);
}

/// A mass pulls where the velocity changes. What its law errs by stands there and is no drift, though eight hundredths
/// of its largest pull are more than the drift.
TEST(InsignificantEffects, AMassThatPullsAtCornersDoubtsNoDrift) {
  const Searched on(test::record_other({.mass_kg = 20.0, .drift_N_h = 1.5, .seed = 12}));
  Selection selection;
  selection.pool.push_back(on.search.nominal(model::nominal_model("slse1")));
  selection.pool.push_back(on.with({{"fixture_inertia", "rigid"}}));
  selection.pool.push_back(on.with({{"fixture_inertia", "rigid"}, {"zero_drift", "linear"}}));
  selection.weight = {0.0, 0.1, 0.9};
  selection.excess = {1e4, 0.0, 0.0};
  selection.best = 2;
  ASSERT_LT(size_N(on.search, selection.pool[2], selection.pool[1]),
            SelectionOptions{}.model_error_share * size_N(on.search, selection.pool[2], selection.pool[0]));
  discount_insignificant_effects(selection, on.search, {});
  EXPECT_GT(selection.probability.at(&effect("zero_drift")), 0.8);
}

TEST(InsignificantEffects, SizeIsWhatTheForceChangesByWithoutTheEffect) {
  const Searched on(test::record_other({.drift_N_h = 20.0, .seed = 4}));
  const Hypothesis with = on.with({{"zero_drift", "linear"}}), without = on.with({});
  // The tare takes the mean of a drift: half of its range at both ends.
  const double range_N = 20.0 / 3600.0 * on.series[0].nodes.back().t_s;
  const double size = size_N(on.search, with, without);
  EXPECT_GT(size, 0.2 * range_N);
  EXPECT_LT(size, 0.8 * range_N);
  EXPECT_EQ(size_N(on.search, with, with), 0.0);
}

// A drift and a settling start take each other's place: beside the other each is small, and only one of them is too
// many.
TEST(InsignificantEffects, OfTwoThatStandInForEachOtherOneStays) {
  const Searched on(test::record_other({.friction_N = 0.8, .drift_N_h = 15.0, .seed = 8}));
  Selection selection;
  selection.pool.push_back(on.search.nominal(model::nominal_model("slse1")));
  selection.pool.push_back(
      on.with({{"coulomb_friction", "dahl"}, {"zero_drift", "linear"}, {"unsettled_start", "exponential"}}));
  selection.weight = {0.0, 1.0};
  selection.excess = {1e4, 0.0};
  selection.best = 1;
  discount_insignificant_effects(selection, on.search, {});
  EXPECT_EQ(selection.chosen().effects.size(), 2U) << selection.chosen().key();
  EXPECT_TRUE(selection.chosen().has(effect("coulomb_friction"))) << selection.chosen().key();
}

// --- discount_unrepeated_effects ---------------------------------------------------------------------------------

std::optional<double> agreement_on_drift(const test::ConcealedSpecimen& specimen) {
  const Searched on(test::record_other(specimen));
  const Hypothesis with = on.with({{"zero_drift", "linear"}});
  return agreement(on.search, with, on.with({}), with.fit.noise);
}

// z of one number that is not there is the size of a standard normal deviate: the mean of 24 squares is 1 with a
// standard deviation of sqrt(2 / 24), in white noise as in one that wanders for two seconds.
TEST(RepeatedEvidence, OfWhatIsNotThereIsAStandardNormalDeviateInNoiseOfAnyColour) {
  for (const double coloured_N : {0.0, 0.1}) {
    double squares = 0.0;
    constexpr unsigned kSeeds = 24;
    for (unsigned seed = 1; seed <= kSeeds; ++seed)
      squares += std::pow(agreement_on_drift({.coloured_N = coloured_N, .seed = seed}).value(), 2);
    const double sigma = std::sqrt(2.0 / kSeeds);
    EXPECT_NEAR(squares / kSeeds, 1.0, 3.0 * sigma) << coloured_N;
  }
}

// A drift of 0.5 N/h moves the force by a noise or so; the error of z is estimated from about ten strokes, hence the
// wide margin below the 12 to 16 that it comes to.
TEST(RepeatedEvidence, OfWhatIsThereIsLarge) {
  for (unsigned seed = 1; seed <= 3; ++seed)
    EXPECT_GT(agreement_on_drift({.drift_N_h = 0.5, .seed = seed}).value(), 6.0) << seed;
}

/// The weight that a drift keeps of 0.99 beside the nominal model.
double weight_kept(const test::ConcealedSpecimen& specimen) {
  const Searched on(test::record_other(specimen));
  Selection selection;
  selection.pool.push_back(on.search.nominal(model::nominal_model("slse1")));
  selection.pool.push_back(on.with({{"zero_drift", "linear"}}));
  selection.weight = {0.01, 0.99};
  selection.excess = {10.0, 0.0};
  selection.best = 1;
  count_weights(selection);
  discount_unrepeated_effects(selection, on.search, {});
  return selection.probability.at(&effect("zero_drift"));
}

TEST(RepeatedEvidence, TakesTheWeightOfAnEffectThatStrokesDoNotAgreeOnAndNoOther) {
  // exp(z^2 / 2 - 3) / n with z about 1 leaves less than one in a hundred.
  EXPECT_LT(weight_kept({.coloured_N = 0.1, .seed = 7}), 0.05);
  EXPECT_DOUBLE_EQ(weight_kept({.drift_N_h = 15.0, .seed = 7}), 0.99);
}

/// Friction beside a drift that nobody has in the model: what the drift leaves is no noise of the friction's. That a
/// larger set is known which leaves far less speaks for it, though that set is not the chosen one.
double friction_kept_beside_a_drift(bool larger_is_known) {
  const Searched on(test::record({.friction_N = 0.05, .drift_N_h = 15.0, .seed = 7}));
  Selection selection;
  selection.pool.push_back(on.search.nominal(model::nominal_model("slse1")));
  selection.pool.push_back(on.with({{"coulomb_friction", "dahl"}}));
  if (larger_is_known) selection.pool.push_back(on.with({{"coulomb_friction", "dahl"}, {"zero_drift", "linear"}}));
  selection.weight.assign(selection.pool.size(), 0.0);
  selection.weight[1] = 1.0;
  selection.excess.assign(selection.pool.size(), 0.0);
  selection.noise_scale = 1.0;
  count_weights(selection);
  discount_unrepeated_effects(selection, on.search, {});
  return selection.probability.at(&effect("coulomb_friction"));
}

TEST(RepeatedEvidence, IsLookedForInALargerSetThatLeavesFarLess) {
  EXPECT_LT(friction_kept_beside_a_drift(false), 0.5) << "the case is none: the strokes agree beside the drift";
  EXPECT_DOUBLE_EQ(friction_kept_beside_a_drift(true), 1.0);
}

// --- calibrated, stated_if_refused ---------------------------------------------------------------------------------
TEST(Calibrated, NoNameIsCertainAndLessSoBesideTheUnknown) {
  EXPECT_DOUBLE_EQ(calibrated(1.0, 0.0, false), 0.985);
  EXPECT_DOUBLE_EQ(calibrated(1.0, 0.0, true), 0.85);
  EXPECT_DOUBLE_EQ(calibrated(0.8, 0.25, false), 0.8 * 0.75 * 0.985);
  EXPECT_DOUBLE_EQ(calibrated(0.8, 0.9, false), 0.8 * 0.5 * 0.985);
}

TEST(Calibrated, ANameWhoseLawWasRefusedIsAtMostAsLikelyAsNot) {
  EXPECT_DOUBLE_EQ(stated_if_refused(0.976), 0.5);
  EXPECT_DOUBLE_EQ(stated_if_refused(0.3), 0.3);
}

// --- prefer_simpler_laws -----------------------------------------------------------------------------------------

const model::Law* law_after(const Searched& on, std::string_view name, std::string_view law) {
  Selection selection;
  selection.pool.push_back(on.search.nominal(model::nominal_model("slse1")));
  selection.pool.push_back(on.with({{name, law}}));
  selection.weight = {0.0, 1.0};
  selection.best = 1;
  prefer_simpler_laws(selection, on.search);
  for (const model::Part& part : selection.chosen().fit.spec.parts)
    if (part.physics == &effect(name)) return part.law;
  return nullptr;
}

TEST(RepeatedEvidence, AnEffectIsNotJudgedWhileAnotherRefinesIt) {
  const model::Physics& friction = *model::find_physics("coulomb_friction");
  const model::Physics& with_pressure = *model::find_physics("friction_with_pressure");
  Hypothesis both;
  both.effects = {&friction, &with_pressure};
  EXPECT_TRUE(is_refined(both, friction)) << "it would leave friction_with_pressure alone, which is another law";
  EXPECT_FALSE(is_refined(both, with_pressure));
  both.effects = {&friction};
  EXPECT_FALSE(is_refined(both, friction));
}

TEST(SimplerLaws, ACoefficientWhoseIntervalHoldsZeroGoes) {
  const Searched on(test::record_other({.quadratic_N_mm2 = 0.15, .seed = 5}));
  const model::Law* law = law_after(on, "strain_stiffening", "polynomial");
  ASSERT_NE(law, nullptr);
  EXPECT_EQ(law->name, "quadratic");
}

TEST(SimplerLaws, ACoefficientThatIsThereStays) {
  messages::Recording recording = test::record_other({.quadratic_N_mm2 = 0.15, .seed = 5});
  for (std::size_t k = 0; k < recording.frame.size(); ++k)
    recording.frame.force_N[k] += 0.1 * std::pow(recording.frame.position_mm[k], 3);
  const Searched on(std::move(recording));
  const model::Law* law = law_after(on, "strain_stiffening", "polynomial");
  ASSERT_NE(law, nullptr);
  EXPECT_EQ(law->name, "polynomial");
}

TEST(SimplerLaws, AWeakeningThatIsNotThereGoes) {
  const Searched on(test::record_other({.friction_N = 0.8, .presliding_mm = 0.05, .seed = 6}));
  const model::Law* law = law_after(on, "coulomb_friction", "stribeck");
  ASSERT_NE(law, nullptr);
  EXPECT_EQ(law->parameters.size(), 1u) << law->name;
}

/// A logarithmic creep, which no law of the catalogue writes. Under a noise that wanders as slowly as the creep, any
/// law of it is worth nothing: the time constant goes to its bound, and the law would give way to a straight line that
/// leaves 26,324 squares where it leaves 8,218.
TEST(SimplerLaws, ADriftThatOnlyLeastSquaresSeeKeepsItsLawAndItsNumbers) {
  messages::Recording recording = test::record({.force_noise_N = 0.005, .seed = 7});
  for (std::size_t k = 0; k < recording.frame.size(); ++k)
    recording.frame.force_N[k] += 0.02 * std::log1p(recording.frame.t_s[k] / 10.0);
  const Searched on(std::move(recording));
  Selection selection;
  selection.pool.push_back(on.search.nominal(model::nominal_model("slse1")));
  selection.pool.push_back(on.with({{"zero_drift", "settling"}}));
  selection.weight = {0.0, 1.0};
  selection.best = 1;
  const double least = selection.chosen().ls_chi2;
  prefer_simpler_laws(selection, on.search);
  const model::ModelSpec& published = selection.chosen().fit.spec;
  const auto drift = std::ranges::find(published.parts, &effect("zero_drift"), &model::Part::physics);
  ASSERT_NE(drift, published.parts.end());
  EXPECT_EQ(drift->law->name, "settling");
  EXPECT_LT(squares_of(on.search.instrument_problem(), published), 1.001 * least);
}

// --- effective_degrees_of_freedom ----------------------------------------------------------------------------------

/// `n` bins in one stroke, and a residual of given correlation from bin to bin.
double degrees(std::size_t n, double correlation) {
  Series series;
  series.excitation.width = 2;  // strokes are then counted in the bins
  for (std::size_t k = 0; k < n; ++k) {
    model::Instant now;
    now.t_s = 0.01 * static_cast<double>(k);
    now.dt_s = k > 0 ? 0.01 : 0.0;
    now.position_mm = 1e-3 * static_cast<double>(k);
    now.step_mm = now.slide_mm = k > 0 ? 1e-3 : 0.0;
    now.velocity_mm_s = 0.1;
    series.nodes.push_back(now);
  }
  series.count.assign(n, 1.0);
  series.force_N.assign(n, 0.0);
  series.since_corner_s.assign(n, 1.0);
  std::mt19937 random(9);
  std::normal_distribution<double> normal;
  Eigen::VectorXd residual(static_cast<Eigen::Index>(n));
  double state = normal(random);
  for (Eigen::Index k = 0; k < residual.size(); ++k) {
    residual[k] = state;
    state = correlation * state + std::sqrt(1.0 - correlation * correlation) * normal(random);
  }
  const std::vector<Series> one{series};
  return effective_degrees_of_freedom(one, residual);
}

TEST(DegreesOfFreedom, AreTheBinsOfWhiteNoiseAndFewerWhereBinsHangTogether) {
  constexpr double kBins = 8000.0;
  // White: Box's spread of blocks of 25 takes 1 / (1 + 2/25).
  EXPECT_NEAR(degrees(8000, 0.0), kBins / 1.08, 0.03 * kBins);
  // AR(1): the sum of squares has n (1 - r^2) / (1 + r^2) degrees; blocks that share an error take some more.
  const double expected = kBins * (1.0 - 0.81) / (1.0 + 0.81);
  EXPECT_LT(degrees(8000, 0.9), 1.1 * expected);
  EXPECT_GT(degrees(8000, 0.9), 0.4 * expected);
}

// --- describe_unknown ------------------------------------------------------------------------------------------------

TEST(Table, DescribesAForceOfThePositionThatNoEffectIs) {
  const Searched on(test::record_other({.ripple_N = 0.3, .ripple_mm = 0.6, .seed = 7}));
  const Hypothesis nominal = on.search.nominal(model::nominal_model("slse1"));
  const auto table = describe_unknown(on.search, nominal);
  ASSERT_TRUE(table.has_value());
  EXPECT_TRUE(table->empirical.starts_with("position")) << table->empirical;
  const auto rows = static_cast<double>(nominal.fit.rows);
  EXPECT_LT(table->ls_chi2 - rows, 0.1 * (nominal.ls_chi2 - rows));
  // The table itself: amplitude and period of what was put in.
  const model::Part& part = table->fit.spec.parts.back();
  ASSERT_FALSE(part.table.values.empty());
  if (part.physics->stage != model::Stage::kKinematics) {
    const double swing = part.table.at(0.15) - part.table.at(0.45);
    EXPECT_NEAR(swing, 0.6, 0.15);
  }
}

TEST(Table, IsNotMadeOfNoise) {
  const Searched on(test::record_other({.seed = 8}));
  EXPECT_FALSE(describe_unknown(on.search, on.search.nominal(model::nominal_model("slse1"))).has_value());
}

// --- may_be_tried ----------------------------------------------------------------------------------------------------

TEST(MayBeTried, TrappedGasNeedsALengthAndAGaugeThatStandsStill) {
  const Searched on(test::record({}));
  const Hypothesis nominal = on.search.nominal(model::nominal_model("slse1"));
  const auto tried = [&](const std::function<void(Excitation&)>& change) {
    std::vector<Series> series = on.series;
    change(series[0].excitation);
    return may_be_tried(effect("trapped_gas"), nominal, series);
  };
  EXPECT_TRUE(tried([](Excitation&) {}));
  EXPECT_FALSE(tried([](Excitation& e) { e.reference.rest_length_mm = 0.0; }));
  EXPECT_FALSE(tried([](Excitation& e) { e.pressure_psi.clear(); }));
  // A hundredth of 15 psi and an atmosphere is 0.297 psi.
  const auto moved = [](double psi) {
    return [=](Excitation& e) {
      std::ranges::fill(e.pressure_psi, 15.0);
      e.pressure_psi.back() -= psi;
    };
  };
  EXPECT_TRUE(tried(moved(0.29)));
  EXPECT_FALSE(tried(moved(0.30)));
}

// --- beyond_physical_size --------------------------------------------------------------------------------------------

TEST(PhysicalSize, AForceThatFollowsThePressureIsHeldAgainstTheLargestForceRead) {
  Series series;
  series.excitation.reference = {
      .elongation_at_zero_mm = 2.0, .nominal_pressure_psi = 10.0, .largest_force_N = 5.0, .highest_position_mm = 4.0};
  const auto beyond = [&](std::string_view law_name, std::vector<double> coefficients) {
    model::ModelSpec spec = model::nominal_model("slse1");
    const model::Physics& coupling = effect("pressure_coupling");
    const model::Law& law = *std::ranges::find(coupling.laws, law_name, &model::Law::name);
    spec.parts.push_back(model::make_part(coupling, law));
    spec.parts.back().coefficients = std::move(coefficients);
    const model::Physics* const added[] = {&coupling};
    EXPECT_FALSE(beyond_physical_size(spec, {}, std::span(&series, 1))) << "of the given model";
    return beyond_physical_size(spec, added, std::span(&series, 1));
  };
  // Twenty times 5 N for 10 psi more: 10 N/psi, whatever the sign and however late the tube.
  EXPECT_FALSE(beyond("force", {9.99}));
  EXPECT_TRUE(beyond("force", {-10.01}));
  EXPECT_TRUE(beyond("tube", {10.01}));
  // At an elongation of 6 mm, and between 2 mm and 6 mm.
  EXPECT_FALSE(beyond("stiffness", {1.66}));
  EXPECT_TRUE(beyond("stiffness", {1.68}));
  EXPECT_FALSE(beyond("both", {-4.9, 2.45}));
  EXPECT_TRUE(beyond("both", {-10.1, 2.55}));
  // The force at the middle of the travel is none; at its ends, beyond.
  EXPECT_TRUE(beyond("both", {-21.0, 5.2}));
  // Where no pressure is named, or no force was read, nothing is known of the size.
  series.excitation.reference.nominal_pressure_psi = 0.0;
  EXPECT_FALSE(beyond("force", {1e6}));
  series.excitation.reference = {.nominal_pressure_psi = 10.0};
  EXPECT_FALSE(beyond("force", {1e6}));
}

TEST(PhysicalSize, ATableOfThePressureIsHeldAgainstItToo) {
  Series series;
  series.excitation.reference = {.nominal_pressure_psi = 10.0, .largest_force_N = 5.0};
  const auto beyond = [&](std::vector<double> values) {
    return beyond_physical_size(model::Table{.first = -0.1, .step = 0.05, .values = std::move(values)},
                                std::span(&series, 1));
  };
  // 10 N/psi over 0.2 psi, wherever the ends lie.
  EXPECT_FALSE(beyond({-0.9, 0.0, 1.09, 0.0, 0.3}));
  EXPECT_TRUE(beyond({-0.9, 0.0, 1.11, 0.0, 0.3}));
  EXPECT_FALSE(beyond({}));
  series.excitation.reference.nominal_pressure_psi = 0.0;
  EXPECT_FALSE(beyond({-0.9, 0.0, 1.11, 0.0, 0.3}));
}

TEST(PhysicalSize, AForceChannelDriftsByNoMoreThanItReads) {
  Series series;
  series.excitation.reference = {.duration_s = 1800.0, .largest_force_N = 10.0};
  const auto beyond = [&](std::string_view law_name, std::vector<double> parameters, std::vector<double> coefficients) {
    model::ModelSpec spec = model::nominal_model("slse1");
    const model::Physics& drift = effect("zero_drift");
    spec.parts.push_back(model::make_part(drift, *std::ranges::find(drift.laws, law_name, &model::Law::name)));
    spec.parts.back().parameters = std::move(parameters);
    spec.parts.back().coefficients = std::move(coefficients);
    const model::Physics* const added[] = {&drift};
    EXPECT_FALSE(beyond_physical_size(spec, {}, std::span(&series, 1))) << "of the given model";
    return beyond_physical_size(spec, added, std::span(&series, 1));
  };
  // Half an hour.
  EXPECT_FALSE(beyond("linear", {}, {-19.9}));
  EXPECT_TRUE(beyond("linear", {}, {-20.1}));
  // Two time constants: 1 - exp(-2) is 0.8647.
  EXPECT_FALSE(beyond("settling", {900.0}, {11.5}));
  EXPECT_TRUE(beyond("settling", {900.0}, {11.6}));
  // From one end of a cosine to the other.
  EXPECT_FALSE(beyond("wander", {1800.0}, {4.99, 0.0, 0.0, 0.0, 0.0, 0.0}));
  EXPECT_TRUE(beyond("wander", {1800.0}, {5.01, 0.0, 0.0, 0.0, 0.0, 0.0}));
}

TEST(PhysicalSize, AskedOfNoOtherLaws) {
  Series series;
  series.excitation.reference = {.nominal_pressure_psi = 10.0, .largest_force_N = 1e-3, .highest_position_mm = 4.0};
  model::ModelSpec spec = model::nominal_model("slse1");
  std::vector<const model::Physics*> all;
  for (model::Part& part : spec.parts) {
    std::ranges::fill(part.coefficients, 1e6);
    all.push_back(part.physics);
  }
  EXPECT_FALSE(beyond_physical_size(spec, all, std::span(&series, 1)));
}

// --- extend ----------------------------------------------------------------------------------------------------------

/// A zero that wanders without law: each of several recordings has another, and no shape is that of all.
TEST(Extend, AZeroThatWandersIsTriedForOneRecordingAlone) {
  const auto wandering = [](unsigned seed) {
    messages::Recording recording = test::record({.seed = seed});
    for (std::size_t k = 0; k < recording.frame.size(); ++k)
      recording.frame.force_N[k] += 0.3 * std::sin(2.0 * M_PI * recording.frame.t_s[k] / 300.0);
    return prepare_series("bench", std::move(recording), {});
  };
  const auto named = [](const std::vector<Series>& series) {
    const Search search(series, {0.02, 0.0, 1.0}, 1);
    const std::vector<Hypothesis> found = search.extend(search.nominal(model::nominal_model("slse1")), 3, false);
    return std::ranges::any_of(found, [](const Hypothesis& hypothesis) {
      return std::ranges::any_of(hypothesis.fit.spec.parts,
                                 [](const model::Part& part) { return part.law->name == "wander"; });
    });
  };
  EXPECT_TRUE(named({wandering(1)}));
  EXPECT_FALSE(named({wandering(1), wandering(2)}));
}

/// 2,000 rows of noise leave 2,000 squares, with a standard deviation of 63.
TEST(Events, AreHopelessBesideAnEffectThatLeavesNoMoreThanNoise) {
  const auto leaves = [](double squares) {
    Fit fit;
    fit.rows = 2000;
    fit.chi2 = squares;
    return fit;
  };
  constexpr double kTimes = 2.0;
  EXPECT_TRUE(explained_without(leaves(5000.0), leaves(2000.0), kTimes));
  EXPECT_TRUE(explained_without(leaves(5000.0), leaves(2120.0), kTimes));
  EXPECT_FALSE(explained_without(leaves(5000.0), leaves(2130.0), kTimes))
      << "two slips may leave less than this effect";
  EXPECT_FALSE(explained_without(leaves(3900.0), leaves(2000.0), kTimes)) << "one more slip may make up for it";
}

/// A force behind two poles, in one pass more than the bench's own lag.
messages::Recording behind_two_poles(double tau_s) {
  messages::Recording recording = test::record({.friction_N = 0.8, .lag_s = tau_s, .force_noise_N = 0.0, .seed = 9});
  const auto& t_s = recording.frame.t_s;
  auto& force_N = recording.frame.force_N;
  double before_N = force_N.front(), out_N = before_N;
  for (std::size_t k = 1; k < force_N.size(); ++k) {
    const double dt_s = t_s[k] - t_s[k - 1], behind_N = tau_s * (force_N[k] - before_N) / dt_s;
    out_N = force_N[k] - behind_N + (out_N - before_N + behind_N) * std::exp(-dt_s / tau_s);
    before_N = std::exchange(force_N[k], out_N);
  }
  std::mt19937 random(9);
  std::normal_distribution<double> noise(0.0, 0.01);
  for (double& each : force_N) each += noise(random);
  return recording;
}

/// Which law a lag has, another law of the friction beside it hides: chosen before the friction was there, it stays.
TEST(OtherLaws, AreTriedOnceTheOtherEffectsAreThere) {
  constexpr double kTau_s = 0.03;
  const Searched on(behind_two_poles(kTau_s));
  const Hypothesis first = on.with({{"coulomb_friction", "dahl"}, {"force_lag", "first_order"}});
  const Hypothesis best = on.search.with_other_laws(first);
  EXPECT_EQ(best.effects, first.effects);
  EXPECT_LT(best.ls_chi2, 0.7 * first.ls_chi2);
  const auto lag = std::ranges::find(best.fit.spec.parts, &effect("force_lag"), &model::Part::physics);
  ASSERT_NE(lag, best.fit.spec.parts.end());
  EXPECT_EQ(lag->law->name, "two_poles");
  // The bench reads 5 ms apart, between which its force is no straight line.
  EXPECT_NEAR(lag->parameters[0], kTau_s, 0.03 * kTau_s);
  // Where the law is the right one already, it stays.
  const Hypothesis again = on.search.with_other_laws(best);
  EXPECT_GE(again.evidence, best.evidence);
  EXPECT_EQ(std::ranges::count(again.fit.spec.parts, &effect("force_lag"), &model::Part::physics), 1);
}

// --- inside_ranges ---------------------------------------------------------------------------------------------------

/// `explanation` with a number of an effect at the lower end of its range.
Hypothesis at_lower_end(Hypothesis explanation, std::string_view name, std::string_view number) {
  for (model::ModelSpec* spec : {&explanation.fit.spec, &explanation.ls_spec}) {
    for (model::Part& part : spec->parts) {
      if (part.physics != &effect(name)) continue;
      const auto& numbers = part.law->parameters;
      const auto found = std::ranges::find(numbers, number, &model::Parameter::name);
      part.parameters[static_cast<std::size_t>(found - numbers.begin())] = found->lower;
    }
  }
  return explanation;
}

TEST(Ranges, ALawWithANumberAtTheEndOfItsRangeGivesWay) {
  const Searched on(test::record_other({.friction_N = 0.8, .presliding_mm = 0.05, .seed = 6}));
  const Hypothesis fitted = on.with({{"coulomb_friction", "stribeck_exponential"}});
  Hypothesis at_end = at_lower_end(fitted, "coulomb_friction", "stribeck_velocity_mm_s");
  const auto inside = on.search.inside_ranges(at_end);
  ASSERT_TRUE(inside);
  EXPECT_EQ(inside->effects, fitted.effects);
  const auto friction = std::ranges::find(inside->fit.spec.parts, &effect("coulomb_friction"), &model::Part::physics);
  ASSERT_NE(friction, inside->fit.spec.parts.end());
  EXPECT_NE(friction->law->name, "stribeck_exponential");
  EXPECT_FALSE(at_wrong_bound(*friction));
  EXPECT_LT(inside->ls_chi2, 2.0 * fitted.ls_chi2);
  EXPECT_FALSE(on.search.inside_ranges(*inside)) << "nothing stands at an end any more";
  // Where the other laws leave far more, the physics is in the law that stands at its end.
  at_end.ls_chi2 *= 0.1;
  EXPECT_FALSE(on.search.inside_ranges(at_end));
}

TEST(Ranges, ASlipLosesAnEventWithANumberAtTheEndOfItsRange) {
  const Searched on(test::record({.slip_mm = 0.1, .slip_s = 300.0, .seed = 3}));
  const model::Physics& slip = effect("grip_slip");
  const auto with_creep_of = [&](double time_constant_s) {
    Hypothesis out;
    out.effects = {&slip};
    out.fit.spec = model::nominal_model("slse1");
    for (const auto& [law, time_s] : {std::pair{"event", 300.0}, std::pair{"creep", 600.0}}) {
      out.fit.spec.parts.push_back(model::make_part(slip, *model::find_law(slip, law)));
      out.fit.spec.parts.back().parameters[0] = time_s;
    }
    out.fit = on.search.fit_from(out.fit.spec, 30);
    on.search.settle(out, false);
    for (model::ModelSpec* spec : {&out.fit.spec, &out.ls_spec}) spec->parts.back().parameters[2] = time_constant_s;
    return out;
  };
  EXPECT_FALSE(on.search.inside_ranges(with_creep_of(20.0)));
  const auto inside = on.search.inside_ranges(with_creep_of(1000.0));
  ASSERT_TRUE(inside);
  ASSERT_EQ(std::ranges::count(inside->fit.spec.parts, &slip, &model::Part::physics), 1);
  EXPECT_EQ(inside->fit.spec.parts.back().law->name, "event");

  // The size is then that of what is left, whatever it was before.
  Selection selection;
  selection.pool.push_back(on.search.nominal(model::nominal_model("slse1")));
  selection.pool.push_back(with_creep_of(1000.0));
  selection.weight = {0.0, 1.0};
  selection.excess = {0.0, 0.0};
  selection.best = 1;
  selection.size_N[&slip] = 1e3;
  prefer_simpler_laws(selection, on.search);
  EXPECT_EQ(std::ranges::count(selection.chosen().fit.spec.parts, &slip, &model::Part::physics), 1);
  EXPECT_NEAR(selection.size_N[&slip], size_N(on.search, *inside, selection.nominal()), 0.01);
}

// --- below_resolution ------------------------------------------------------------------------------------------------

TEST(Resolution, APlayASlipALagAndADelayMustStandClearOfTheInstruments) {
  const InstrumentResolution instruments{0.001, 0.01, {}};
  const auto below = [&](std::string_view name, std::string_view parameter, double value) {
    model::ModelSpec spec = model::nominal_model("slse1");
    const model::Law& law = effect(name).laws.front();
    spec.parts.push_back(model::make_part(effect(name), law));
    for (std::size_t i = 0; i < law.parameters.size(); ++i)
      if (law.parameters[i].name == parameter) spec.parts.back().parameters[i] = value;
    return below_resolution(spec, instruments);
  };
  EXPECT_TRUE(below("crosshead_backlash", "gap_mm", 0.0079));
  EXPECT_FALSE(below("crosshead_backlash", "gap_mm", 0.0081));
  EXPECT_TRUE(below("grip_slip", "slip_mm", 0.0039));
  EXPECT_FALSE(below("grip_slip", "slip_mm", 0.0041));
  EXPECT_TRUE(below("force_delay", "delay_s", 0.0009));
  EXPECT_FALSE(below("force_delay", "delay_s", 0.0011));
  EXPECT_TRUE(below("force_lag", "time_constant_s", 0.0009));
  EXPECT_FALSE(below("force_lag", "time_constant_s", 0.0011));
  EXPECT_FALSE(below("zero_drift", "rate_N_h", 0.0));
}

TEST(Resolution, AnEventThatGoesOnNeedsAsLongATimeBeforeIt) {
  const model::Law* creep = model::find_law(effect("grip_slip"), "creep");
  ASSERT_NE(creep, nullptr);
  model::ModelSpec spec = model::nominal_model("slse1");
  spec.parts.push_back(model::make_part(effect("grip_slip"), *creep));
  spec.parts.back().parameters = {150.0, 0.1, 20.0, 7.0};  // of the recording 7
  EXPECT_TRUE(below_resolution(spec, {.position_mm = 0.001, .interval_s = 0.01, .first_s = {{7.0, 131.0}}}));
  EXPECT_FALSE(below_resolution(spec, {.position_mm = 0.001, .interval_s = 0.01, .first_s = {{7.0, 129.0}}}));
  EXPECT_FALSE(below_resolution(spec, {.position_mm = 0.001, .interval_s = 0.01, .first_s = {{8.0, 131.0}}}));
}

TEST(Resolution, AFlowThatHardlyDependsOnTheRateStandsUnderFrictionsName) {
  const model::Physics& viscosity = effect("nonlinear_viscosity");
  model::ModelSpec spec = model::nominal_model("slse1");
  spec.parts.push_back(model::make_part(viscosity, *model::find_law(viscosity, "power_dashpot")));
  spec.parts.back().parameters[0] = 0.3;
  EXPECT_TRUE(below_resolution(spec, {}));
  spec.parts.back().parameters[0] = 0.31;
  EXPECT_FALSE(below_resolution(spec, {}));
}

// A start that settles in 100 s and more is a drift.
TEST(Resolution, ALawAtTheUpperBoundWhereItIsAnotherEffectIsThat) {
  model::ModelSpec spec = model::nominal_model("slse1");
  spec.parts.push_back(
      model::make_part(effect("unsettled_start"), *model::find_law(effect("unsettled_start"), "exponential")));
  spec.parts.back().parameters = {99.5};
  EXPECT_TRUE(below_resolution(spec, {}));
  spec.parts.back().parameters = {90.0};
  EXPECT_FALSE(below_resolution(spec, {}));
}

TEST(Resolution, IsThatOfTheReadings) {
  const Searched on(test::record_other({.position_noise_mm = 4e-4}));
  const InstrumentResolution found = resolution_of(on.series);
  EXPECT_NEAR(found.position_mm, 4e-4, 1.5e-4);
  EXPECT_NEAR(found.interval_s, 0.005, 5e-4);
}

}  // namespace
}  // namespace isorig::identify
