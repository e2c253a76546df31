#pragma once
#include <functional>
#include <span>
#include <string>
#include <vector>

#include "identify/diagnose/signal/channel_quality.hpp"
#include "messages/recording.hpp"
#include "model/process.hpp"

namespace isorig::identify {

using MotionProgress = std::function<void(double done)>;

/// The motion that a noisy, unevenly sampled position reading most likely shows.
struct Motion {
  std::vector<double> position_mm;
  std::vector<double> velocity_mm_s;
  std::vector<double> acceleration_mm_s2;
  std::vector<double> position_variance_mm2;  ///< of position_mm, given the readings and their noise
  std::vector<double> log_likelihood;         ///< of each reading given those before it, as straight lines
  std::vector<bool> turns;                    ///< the lines before and after a reading are not the same
  std::vector<bool> curves;                   ///< not of straight lines (smooth_curves())
  double assumed_noise_mm = 0.0;              ///< rms of a reading that it was made with
  double noise_mm = 0.0;                      ///< rms of the reading about it
  double quantisation_mm = 0.0;               ///< smallest step of the reading, 0 when it is finer than the noise
};

/// Sparse Bayesian smoothing: straight between readings, with a change of velocity at each that is Gaussian
/// with a variance of its own, which is estimated (MacKay's fixed point over a Rauch-Tung-Striebel smoother).
/// Where the crosshead holds or runs at constant velocity the variance dies out and hundreds of readings
/// average into a straight line; at a corner it survives and the readings are followed. Play, friction and
/// lag operators must be driven by this, never by the reading: every micrometre of noise reverses them.
/// `on_progress` is told which part of the work is done, 0 to 1: of a recording of hours it takes minutes.
[[nodiscard]] Motion smooth_motion(std::span<const double> t_s, std::span<const double> reading_mm,
                                   const ChannelQuality& quality, const MotionProgress& on_progress = {});

/// A recording's input: what drives a model, one instant per row of frame.csv.
struct Excitation {
  std::vector<model::Instant> instants;
  model::Reference reference;
  Motion motion;
  std::vector<double> slid_mm;       ///< position without reversals smaller than the reading's noise, per row
  std::vector<double> pressure_psi;  ///< smoothed, per row; empty without a pressure channel
  double pressure_noise_psi = 0.0;
  double pressure_clock_s = 0.0;        ///< its time stamps minus the frame's, 0 when it cannot be told
  double pressure_clock_error_s = 0.0;  ///< 95 % half-width
  std::vector<double> since_corner_s;   ///< per row: time since the motion last changed its velocity
  /// Rows that position and force are averaged over, three times, in a recording whose motion changes its
  /// velocity most of the time (band_limited_motion.hpp); 1 otherwise.
  std::size_t width = 1;
  /// Row at which the session begins, where the recording holds its filling as well (count_as_fitted): a fit has
  /// nothing of what is before, so travel, time and arms count from here in a prediction, too.
  std::size_t begin_row = 0;
};
/// Counts the pressure of all instants from `psi` instead of the recording's own nominal pressure. Without effect where
/// neither a gauge nor the recording says what the pressure was.
void count_pressure_from(Excitation& excitation, double psi);

/// The second one measures the quality itself.
[[nodiscard]] Excitation reconstruct_excitation(const messages::Recording& recording, const RecordingQuality& quality,
                                                const MotionProgress& on_progress = {});
[[nodiscard]] Excitation reconstruct_excitation(const messages::Recording& recording,
                                                const MotionProgress& on_progress = {});

}  // namespace isorig::identify
