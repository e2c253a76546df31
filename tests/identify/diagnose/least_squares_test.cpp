// The two solvers below every fit, on problems whose answer is known.
#include <gtest/gtest.h>

#include <cmath>

#include "identify/diagnose/fit/nonlinear_least_squares.hpp"
#include "identify/diagnose/fit/signed_least_squares.hpp"

namespace isorig::identify {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

LeastSquaresProblem boxed(double half_width, Eigen::Index count) {
  LeastSquaresProblem problem;
  problem.lower = VectorXd::Constant(count, -half_width);
  problem.upper = VectorXd::Constant(count, half_width);
  problem.longest_step = VectorXd::Constant(count, 1.5);
  problem.difference_steps = [](const VectorXd& u) { return VectorXd::Constant(u.size(), 1e-3); };
  return problem;
}

/// Two columns that differ by 1e-6 of their length, weighed so that one unit along the valley between them is worth
/// 100 standard deviations: well determined, and badly conditioned.
TEST(NonlinearLeastSquares, FindsTheFloorOfAValleyThatNormalEquationsDoNotSee) {
  constexpr int kRows = 200;
  constexpr double kApart = 1e-6;
  MatrixXd a(kRows, 2);
  for (int i = 0; i < kRows; ++i) {
    const double x = static_cast<double>(i) / kRows;
    a(i, 0) = 1e7 * std::sin(3.0 * x);
    a(i, 1) = 1e7 * (std::sin(3.0 * x) + kApart * std::cos(7.0 * x));
  }
  const VectorXd truth = (VectorXd(2) << 1.3, -0.9).finished();
  const VectorXd measured = a * truth;
  LeastSquaresProblem problem = boxed(10.0, 2);
  problem.residual = [&](const VectorXd& u, VectorXd& r) { r = a * u - measured; };
  const LeastSquaresResult found = minimise_squares(problem, VectorXd::Zero(2), 60);
  EXPECT_EQ(found.stop, Stop::kConverged) << name_of(found.stop);
  EXPECT_NEAR(found.u[0], truth[0], 1e-2);
  EXPECT_NEAR(found.u[1], truth[1], 1e-2);
  EXPECT_LT(found.squares, 1.0);
}

TEST(NonlinearLeastSquares, WalksACurvedValley) {
  // Rosenbrock's, as squares: 10 (y - x^2) and 1 - x.
  LeastSquaresProblem problem = boxed(5.0, 2);
  problem.residual = [](const VectorXd& u, VectorXd& r) {
    r.resize(2);
    r << 1e3 * (u[1] - u[0] * u[0]), 1e2 * (1.0 - u[0]);
  };
  const VectorXd start = (VectorXd(2) << -1.2, 1.0).finished();
  const LeastSquaresResult found = minimise_squares(problem, start, 200);
  EXPECT_EQ(found.stop, Stop::kConverged) << name_of(found.stop);
  EXPECT_NEAR(found.u[0], 1.0, 1e-3);
  EXPECT_NEAR(found.u[1], 1.0, 2e-3);
  const LeastSquaresResult cut_short = minimise_squares(problem, start, 3);
  EXPECT_EQ(cut_short.stop, Stop::kIterationLimit);
  EXPECT_GT(cut_short.squares, found.squares + 1.0);
}

TEST(NonlinearLeastSquares, SaysThatANumberStandsAtItsBoundAndFitsTheOther) {
  // Along the bound u0 = 0.5 the best u1 is 2 - 0.8 * 0.5; a search that only clips its steps would crawl there.
  LeastSquaresProblem problem = boxed(3.0, 2);
  problem.upper[0] = 0.5;
  problem.residual = [](const VectorXd& u, VectorXd& r) {
    r.resize(2);
    r << 100.0 * (u[1] + 0.8 * u[0] - 2.0), 10.0 * (u[0] - 1.0);
  };
  const LeastSquaresResult found = minimise_squares(problem, VectorXd::Zero(2), 30);
  EXPECT_EQ(found.stop, Stop::kAtBounds) << name_of(found.stop);
  EXPECT_DOUBLE_EQ(found.u[0], 0.5);
  EXPECT_NEAR(found.u[1], 1.6, 1e-4);
}

TEST(NonlinearLeastSquares, SaysThatSlopesPromiseWhatNoStepFinds) {
  // The difference quotient sees a slope of a thousand; every step that follows it falls off a cliff.
  LeastSquaresProblem problem = boxed(3.0, 1);
  problem.residual = [](const VectorXd& u, VectorXd& r) {
    r.resize(1);
    r << (u[0] == 0.0 ? 10.0 : u[0] == 1e-3 ? 9.0 : 1e3);
  };
  const LeastSquaresResult found = minimise_squares(problem, VectorXd::Zero(1), 30);
  EXPECT_EQ(found.stop, Stop::kNoProgress) << name_of(found.stop);
  EXPECT_EQ(found.u[0], 0.0);
}

TEST(NonlinearLeastSquares, HasNothingToDoWithoutNumbers) {
  LeastSquaresProblem problem = boxed(1.0, 0);
  problem.residual = [](const VectorXd&, VectorXd& r) { r = VectorXd::Constant(3, 2.0); };
  const LeastSquaresResult found = minimise_squares(problem, VectorXd(0), 5);
  EXPECT_EQ(found.stop, Stop::kConverged);
  EXPECT_DOUBLE_EQ(found.squares, 12.0);
  EXPECT_EQ(found.evaluations, 1);
}

class NearlyTheSame : public testing::Test {
 protected:
  NearlyTheSame() : columns_(300, 3) {
    for (int i = 0; i < 300; ++i) {
      const double x = static_cast<double>(i) / 300.0;
      columns_(i, 0) = 1.0;
      columns_(i, 1) = std::exp(-3.0 * x);
      columns_(i, 2) = std::exp(-3.0 * x * (1.0 + kApart));
    }
  }
  static constexpr double kApart = 1e-7;
  MatrixXd columns_;
  std::vector<model::Sign> signs_{model::Sign::kFree, model::Sign::kNonNegative, model::Sign::kNonNegative};
};

TEST_F(NearlyTheSame, AreToldApartFromTheColumnsAndRefusedByTheNormalEquations) {
  const VectorXd truth = (VectorXd(3) << -0.5, 2.0, 1.0).finished();
  const VectorXd target = columns_ * truth;
  Reduced reduced;
  EXPECT_FALSE(reduce_normal_equations(columns_.transpose() * columns_, columns_.transpose() * target, reduced));
  const VectorXd found = solve_signed(reduce_columns(columns_, target), signs_);
  for (int i = 0; i < 3; ++i) EXPECT_NEAR(found[i], truth[i], 1e-6) << i;

  // The same by normal equations with a ridge, as it was until now: the two share their sum evenly.
  MatrixXd gram = columns_.transpose() * columns_;
  const VectorXd scale = gram.diagonal().cwiseSqrt().cwiseInverse();
  gram = scale.asDiagonal() * gram * scale.asDiagonal();
  gram.diagonal().array() += 1e-13;
  const VectorXd ridged =
      scale.asDiagonal() * gram.ldlt().solve(VectorXd(scale.asDiagonal() * (columns_.transpose() * target)));
  EXPECT_GT(std::fabs(ridged[1] - truth[1]), 0.1) << "then this test shows nothing";
}

TEST_F(NearlyTheSame, ShareWhatTheyStandForWhenTheyAreTheSame) {
  columns_.col(2) = columns_.col(1);
  const VectorXd target = columns_ * (VectorXd(3) << 0.3, 2.0, 1.0).finished();
  const VectorXd found = solve_signed(reduce_columns(columns_, target), signs_);
  EXPECT_NEAR(found[0], 0.3, 1e-9);
  EXPECT_NEAR(found[1], 1.5, 1e-9);
  EXPECT_NEAR(found[2], 1.5, 1e-9);
}

TEST_F(NearlyTheSame, BothWaysGiveTheSameWhereTheConditionIsFair) {
  for (int i = 0; i < 300; ++i) columns_(i, 2) = i / 300.0;
  const VectorXd target = columns_ * (VectorXd(3) << 0.3, -2.0, 1.0).finished();
  for (const auto& signs : {signs_, std::vector<model::Sign>(3, model::Sign::kFree),
                            std::vector<model::Sign>(3, model::Sign::kNonPositive)}) {
    Reduced reduced;
    ASSERT_TRUE(reduce_normal_equations(columns_.transpose() * columns_, columns_.transpose() * target, reduced));
    const VectorXd normal = solve_signed(reduced, signs),
                   direct = solve_signed(reduce_columns(columns_, target), signs);
    EXPECT_LT((normal - direct).norm(), 1e-8);
    for (int i = 0; i < 3; ++i) {
      const model::Sign sign = signs[static_cast<std::size_t>(i)];
      EXPECT_TRUE(sign != model::Sign::kNonNegative || direct[i] >= 0.0) << direct[i];
      EXPECT_TRUE(sign != model::Sign::kNonPositive || direct[i] <= 0.0) << direct[i];
    }
  }
}

TEST_F(NearlyTheSame, AnEmptyColumnGetsNothing) {
  columns_.col(2).setZero();
  const VectorXd target = columns_ * (VectorXd(3) << 0.3, 2.0, 0.0).finished();
  Reduced reduced;
  ASSERT_TRUE(reduce_normal_equations(columns_.transpose() * columns_, columns_.transpose() * target, reduced));
  for (const Reduced& each : {reduced, reduce_columns(columns_, target)}) {
    const VectorXd found = solve_signed(each, signs_);
    EXPECT_NEAR(found[1], 2.0, 1e-9);
    EXPECT_EQ(found[2], 0.0);
  }
}

}  // namespace
}  // namespace isorig::identify
