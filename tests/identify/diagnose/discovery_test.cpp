#include "identify/diagnose/search/discovery.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <ostream>

#include "concealed_specimen.hpp"
#include "identify/diagnose/diagnosis.hpp"
#include "identify/diagnose/explain/discovered.hpp"
#include "identify/diagnose/search/hysteresis.hpp"
#include "model/composed.hpp"
#include "model/elements.hpp"

namespace isorig::identify {
namespace {

double rms_against(const model::ModelSpec& spec, const messages::Recording& truth) {
  const Excitation excitation = reconstruct_excitation(truth);
  model::RunningModel running(spec, excitation.reference);
  running.reset(excitation.instants.front());
  double squares = 0.0;
  for (std::size_t k = 0; k < truth.frame.size(); ++k) {
    const double e = running.step(excitation.instants[k]) - truth.frame.force_N[k];
    squares += e * e;
  }
  return std::sqrt(squares / static_cast<double>(truth.frame.size()));
}

/// What stands beside the nominal model alone.
struct Described {
  model::ModelSpec nominal;
  std::optional<HysteresisDescription> memory;
};
Described describe(messages::Recording recording) {
  std::vector<Series> series;
  series.push_back(prepare_series("bench", std::move(recording), {}));
  const InstrumentNoise noise = instrument_noise(series, {});
  const Search search(series, noise.weighing, 2);
  Selection selection;
  selection.pool.push_back(search.nominal(model::nominal_model("slse1")));
  selection.weight.push_back(1.0);
  return {selection.nominal().fit.spec, describe_hysteresis(search, selection, 2)};
}

struct Concealed {
  const char* name;
  test::ConcealedSpecimen bench;
  const char* law;     ///< that the search must find
  double coefficient;  ///< of it
  const char* says;    ///< in words
};
void PrintTo(const Concealed& concealed, std::ostream* out) {
  *out << concealed.name;
}

class Discovery : public testing::TestWithParam<Concealed> {};

/// The specimen is stepped by the bench's own code (concealed_specimen.cpp).
TEST_P(Discovery, FindsTheProductAndItsSize) {
  const Concealed& concealed = GetParam();
  const Described found = describe(test::record(concealed.bench));
  ASSERT_TRUE(found.memory.has_value());
  const auto& parts = found.memory->spec.parts;
  const auto part = std::ranges::find_if(parts, [&](const model::Part& one) { return one.law->name == concealed.law; });
  ASSERT_NE(part, parts.end()) << found.memory->function_of;
  // Noise of 0.02 N in some thousand bins moves a coefficient by less than 1 % of any of these.
  EXPECT_NEAR(part->coefficients[0], concealed.coefficient, 0.03 * std::fabs(concealed.coefficient));
  EXPECT_GT(found.memory->inclusion.at(concealed.law), 0.9);
  const auto laws =
      discovered_laws(found.memory->spec, std::vector<std::vector<NamedValue>>(parts.size()), found.memory->inclusion);
  std::string words;
  for (const DiscoveredLaw& law : laws) words += law.in_words + "; ";
  EXPECT_NE(words.find(concealed.says), std::string::npos) << words;
  const auto other = test::record_other(concealed.bench);
  const double after = rms_against(found.memory->spec, other);
  EXPECT_LT(after, 0.3 * rms_against(found.nominal, other));
  const model::ModelSpec read = model::parse_model(model::model_text(found.memory->spec), "read");
  EXPECT_NEAR(rms_against(read, other), after, 1e-9);
}

Diagnosis diagnosed(const test::ConcealedSpecimen& bench) {
  DiagnosisOptions options;
  options.threads = 2;
  return diagnose({test::record(bench)}, {"bench"}, model::nominal_model("slse1"), options).diagnosis;
}

class Published : public Discovery {};

TEST_P(Published, WithItsEquationAndNoWrongName) {
  const Concealed& concealed = GetParam();
  const Diagnosis d = diagnosed(concealed.bench);
  EXPECT_EQ(d.verdict, Verdict::kUnknownPhysics);
  for (const MissingEffect& missing : d.missing) EXPECT_LT(missing.probability, 0.9) << missing.effect->name;
  const auto law = std::ranges::find(d.discovered, concealed.law, &DiscoveredLaw::law);
  ASSERT_NE(law, d.discovered.end()) << d.described_by << d.not_modelled.why;
  EXPECT_NE(law->formula.find("c = "), std::string::npos) << law->formula;
  // Left-out readings have the noise of 0.02 N, a fifth of what the smallest of these laws leaves of the nominal model.
  EXPECT_LT(d.model_errors.heldout_rmse_N.value(), 0.5 * d.nominal_errors.heldout_rmse_N.value());
}

/// A drag that turns round with the sign of the position feeds energy in: no specimen does, and the law is refused.
TEST(DiscoveryRefused, AnActiveLawIsNotPublished) {
  const Diagnosis d = diagnosed({.drag_N_s_mm2 = 0.15, .seed = 31});
  EXPECT_EQ(d.verdict, Verdict::kUnknownPhysics);
  EXPECT_TRUE(d.discovered.empty());
  EXPECT_NE(d.not_modelled.why.find("would give out"), std::string::npos) << d.not_modelled.why;
}

/// Of two recordings one hardly moves: it forbids nothing that the motions of the other show one after another.
TEST(DiscoveryOfTwo, IsPublishedAlsoWhereOneRecordingHardlyMoves) {
  const test::ConcealedSpecimen bench{.arm_N_mm3 = 0.3, .seed = 33};
  test::ConcealedSpecimen again = bench;
  again.seed = 36;
  const messages::Recording moves = test::record(bench), moves_again = test::record(again);
  messages::Recording rests = moves_again;
  std::size_t rows = 0;
  while (rows < rests.frame.size() && std::fabs(rests.frame.position_mm[rows]) < 0.05) ++rows;
  for (auto* column : {&rests.frame.t_s, &rests.frame.force_N, &rests.frame.position_mm}) column->resize(rows);
  DiagnosisOptions options;
  options.threads = 2;
  const auto of_two = [&](const messages::Recording& second) {
    return diagnose({moves, second}, {"first", "second"}, model::nominal_model("slse1"), options).diagnosis;
  };
  const Diagnosis both = of_two(moves_again), one = of_two(rests);
  EXPECT_FALSE(both.discovered.empty()) << both.not_modelled.why;
  EXPECT_FALSE(one.discovered.empty()) << one.not_modelled.why;
}

const Concealed kActiveDrag{"drag_with_position",
                            {.drag_N_s_mm2 = 0.15, .seed = 31},
                            "dashpot_position",
                            0.15,
                            "in proportion to the position"};
const Concealed kFriction{"friction_with_position_squared",
                          {.friction_N_mm2 = 0.3, .seed = 32},
                          "friction_position_squared",
                          0.3,
                          "friction in proportion to the square of the position"};
const Concealed kArmWithPosition{
    "arm_with_position_squared", {.arm_N_mm3 = 0.3, .seed = 33}, "arm_position_squared", 0.3, "times (1 + 0.1"};
const Concealed kArmWithSpeed{
    "arm_with_speed", {.arm_N_s_mm2 = 0.1, .seed = 34}, "arm_rate", 0.1, "with the speed: times (1 + 0.05"};
/// Two laws of the file format are this product; the search has one of them, with all of the weight.
const Concealed kDragWithSpeed{
    "drag_with_speed", {.drag_N_s2_mm2 = 0.05, .seed = 35}, "dashpot_rate", 0.05, "in proportion to the speed"};
constexpr auto kName = [](const auto& one) { return std::string(one.param.name); };
INSTANTIATE_TEST_SUITE_P(Concealed, Discovery,
                         testing::Values(kActiveDrag, kFriction, kArmWithPosition, kArmWithSpeed, kDragWithSpeed),
                         kName);
INSTANTIATE_TEST_SUITE_P(Concealed, Published, testing::Values(kFriction, kArmWithPosition, kArmWithSpeed), kName);

}  // namespace
}  // namespace isorig::identify
