// How sure a name is, by simulation: what the posterior of its sureness holds, what a replicate is made of, and that
// rehearsals tell right names from wrong ones.
#include "identify/diagnose/reliability/reliability.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <random>

#include "concealed_specimen.hpp"
#include "identify/diagnose/claims_json.hpp"
#include "identify/diagnose/fit/free_parameters.hpp"
#include "identify/diagnose/forecast.hpp"
#include "identify/diagnose/prepare.hpp"
#include "identify/diagnose/reliability/replicate.hpp"
#include "identify/diagnose/reliability/sureness.hpp"
#include "identify/diagnose/search/calibration.hpp"
#include "model/catalogue.hpp"

namespace isorig::identify {
namespace {

// With promises of 1 the posterior is Beta(r + 1/2, n - r + 1/2), whose mean is (r + 1/2) / (n + 1).
TEST(Sureness, IsTheMeanOfTheBetaDistributionWhereEverythingWasPromised) {
  EXPECT_NEAR(sureness_of({}).value, 0.5, 1e-6);
  std::vector<CountedClaim> claims(40, {1.0, true, 1.0});
  EXPECT_NEAR(sureness_of(claims).value, 40.5 / 41.0, 1e-6);
  for (std::size_t i = 0; i < 4; ++i) claims[i].right = false;
  const Sureness some = sureness_of(claims);
  EXPECT_NEAR(some.value, 36.5 / 41.0, 1e-6);
  EXPECT_EQ(some.claims, 40U);
  EXPECT_EQ(some.right, 36U);
  // Quantiles of Beta(36.5, 4.5) by scipy.stats.beta.ppf([0.025, 0.975], 36.5, 4.5).
  EXPECT_NEAR(some.low95, 0.77955, 1e-3);
  EXPECT_NEAR(some.high95, 0.96529, 1e-3);
}

TEST(Sureness, AClaimThatCountsTwiceIsTwoClaims) {
  const std::vector<CountedClaim> once{{0.9, true, 2.0}, {0.8, false, 0.5}, {0.7, true, 1.0}};
  const std::vector<CountedClaim> twice{
      {0.9, true, 1.0}, {0.9, true, 1.0}, {0.8, false, 0.25}, {0.8, false, 0.25}, {0.7, true, 1.0}};
  EXPECT_NEAR(sureness_of(once).value, sureness_of(twice).value, 1e-12);
}

// Claims that promise 0.3 to 1 and keep 0.8 of it: of 400 intervals 95 % hold 0.8, +- 3.3 % (three standard errors).
TEST(Sureness, ItsIntervalsHoldTheTruth) {
  constexpr double kTruth = 0.8;
  constexpr int kRepeats = 400;
  std::mt19937_64 random(1);
  std::uniform_real_distribution<double> uniform;
  int held = 0;
  double sum = 0.0;
  for (int repeat = 0; repeat < kRepeats; ++repeat) {
    std::vector<CountedClaim> claims;
    for (int i = 0; i < 60; ++i) {
      const double promised = 0.3 + 0.7 * uniform(random);
      claims.push_back({promised, uniform(random) < kTruth * promised, 1.0});
    }
    const Sureness found = sureness_of(claims);
    held += found.low95 <= kTruth && kTruth <= found.high95 ? 1 : 0;
    sum += found.value;
  }
  EXPECT_NEAR(held / static_cast<double>(kRepeats), 0.95, 0.033);
  // One posterior mean scatters by 0.07; the prior draws it towards one half by 0.3 / 61.
  EXPECT_NEAR(sum / kRepeats, kTruth, 0.005 + 3.0 * 0.07 / std::sqrt(kRepeats));
}

/// A study as far as replicates need it: prepared, and the pool that `with` names, all as probable.
struct Studied {
  explicit Studied(const test::ConcealedSpecimen& bench, const std::vector<const char*>& with = {})
      : originals{test::record(bench)}, given(model::nominal_model("slse1")) {
    model::ModelSpec nominal = given;
    prepare(study, originals, names, nominal);
    const Search search(study.series, study.noise.weighing, 2);
    study.selection.pool.push_back(search.nominal(nominal));
    for (const char* name : with) {
      const auto effects = model::effects();
      Hypothesis one;
      one.effects = {*std::ranges::find_if(effects, [&](const model::Physics* p) { return p->name == name; })};
      model::ModelSpec spec = study.selection.pool[0].fit.spec;
      spec.parts.push_back(
          started_part(*one.effects[0], one.effects[0]->laws[0], 0, study.series[0].excitation.reference));
      one.fit = search.fit_from(spec, 50);
      search.settle(one, false);
      study.selection.pool.push_back(one);
    }
    study.selection.best = study.selection.pool.size() - 1;
    study.selection.weight.assign(study.selection.pool.size(), 1.0 / static_cast<double>(study.selection.pool.size()));
  }
  std::vector<messages::Recording> originals;
  std::vector<std::string> names{"bench"};
  model::ModelSpec given;
  Study study;
};

// With nothing left but noise, the drawn force less the force of the drawn numbers is white and of the noise's size:
// its mean square over n rows is that of the noise to 1 +- sqrt(2 / n).
TEST(Replicate, IsTheDrawnModelAndTheNoise) {
  const Studied s({.force_step_N = 1e-6, .seed = 5});
  const Replicator replicator(s.study, s.originals);
  std::mt19937_64 random(7), again(7);
  const std::vector<messages::Recording> drawn = replicator.draw(0, random);
  const model::ModelSpec spec = replicator.draw_numbers(0, again);
  const Series& series = s.study.series[0];
  const std::vector<double> force_N = forecast(spec, series.excitation).force_N;
  ASSERT_EQ(drawn[0].frame.size(), s.originals[0].frame.size());
  EXPECT_EQ(drawn[0].frame.position_mm, s.originals[0].frame.position_mm);
  double squares = 0.0, products = 0.0, before = 0.0;
  const std::size_t rows = force_N.size();
  ASSERT_EQ(drawn[0].frame.size(), rows) << "nothing was cut from this recording";
  for (std::size_t k = 0; k < rows; ++k) {
    const double whitened =
        (drawn[0].frame.force_N[k] - force_N[k]) * std::sqrt(series.readings[k]) / s.study.noise.noise.white_N;
    squares += whitened * whitened;
    products += whitened * before;
    before = whitened;
  }
  const auto n = static_cast<double>(rows);
  // Five standard errors, and what the residual holds beyond noise by chance (two standard deviations of its squares).
  const double slack = 2.0 * std::sqrt(2.0 / static_cast<double>(series.nodes.size()));
  EXPECT_NEAR(squares / n, 1.0, 5.0 * std::sqrt(2.0 / n) + slack);
  EXPECT_NEAR(products / n, 0.0, 5.0 / std::sqrt(n) + slack);
}

// Of 600 draws the standard deviation is that of the covariance to 1 / sqrt(1200), five of those allowed.
TEST(Replicate, DrawsNumbersFromTheirCovariance) {
  const Studied s({.seed = 6});
  const Replicator replicator(s.study, s.originals);
  const Fit& fit = s.study.selection.pool[0].fit;
  const std::vector<FreeNumber> numbers = fitted_numbers(fit.spec);
  const Eigen::MatrixXd expected = covariance(Problem(s.study.series, fit.noise), fit.spec, Spread::kMoves);
  constexpr int kDraws = 600;
  std::mt19937_64 random(3);
  std::vector<double> sum(numbers.size()), squares(numbers.size());
  for (int draw = 0; draw < kDraws; ++draw) {
    const model::ModelSpec spec = replicator.draw_numbers(0, random);
    for (std::size_t i = 0; i < numbers.size(); ++i) {
      const double off = value_of(spec, numbers[i]) - value_of(fit.spec, numbers[i]);
      sum[i] += off;
      squares[i] += off * off;
    }
  }
  for (std::size_t i = 0; i < numbers.size(); ++i) {
    const auto at = static_cast<Eigen::Index>(i);
    const double deviation = std::sqrt(expected(at, at));
    EXPECT_NEAR(std::sqrt(squares[i] / kDraws) / deviation, 1.0, 5.0 / std::sqrt(2.0 * kDraws)) << i;
    EXPECT_NEAR(sum[i] / kDraws / deviation, 0.0, 5.0 / std::sqrt(kDraws)) << i;
  }
}

// A ripple that no law has stays in every replicate, at its size and with another course.
TEST(Replicate, KeepsWhatNoExplanationHas) {
  const Studied plain({.seed = 8}), rippled({.ripple_N = 0.3, .seed = 8});
  const auto rms = [](const Eigen::VectorXd& v) { return std::sqrt(v.squaredNorm() / static_cast<double>(v.size())); };
  const double left_N = rms(Replicator(rippled.study, rippled.originals).discrepancy_N());
  // A sine of 0.3 N has 0.21 N rms; the model's own numbers take some of it up.
  EXPECT_GT(left_N, 0.1);
  EXPECT_LT(left_N, 0.22);
  // Two standard deviations of the noise's own squares, as a share of them, on the bins' noise.
  EXPECT_LT(rms(Replicator(plain.study, plain.originals).discrepancy_N()), 0.02 * 0.5);
}

TEST(Rehearsals, TheSameWhateverTheThreadsAndWhatIsKnown) {
  const Studied s({.friction_N = 1.0, .seed = 9}, {"coulomb_friction"});
  ReliabilityOptions options;
  options.rehearsals = 4;
  const auto told = [](const Reliability& r) { return name_check_json(r.rehearsals, "x").dump(); };
  options.threads = 2;
  const Reliability two = measure_reliability(s.study, s.originals, s.names, s.given, options);
  options.threads = 1;
  options.known.assign(two.rehearsals.begin(), two.rehearsals.begin() + 2);
  EXPECT_EQ(told(measure_reliability(s.study, s.originals, s.names, s.given, options)), told(two));

  ASSERT_EQ(two.rehearsals.size(), 4U);
  bool withheld = false;
  for (const Rehearsal& one : two.rehearsals) {
    EXPECT_EQ(one.failed, "");
    for (const Claim& claim : one.claims) {
      EXPECT_EQ(claim.right, one.truth == claim.effect);
      EXPECT_NE(claim.effect, one.withheld) << "the search was not given it";
    }
    withheld = withheld || !one.withheld.empty();
    if (one.truth == "coulomb_friction" && one.withheld.empty()) {
      EXPECT_TRUE(std::ranges::any_of(one.claims, &Claim::right)) << "1 N of friction beside 0.02 N of noise";
    }
  }
  EXPECT_FALSE(two.beside_nothing) << "too few claims to say anything";
}

Diagnosis with_one_name(double weight, double unexplained, Verdict verdict) {
  Diagnosis d;
  MissingEffect missing;
  missing.effect = model::effects()[0];
  missing.weight = weight;
  missing.probability = 0.123;
  d.missing = {missing};
  d.unexplained = unexplained;
  d.verdict = verdict;
  return d;
}

TEST(Restate, ByTheClaimsOfItsOwnKind) {
  Reliability reliability;
  reliability.beside_nothing = Sureness{0.9, 0.8, 0.97, 30, 28};
  Diagnosis d = with_one_name(0.8, 0.1, Verdict::kMissingPhysics);
  restate(d, reliability);
  EXPECT_DOUBLE_EQ(d.missing[0].probability, 0.8 * 0.9 * 0.9);
  ASSERT_TRUE(d.reliability);
  // Beside unknown physics there were too few claims: what was stated stays.
  d = with_one_name(0.8, 0.1, Verdict::kUnknownPhysics);
  restate(d, reliability);
  EXPECT_DOUBLE_EQ(d.missing[0].probability, 0.123);
  reliability.beside_unknown = Sureness{0.4, 0.2, 0.6, 12, 5};
  restate(d, reliability);
  EXPECT_DOUBLE_EQ(d.missing[0].probability, 0.8 * 0.9 * 0.4);
  // A law that left-out readings refuse is stated with one half at most.
  d = with_one_name(1.0, 0.0, Verdict::kMissingPhysics);
  d.not_modelled = {{std::string(d.missing[0].effect->name)}, "worse", {}};
  restate(d, reliability);
  EXPECT_DOUBLE_EQ(d.missing[0].probability, 0.5);
}

TEST(NameCheck, ItsFileReadsBackAndNoOther) {
  const std::vector<Rehearsal> made{
      {"coulomb_friction", "", Verdict::kMissingPhysics, {{"coulomb_friction", 0.97, true, false}}, ""},
      {"coulomb_friction+play", "play", Verdict::kUnknownPhysics, {{"mass", 0.5, false, true}}, ""},
      {"nominal", "", Verdict::kConsistent, {}, "nothing moves in this recording"}};
  const std::string text = name_check_json(made, "these").dump();
  const auto read = rehearsals_of(text, "these");
  ASSERT_TRUE(read);
  EXPECT_EQ(name_check_json(*read, "these").dump(), text);
  EXPECT_FALSE(rehearsals_of(text, "others"));
  EXPECT_FALSE(rehearsals_of(text.substr(0, text.size() / 2), "these"));
  EXPECT_FALSE(rehearsals_of("{}", "these"));
  std::string odd = text;
  odd.replace(odd.find("unknown_physics"), 15, "unknown_weather");
  EXPECT_FALSE(rehearsals_of(odd, "these"));
}

TEST(NameCheck, IsToldInSentences) {
  Reliability r;
  r.rehearsals = {{"coulomb_friction", "", Verdict::kMissingPhysics, {{"coulomb_friction", 0.97, true, false}}, ""},
                  {"coulomb_friction", "coulomb_friction", Verdict::kMissingPhysics, {{"play", 0.9, false, false}}, ""},
                  {"nominal", "", Verdict::kConsistent, {}, ""}};
  r.beside_nothing = Sureness{0.9, 0.8, 0.97, 30, 28};
  const std::vector<std::string> text = reliability_text(r);
  ASSERT_EQ(text.size(), 4U);
  EXPECT_EQ(text[0],
            "names where nothing unknown was told: 30, of which 28 were right: a name with all of the weight is stated "
            "with 0.90 [0.80, 0.97]");
  EXPECT_EQ(text[2], "recordings that lacked nothing: 1, of which 0 got a name or unknown physics all the same");
  EXPECT_EQ(text[3],
            "recordings with an effect that the search was not given: 1, of which 0 were told to hold unknown physics "
            "and 1 got another name with 0.5 or more");
}

}  // namespace
}  // namespace isorig::identify
