// The published nominal model against an optimiser that shares no line with identify/ or model/.
#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>
#include <random>

#include "concealed_specimen.hpp"
#include "identify/diagnose/diagnosis.hpp"
#include "identify/diagnose/search/events.hpp"
#include "identify/diagnose/search/published.hpp"
#include "model/catalogue.hpp"

namespace isorig::identify {
namespace {

using test::ConcealedSpecimen;

/// k, arm and tare by least squares, signs obeyed by trying without; the time constant by its logarithm.
class Independent {
 public:
  explicit Independent(const messages::Recording& r) : frame_(r.frame) {}

  /// Least rms over Nelder and Mead's search in (ln k, ln arm, ln tau, tare) from 20 starts.
  [[nodiscard]] double least_rms_N() const {
    std::mt19937 random(20);
    std::uniform_real_distribution<double> uniform;
    double least = 1e300;
    for (int start = 0; start < 20; ++start) {
      Eigen::Vector4d x{std::log(0.2 + 6.0 * uniform(random)), std::log(0.05 + 6.0 * uniform(random)),
                        std::log(0.02) + uniform(random) * std::log(1e4), -40.0 + 80.0 * uniform(random)};
      for (int round = 0; round < 3; ++round) x = descend(x);  // a simplex that has collapsed begins anew
      least = std::min(least, rms_N(x));
    }
    return least;
  }

 private:
  [[nodiscard]] double rms_N(const Eigen::Vector4d& x) const {
    const double k = std::exp(x[0]), arm = std::exp(x[1]), tau = std::exp(x[2]);
    double z = 0.0, squares = 0.0;
    for (std::size_t i = 0; i < frame_.size(); ++i) {
      if (i > 0) {
        const double dt = frame_.t_s[i] - frame_.t_s[i - 1], keep = std::exp(-dt / tau);
        z = z * keep + (frame_.position_mm[i] - frame_.position_mm[i - 1]) * (1.0 - keep) * tau / dt;
      }
      const double error = k * frame_.position_mm[i] + arm * z + x[3] + kOffset - frame_.force_N[i];
      squares += error * error;
    }
    return std::sqrt(squares / static_cast<double>(frame_.size()));
  }

  [[nodiscard]] Eigen::Vector4d descend(const Eigen::Vector4d& from) const {
    std::array<std::pair<double, Eigen::Vector4d>, 5> simplex;
    for (int i = 0; i < 5; ++i) {
      Eigen::Vector4d x = from;
      if (i > 0) x[i - 1] += i == 4 ? 5.0 : 0.5;
      simplex[static_cast<std::size_t>(i)] = {rms_N(x), x};
    }
    const auto by_rms = [](const auto& a, const auto& b) { return a.first < b.first; };
    for (int step = 0; step < 250; ++step) {
      std::ranges::sort(simplex, by_rms);
      if (simplex[4].first - simplex[0].first < 1e-7 * simplex[0].first) break;
      Eigen::Vector4d middle = Eigen::Vector4d::Zero();
      for (int i = 0; i < 4; ++i) middle += 0.25 * simplex[static_cast<std::size_t>(i)].second;
      const auto at = [&](double t) {
        const Eigen::Vector4d x = middle + t * (simplex[4].second - middle);
        return std::pair{rms_N(x), x};
      };
      auto moved = at(-1.0);
      if (moved.first < simplex[0].first) {
        if (auto farther = at(-2.0); farther.first < moved.first) moved = farther;
      } else if (moved.first >= simplex[3].first) {
        moved = at(0.5);
      }
      if (moved.first < simplex[4].first) {
        simplex[4] = moved;
        continue;
      }
      for (std::size_t i = 1; i < 5; ++i) {
        simplex[i].second = 0.5 * (simplex[0].second + simplex[i].second);
        simplex[i].first = rms_N(simplex[i].second);
      }
    }
    return std::ranges::min_element(simplex, by_rms)->second;
  }

  static constexpr double kOffset = 50.0;  // k times the elongation at zero, give or take the tare
  const messages::FrameSamples& frame_;
};

double rms_N(const model::ModelSpec& spec, const Series& series) {
  const RowErrors errors = row_errors(spec, series, {});
  return std::sqrt(errors.squares_N2 / static_cast<double>(errors.rows));
}

struct Published {
  explicit Published(const messages::Recording& recording)
      : series{prepare_series("bench", recording, {})}, search(series, instrument_noise(series, {}).weighing, 2) {
    selection.pool.push_back(search.nominal(model::nominal_model("slse1")));
    weighed_N = rms_N(selection.nominal().fit.spec, series[0]);
    published_N = rms_N(published_nominal(search, selection, {}, 2).fit.spec, series[0]);
  }
  std::vector<Series> series;
  Search search;
  Selection selection;
  double weighed_N = 0.0, published_N = 0.0;
};

constexpr double kBar = 1.01;

class Nominal : public testing::TestWithParam<ConcealedSpecimen> {};
TEST_P(Nominal, IsWithinOnePercentOfAnIndependentOptimiser) {
  const messages::Recording recording = test::record(GetParam());
  const Published found(recording);
  const double least_N = Independent(recording).least_rms_N();
  EXPECT_LT(found.published_N, kBar * least_N);
  EXPECT_GT(found.published_N, least_N / kBar) << "the independent optimiser did not arrive";
}
// What is concealed is 20 to 400 times the noise of 0.02 N.
INSTANTIATE_TEST_SUITE_P(MuchConcealed, Nominal,
                         testing::Values(ConcealedSpecimen{.friction_N = 4.0},
                                         ConcealedSpecimen{.quadratic_N_mm2 = 1.5},
                                         ConcealedSpecimen{.softening_N_mm = 0.4, .softening_travel_mm = 40.0},
                                         ConcealedSpecimen{.second_arm_N_mm = 4.0, .second_arm_s = 20.0},
                                         ConcealedSpecimen{.drift_N_h = 20.0},
                                         ConcealedSpecimen{.ripple_N = 3.0, .ripple_mm = 1.7}));

TEST(NominalModel, OfTheSearchIsNotItWhereMuchIsLacking) {
  // The reason for publishing another: what likelihood weighs by is far from what least squares reach.
  const Published found(test::record({.softening_N_mm = 0.4, .softening_travel_mm = 40.0}));
  EXPECT_GT(found.weighed_N, 1.1 * found.published_N);
}

TEST(NominalModel, StaysThatOfTheSearchWhereNothingIsLacking) {
  const Published found(test::record({.coloured_N = 0.04, .seed = 3}));
  EXPECT_LT(found.weighed_N, kBar * found.published_N);
}

TEST(NominalModel, IsWhatTheDiagnosisHandsOut) {
  const messages::Recording recording = test::record({.softening_N_mm = 0.4, .softening_travel_mm = 40.0});
  const double least_N = Independent(recording).least_rms_N();
  const Study study = diagnose({recording}, {"bench"}, model::nominal_model("slse1"), {});
  const Diagnosis& d = study.diagnosis;
  ASSERT_EQ(d.missing.size(), 1u);
  EXPECT_EQ(d.missing[0].effect->name, "cyclic_softening");
  EXPECT_LT(d.nominal_errors.train_rmse_N, kBar * least_N);
  EXPECT_NEAR(rms_N(d.nominal, study.series[0]), d.nominal_errors.train_rmse_N, 1e-9);
}

}  // namespace
}  // namespace isorig::identify
