#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>
#include <random>

#include "identify/diagnose/fit/series.hpp"
#include "identify/diagnose/motion/band_limited_motion.hpp"
#include "identify/diagnose/motion/corner_motion.hpp"
#include "identify/diagnose/motion/pressure_reconstruction.hpp"

namespace isorig::identify {
namespace {

constexpr double kTau = 2.0 * std::numbers::pi;

/// A servo axis: 95 kg on a sum of two sines, encoder noise of 0.2 um at 1 kHz. The acceleration's noise
/// power may be 0.2 % of its own (band_limited_motion.hpp), which pulls the mass by as much; force noise of 1 N on an
/// rms of some 40 N over 10 000 rows adds 1 / (40 sqrt(10000)) = 0.03 %.
TEST(BandLimitedMotion, KeepsAMassWithinHalfAPercent) {
  std::mt19937 random(3);
  std::normal_distribution<double> normal;
  messages::Recording recording;
  recording.metadata.rest_length_mm = 100.0;
  constexpr double kMass_kg = 95.0;
  for (int k = 0; k < 10000; ++k) {
    const double t = 1e-3 * k, w1 = kTau * 0.4, w2 = kTau * 1.3;
    const double x = 100.0 * std::sin(w1 * t) + 8.0 * std::sin(w2 * t);
    const double a = -100.0 * w1 * w1 * std::sin(w1 * t) - 8.0 * w2 * w2 * std::sin(w2 * t);
    recording.frame.t_s.push_back(t);
    recording.frame.position_mm.push_back(x + 2e-4 * normal(random));
    recording.frame.force_N.push_back(kMass_kg * 1e-3 * a + normal(random));
  }
  const Series series = prepare_series("axis", recording, {});
  ASSERT_GT(series.excitation.width, 1u);
  double af = 0.0, aa = 0.0;
  for (std::size_t k = 0; k < series.nodes.size(); ++k) {
    const double a = series.nodes[k].acceleration_mm_s2 * 1e-3;
    af += series.count[k] * a * series.force_N[k];
    aa += series.count[k] * a * a;
  }
  EXPECT_NEAR(af / aa, kMass_kg, 0.005 * kMass_kg);
}

/// A path of straight ways and holds, its corners rounded by a mean over 40 ms.
class Way {
 public:
  static constexpr double kStep_s = 1e-3;
  void hold(double seconds) { corners_.insert(corners_.end(), std::size_t(seconds / kStep_s), corners_.back()); }
  void go(double to_mm, double mm_s) {
    const double from_mm = corners_.back();
    const int steps = static_cast<int>(std::fabs(to_mm - from_mm) / mm_s / kStep_s);
    for (int i = 1; i <= steps; ++i) corners_.push_back(from_mm + (to_mm - from_mm) * i / steps);
  }
  [[nodiscard]] std::vector<double> path() const {
    std::vector<double> out;
    for (std::size_t i = 20; i + 20 < corners_.size(); ++i)
      out.push_back(std::accumulate(corners_.begin() + static_cast<std::ptrdiff_t>(i) - 20,
                                    corners_.begin() + static_cast<std::ptrdiff_t>(i) + 21, 0.0) /
                    41.0);
    return out;
  }

