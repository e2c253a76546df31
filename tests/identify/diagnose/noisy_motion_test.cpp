// Motions whose readings are so noisy that corners are hidden and bends are drawn as polygons.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>
#include <random>

#include "identify/diagnose/fit/series.hpp"
#include "identify/diagnose/motion/curved_motion.hpp"
#include "identify/diagnose/motion/white_jerk.hpp"

namespace isorig::identify {
namespace {

constexpr double kStep_s = 1e-3, kNoise_mm = 7e-3;

/// Ramps, holds and sines in turn, its corners rounded by a mean over 20 ms.
class Path {
 public:
  void hold(double seconds) {
    for (int k = 0; k < seconds / kStep_s; ++k) add(x_mm_.back());
  }
  void ramp(double to_mm, double mm_s) {
    const double from_mm = x_mm_.back();
    const int steps = static_cast<int>(std::fabs(to_mm - from_mm) / mm_s / kStep_s);
    for (int k = 1; k < steps; ++k) add(from_mm + (to_mm - from_mm) * k / steps);
    corners_s_.push_back(kStep_s * static_cast<double>(x_mm_.size()));
    add(to_mm);
  }
  void sine(double amplitude_mm, double frequency_Hz, int periods) {
    const double middle_mm = x_mm_.back(), w = 2.0 * std::numbers::pi * frequency_Hz;
    const int steps = static_cast<int>(periods / frequency_Hz / kStep_s);
    for (int k = 1; k <= steps; ++k) add(middle_mm + amplitude_mm * std::sin(w * kStep_s * k));
  }
  [[nodiscard]] std::vector<double> rounded() const {
    constexpr std::ptrdiff_t kHalf = 10;
    const auto n = static_cast<std::ptrdiff_t>(x_mm_.size());
    std::vector<double> out(x_mm_.size());
    for (std::ptrdiff_t k = 0; k < n; ++k) {
      const std::ptrdiff_t from = std::max<std::ptrdiff_t>(0, k - kHalf), to = std::min(n, k + kHalf + 1);
      out[static_cast<std::size_t>(k)] =
          std::accumulate(x_mm_.begin() + from, x_mm_.begin() + to, 0.0) / static_cast<double>(to - from);
    }
    return out;
  }
  /// When its ramps ended.
  [[nodiscard]] const std::vector<double>& corners_s() const { return corners_s_; }

