#include "identify/diagnose/explain/heldout.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <map>
#include <numbers>
#include <random>
#include <set>

#include "concealed_specimen.hpp"
#include "identify/diagnose/explain/locate.hpp"
#include "identify/diagnose/fit/fading.hpp"
#include "identify/diagnose/fit/left_out.hpp"
#include "identify/diagnose/fit/moves.hpp"
#include "identify/diagnose/search/events.hpp"
#include "identify/diagnose/search/published.hpp"
#include "model/catalogue.hpp"

namespace isorig::identify {
namespace {

constexpr double kNoise_N = 0.02;
constexpr NoiseModel kWhite{kNoise_N, 0.0, 1.0};

class Heldout : public testing::Test {
 protected:
  explicit Heldout(const test::ConcealedSpecimen& bench = {.friction_N = 0.8, .force_noise_N = kNoise_N, .seed = 12})
      : series_{prepare_series("bench", test::record(bench), {})}, problem_(series_, kWhite) {
    nominal_ = problem_.fit(model::nominal_model("slse1"), 20).spec;
    model::ModelSpec spec = nominal_;
    const model::Physics& friction = *model::find_physics("coulomb_friction");
    spec.parts.push_back(model::make_part(friction, friction.laws.front()));
    model_ = problem_.fit(spec, 30).spec;
  }
  [[nodiscard]] HeldoutStudy study() const {
    return LeaveOut(series_, kNoise_N, refit(nominal_, kWhite), 2).study(model_, refit(model_, kWhite), kWhite);
  }

