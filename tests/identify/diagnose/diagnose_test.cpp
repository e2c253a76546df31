#include <gtest/gtest.h>

#include <cmath>
#include <nlohmann/json.hpp>

#include "concealed_specimen.hpp"
#include "identify/diagnose/design/designer.hpp"
#include "identify/diagnose/diagnosis.hpp"
#include "model/catalogue.hpp"
#include "protocol/compile.hpp"

namespace isorig::identify {
namespace {

using test::ConcealedSpecimen;

Diagnosis diagnose_bench(const ConcealedSpecimen& bench, const char* nominal = "slse1") {
  std::vector<messages::Recording> recordings{test::record(bench)};
  return diagnose(std::move(recordings), {"bench"}, model::nominal_model(nominal), {}).diagnosis;
}

double rms_against(const model::ModelSpec& spec, messages::Recording truth) {
  const std::vector<double> force = truth.frame.force_N;
  std::ranges::fill(truth.frame.force_N, 0.0);
  const Excitation excitation = reconstruct_excitation(truth);
  model::RunningModel running(spec, excitation.reference);
  running.reset(excitation.instants.front());
  double squares = 0.0;
  for (std::size_t k = 0; k < force.size(); ++k) {
    const double e = running.step(excitation.instants[k]) - force[k];
    squares += e * e;
  }
  return std::sqrt(squares / static_cast<double>(force.size()));
}

/// The named effect first, alone, near certain, with its size within `tolerance`, and a model that predicts
/// motions it has not seen: at least 95 % of the nominal model's error gone.
/// `carrier`: the variable that carries most of the excess, where the law leaves no doubt.
void expect_single(const ConcealedSpecimen& bench, std::string_view effect, std::string_view number, double truth,
                   double tolerance, std::string_view carrier = {}) {
  const Diagnosis d = diagnose_bench(bench);
  ASSERT_EQ(d.verdict, Verdict::kMissingPhysics);
  ASSERT_EQ(d.missing.size(), 1u) << diagnosis_json(d)["missing"].dump(1);
  EXPECT_EQ(d.missing[0].effect->name, effect);
  EXPECT_GT(d.missing[0].probability, 0.9);
  ASSERT_FALSE(d.where.empty());
  for (const Place& place : d.where) EXPECT_LT(place.model_rmse_N, place.nominal_rmse_N) << place.text;
  for (const std::string& note : d.notes) EXPECT_EQ(note.find("stopped before it had converged"), note.npos) << note;
  if (!carrier.empty()) {
    EXPECT_EQ(d.where[0].covariate, carrier);
  }
  for (const NamedValue& value : d.missing[0].parameters)
    if (value.name == number) {
      EXPECT_NEAR(value.value, truth, tolerance);
    }
  const double before = rms_against(d.nominal, test::record_other(bench));
  const double after = rms_against(d.model, test::record_other(bench));
  EXPECT_LT(after, 0.05 * before + 0.004) << "nominal " << before;
}

TEST(Diagnose, FindsFriction) {
  expect_single({.friction_N = 0.8, .presliding_mm = 0.04}, "coulomb_friction", "force_N", 0.8, 0.02);
}
TEST(Diagnose, FindsQuarterSizeFriction) {
  expect_single({.friction_N = 0.1, .presliding_mm = 0.04, .seed = 5}, "coulomb_friction", "force_N", 0.1, 0.015);
}
TEST(Diagnose, FindsStiffening) {
  expect_single({.quadratic_N_mm2 = 0.06}, "strain_stiffening", "quadratic_N_mm2", 0.06, 0.002);
}
TEST(Diagnose, FindsASecondRelaxation) {
  expect_single({.second_arm_N_mm = 0.6, .second_arm_s = 9.0}, "second_relaxation", "", 0.0, 0.0);
}
TEST(Diagnose, FindsANonlinearDashpot) {
  expect_single({.power = 1.8}, "nonlinear_viscosity", "exponent", 1.8, 0.05);
}
/// Of a linear arm and one that is not, one is the nominal model's own and one is missing: not two.
TEST(Diagnose, FindsANonlinearArmBesideTheArmOfTheNominalModel) {
  const ConcealedSpecimen bench{.second_arm_N_mm = 1.2, .second_arm_s = 6.0, .power = 1.8};
  const Diagnosis d = diagnose_bench(bench);
  ASSERT_EQ(d.missing.size(), 1u) << diagnosis_json(d)["missing"].dump(1);
  EXPECT_EQ(d.missing[0].effect->name, "nonlinear_viscosity");
  EXPECT_GT(d.missing[0].probability, 0.9);
  const double before = rms_against(d.nominal, test::record_other(bench));
  EXPECT_LT(rms_against(d.model, test::record_other(bench)), 0.05 * before + 0.004) << "nominal " << before;
  EXPECT_EQ(std::ranges::count(d.model.parts, std::string_view("maxwell"),
                               [](const model::Part& part) { return part.physics->name; }),
            1);
  EXPECT_TRUE(std::ranges::any_of(d.notes, [](const std::string& note) {
    return note.find("stands beside the arms of the nominal model") != note.npos;
  }));
}
TEST(Diagnose, FindsPressureCoupling) {
  expect_single({.coupling_N_mm_psi = 0.15, .pressure_wander_psi = 0.1}, "pressure_coupling", "stiffness_N_mm_psi",
                0.15, 0.01);
}
TEST(Diagnose, FindsSoftening) {
  expect_single({.softening_N_mm = 0.05}, "cyclic_softening", "travel_mm", 15.0, 1.0);
}
TEST(Diagnose, FindsALagAndCallsItNoDelay) {
  expect_single({.lag_s = 0.03}, "force_lag", "time_constant_s", 0.03, 0.0015);
}
TEST(Diagnose, FindsADelayAndCallsItNoLag) {
  expect_single({.delay_s = 0.02}, "force_delay", "delay_s", 0.02, 0.001);
}
TEST(Diagnose, FindsAMass) {
  expect_single({.mass_kg = 0.5}, "fixture_inertia", "mass_kg", 0.5, 0.05, "onset");
}
TEST(Diagnose, FindsDrift) {
  expect_single({.drift_N_h = 1.5}, "zero_drift", "rate_N_h", 1.5, 0.05, "time");
}
TEST(Diagnose, FindsPlay) {
  expect_single({.gap_mm = 0.08}, "crosshead_backlash", "gap_mm", 0.08, 0.004);
}
TEST(Diagnose, FindsSlack) {
  const ConcealedSpecimen bench{.elongation_at_zero_mm = 2.5, .slack = true};
  const Diagnosis d = diagnose_bench(bench);
  ASSERT_EQ(d.verdict, Verdict::kMissingPhysics);
  EXPECT_EQ(d.missing.at(0).effect->name, "slack");
}

TEST(Diagnose, FindsASlipWithItsTimeAndKeepsItOutOfOtherRecordings) {
  const ConcealedSpecimen bench{.slip_mm = 0.1, .slip_s = 700.0};
  const Diagnosis d = diagnose_bench(bench);
  ASSERT_EQ(d.missing.size(), 1u);
  ASSERT_EQ(d.missing[0].effect->name, "grip_slip");
  for (const NamedValue& value : d.missing[0].parameters) {
    if (value.name == "time_s") {
      EXPECT_NEAR(value.value, 700.0, 0.3);
    }
    if (value.name == "slip_mm") {
      EXPECT_NEAR(value.value, 0.1, 0.005);
    }
  }
  EXPECT_LT(rms_against(d.model, test::record_other({})), 0.01);
}

TEST(Diagnose, FindsBothOfAPair) {
  const Diagnosis d = diagnose_bench({.friction_N = 0.5, .quadratic_N_mm2 = 0.05});
  ASSERT_EQ(d.missing.size(), 2u);
  std::vector<std::string_view> names{d.missing[0].effect->name, d.missing[1].effect->name};
  std::ranges::sort(names);
  EXPECT_EQ(names[0], "coulomb_friction");
  EXPECT_EQ(names[1], "strain_stiffening");
}

TEST(Diagnose, CallsStructureOutsideOfTheCatalogueUnknownAndStillPredictsIt) {
  const ConcealedSpecimen bench{.ripple_N = 0.3};
  const Diagnosis d = diagnose_bench(bench);
  EXPECT_EQ(d.verdict, Verdict::kUnknownPhysics);
  for (const MissingEffect& missing : d.missing) EXPECT_LT(missing.probability, 0.9);
  EXPECT_LT(rms_against(d.model, test::record_other(bench)), 0.3 * rms_against(d.nominal, test::record_other(bench)));
  ASSERT_FALSE(d.where.empty());
  EXPECT_EQ(d.where[0].covariate, "position");
}

/// Traps: everything an instrument does, and nothing missing.
class Nothing : public testing::TestWithParam<ConcealedSpecimen> {};
TEST_P(Nothing, IsCalledConsistent) {
  const Diagnosis d = diagnose_bench(GetParam());
  EXPECT_EQ(d.verdict, Verdict::kConsistent) << (d.missing.empty() ? "" : d.missing[0].effect->name);
}
INSTANTIATE_TEST_SUITE_P(Traps, Nothing,
                         testing::Values(ConcealedSpecimen{}, ConcealedSpecimen{.position_noise_mm = 2e-3, .seed = 2},
                                         ConcealedSpecimen{.coloured_N = 0.04, .seed = 3},
                                         ConcealedSpecimen{.coloured_N = 0.03, .coloured_s = 0.4, .seed = 4},
                                         ConcealedSpecimen{.force_step_N = 0.05, .seed = 5},
                                         ConcealedSpecimen{.force_noise_N = 0.005, .force_step_N = 0.1, .seed = 13},
                                         ConcealedSpecimen{.spikes = 40, .seed = 6},
                                         ConcealedSpecimen{.pressure_wander_psi = 0.3, .seed = 7},
                                         ConcealedSpecimen{
                                             .force_noise_N = 0.0024, .position_noise_mm = 1e-3, .seed = 8}));

TEST(Diagnose, ACleanSecondArmIsNoEffectOfATwoArmModel) {
  const Diagnosis d = diagnose_bench({.second_arm_N_mm = 0.6, .second_arm_s = 9.0}, "slse2");
  EXPECT_EQ(d.verdict, Verdict::kConsistent);
}

TEST(Diagnose, DesignsAnExperimentThatTellsALagFromADelay) {
  std::vector<messages::Recording> recordings{test::record({.lag_s = 0.03})};
  Study study = diagnose(std::move(recordings), {"bench"}, model::nominal_model("slse1"), {});
  EXPECT_FALSE(study.diagnosis.design.experiment.has_value()) << study.diagnosis.design.separates();
  for (const auto& other : study.diagnosis.alternatives) {
    std::string named;
    for (const auto& effect : other.effects) named += effect + ' ';
    EXPECT_LT(other.probability, 0.2) << named;
  }
  Selection& selection = study.selection;
  const Search search(study.series, study.noise.noise, 2);
  std::ranges::fill(selection.weight, 0.0);
  for (std::size_t i = 0; i < selection.pool.size(); ++i) {
    if (selection.pool[i].key() == "force_lag") selection.weight[selection.best = i] = 0.6;
    if (selection.pool[i].key() == "force_delay") selection.weight[i] = 0.4;
  }
  const Design design = design_experiment(search, selection, {}, 2);
  ASSERT_TRUE(design.experiment.has_value());
  const Experiment& experiment = *design.experiment;
  EXPECT_TRUE(experiment.enough);
  EXPECT_GE(experiment.distance, design.enough);
  EXPECT_EQ(design.tied.size(), 2u);
  EXPECT_EQ(design.separates(), "a force reading that lags from a force reading that comes late");
  EXPECT_EQ(experiment.distances.size(), 2u);
  EXPECT_TRUE(design.inseparable.empty());
  // Without a rig, within what the recording has shown: 2 mm and 10 mm/s, give or take what noise adds.
  const auto plan =
      protocol::compile(base::TomlDocument::parse_text(experiment.protocol, "designed"), protocol::Limits{});
  EXPECT_LE(plan.peak_speed_mm_s, 10.5);
  EXPECT_LE(plan.position_max_mm, 2.05);
  EXPECT_GE(plan.position_min_mm, -2.05);
  EXPECT_NEAR(plan.nominal_s, experiment.duration_s, 0.2 * experiment.duration_s);

  // An experiment that is beaten is given up, and one that is better is proved as if nothing were to be beaten.
  std::vector<std::size_t> tied;
  for (std::size_t i = 0; i < selection.pool.size(); ++i)
    if (selection.weight[i] > 0.0) tied.push_back(i);
  const DesignOptions options;
  const Designer designer(search, selection, tied, options, 2);
  const std::vector<bool> counts(designer.pairs().size(), true);
  const auto items = candidate_experiments(designer.limits());
  const auto item = std::ranges::find_if(items, [&](const CandidateExperiment& each) {
    const auto score = designer.score(each);
    return score && score->least(counts) >= options.enough;
  });
  ASSERT_NE(item, items.end());
  const Score whole = designer.prove(*item, counts);
  const double least = whole.least(counts);
  ASSERT_GT(least, 0.0);
  for (std::size_t pair = 0; pair < counts.size(); ++pair) {
    EXPECT_EQ(designer.prove(*item, counts, {0.999 * least, pair}).distance, whole.distance);
    EXPECT_LE(designer.prove(*item, counts, {least, pair}).least(counts), least);
  }
  EXPECT_EQ(Designer(search, selection, tied, options, 1).prove(*item, counts, {1e12, 1}).distance.front(), 0.0);
}

TEST(Diagnose, SaysThatNoExperimentSeparatesOneModelUnderTwoNames) {
  // A relaxation of one hour is, on a recording of minutes and on any experiment that takes no longer than it
  // is allowed to, a spring.
  std::vector<messages::Recording> recordings{test::record({})};
  Study study = diagnose(std::move(recordings), {"bench"}, model::nominal_model("slse1"), {});
  Selection& selection = study.selection;
  const Search search(study.series, study.noise.noise, 2);
  Hypothesis slow = selection.nominal();
  slow.effects = {model::find_physics("second_relaxation")};
  slow.fit.spec.parts.push_back(model::make_part(*slow.effects[0], *model::find_law(*slow.effects[0], "arm")));
  slow.fit.spec.parts.back().coefficients[0] = 1e-4;
  selection.pool = {selection.nominal(), slow};
  selection.excess.assign(2, 0.0);
  selection.weight = {0.5, 0.5};
  selection.best = 0;
  DesignOptions options;
  options.longest_s = 300.0;
  const Design design = design_experiment(search, selection, options, 2);
  EXPECT_FALSE(design.experiment.has_value());
  ASSERT_EQ(design.inseparable.size(), 1u);
  EXPECT_LT(design.inseparable[0].distance, 20.0);
  EXPECT_NE(design.inseparable[0].text.find("a second relaxation"), std::string::npos);
}

TEST(Diagnose, RefusesWhatCannotBeJudged) {
  messages::Recording few = test::record({});
  few.frame.t_s.resize(5);
  few.frame.position_mm.resize(5);
  few.frame.force_N.resize(5);
  EXPECT_THROW((void)diagnose({few}, {"few"}, model::nominal_model("slse1"), {}), std::invalid_argument);
  messages::Recording still = test::record({});
  std::ranges::fill(still.frame.position_mm, 0.0);
  EXPECT_THROW((void)diagnose({still}, {"still"}, model::nominal_model("slse1"), {}), std::invalid_argument);
}

TEST(Diagnose, WritesTheFixedFormat) {
  const Diagnosis d = diagnose_bench({.friction_N = 0.8});
  const auto json = diagnosis_json(d);
  EXPECT_EQ(json["format"], "isorig-diagnosis/1");
  EXPECT_EQ(json["verdict"], "missing_physics");
  EXPECT_EQ(json["missing"][0]["effect"], "coulomb_friction");
  EXPECT_EQ(json["missing"][0]["parameters"]["force_N"]["ci95"].size(), 2u);
  EXPECT_EQ(json["missing"][0]["acts_on"], "friction element");
  EXPECT_EQ(json["missing"][0]["depends_on"][0], "direction");
  EXPECT_TRUE(json["missing"][0]["formula"].get<std::string>().starts_with("F = Fc")) << json["missing"][0]["formula"];
  const auto& shape = json["missing"][0]["shape"];
  EXPECT_EQ(shape["of"], "rate_mm_s");
  ASSERT_GE(shape["x"].size(), 2u);
  for (const char* key : {"y", "low95", "high95"}) EXPECT_EQ(shape[key].size(), shape["x"].size()) << key;
  // Dry friction of 0.8 N, whichever of its laws: at the fastest velocities its force with the sign of the velocity.
  EXPECT_NEAR(shape["y"].front().get<double>(), -0.8, 0.05);
  EXPECT_NEAR(shape["y"].back().get<double>(), 0.8, 0.05);
  EXPECT_LT(shape["low95"].back(), shape["high95"].back());
  EXPECT_TRUE(json["next_experiment"].is_null() || json["next_experiment"].is_object());
  EXPECT_LT(json["fit"]["model"]["train_rmse_N"], json["fit"]["nominal"]["train_rmse_N"]);
}

}  // namespace
}  // namespace isorig::identify
