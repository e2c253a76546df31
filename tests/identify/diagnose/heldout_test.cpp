#include "identify/diagnose/explain/heldout.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <set>

#include "concealed_specimen.hpp"
#include "identify/diagnose/fit/left_out.hpp"
#include "identify/diagnose/fit/moves.hpp"
#include "model/catalogue.hpp"

namespace isorig::identify {
namespace {

constexpr double kNoise_N = 0.02;

class Heldout : public testing::Test {
 protected:
  explicit Heldout(const test::ConcealedSpecimen& bench = {.friction_N = 0.8, .force_noise_N = kNoise_N, .seed = 12})
      : series_{prepare_series("bench", test::record(bench), {})}, problem_(series_, {kNoise_N, 0.0, 1.0}) {
    nominal_ = problem_.fit(model::nominal_model("slse1"), 20).spec;
    model::ModelSpec spec = nominal_;
    const model::Physics& friction = *model::find_physics("coulomb_friction");
    spec.parts.push_back(model::make_part(friction, friction.laws.front()));
    model_ = problem_.fit(spec, 30).spec;
  }
  std::vector<Series> series_;
  Problem problem_;
  model::ModelSpec nominal_, model_;
};

TEST_F(Heldout, EveryVelocityOfTheSessionIsLeftOutAndPredicted) {
  const HeldoutStudy study = study_heldout(problem_, nominal_, model_, 2);
  std::set<std::string> velocities;
  for (const LeftOut& one : study.left_out) {
    EXPECT_GE(one.readings, 50.0) << one.by << ' ' << one.value;
    EXPECT_GT(one.nominal_rmse_N, 2.0 * one.model_rmse_N) << one.by << ' ' << one.value;
    if (one.by != "velocity" || one.value == "0.05 mm/s") continue;
    velocities.insert(one.value);
    // With all other velocities to learn from, the model that has the friction predicts to the noise, and to what the
    // reconstructed corners cost: 0.8 N of friction over a few micrometres.
    EXPECT_GT(one.model_rmse_N, 0.8 * kNoise_N) << one.by << ' ' << one.value;
    EXPECT_LT(one.model_rmse_N, 2.0 * kNoise_N) << one.by << ' ' << one.value;
    EXPECT_GT(one.nominal_rmse_N, 4.0 * kNoise_N) << one.by << ' ' << one.value;
  }
  EXPECT_GE(velocities.size(), 4u) << "ramps at 2, 4, 6, 8 and 10 mm/s, a triangle at 0.05";
}

TEST_F(Heldout, TheModelsNumbersHoldOverAllTheseFits) {
  const HeldoutStudy study = study_heldout(problem_, nominal_, model_, 2);
  const auto force = std::ranges::find(study.stability, "coulomb_friction.force_N", &Stability::parameter);
  ASSERT_NE(force, study.stability.end());
  EXPECT_NEAR(force->value, 0.8, 0.02);
  EXPECT_LE(force->lowest, force->highest);
  EXPECT_NEAR(force->lowest, 0.8, 0.04);
  EXPECT_NEAR(force->highest, 0.8, 0.04);
}

TEST_F(Heldout, AMoveIsPredictedByAFitThatDidNotSeeIt) {
  // A force that only the bins of one move have: left out, all of it is missed; fitted, a part is taken up.
  const MoveNumbers moves = number_moves(series_);
  std::vector<bool> out;
  for (const std::size_t move : moves.of_bin) out.push_back(move == 2);
  std::vector<Series> changed = series_;
  for (std::size_t k = 0; k < out.size(); ++k)
    if (out[k]) changed[0].force_N[k] += 1.0;
  const Problem problem(changed, {kNoise_N, 0.0, 1.0});
  const Prediction missed = predict_left_out(problem, model_, out, 6);
  EXPECT_NEAR(missed.rmse_N(kNoise_N), 1.0, 0.05);
  double readings = 0.0;
  for (std::size_t k = 0; k < out.size(); ++k)
    if (out[k]) readings += changed[0].count[k];
  EXPECT_DOUBLE_EQ(missed.readings, readings);
}

TEST_F(Heldout, FoldsTogetherHoldEveryReadingOnce) {
  const std::vector<Prediction> moves = predict_moves(problem_, model_, 2);
  EXPECT_EQ(moves.size(), number_moves(series_).count);
  double readings = 0.0, all = 0.0;
  for (const Prediction& move : moves) readings += move.readings;
  for (const double count : series_[0].count) all += count;
  EXPECT_NEAR(readings, all, 1e-6 * all);
  EXPECT_NEAR(left_out_rmse_N(problem_, model_, 2), kNoise_N, 0.2 * kNoise_N);
}

TEST(HeldoutStudy, IsEmptyWhereAllMotionIsOfOneKind) {
  test::ConcealedSpecimen bench{.seed = 2};
  messages::Recording recording = test::record(bench);
  // A rest and the first leg of the triangle alone.
  const auto end = std::ranges::find_if(recording.frame.t_s, [](double t) { return t > 98.0; });
  const auto rows = static_cast<std::size_t>(end - recording.frame.t_s.begin());
  recording.frame.t_s.resize(rows);
  recording.frame.position_mm.resize(rows);
  recording.frame.force_N.resize(rows);
  const std::vector<Series> series{prepare_series("triangle", std::move(recording), {})};
  const Problem problem(series, {kNoise_N, 0.0, 1.0});
  const model::ModelSpec nominal = problem.fit(model::nominal_model("slse1"), 10).spec;
  EXPECT_TRUE(study_heldout(problem, nominal, nominal, 1).left_out.empty());
}

}  // namespace
}  // namespace isorig::identify