 private:
  void add(double mm) { x_mm_.push_back(mm); }
  std::vector<double> x_mm_{0.0}, corners_s_;
};

struct Noisy {
  std::vector<double> t_s, reading_mm;
};
Noisy noisy(const std::vector<double>& path_mm, unsigned seed) {
  std::mt19937 random(seed);
  std::normal_distribution<double> normal;
  Noisy out;
  for (std::size_t k = 0; k < path_mm.size(); ++k) {
    out.t_s.push_back(kStep_s * static_cast<double>(k));
    out.reading_mm.push_back(path_mm[k] + kNoise_mm * normal(random));
  }
  return out;
}

/// A linear spring and an arm, driven straight from instant to instant: exact for that way.
struct Specimen {
  double spring_N_mm = 0.24, arm_N_mm = 0.15, arm_s = 0.38, z_mm = 0.0;
  double step(double x_mm, double step_mm, double dt_s) {
    if (dt_s > 0.0) {
      const double kept = std::exp(-dt_s / arm_s);
      z_mm = z_mm * kept + step_mm / dt_s * arm_s * (1.0 - kept);
    }
    return spring_N_mm * x_mm + arm_N_mm * z_mm;
  }
};

Path session() {
  Path path;
  path.hold(3.0);
  for (const double to_mm : {4.0, -4.0}) {
    path.ramp(to_mm, 8.0);
    path.ramp(0.0, 4.0);
    path.hold(6.0);
  }
  for (int k = 0; k < 3; ++k) {
    path.ramp(4.0, 8.0);
    path.ramp(-4.0, 8.0);
  }
  path.ramp(0.0, 1.0);
  path.hold(6.0);
  path.sine(3.5, 0.5, 8);
  path.hold(3.0);
  path.sine(2.0, 1.5, 12);
  path.hold(6.0);
  return path;
}

/// What a right model leaves of the bins is noise, and nothing that the bins have hidden: a turn in mid-bin, or a bend
/// that was drawn as a polygon. Squares of b bins of noise have a standard deviation of sqrt(2 b). The noise of the
/// position adds to them less than (0.39 N/mm 1 um)^2 / (6 mN)^2 = 0.4 % of a reading's, times the readings of a bin,
/// 10 to 50 where it moves.
TEST(BinsOfANoisyMotion, HideNeitherTurnsNorBends) {
  constexpr double kForceNoise_N = 6e-3;
  const std::vector<double> path_mm = session().rounded();
  const Noisy readings = noisy(path_mm, 11);
  std::mt19937 random(12);
  std::normal_distribution<double> normal;
  messages::Recording recording;
  recording.metadata.rest_length_mm = 100.0;
  recording.frame.t_s = readings.t_s;
  recording.frame.position_mm = readings.reading_mm;
  Specimen truth;
  for (std::size_t k = 0; k < path_mm.size(); ++k)
    recording.frame.force_N.push_back(
        truth.step(path_mm[k], k > 0 ? path_mm[k] - path_mm[k - 1] : 0.0, k > 0 ? kStep_s : 0.0) +
        kForceNoise_N * normal(random));
  const Series series = prepare_series("noisy", recording, {});
  ASSERT_EQ(series.excitation.width, 1U);
  Specimen model;
  double squares = 0.0;
  for (std::size_t k = 0; k < series.nodes.size(); ++k) {
    const auto& node = series.nodes[k];
    const double left_N = series.force_N[k] - model.step(node.position_mm, node.step_mm, node.dt_s);
    squares += series.count[k] * left_N * left_N / (kForceNoise_N * kForceNoise_N);
  }
  const auto bins = static_cast<double>(series.nodes.size());
  EXPECT_LT(bins, 0.2 * static_cast<double>(path_mm.size())) << "nothing is averaged";
  EXPECT_NEAR(squares / bins, 1.0, 4.0 * std::sqrt(2.0 / bins) + 0.1);
}

TEST(CornersOfANoisyMotion, AreSeenWhereFiveReadingsDoNotShowThem) {
  Path path;
  path.hold(2.0);
  for (int k = 0; k < 6; ++k) {
    path.ramp(4.0, 8.0);
    path.ramp(-4.0, 8.0);
  }
  path.ramp(0.0, 0.5);
  path.hold(4.0);
  const Noisy readings = noisy(path.rounded(), 5);
  messages::Recording recording;
  recording.frame.t_s = readings.t_s;
  recording.frame.position_mm = readings.reading_mm;
  recording.frame.force_N.assign(readings.t_s.size(), 0.0);
  const Excitation seen = reconstruct_excitation(recording);
  ASSERT_EQ(seen.width, 1U);
  for (const double corner_s : path.corners_s()) {
    const auto k = static_cast<std::size_t>(std::lround(corner_s / kStep_s));
    double nearest_s = 1.0;
    for (std::size_t j = k - 150; j <= std::min(k + 150, seen.since_corner_s.size() - 1); ++j)
      if (seen.since_corner_s[j] == 0.0) nearest_s = std::min(nearest_s, std::fabs(seen.instants[j].t_s - corner_s));
    EXPECT_LT(nearest_s, 0.02) << "the corner at " << corner_s << " s";
  }
  // A straight way has none: nine tenths of each ramp and hold are far from its ends.
  std::size_t in_corners = 0;
  for (const double since_s : seen.since_corner_s) in_corners += since_s == 0.0 ? 1 : 0;
  EXPECT_LT(static_cast<double>(in_corners), 0.1 * static_cast<double>(seen.since_corner_s.size()));
}

/// rms of a motion against its path between two readings, and in units of what it says of itself.
struct Error {
  double mm = 0.0, in_deviations = 0.0;
};
Error error_of(const Motion& motion, const std::vector<double>& path_mm, std::size_t from, std::size_t to) {
  Error out;
  for (std::size_t k = from; k < to; ++k) {
    const double e = motion.position_mm[k] - path_mm[k];
    out.mm += e * e / static_cast<double>(to - from);
    out.in_deviations += e * e / motion.position_variance_mm2[k] / static_cast<double>(to - from);
  }
  out.mm = std::sqrt(out.mm);
  out.in_deviations = std::sqrt(out.in_deviations);
  return out;
}

/// A sine between two holds. Its position comes out at least twice as near as by the polygon, with an error that is as
/// large as it says (it has the correlation time of the smoother, some 30 ms, so that 16 s hold 500 independent errors,
/// and their rms is known to 3 %; that a sine is no random walk is the rest of the tolerance).
TEST(SmoothCurves, FollowASineAndSayHowWell) {
  Path path;
  path.hold(4.0);
  path.sine(3.5, 0.5, 8);
  path.hold(4.0);
  const std::vector<double> path_mm = path.rounded();
  const Noisy readings = noisy(path_mm, 3);
  Motion motion = smooth_motion(readings.t_s, readings.reading_mm, channel_quality(readings.t_s, readings.reading_mm));
  const Error polygon = error_of(motion, path_mm, 4500, 19500);
  smooth_curves(readings.t_s, readings.reading_mm, motion);
  EXPECT_TRUE(std::all_of(motion.curves.begin() + 4500, motion.curves.begin() + 19500, [](bool c) { return c; }));
  EXPECT_FALSE(std::any_of(motion.curves.begin(), motion.curves.begin() + 3500, [](bool c) { return c; }));
  EXPECT_FALSE(std::any_of(motion.curves.begin() + 20500, motion.curves.end(), [](bool c) { return c; }));
  const Error curve = error_of(motion, path_mm, 4500, 19500);
  EXPECT_GT(polygon.in_deviations, 1.4) << "what a polygon says of itself is too good";
  EXPECT_LT(curve.mm, 0.5 * polygon.mm);
  EXPECT_NEAR(curve.in_deviations, 1.0, 0.25);
}

/// Of strokes without a hold, a corner every second, nothing is a curve.
TEST(SmoothCurves, LeaveStrokesStraight) {
  Path path;
  path.hold(2.0);
  for (int k = 0; k < 12; ++k) path.ramp(k % 2 == 0 ? 4.0 : -4.0, 8.0);
  path.hold(2.0);
  const Noisy readings = noisy(path.rounded(), 4);
  Motion motion = smooth_motion(readings.t_s, readings.reading_mm, channel_quality(readings.t_s, readings.reading_mm));
  const Motion before = motion;
  smooth_curves(readings.t_s, readings.reading_mm, motion);
  EXPECT_EQ(std::ranges::count(motion.curves, true), 0);
  EXPECT_EQ(motion.position_mm, before.position_mm);
}

/// Ten times as large, or at a tenth of the pace, a motion is as curved.
TEST(SmoothCurves, DoNotDependOnUnits) {
  Path path;
  path.hold(3.0);
  path.sine(3.5, 0.5, 4);
  path.hold(3.0);
  const Noisy readings = noisy(path.rounded(), 6);
  const auto curves = [&](double length, double time) {
    Noisy scaled = readings;
    for (double& t : scaled.t_s) t *= time;
    for (double& x : scaled.reading_mm) x *= length;
    Motion motion = smooth_motion(scaled.t_s, scaled.reading_mm, channel_quality(scaled.t_s, scaled.reading_mm));
    smooth_curves(scaled.t_s, scaled.reading_mm, motion);
    return std::ranges::count(motion.curves, true);
  };
  const auto as_read = curves(1.0, 1.0);
  EXPECT_GT(as_read, 7000);
  EXPECT_NEAR(static_cast<double>(curves(10.0, 1.0)), static_cast<double>(as_read), 100.0);
  EXPECT_NEAR(static_cast<double>(curves(1.0, 10.0)), static_cast<double>(as_read), 100.0);
}

/// A random walk of the acceleration comes out with its strength: the grid has factors of 4, and the likelihood of
/// 4,000 readings is sharper than that.
TEST(WhiteJerk, ItsStrengthIsFoundFromFarAway) {
  constexpr double kJerk2 = 300.0;
  std::mt19937 random(8);
  std::normal_distribution<double> normal;
  std::vector<double> t_s, reading_mm;
  double x = 0.0, v = 0.0, a = 0.0;
  for (int k = 0; k < 4000; ++k) {
    t_s.push_back(kStep_s * k);
    reading_mm.push_back(x + kNoise_mm * normal(random));
    x += kStep_s * (v + 0.5 * kStep_s * a);
    v += kStep_s * a;
    a += std::sqrt(kJerk2 * kStep_s) * normal(random);
  }
  MotionEnd open;
  open.position_variance_mm2 = open.velocity_variance_mm2_s2 = open.acceleration_variance_mm2_s4 = 1e4;
  WhiteJerkSmoother walk(t_s, reading_mm, kNoise_mm, open, open);
  const double best = walk.filter_likeliest_from(kJerk2);
  EXPECT_GE(best, walk.filter(kJerk2 / 4.0));
  EXPECT_GE(best, walk.filter(kJerk2 * 4.0));
  for (const double from : {1e-6, 1e2, 1e9}) EXPECT_NEAR(walk.filter_likeliest_from(from), best, 2.0) << from;
  EXPECT_EQ(walk.filter_likeliest(), std::max(walk.filter(160.0), walk.filter(640.0)));
}

}  // namespace
}  // namespace isorig::identify