  std::vector<Series> series_;
  Problem problem_;
  model::ModelSpec nominal_, model_;
};

TEST_F(Heldout, TheWorstAndTheMedianBlockAreToBeDrawn) {
  const HeldoutStudy study = this->study();
  ASSERT_GE(study.each_block.size(), 5u);
  std::vector<double> rms;
  double squares = 0.0, readings = 0.0;
  for (const BlockError& one : study.each_block) {
    EXPECT_LT(one.t_start_s, one.t_end_s);
    EXPECT_EQ(one.recording, "bench");
    rms.push_back(std::max(one.nominal_rmse_N, one.model_rmse_N));
    squares += one.readings * one.model_rmse_N * one.model_rmse_N;
    readings += one.readings;
  }
  // Each block's rms is that of single readings, and so is that of all of them: weighed by readings they are the same.
  EXPECT_NEAR(std::sqrt(squares / readings), study.all->model_rmse_N, 1e-9);
  ASSERT_EQ(study.to_draw.size(), 4u) << "of the blocks, then of the velocities and amplitudes";
  const LeftOutStretch &worst = study.to_draw[0], &median = study.to_draw[1];
  EXPECT_TRUE(worst.worst);
  EXPECT_FALSE(median.worst);
  EXPECT_EQ(worst.of, rms.size());
  std::ranges::sort(rms);
  EXPECT_EQ(std::max(worst.nominal_rmse_N, worst.model_rmse_N), rms.back());
  EXPECT_EQ(std::max(median.nominal_rmse_N, median.model_rmse_N), rms[(rms.size() - 1) / 2]);
  // 0.8 N of friction that the nominal model lacks: where it errs most the model that has it stays near the noise.
  EXPECT_GT(worst.nominal_rmse_N, 4.0 * worst.model_rmse_N);
  EXPECT_EQ(study.to_draw[2].worst, true);
  EXPECT_NE(study.to_draw[2].by, "block");
  for (const LeftOutStretch& one : study.to_draw)
    for (std::size_t bin = one.first_bin; bin < one.end_bin; ++bin) EXPECT_TRUE(one.out[bin]) << one.by << ' ' << bin;
}

TEST_F(Heldout, WhatIsDrawnKnowsNothingOfWhatWasMeasuredThere) {
  const LeftOutStretch before = study().to_draw.front();
  // Whatever is measured in all that was left out together: the numbers that it is predicted by stay.
  std::size_t bin = 0;
  for (double& force_N : series_[0].force_N) force_N += before.out[bin++] ? 0.7 : 0.0;
  const HeldoutStudy after = study();
  const auto same =
      std::ranges::find_if(after.to_draw, [&](const LeftOutStretch& one) { return one.out == before.out; });
  ASSERT_NE(same, after.to_draw.end()) << "0.7 N more make it the worst again";
  for (std::size_t p = 0; p < before.model.parts.size(); ++p) {
    for (std::size_t i = 0; i < before.model.parts[p].coefficients.size(); ++i)
      EXPECT_NEAR(same->model.parts[p].coefficients[i], before.model.parts[p].coefficients[i], 1e-9);
    for (std::size_t i = 0; i < before.model.parts[p].parameters.size(); ++i)
      EXPECT_NEAR(same->model.parts[p].parameters[i], before.model.parts[p].parameters[i], 1e-9);
  }
  EXPECT_GT(same->model_rmse_N, 0.5) << "and it errs by what was added";
}

TEST_F(Heldout, EveryVelocityOfTheSessionIsLeftOutAndPredicted) {
  const HeldoutStudy study = this->study();
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
  const HeldoutStudy study = this->study();
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
  const Prediction missed = predict_left_out(changed, refit(model_, kWhite), out, strokes_of(changed));
  EXPECT_NEAR(missed.rmse_N(kNoise_N), 1.0, 0.05);
  double readings = 0.0;
  for (std::size_t k = 0; k < out.size(); ++k)
    if (out[k]) readings += changed[0].count[k];
  EXPECT_DOUBLE_EQ(missed.readings, readings);
}

/// The mixture of two predictions, once by their errors and once by a model that says its share.
TEST_F(Heldout, AShareOfAModelErrsAsTheModelThatPredictsIt) {
  const MoveNumbers moves = number_moves(series_);
  std::vector<bool> out;
  for (const std::size_t move : moves.of_bin) out.push_back(move % 4 == 2);
  const Blocks strokes = strokes_of(series_);
  const Learner learn_nominal = refit(nominal_, kWhite), learn_model = refit(model_, kWhite);
  const auto at = [&](double share) {
    return [&, share](std::span<const Series> kept) {
      model::ModelSpec spec = learn_model(kept);
      spec.seen = ranges_of(kept);
      spec.seen->nominal = learn_nominal(kept).parts;
      spec.seen->share = share;
      return spec;
    };
  };
  const Prediction nominal = predict_left_out(series_, learn_nominal, out, strokes);
  const Prediction whole = predict_left_out(series_, at(1.0), out, strokes);
  const Prediction direct = predict_left_out(series_, at(0.6), out, strokes);
  const Prediction by_errors = mixed(nominal, whole, 0.6);
  EXPECT_GT(nominal.squares_N2, 2.0 * direct.squares_N2);
  EXPECT_GT(direct.squares_N2, 2.0 * whole.squares_N2);
  EXPECT_NEAR(by_errors.squares_N2, direct.squares_N2, 1e-9 * direct.squares_N2);
  EXPECT_EQ(by_errors.readings, direct.readings);
  EXPECT_EQ(by_errors.bins, direct.bins);
  EXPECT_EQ(by_errors.spec.seen->share, 0.6);
  ASSERT_EQ(by_errors.squares_of_stroke.size(), direct.squares_of_stroke.size());
  ASSERT_GT(direct.squares_of_stroke.size(), 1U);
  for (std::size_t i = 0; i < direct.squares_of_stroke.size(); ++i)
    EXPECT_NEAR(by_errors.squares_of_stroke[i], direct.squares_of_stroke[i], 1e-9 * direct.squares_N2);
}

/// What is stated of the readings that were fitted is of the force that is predicted, not of the whole model's.
TEST_F(Heldout, TheErrorOfAShareIsThatOfItsPrediction) {
  model::ModelSpec shared = model_;
  shared.seen.emplace().share = 0.6;
  shared.seen->nominal = nominal_.parts;
  const Excitation& excitation = series_[0].excitation;
  model::RunningModel model(model_, excitation.reference), nominal(nominal_, excitation.reference);
  model.reset(excitation.instants.front());
  nominal.reset(excitation.instants.front());
  double squares_N2 = 0.0;
  for (std::size_t k = 0; k < excitation.instants.size(); ++k) {
    const double with_N = model.step(excitation.instants[k]), without_N = nominal.step(excitation.instants[k]);
    squares_N2 += std::pow(series_[0].recording.frame.force_N[k] - 0.6 * with_N - 0.4 * without_N, 2);
  }
  const double whole_N2 = row_errors(model_, series_[0], {}).squares_N2;
  EXPECT_NEAR(row_errors(shared, series_[0], {}).squares_N2, squares_N2, 1e-9 * squares_N2);
  EXPECT_GT(squares_N2, 2.0 * whole_N2);

  const auto error_in_first_place = [&](const model::ModelSpec& spec) {
    return locate(problem_, nominal_, spec, 1.0).at(0).model_rmse_N;
  };
  EXPECT_GT(error_in_first_place(shared), 1.5 * error_in_first_place(model_));
}

TEST_F(Heldout, WhatNoiseInTheNumbersCostsIsForeseen) {
  // The model is true, its numbers are learnt from noisy readings. The squares of what its prediction is off by are a
  // quadratic form of normal deviates with mean T and variance 2 T^2 at most (all in one direction): the mean of n
  // draws has a standard error of T sqrt(2 / n) at most, here 0.22 T, of which three are allowed.
  constexpr unsigned kDraws = 40;
  const MoveNumbers moves = number_moves(series_);
  std::vector<bool> out;
  for (const std::size_t move : moves.of_bin) out.push_back(move % 3 == 1);
  const Eigen::VectorXd truth_N = problem_.predict(model_);
  std::mt19937 random(31);
  std::normal_distribution<double> normal;
  double sum_N2 = 0.0, foreseen_N2 = 0.0;
  for (unsigned draw = 0; draw < kDraws; ++draw) {
    std::vector<Series> drawn = series_;
    for (std::size_t k = 0; k < out.size(); ++k)
      drawn[0].force_N[k] = truth_N[static_cast<Eigen::Index>(k)] +
                            (drawn[0].count[k] > 0.0 ? kNoise_N / std::sqrt(drawn[0].count[k]) * normal(random) : 0.0);
    const Prediction one = predict_left_out(drawn, refit(model_, kWhite), out, strokes_of(drawn));
    const Eigen::VectorXd off_N = problem_.predict(one.spec) - truth_N;
    for (std::size_t k = 0; k < out.size(); ++k)
      if (out[k]) sum_N2 += drawn[0].count[k] * std::pow(off_N[static_cast<Eigen::Index>(k)], 2);
    foreseen_N2 += learning_error_N2(drawn, one.spec, kWhite, out);
  }
  const double mean_N2 = sum_N2 / kDraws, mean_foreseen_N2 = foreseen_N2 / kDraws;
  EXPECT_GT(mean_N2, 0.0);
  EXPECT_NEAR(mean_N2 / mean_foreseen_N2, 1.0, 3.0 * std::sqrt(2.0 / kDraws)) << mean_N2;
}

TEST_F(Heldout, FoldsTogetherHoldEveryReadingOnce) {
  const Blocks blocks = blocks_of(series_);
  EXPECT_EQ(blocks.kind, BlockKind::kMoves);
  const std::vector<Prediction> moves = predict_blocks(series_, refit(model_, kWhite), blocks, 2);
  EXPECT_EQ(moves.size(), number_moves(series_).count);
  double all = 0.0;
  for (const double count : series_[0].count) all += count;
  EXPECT_NEAR(together(moves).readings, all, 1e-6 * all);
  EXPECT_NEAR(together(moves).rmse_N(kNoise_N), kNoise_N, 0.2 * kNoise_N);
}

TEST_F(Heldout, ByStrokesTheModelIsClearlyTheBetterOne) {
  const HeldoutStudy study = this->study();
  ASSERT_TRUE(study.all.has_value());
  EXPECT_EQ(study.all->strokes, number_moves(series_).count);
  for (const LeftOut& one : study.left_out) {
    if (one.strokes < 4) continue;
    EXPECT_LT(one.more_N2, -2.0 * one.more_error_N2) << one.by << ' ' << one.value;
  }
}

/// A motion at 100 Hz, and 2.5 N/mm with 0.8 N of friction that follows the rate over 0.5 mm/s.
messages::Recording moved(double duration_s, const std::function<double(double)>& position_mm, unsigned seed) {
  std::mt19937 random(seed);
  std::normal_distribution<double> force(0.0, kNoise_N), position(0.0, 1e-4);
  messages::Recording r;
  r.metadata.rest_length_mm = 90.0;
  for (double t_s = 0.0; t_s < duration_s; t_s += 0.01) {
    const double x = position_mm(t_s), v = (position_mm(t_s + 1e-4) - position_mm(t_s - 1e-4)) / 2e-4;
    r.frame.t_s.push_back(t_s);
    r.frame.position_mm.push_back(x + position(random));
    r.frame.force_N.push_back(2.5 * x + 0.8 * std::tanh(v / 0.5) + force(random));
  }
  return r;
}

std::vector<Series> series_of(messages::Recording recording) {
  return {prepare_series("bench", std::move(recording), {})};
}

TEST(Blocks, WithoutRestsAreTheStrokes) {
  const auto series = series_of(moved(
      20.0, [](double t) { return 2.0 * std::sin(2.0 * M_PI * 0.5 * t); }, 1));
  const Blocks blocks = blocks_of(series);
  EXPECT_EQ(blocks.kind, BlockKind::kStrokes);
  EXPECT_EQ(blocks.count, 21u) << "ten periods turn twenty times";
  // A stroke ends where the motion turns: to a bin, which lasts as long as the filter of a motion that never rests.
  for (std::size_t k = 1; k < blocks.of_bin.size(); ++k) {
    if (blocks.of_bin[k] == blocks.of_bin[k - 1]) continue;
    EXPECT_NEAR(std::fabs(std::sin(2.0 * M_PI * 0.5 * series[0].nodes[k].t_s)), 1.0, 0.1) << series[0].nodes[k].t_s;
  }
}

TEST(Blocks, WhereOnlyThePressureMovesAreItsStrokes) {
  messages::Recording r = moved(
      40.0, [](double) { return 0.0; }, 2);
  r.metadata.nominal_pressure_psi = 20.0;
  r.pressure.emplace();
  for (const double t_s : r.frame.t_s) {
    r.pressure->t_s.push_back(t_s);
    r.pressure->pressure_psi.push_back(20.0 + 10.0 * std::sin(2.0 * M_PI * 0.2 * t_s));
  }
  const Blocks blocks = blocks_of(series_of(std::move(r)));
  EXPECT_EQ(blocks.kind, BlockKind::kPressureStrokes);
  EXPECT_EQ(blocks.count, 17u) << "eight periods turn sixteen times";
}

TEST(Blocks, OfOneRampWithItsHoldAreEightStretchesOfTime) {
  const auto series = series_of(moved(
      16.0, [](double t) { return std::min(t, 2.0); }, 3));
  const Blocks blocks = blocks_of(series);
  EXPECT_EQ(blocks.kind, BlockKind::kStretches);
  EXPECT_EQ(blocks.count, 8u);
  const double longest_bin_s = 2.0;  // prepare_series
  for (std::size_t k = 0; k < blocks.of_bin.size(); ++k)
    EXPECT_NEAR(2.0 * static_cast<double>(blocks.of_bin[k]) + 1.0, series[0].nodes[k].t_s, 1.0 + longest_bin_s);
}

TEST(Blocks, OfTooFewReadingsAreNoneAndNothingIsSaid) {
  const auto series = series_of(moved(
      0.3, [](double t) { return t; }, 4));
  EXPECT_EQ(blocks_of(series).kind, BlockKind::kNone);
  const model::ModelSpec nominal = Problem(series, kWhite).fit(model::nominal_model("slse1"), 10).spec;
  const HeldoutStudy study =
      LeaveOut(series, kNoise_N, refit(nominal, kWhite), 1).study(nominal, refit(nominal, kWhite), kWhite);
  EXPECT_FALSE(study.all.has_value());
}

TEST(HeldoutStudy, WithoutRestsNoModelIsLearntFromNothing) {
  const auto series = series_of(moved(
      20.0, [](double t) { return 2.0 * std::sin(2.0 * M_PI * 0.5 * t); }, 5));
  const Problem problem(series, kWhite);
  const model::ModelSpec nominal =
      problem
          .fit(model::parse_model(
              "format = \"isorig-model/1\"\n[[part]]\nphysics = \"spring\"\n[[part]]\nphysics = \"constant\"\n",
              "spring"))
          .spec;
  model::ModelSpec spec = nominal;
  const model::Physics& friction = *model::find_physics("coulomb_friction");
  spec.parts.push_back(model::make_part(friction, *model::find_law(friction, "regularised")));
  const model::ModelSpec model = problem.fit(spec, 30).spec;
  const HeldoutStudy study =
      LeaveOut(series, kNoise_N, refit(nominal, kWhite), 1).study(model, refit(model, kWhite), kWhite);
  ASSERT_TRUE(study.all.has_value());
  // Fitted to nothing, both would leave the whole force: 2.5 N/mm of 2 mm, 3.5 N rms. A spring misses the friction.
  EXPECT_GT(study.all->nominal_rmse_N, 0.5);
  EXPECT_LT(study.all->nominal_rmse_N, 0.8);
  EXPECT_LT(study.all->model_rmse_N, 2.0 * kNoise_N);
}

TEST(HeldoutStudy, LeavesEveryRecordingOut) {
  std::vector<Series> series;
  for (const double stretch_mm : {1.0, 2.0, 3.0}) {
    series.push_back(prepare_series("by " + std::to_string(static_cast<int>(stretch_mm)),
                                    moved(
                                        10.0, [=](double t) { return stretch_mm * std::sin(2.0 * M_PI * 0.5 * t); }, 6),
                                    {}));
  }
  // One of them reads 1 N more throughout: nothing that the others know.
  for (double& force_N : series[1].force_N) force_N += 1.0;
  const model::ModelSpec nominal = Problem(series, kWhite).fit(model::nominal_model("slse1"), 20).spec;
  const HeldoutStudy study =
      LeaveOut(series, kNoise_N, refit(nominal, kWhite), 2).study(nominal, refit(nominal, kWhite), kWhite);
  std::map<std::string, double> rmse_N;
  for (const LeftOut& one : study.left_out)
    if (one.by == "recording") rmse_N[one.value] = one.nominal_rmse_N;
  ASSERT_EQ(rmse_N.size(), 3u);
  EXPECT_GT(rmse_N["by 2"], 1.0);
  EXPECT_LT(rmse_N["by 3"], rmse_N["by 2"]);
}

TEST(LearnAgain, ATableIsLearntFromWhatIsKeptAlone) {
  // A ripple of 0.5 N over 0.4 mm, and a table that says something else altogether.
  const auto series = series_of(test::record({.ripple_N = 0.5, .force_noise_N = kNoise_N, .seed = 7}));
  const Problem problem(series, kWhite);
  const model::ModelSpec nominal = problem.fit(model::nominal_model("slse1"), 20).spec;
  model::ModelSpec spec = nominal;
  const model::Physics& table = *model::find_physics("empirical_force");
  spec.parts.push_back(model::make_part(table, *model::find_law(table, "position")));
  spec.parts.back().fixed = true;
  spec.parts.back().table = {-3.0, 1.0, {9.0, -9.0, 9.0, -9.0, 9.0, -9.0, 9.0}};
  const Learner learner = learn_again(spec, {kWhite, false});
  const model::ModelSpec learnt = learner(series);
  spec.parts.back().table = {-3.0, 6.0, {0.0, 0.0}};
  EXPECT_EQ(model::model_text(learn_again(spec, {kWhite, false})(series)), model::model_text(learnt));
  // On moves that it was not learnt from it holds: 0.35 N rms of ripple become less than half.
  const Blocks blocks = blocks_of(series);
  const double with_N = together(predict_blocks(series, learner, blocks, 2)).rmse_N(kNoise_N);
  const double without_N = together(predict_blocks(series, refit(nominal, kWhite), blocks, 2)).rmse_N(kNoise_N);
  EXPECT_LT(with_N, 0.5 * without_N);
}

// Half a period of a drift of 0.3 N, and the third of the session that is left out in one piece: six cosines that are
// looked at elsewhere alone would be anything there, and take the stiffness with them.
TEST(LearnAgain, AWanderIsAStateAndLeavesTheMaterialAlone) {
  messages::Recording recording = test::record({.force_noise_N = kNoise_N, .seed = 9});
  const double end_s = recording.frame.t_s.back();
  for (std::size_t k = 0; k < recording.frame.size(); ++k)
    recording.frame.force_N[k] += 0.3 * std::cos(std::numbers::pi * 3.0 * recording.frame.t_s[k] / end_s);
  const auto series = series_of(std::move(recording));
  const Problem problem(series, kWhite);
  model::ModelSpec spec = model::nominal_model("slse1");
  const model::Physics& drift = *model::find_physics("zero_drift");
  spec.parts.push_back(model::make_part(drift, *model::find_law(drift, "wander")));
  spec.parts.back().parameters[0] = end_s;
  spec = problem.fit(spec, 30).spec;
  ASSERT_TRUE(is_state(spec.parts.back()));
  ASSERT_FALSE(is_state(spec.parts.front()));

  std::vector<bool> out;
  for (const auto& node : series[0].nodes) out.push_back(node.t_s > end_s / 3.0 && node.t_s < 2.0 * end_s / 3.0);
  const Prediction missed = predict_left_out(series, learn_again(spec, {kWhite, false}), out, strokes_of(series));
  EXPECT_LT(missed.rmse_N(kNoise_N), 1.2 * kNoise_N);
  EXPECT_NEAR(missed.spec.parts.front().coefficients[0], spec.parts.front().coefficients[0],
              0.01 * spec.parts.front().coefficients[0]);
}

TEST(HeldoutStudy, HasNoKindsWhereAllMotionIsOfOneKind) {
  test::ConcealedSpecimen bench{.seed = 2};
  messages::Recording recording = test::record(bench);
  // A rest and the first leg of the triangle alone.
  const auto end = std::ranges::find_if(recording.frame.t_s, [](double t) { return t > 98.0; });
  const auto rows = static_cast<std::size_t>(end - recording.frame.t_s.begin());
  recording.frame.t_s.resize(rows);
  recording.frame.position_mm.resize(rows);
  recording.frame.force_N.resize(rows);
  const std::vector<Series> series{prepare_series("triangle", std::move(recording), {})};
  const model::ModelSpec nominal = Problem(series, kWhite).fit(model::nominal_model("slse1"), 10).spec;
  const LeaveOut leave_out(series, kNoise_N, refit(nominal, kWhite), 1);
  EXPECT_TRUE(leave_out.study(nominal, refit(nominal, kWhite), kWhite).left_out.empty());
}

}  // namespace
}  // namespace isorig::identify
