#include "identify/diagnose/noise/repetitions.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include "base/quantile.hpp"
#include "identify/diagnose/deciding/deciding.hpp"

namespace isorig::identify {
namespace {

struct Stroke {
  std::size_t first = 0, end = 0;
  double direction = 0.0;
};

/// What is compared: the readings themselves, or the bins of a band-limited recording.
struct Track {
  std::vector<model::Instant> at;
  std::vector<double> force_N, readings, slid_mm;
};

Track track_of(const Series& series) {
  Track track;
  if (series.excitation.width > 1) {
    track.at = series.nodes;
    track.force_N = series.force_N;
    track.readings = series.count;
    double slid_mm = 0.0;
    for (const auto& node : series.nodes) track.slid_mm.push_back(slid_mm += node.slide_mm);
    return track;
  }
  track.at = series.excitation.instants;
  track.force_N = series.recording.frame.force_N;
  track.slid_mm = series.excitation.slid_mm;
  track.readings = series.readings;
  // Rows that the guard left out are in bins that count for nothing, or count for less than they hold.
  for (std::size_t bin = 0; bin < series.nodes.size(); ++bin) {
    double held = 0.0;
    for (std::size_t row = series.first_row[bin]; row < series.first_row[bin + 1]; ++row) held += series.readings[row];
    if (series.count[bin] >= 0.999 * held) continue;
    for (std::size_t row = series.first_row[bin]; row < series.first_row[bin + 1]; ++row) track.readings[row] = 0.0;
  }
  return track;
}

std::vector<Stroke> strokes_of(const Track& track) {
  std::vector<Stroke> strokes;
  for (std::size_t k = 1; k < track.at.size(); ++k) {
    const double step = track.slid_mm[k] - track.slid_mm[k - 1];
    if (step != 0.0 && (strokes.empty() || step * strokes.back().direction < 0.0))
      strokes.push_back({k, k, step > 0.0 ? 1.0 : -1.0});
    if (!strokes.empty()) strokes.back().end = k + 1;
  }
  return strokes;
}

double floor_of(std::span<const Series> series) {
  double floor_N = 0.0;
  for (const Series& each : series) floor_N = std::max(floor_N, each.force_quality.rounding());
  return floor_N;
}

/// Gram and Schmidt's, one column after the other, each to mean square one: columns of different units would lose
/// digits in the normal equations of noise_likelihood(). A column that others hold to all but 1e-6 of its square is
/// left out.
void orthogonalise(NoiseSample& sample) {
  constexpr double kOwn = 1e-6;
  for (std::size_t c = 0; c < NoiseSample::kMostColumns; ++c) {
    double before = 0.0, after = 0.0;
    for (const auto& row : sample.columns) before += row[c] * row[c];
    for (std::size_t other = 0; other < c; ++other) {
      double dot = 0.0, norm = 0.0;
      for (const auto& row : sample.columns) {
        dot += row[c] * row[other];
        norm += row[other] * row[other];
      }
      if (norm == 0.0) continue;
      for (auto& row : sample.columns) row[c] -= dot / norm * row[other];
    }
    for (const auto& row : sample.columns) after += row[c] * row[c];
    const double scale = after > kOwn * before ? std::sqrt(static_cast<double>(sample.size()) / after) : 0.0;
    for (auto& row : sample.columns) row[c] *= scale;
  }
}

/// Reading k of the stroke against the earlier stroke at the same position, between its readings j and j + 1:
///
///     y_k = (F_k - (1 - w) F_j - w F_j+1) / sqrt(2)
///     var y_k = white^2 / m_k,   2 / m_k = 1 / n_k + (1 - w)^2 / n_j + w^2 / n_j+1
///
/// with n the readings that a row stands for: m_k is what the sample says in `readings`.
NoiseSample difference(const Track& track, const Stroke& stroke, const Stroke& earlier, double fastest_mm_s) {
  NoiseSample sample;
  const auto& slid_mm = track.slid_mm;
  const double sign = stroke.direction;
  const double after_mm = sign * slid_mm[stroke.first] +
                          deciding().repeated_turn_share * std::fabs(slid_mm[stroke.end - 1] - slid_mm[stroke.first]);
  std::size_t j = earlier.first;
  for (std::size_t k = stroke.first; k < stroke.end; ++k) {
    const double at_mm = sign * slid_mm[k];
    if (track.readings[k] == 0.0 || at_mm < after_mm) continue;
    while (j + 1 < earlier.end && sign * slid_mm[j + 1] < at_mm) ++j;
    if (j + 1 >= earlier.end) break;
    const double from_mm = sign * slid_mm[j], to_mm = sign * slid_mm[j + 1];
    if (at_mm < from_mm || !(to_mm > from_mm) || track.readings[j] == 0.0 || track.readings[j + 1] == 0.0) continue;
    const double w = (at_mm - from_mm) / (to_mm - from_mm);
    const auto more = [&](double model::Instant::*value) {
      return track.at[k].*value - ((1.0 - w) * track.at[j].*value + w * track.at[j + 1].*value);
    };
    const double faster_mm_s = more(&model::Instant::velocity_mm_s);
    if (std::fabs(faster_mm_s) > deciding().repeated_speed_share * fastest_mm_s) continue;
    sample.t_s.push_back(track.at[k].t_s);
    sample.force_N.push_back(std::sqrt(0.5) *
                             (track.force_N[k] - ((1.0 - w) * track.force_N[j] + w * track.force_N[j + 1])));
    sample.readings.push_back(
        2.0 / (1.0 / track.readings[k] + (1.0 - w) * (1.0 - w) / track.readings[j] + w * w / track.readings[j + 1]));
    sample.columns.push_back({1.0, track.at[k].t_s, faster_mm_s, more(&model::Instant::excess_pressure_psi),
                              more(&model::Instant::acceleration_mm_s2)});
  }
  return sample;
}

}  // namespace

std::size_t stroke_count(const Series& series) {
  return strokes_of(track_of(series)).size();
}

std::vector<NoiseSample> repetitions(const Series& series) {
  std::vector<NoiseSample> samples;
  const Track track = track_of(series);
  const auto strokes = strokes_of(track);
  double fastest_mm_s = 0.0;
  for (const auto& now : track.at) fastest_mm_s = std::max(fastest_mm_s, std::fabs(now.velocity_mm_s));
  // The stroke before in the same direction, or of the few before that the one that is most alike.
  constexpr std::size_t kBack = 6;
  for (std::size_t s = 2; s < strokes.size(); ++s) {
    NoiseSample best;
    for (std::size_t back = 2; back <= std::min(s, 2 * kBack); back += 2) {
      NoiseSample one = difference(track, strokes[s], strokes[s - back], fastest_mm_s);
      if (one.size() > best.size() + best.size() / 4) best = std::move(one);
    }
    if (best.size() < deciding().fewest_repeated_readings) continue;
    const double middle_s = 0.5 * (best.t_s.front() + best.t_s.back());
    for (auto& row : best.columns) row[1] -= middle_s;
    orthogonalise(best);
    samples.push_back(std::move(best));
  }
  return samples;
}

std::optional<NoiseModel> noise_of_repetitions(std::span<const Series> series, double start_N) {
  std::vector<NoiseSample> samples;
  std::vector<double> lasts_s;
  std::size_t rows = 0;
  for (const Series& each : series) {
    for (NoiseSample& sample : repetitions(each)) {
      rows += sample.size();
      lasts_s.push_back(sample.t_s.back() - sample.t_s.front());
      samples.push_back(std::move(sample));
    }
  }
  if (rows < deciding().fewest_readings_in_motion || samples.size() < deciding().fewest_repeated_strokes)
    return std::nullopt;
  const double longest_s =
      std::clamp(deciding().repeated_correlation_share * base::quantile_in_place(lasts_s, 0.5), 0.02, 8.0);
  NoiseModel noise = fit_noise(samples, start_N, longest_s);
  // Amplitude and correlation time trade against each other: along that ridge, too.
  double best = noise_likelihood(samples, noise);
  for (double width = 0.5; noise.coloured_N > 0.0 && width > 0.01; width *= 0.7) {
    for (const double move : {width, -width}) {
      NoiseModel trial = noise;
      trial.correlation_s = std::clamp(trial.correlation_s * std::exp(2.0 * move), 0.01, longest_s);
      for (const double share : {0.0, 0.5, 1.0}) {
        trial.coloured_N = noise.coloured_N * std::exp(share * move);
        if (const double score = noise_likelihood(samples, trial); score > best) {
          best = score;
          noise = trial;
        }
      }
    }
  }
  noise.white_N = std::max(noise.white_N, floor_of(series));
  return noise;
}

NoiseModel noise_of_bins(std::span<const Series> series, const NoiseModel& noise) {
  double sum = 0.0, bins = 0.0;
  for (const Series& each : series) {
    for (std::size_t k = 0; k < each.nodes.size(); ++k) {
      if (each.count[k] == 0.0) continue;
      // The mean of an Ornstein-Uhlenbeck process of variance c^2 over a bin of length B has, with u = B / T, the
      // variance
      //     c^2 / B^2 * double integral of exp(-|s - t| / T) = c^2 * 2 (u - 1 + exp(-u)) / u^2.
      // The noise of band-limited bins is already that of bins.
      const double rows = static_cast<double>(each.first_row[k + 1] - each.first_row[k]);
      const double u = each.excitation.width > 1 || rows < 2.0
                           ? 0.0
                           : (each.excitation.instants[each.first_row[k + 1] - 1].t_s -
                              each.excitation.instants[each.first_row[k]].t_s) /
                                 noise.correlation_s;
      const double kept = u > 1e-3 ? 2.0 * (u + std::expm1(-u)) / (u * u) : 1.0;
      sum += noise.white_N * noise.white_N + each.count[k] * kept * noise.coloured_N * noise.coloured_N;
      bins += 1.0;
    }
  }
  return {bins > 0.0 ? std::sqrt(sum / bins) : noise.white_N, 0.0, 1.0};
}

std::optional<NoiseModel> noise_within_strokes(std::span<const Series> series, double start_N) {
  std::vector<NoiseSample> samples;
  std::size_t rows = 0;
  for (const Series& each : series) {
    if (each.excitation.width <= 1) return std::nullopt;  // its bins are not even
    for (const Stroke& stroke : strokes_of(track_of(each))) {
      NoiseSample piece;
      const auto close = [&] {
        if (piece.size() >= deciding().fewest_bins_of_a_piece) {
          const double first_s = piece.t_s.front(), span_s = piece.t_s.back() - first_s;
          for (const double t_s : piece.t_s) {
            const double u = 2.0 * (t_s - first_s) / span_s - 1.0;
            std::array<double, NoiseSample::kMostColumns> row{1.0, u};
            for (std::size_t n = 1; n + 1 < row.size(); ++n) {
              // Legendre's polynomials: (m + 1) P_m+1 = (2 m + 1) u P_m - m P_m-1
              const auto m = static_cast<double>(n);
              row[n + 1] = ((2.0 * m + 1.0) * u * row[n] - m * row[n - 1]) / (m + 1.0);
            }
            piece.columns.push_back(row);
          }
          rows += piece.size();
          samples.push_back(std::move(piece));
        }
        piece = {};
      };
      // The bins at the turning points went through the filter together with the other side.
      for (std::size_t k = stroke.first + 2; k + 2 < stroke.end; ++k) {
        if (each.count[k] == 0.0 || piece.size() == deciding().stroke_piece_bins) close();
        if (each.count[k] == 0.0) continue;
        piece.t_s.push_back(each.nodes[k].t_s);
        piece.force_N.push_back(each.force_N[k]);
        piece.readings.push_back(each.count[k]);
      }
      close();
    }
  }
  if (rows < deciding().fewest_readings_in_motion) return std::nullopt;
  NoiseModel noise = fit_white_noise(samples, start_N);
  noise.white_N = std::max(noise.white_N, floor_of(series));
  return noise;
}

}  // namespace isorig::identify
