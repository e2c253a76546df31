#pragma once
#include <span>
#include <string>
#include <vector>

#include "identify/diagnose/motion/reconstruction.hpp"
#include "messages/recording.hpp"

namespace isorig::identify {

/// A recording prepared for fitting: readings that say the same thing (a hold, a slow return) are averaged
/// into bins that grow with the time since the last corner, so that 30 000 rows become some 5000 without
/// losing what any of the laws could show.
struct Series {
  std::string name;
  messages::Recording recording;
  Excitation excitation;
  /// One per bin: the excitation at the mean time of its rows.
  std::vector<model::Instant> nodes;
  std::vector<double> force_N;
  std::vector<double> count;           ///< readings in the bin
  std::vector<double> readings;        ///< that each row of the recording stands for; fewer where the noise is larger
  double reading_noise_N = 0.0;        ///< rms of a row that stands for one
  std::vector<std::size_t> first_row;  ///< bin i holds rows first_row[i] .. first_row[i + 1]; one past the end last
  std::vector<double> since_corner_s;  ///< time since the last corner of the motion, per bin
};

/// `usable` marks the rows of frame.csv that the guard left in; empty means all.
[[nodiscard]] Series prepare_series(std::string name, messages::Recording recording, const std::vector<bool>& usable);

/// The same recording with every usable row a bin of its own, and all of them alike: where a model errs by more than
/// the noise, a row that is the mean of many readings is no better explained than one that stands for itself.
[[nodiscard]] Series by_rows(const Series& series, const std::vector<bool>& usable);

/// Recordings that are fitted together share one noise per reading: those with less count for more.
void share_noise(std::span<Series> series);

}  // namespace isorig::identify
