#include "identify/diagnose/search/hysteresis.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <numeric>

#include "concealed_specimen.hpp"
#include "identify/diagnose/diagnosis.hpp"
#include "model/composed.hpp"

namespace isorig::identify {
namespace {

/// A specimen that snaps beyond 0.7 mm and comes back below -0.1 mm: in no catalogue, and a table of nothing
/// that can be seen at one instant.
messages::Recording snapping(messages::Recording r, double force_N) {
  bool over = false;
  for (std::size_t k = 0; k < r.frame.size(); ++k) {
    if (r.frame.position_mm[k] > 0.7) over = true;
    if (r.frame.position_mm[k] < -0.1) over = false;
    if (over) r.frame.force_N[k] -= force_N;
  }
  return r;
}

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

TEST(Memory, ASnapIsDescribedAndPredictsMotionsThatWereNotSeen) {
  const test::ConcealedSpecimen bench{.seed = 21};
  const Described found = describe(snapping(test::record(bench), 0.8));
  ASSERT_TRUE(found.memory.has_value());
  EXPECT_NE(found.memory->function_of.find("branch"), std::string::npos) << found.memory->function_of;
  const auto other = snapping(test::record_other(bench), 0.8);
  const double after = rms_against(found.memory->spec, other);
  EXPECT_LT(after, 0.3 * rms_against(found.nominal, other));
  // The same model after a journey through its file.
  const model::ModelSpec read = model::parse_model(model::model_text(found.memory->spec), "read");
  EXPECT_NEAR(rms_against(read, other), after, 1e-9);
}

TEST(Memory, NothingIsTakenWhereOnlyNoiseIsLeft) {
  EXPECT_FALSE(describe(test::record({.seed = 22})).memory.has_value());
}

}  // namespace
}  // namespace isorig::identify
