#include "identify/diagnose/fit/free_parameters.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numeric>
#include <vector>

#include "concealed_specimen.hpp"
#include "identify/diagnose/fit/fit.hpp"
#include "identify/diagnose/fit/moves.hpp"
#include "model/catalogue.hpp"

namespace isorig::identify {
namespace {

class OnTheBench : public testing::Test {
 protected:
  OnTheBench() {
    series_.push_back(prepare_series("bench", test::record_other({}), {}));
    series_.back().excitation.reference.nominal_pressure_psi = 15.0;
  }
  std::vector<Series> series_;
};

/// Of two columns, one's error in shares of the other; without the hundredth of the readings that differ most, rounded
/// up, if the law bends there.
double error_of(const Eigen::VectorXd& one, const Eigen::VectorXd& reference, bool bends) {
  std::vector<double> squares;
  for (Eigen::Index i = 0; i < one.size(); ++i)
    if (one[i] != 0.0 || reference[i] != 0.0) squares.push_back(std::pow(one[i] - reference[i], 2));
  std::ranges::sort(squares);
  if (bends) squares.resize(squares.size() - (squares.size() + 99) / 100);
  return std::sqrt(std::accumulate(squares.begin(), squares.end(), 0.0)) / reference.norm();
}

/// The step that all derivatives use against a far finer reference: central differences of a quarter and a half of it,
/// extrapolated. Laws that jump or bend in a parameter (a gap, a knee, a threshold) have a slope almost everywhere, and
/// nothing to extrapolate by where they bend: their reference is the finer of the two, and what lies within a step of
/// the bend is left out.
TEST_F(OnTheBench, TheOneStepIsGoodToHalfAPerCentForEverySmoothLaw) {
  const Problem problem(series_, {0.02, 0.0, 1.0});
  for (const model::Physics* effect : model::effects()) {
    for (const model::Law& law : effect->laws) {
      model::ModelSpec spec = model::nominal_model("slse1");
      spec.parts.push_back(model::make_part(*effect, law));
      for (const FreeNumber& number : free_parameters(spec)) {
        if (number.part + 1 != spec.parts.size()) continue;
        const auto force = [&](double by) {
          model::ModelSpec moved = spec;
          value_of(moved, number) += by;
          return problem.predict(moved);
        };
        const double h = difference_step(spec, number);
        const Eigen::VectorXd one = (force(h) - force(0.0)) / h;
        const Eigen::VectorXd half = (force(0.5 * h) - force(-0.5 * h)) / h;
        const Eigen::VectorXd quarter = 2.0 * (force(0.25 * h) - force(-0.25 * h)) / h;
        const std::string_view name = law.parameters[number.index].name;
        const bool bends = name == "gap_mm" || name == "start" || name == "presliding_mm" || name == "yield_mm" ||
                           name == "delay_s" || law.name == "knee";
        const Eigen::VectorXd reference = bends ? quarter : (4.0 * quarter - half) / 3.0;
        if (reference.norm() == 0.0) continue;  // a knee beyond the stroke
        const double error = error_of(one, reference, bends);
        EXPECT_LT(error, 5e-3) << effect->name << ' ' << law.name << ' ' << name;
      }
    }
  }
}

TEST_F(OnTheBench, NeitherWhatIsGivenNorWhatIsScannedNorWhatIsFixedIsSearched) {
  model::ModelSpec spec = model::nominal_model("slse2");
  spec.parts[2].fixed = true;  // the second arm
  const model::Physics& slip = *model::find_physics("grip_slip");
  spec.parts.push_back(model::make_part(slip, slip.laws[0]));
  const std::vector<FreeNumber> found = free_parameters(spec);
  ASSERT_EQ(found.size(), 2u);
  EXPECT_EQ(parameter_of(spec, found[0]).name, "time_constant_s");
  EXPECT_EQ(found[0].part, 1u);
  EXPECT_EQ(parameter_of(spec, found[1]).name, "slip_mm");
  EXPECT_EQ(free_coefficients(spec).size(), 3u);
  // Spring, arm and its time, tare, slip and its time twice: a force that is zero counts nothing, nor does its arm.
  spec.parts[0].coefficients[0] = 2.0;
  spec.parts[3].coefficients[0] = 0.1;
  EXPECT_EQ(counted_numbers(spec), 7u);
  spec.parts[1].coefficients[0] = 0.0;
  EXPECT_EQ(counted_numbers(spec), 5u);
}

TEST_F(OnTheBench, AStepStaysWithinTheUpperBound) {
  model::ModelSpec spec = model::nominal_model("slse1");
  const model::Physics& play = *model::find_physics("crosshead_backlash");
  spec.parts.push_back(model::make_part(play, play.laws[0]));
  const FreeNumber start{3, 1, false};
  value_of(spec, start) = 1.0;
  EXPECT_LT(difference_step(spec, start), 0.0);
  value_of(spec, start) = -1.0;
  EXPECT_GT(difference_step(spec, start), 0.0);
  EXPECT_TRUE(at_bound(parameter_of(spec, start), -1.0));
  EXPECT_TRUE(at_bound(parameter_of(spec, start), 1.0));
  EXPECT_FALSE(at_bound(parameter_of(spec, start), 0.99));
}

TEST_F(OnTheBench, AMoveBeginsWhereARestEndsAndARecordingBeginsOne) {
  series_.push_back(series_.front());
  const MoveNumbers moves = number_moves(series_);
  const std::size_t bins = series_[0].nodes.size();
  ASSERT_EQ(moves.of_bin.size(), 2 * bins);
  EXPECT_EQ(moves.of_bin[bins], moves.of_bin[bins - 1] + 1);
  EXPECT_EQ(moves.count, 2 * moves.of_bin[bins]);
  EXPECT_GT(moves.of_bin[bins], 2u) << "the bench's session has several moves";
  for (std::size_t k = 1; k < bins; ++k) {
    if (moves.of_bin[k] == moves.of_bin[k - 1]) continue;
    EXPECT_GT(series_[0].since_corner_s[k - 1], deciding().rest_s);
    EXPECT_EQ(series_[0].since_corner_s[k], 0.0);
  }
}

}  // namespace
}  // namespace isorig::identify