 private:
  std::vector<double> corners_{0.0};
};

struct Bristle {
  double worst_in_hold = 0.0;
  double rms = 0.0;
};

/// A bristle on the true path, and on the one that is reconstructed from readings of it, one in `every` steps: what
/// they differ by, of its full turn.
Bristle difference(const std::vector<double>& path, double noise_mm, double presliding_mm, std::size_t every) {
  std::mt19937 random(5);
  std::normal_distribution<double> normal;
  messages::Recording recording;
  recording.metadata.rest_length_mm = 100.0;
  std::vector<double> bristle;
  double z = 0.0;
  for (std::size_t i = 1; i < path.size(); ++i) {
    const double dx = path[i] - path[i - 1];
    z += dx / presliding_mm * (1.0 - (dx > 0.0 ? z : -z));
    if (i % every != 0) continue;
    bristle.push_back(z);
    recording.frame.t_s.push_back(Way::kStep_s * static_cast<double>(i));
    recording.frame.position_mm.push_back(path[i] + noise_mm * normal(random));
    recording.frame.force_N.push_back(z);
  }
  const Excitation seen = reconstruct_excitation(recording);
  z = 0.0;
  Bristle out;
  double squares = 0.0;
  for (std::size_t k = 0; k < bristle.size(); ++k) {
    const double step_mm = seen.instants[k].slide_mm;
    const double s = step_mm > 0.0 ? 1.0 : -1.0;
    if (k > 0 && step_mm != 0.0) z = s + (z - s) * std::exp(-std::fabs(step_mm) / presliding_mm);
    const double error = z - bristle[k];
    squares += error * error / static_cast<double>(bristle.size());
    if (k > 600 && k + 1 < bristle.size() && bristle[k] == bristle[k - 1] && bristle[k] == bristle[k + 1] &&
        std::fabs(bristle[k]) > 0.999)
      out.worst_in_hold = std::max(out.worst_in_hold, std::fabs(error));
  }
  out.rms = std::sqrt(squares);
  return out;
}

/// A bristle of 30 um in the holds between ramps of several speeds and slow returns, read at 200 Hz with 0.4 um of
/// noise. A ramp turns it round whole, and it stays so until the next motion begins: farthest reading and hold differ
/// by a micrometre, which would turn it back by 0.07.
TEST(SlidPath, KeepsWhatAStrokeHasTurnedRound) {
  Way way;
  way.hold(3.0);
  for (const double mm_s : {2.0, 8.0, 4.0, 10.0}) {
    for (const double to_mm : {2.0, -2.0}) {
      way.go(to_mm, mm_s);
      way.hold(8.0);
      way.go(0.0, 0.25);
      way.hold(3.0);
    }
  }
  const Bristle off = difference(way.path(), 4e-4, 0.03, 5);
  EXPECT_LT(off.worst_in_hold, 0.01);
  EXPECT_LT(off.rms, 0.0015);
}

/// Triangles without a hold, at 200 Hz: five noises are what the motion makes in 20 readings. A path that stood until
/// it had left by them, at the mean of these readings, would be late by half of them: 0.19 of the bristle.
TEST(SlidPath, LeavesATurningPointWhereTheMotionDoes) {
  Way way;
  way.hold(3.0);
  for (int i = 0; i < 20; ++i) {
    way.go(2.0, 1.0);
    way.go(-2.0, 1.0);
  }
  EXPECT_LT(difference(way.path(), 0.02, 0.05, 5).rms, 0.04);
}

/// A slip of one recording must not turn up in another, equally long one.
TEST(RecordingId, IsOfTheReadingsAndNotOfTheirNumberOrDuration) {
  messages::Recording recording;
  recording.metadata.rest_length_mm = 100.0;
  for (int k = 0; k < 200; ++k) {
    recording.frame.t_s.push_back(0.1 * k);
    recording.frame.position_mm.push_back(0.01 * (k % 40));
    recording.frame.force_N.push_back(0.02 * (k % 40));
  }
  const double id = reconstruct_excitation(recording).reference.recording_id;
  EXPECT_EQ(id, std::floor(id));
  EXPECT_GT(id, model::kPlannedRecordingId);
  EXPECT_LE(id, model::kLargestRecordingId);
  messages::Recording copy = recording;
  copy.metadata.specimen = "under another name";
  EXPECT_EQ(reconstruct_excitation(copy).reference.recording_id, id);
  copy.frame.force_N[57] += 1e-9;
  EXPECT_NE(reconstruct_excitation(copy).reference.recording_id, id);
}

TEST(BandLimited, KeepsAStraightLineAndNarrowsAStep) {
  std::vector<double> line, step;
  for (int k = 0; k < 200; ++k) {
    line.push_back(3.0 + 0.5 * k);
    step.push_back(k < 100 ? 0.0 : 1.0);
  }
  const auto straight = band_limited(line, 9);
  for (std::size_t k = 0; k < line.size(); ++k) EXPECT_NEAR(straight[k], line[k], 1e-9);
  const auto soft = band_limited(step, 9);
  // No phase: the middle stays between the rows it was between; three means of 9 reach 12 rows.
  EXPECT_NEAR(0.5 * (soft[99] + soft[100]), 0.5, 1e-12);
  EXPECT_EQ(soft[87], 0.0);
  EXPECT_NEAR(soft[112], 1.0, 1e-12);
}

/// Half a second of acceleration 400 mm/s^2 that comes and goes as a raised cosine, at 200 Hz, noise 0.5 um.
/// Second differences of single readings would err by 0.5 um sqrt(6) / (5 ms)^2 = 49 mm/s^2 rms.
TEST(SmoothCorners, FollowsAnAccelerationBelowTheNoiseOfItsReadings) {
  std::mt19937 random(5);
  std::normal_distribution<double> normal;
  std::vector<double> t_s, reading, truth;
  double v = 0.0, x = 0.0;
  for (int k = 0; k < 4000; ++k) {
    const double t = 1e-3 * k - 2.0;
    const double a = std::fabs(t) < 0.1 ? 200.0 * (1.0 + std::cos(kTau * t / 0.2)) : 0.0;
    if (k % 5 == 0) {
      t_s.push_back(1e-3 * k);
      reading.push_back(x + 5e-4 * normal(random));
      truth.push_back(a);
    }
    x += 1e-3 * v + 0.5e-6 * a;
    v += 1e-3 * a;
  }
  std::vector<double> told;
  Motion motion =
      smooth_motion(t_s, reading, channel_quality(t_s, reading), [&](double done) { told.push_back(done); });
  // At each pass of the smoother, of which there are 44 at least: the shares are even, and never stand or go back.
  ASSERT_GE(told.size(), 44U);
  for (std::size_t k = 0; k < told.size(); ++k) EXPECT_NEAR(told[k], static_cast<double>(k + 1) * told[0], 1e-12) << k;
  EXPECT_GT(told.back(), 0.3);
  EXPECT_LE(told.back(), 1.0);
  smooth_corners(t_s, reading, motion);
  double squares = 0.0;
  int count = 0;
  for (std::size_t k = 0; k < t_s.size(); ++k) {
    if (std::fabs(t_s[k] - 2.0) > 0.1) continue;
    squares += std::pow(motion.acceleration_mm_s2[k] - truth[k], 2);
    ++count;
  }
  EXPECT_LT(std::sqrt(squares / count), 30.0);
}

/// Ramps every 40 s whose droop recovers in 1.5 s; a gauge at 5 Hz whose stamps are 0.15 s late, noise a
/// tenth of the droop.
TEST(ReconstructedPressure, FindsTheGaugesClockAndFillsItsGaps) {
  std::mt19937 random(7);
  std::normal_distribution<double> normal;
  constexpr double kClock_s = 0.15, kDroop_psi_mm = 0.04, kRecovery_s = 1.5, kStep_s = 0.01;
  std::vector<double> t_s, position_mm, truth_psi;
  messages::PressureSamples gauge;
  double x = 0.0, droop = 0.0;
  for (int k = 0; k < 60000; ++k) {
    const double t = kStep_s * k, phase = std::fmod(t, 80.0);
    const double v = phase > 10.0 && phase < 10.5 ? 4.0 : phase > 50.0 && phase < 50.5 ? -4.0 : 0.0;
    t_s.push_back(t);
    position_mm.push_back(x);
    truth_psi.push_back(15.0 + droop);
    if (k % 20 == 7) {
      gauge.t_s.push_back(t + kClock_s);
      gauge.pressure_psi.push_back(15.0 + droop + 0.006 * normal(random));
    }
    x += v * kStep_s;
    droop += kDroop_psi_mm * v * kStep_s - droop * kStep_s / kRecovery_s;
  }
  const ReconstructedPressure pressure =
      reconstruct_pressure(gauge, channel_quality(gauge.t_s, gauge.pressure_psi), t_s, position_mm);
  EXPECT_NEAR(pressure.clock_s, kClock_s, std::max(2.0 * pressure.clock_error_s, 0.01));
  EXPECT_LT(pressure.clock_error_s, 0.05);
  EXPECT_NEAR(pressure.droop_psi_mm, kDroop_psi_mm, 0.1 * kDroop_psi_mm);
  double worst = 0.0;
  for (std::size_t k = 0; k < t_s.size(); ++k)
    worst = std::max(worst, std::fabs(pressure.pressure_psi[k] - truth_psi[k]));
  EXPECT_LT(worst, 0.02);  // a quarter of the droop's 0.08 psi; its reading is 0.2 s apart and 0.15 s late
}

}  // namespace
}  // namespace isorig::identify
