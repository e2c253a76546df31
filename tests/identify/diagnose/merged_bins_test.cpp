#include "identify/diagnose/fit/merged_bins.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <numeric>

#include "concealed_specimen.hpp"
#include "identify/diagnose/fit/fit.hpp"
#include "identify/diagnose/fit/many_starts.hpp"
#include "model/catalogue.hpp"
#include "model/elements.hpp"

namespace isorig::identify {
namespace {

std::vector<Series> bench(const test::ConcealedSpecimen& concealed) {
  messages::Recording recording = test::record(concealed);
  const std::vector<bool> usable(recording.frame.size(), true);
  std::vector<Series> out;
  out.push_back(prepare_series("bench", std::move(recording), usable));
  return out;
}

double readings_times_force(const Series& series) {
  return std::inner_product(series.count.begin(), series.count.end(), series.force_N.begin(), 0.0);
}

/// First bin after `time_s`.
std::size_t bin_after(const Series& series, double time_s) {
  return static_cast<std::size_t>(std::ranges::upper_bound(series.nodes, time_s, {}, &model::Instant::t_s) -
                                  series.nodes.begin());
}

TEST(MergedBins, HoldTheSameReadingsTimeAndTravel) {
  const std::vector<Series> fine = bench({});
  const Series& of = fine.front();
  constexpr std::size_t kTogether = 4;
  const Series merged = merged_bins(fine, kTogether).front();
  EXPECT_LT(merged.nodes.size(), of.nodes.size() / 2);
  EXPECT_GE(merged.nodes.size(), of.nodes.size() / kTogether);
  const double readings = std::accumulate(of.count.begin(), of.count.end(), 0.0);
  EXPECT_NEAR(std::accumulate(merged.count.begin(), merged.count.end(), 0.0), readings, 1e-9 * readings);
  EXPECT_NEAR(readings_times_force(merged), readings_times_force(of), 1e-9 * std::fabs(readings_times_force(of)));
  double time_s = merged.nodes.front().t_s, position_mm = merged.nodes.front().position_mm, slid_mm = 0.0;
  for (std::size_t k = 1; k < merged.nodes.size(); ++k) {
    const model::Instant& bin = merged.nodes[k];
    EXPECT_GT(bin.dt_s, 0.0);
    EXPECT_NEAR(time_s += bin.dt_s, bin.t_s, 1e-9);
    EXPECT_NEAR(position_mm += bin.step_mm, bin.position_mm, 1e-9);
    slid_mm += bin.slide_mm;
  }
  // To what is left of the last bins' own travel after their mean.
  double fine_slid_mm = 0.0, last_mm = 0.0;
  for (std::size_t k = 1; k < of.nodes.size(); ++k) fine_slid_mm += of.nodes[k].slide_mm;
  for (std::size_t k = of.nodes.size() - kTogether; k < of.nodes.size(); ++k)
    last_mm += std::fabs(of.nodes[k].slide_mm);
  EXPECT_NEAR(slid_mm, fine_slid_mm, last_mm + 1e-12);
}

TEST(MergedBins, BeginAtEveryCornerAndAfterTheFirst) {
  const std::vector<Series> fine = bench({});
  const Series& of = fine.front();
  const Series merged = merged_bins(fine, 4).front();
  EXPECT_EQ(merged.first_row[1], of.first_row[1]);
  std::size_t corners = 0;
  for (std::size_t k = 1; k < of.nodes.size(); ++k) {
    if (of.since_corner_s[k] > of.since_corner_s[k - 1]) continue;
    ++corners;
    EXPECT_TRUE(std::ranges::binary_search(merged.first_row, of.first_row[k])) << "at " << of.nodes[k].t_s << " s";
  }
  EXPECT_GE(corners, 10U);
}

/// A mean over both sides of a slip would leave more than any law beside it could take away.
TEST(MergedBins, KeepTheSidesOfASlipApart) {
  constexpr double kSlip_s = 60.03;
  const std::vector<Series> fine = bench({.slip_mm = 0.4, .slip_s = kSlip_s});
  const Series& of = fine.front();
  const Series merged = merged_bins(fine, 4).front();
  const std::size_t after = bin_after(of, kSlip_s);
  // The bin in which it slips holds readings of both sides; the force goes furthest into it or out of it.
  const double into_N = std::fabs(of.force_N[after] - of.force_N[after - 1]),
               before_N = std::fabs(of.force_N[after - 1] - of.force_N[after - 2]);
  const std::size_t first = into_N > before_N ? after : after - 1;
  EXPECT_GT(std::max(into_N, before_N), 0.2);
  EXPECT_TRUE(std::ranges::binary_search(merged.first_row, of.first_row[first]));
}

/// The same model leaves no more of merged bins than of the bins: each is a mean of residuals.
TEST(MergedBins, LeaveNoMoreOfAModelThatFits) {
  const std::vector<Series> fine = bench({});
  const NoiseModel noise{0.02, 0.0, 1.0};
  const Problem problem(fine, noise);
  const Fit fit = problem.fit(model::nominal_model("slse1"), 30);
  const auto time_constant_s = [](const model::ModelSpec& spec) {
    return std::ranges::find(spec.parts, &model::element::maxwell(), &model::Part::physics)->parameters[0];
  };
  for (const std::size_t together : {2U, 3U, 4U}) {
    const std::vector<Series> fewer = merged_bins(fine, together);
    const Problem coarse(fewer, noise);
    EXPECT_LT(squares_of(coarse, fit.spec), fit.chi2);
    // And its own optimum is the same, to a hundredth of the time constant.
    const Fit again = coarse.fit(fit.spec, 30);
    EXPECT_NEAR(time_constant_s(again.spec), time_constant_s(fit.spec), 1e-2 * time_constant_s(fit.spec));
  }
}

TEST(MergedBins, AreTheBinsThemselvesIfNoneAreMerged) {
  const std::vector<Series> fine = bench({});
  const Series same = merged_bins(fine, 1).front();
  EXPECT_EQ(same.force_N, fine.front().force_N);
  EXPECT_EQ(same.count, fine.front().count);
  EXPECT_EQ(same.first_row, fine.front().first_row);
}

}  // namespace
}  // namespace isorig::identify
