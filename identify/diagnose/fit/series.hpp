#pragma once
#include <span>
#include <string>
#include <vector>

#include "identify/diagnose/deciding/deciding.hpp"
#include "identify/diagnose/motion/reconstruction.hpp"
#include "messages/recording.hpp"
#include "model/composed.hpp"

namespace isorig::identify {

/// A recording prepared for fitting: neighbouring readings are averaged into bins that widen with the time since the
/// last corner (a hold, a slow return), so that 30 000 rows become some 5000 and no bin is wider than the features of
/// any law at that time.
struct Series {
  std::string name;
  messages::Recording recording;
  ChannelQuality force_quality;  ///< of the recording's force
  Excitation excitation;
  /// One per bin: the excitation at the mean time of its rows.
  std::vector<model::Instant> nodes;
  std::vector<double> force_N;
  std::vector<double> count;           ///< readings in the bin
  std::vector<double> readings;        ///< that each row of the recording stands for; fewer where the noise is larger
  double reading_noise_N = 0.0;        ///< rms of a row that stands for one
  std::vector<std::size_t> first_row;  ///< bin i holds rows first_row[i] .. first_row[i + 1]; one past the end last
  std::vector<double> since_corner_s;  ///< time since the last corner of the motion, per bin
  double rest_s = deciding().rest_s;   ///< without a change of velocity, from which a rest is a rest
  double noise_reading_s = 0.0;        ///< each reading counts for so long where the noise forgets by readings; else 0
};

/// What the force's noise takes for the time from bin k - 1 to bin k (k > 0): that between their mean times, or
/// `noise_reading_s` for each reading from the middle of the one to the middle of the other.
[[nodiscard]] double noise_dt_s(const Series& series, std::size_t k);

/// `usable` marks the rows of frame.csv that the guard left in; empty means all.
/// The second one measures the quality itself.
[[nodiscard]] Series prepare_series(std::string name, messages::Recording recording, const std::vector<bool>& usable,
                                    const RecordingQuality& quality);
[[nodiscard]] Series prepare_series(std::string name, messages::Recording recording, const std::vector<bool>& usable);

/// The recording that an event happened in (its recording_id); the first where it is not said.
[[nodiscard]] std::size_t series_of(const model::Part& event, std::span<const Series> series);

/// Slower than this a bin stands still: a small share of the recording's fastest.
[[nodiscard]] double still_mm_s(const Series& series);

/// From end to end of the motion, in the recording that moves furthest.
[[nodiscard]] double stroke_mm(std::span<const Series> series);

/// The same recording with every usable row a bin of its own, all of equal weight: where a model's error exceeds the
/// noise, the mean of many readings is predicted no better than a single reading.
[[nodiscard]] Series by_rows(const Series& series, const std::vector<bool>& usable);

/// Recordings that are fitted together share one noise per reading: those with less count for more.
void share_noise(std::span<Series> series);

}  // namespace isorig::identify
