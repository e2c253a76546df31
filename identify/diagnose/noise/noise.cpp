#include "identify/diagnose/noise/noise.hpp"

#include <algorithm>
#include <cmath>

#include "base/number_text.hpp"
#include "base/quantile.hpp"
#include "identify/diagnose/deciding/deciding.hpp"
#include "identify/diagnose/noise/noise_likelihood.hpp"
#include "identify/diagnose/noise/repetitions.hpp"

namespace isorig::identify {
namespace {

// Below these the two clocks of a noise are one: it costs the second fit.
constexpr double kUneven = 1.5, kFewUneven = 0.01;

/// Readings of a rest, with s the time since its first reading and t' that since its middle:
///
///     F(t) = a + b t' + c exp(-s / 4 s) + d exp(-s / 12 s) + noise
///
/// a to d are integrated out (noise_likelihood.hpp). 10 s after the motion ended an arm faster than 2 s has lost 99 %
/// of its force; two decays and a line stand for what slower arms still do in 40 s. All these times are those of a rest
/// of 5 s (Series::rest_s), and shorter where rests are. `reading_s` above 0: the noise counts each reading for so
/// long.
std::vector<NoiseSample> find_rests(const Series& series, const std::vector<bool>& usable, double reading_s) {
  // Longer rests are cut: a line and two decays cannot follow an hour of relaxation.
  const double settled_s = deciding().settled_rests * series.rest_s,
               shortest_s = deciding().shortest_rests * series.rest_s,
               longest_s = deciding().longest_rests * series.rest_s,
               fast_s = deciding().rest_fast_decay_rests * series.rest_s,
               slow_s = deciding().rest_slow_decay_rests * series.rest_s;
  std::vector<NoiseSample> rests;
  NoiseSample rest;
  std::vector<double> at_s;
  const auto close = [&] {
    if (rest.size() >= deciding().fewest_readings_of_a_rest && at_s.back() - at_s.front() >= shortest_s) {
      const double middle_s = 0.5 * (at_s.front() + at_s.back());
      for (const double t_s : at_s) {
        const double since_s = t_s - at_s.front();
        rest.columns.push_back(
            {1.0, (t_s - middle_s) / settled_s, std::exp(-since_s / fast_s), std::exp(-since_s / slow_s)});
      }
      rests.push_back(std::move(rest));
    }
    rest = {};
    at_s.clear();
  };
  const double still_mm_s = identify::still_mm_s(series);
  for (std::size_t k = 0; k < series.nodes.size(); ++k) {
    const bool still = std::fabs(series.nodes[k].velocity_mm_s) < still_mm_s;
    if (!still || series.since_corner_s[k] < settled_s) {
      close();
      continue;
    }
    for (std::size_t row = series.first_row[k]; row < series.first_row[k + 1]; ++row) {
      if (!usable.empty() && !usable[row]) continue;
      const double t_s = series.recording.frame.t_s[row];
      if (!at_s.empty() && t_s - at_s.front() > longest_s) close();
      at_s.push_back(t_s);
      rest.t_s.push_back(reading_s > 0.0 ? static_cast<double>(row) * reading_s : t_s);
      rest.force_N.push_back(series.recording.frame.force_N[row]);
      rest.readings.push_back(row < series.readings.size() ? series.readings[row] : 1.0);
    }
  }
  close();
  return rests;
}

std::vector<NoiseSample> find_rests(std::span<const Series> series, std::span<const std::vector<bool>> usable,
                                    double reading_s) {
  std::vector<NoiseSample> all;
  for (std::size_t i = 0; i < series.size(); ++i) {
    for (NoiseSample& rest : find_rests(series[i], i < usable.size() ? usable[i] : std::vector<bool>{}, reading_s))
      all.push_back(std::move(rest));
  }
  return all;
}

/// Median interval between the readings of the rests; 0 where they are read evenly, so that time and readings are one.
double uneven_interval_s(std::span<const NoiseSample> rests) {
  std::vector<double> intervals_s;
  for (const NoiseSample& rest : rests)
    for (std::size_t k = 1; k < rest.size(); ++k) intervals_s.push_back(rest.t_s[k] - rest.t_s[k - 1]);
  if (intervals_s.empty()) return 0.0;
  const double median_s = base::quantile_in_place(intervals_s, 0.5);
  const auto others = std::ranges::count_if(intervals_s, [median_s](double interval_s) {
    return interval_s > kUneven * median_s || kUneven * interval_s < median_s;
  });
  return static_cast<double>(others) > kFewUneven * static_cast<double>(intervals_s.size()) ? median_s : 0.0;
}

std::size_t readings_of(std::span<const NoiseSample> rests) {
  std::size_t sum = 0;
  for (const NoiseSample& rest : rests) sum += rest.size();
  return sum;
}

/// Longer than that, a rest cannot tell a correlation from its own relaxation.
double longest_correlation_s(std::span<const Series> series) {
  double longest_s = 0.0;
  for (const Series& each : series) longest_s = std::max(longest_s, deciding().shortest_rests * each.rest_s);
  return longest_s;
}

}  // namespace

std::string_view name_of(NoiseSource source) noexcept {
  switch (source) {
    case NoiseSource::kRests:
      return "rests";
    case NoiseSource::kRepetitions:
      return "repetitions";
    case NoiseSource::kStrokes:
      return "strokes";
    case NoiseSource::kDifferences:
      return "differences";
  }
  return "";
}

std::string correlation_words(double correlation_s, double reading_s) {
  return reading_s > 0.0 ? base::number_text(std::round(correlation_s / reading_s)) + " readings"
                         : base::number_text(correlation_s, 3) + " s";
}

InstrumentNoise instrument_noise(std::span<const Series> series, std::span<const std::vector<bool>> usable) {
  InstrumentNoise out;
  const std::vector<NoiseSample> rests = find_rests(series, usable, 0.0);
  double white = 0.0, step = 0.0;
  for (const Series& each : series) {
    const ChannelQuality& force = each.force_quality;
    step = std::max(step, force.step);
    white = std::max({white, each.reading_noise_N, force.noise, force.rounding()});
  }
  out.noise = {std::max(white, 1e-9), 0.0, 1.0};
  if (readings_of(rests) >= deciding().fewest_settled_readings) {
    out.source = NoiseSource::kRests;
    const double start_N = out.noise.white_N, longest_s = longest_correlation_s(series);
    out.noise = fit_noise(rests, start_N, longest_s);
    if (const double reading_s = uneven_interval_s(rests); reading_s > 0.0) {
      const std::vector<NoiseSample> counted = find_rests(series, usable, reading_s);
      const NoiseModel by_readings = fit_noise(counted, start_N, longest_s);
      const double gain = noise_likelihood(counted, by_readings) - noise_likelihood(rests, out.noise);
      if (by_readings.coloured_N > 0.0 && gain > deciding().reading_clock_gain_nats) {
        out.noise = by_readings;
        out.reading_s = reading_s;
      }
    }
    // A coarse reading may stand on one step for a whole rest. It shows no noise there, but is wrong by up to half a
    // step, step / sqrt(12) rms, in all readings alike; in motion that error changes from reading to reading. So the
    // rest measures too little noise, and a step's error is added to both parts.
    if (out.noise.white_N < deciding().undithered_steps * step) {
      out.noise.white_N = std::hypot(out.noise.white_N, step / std::sqrt(12.0));
      out.noise.coloured_N = std::hypot(out.noise.coloured_N, step / std::sqrt(12.0));
      out.noise.correlation_s = 1.0;  // between a slow return's sawtooth and a rest
      out.reading_s = 0.0;
    }
    out.weighing = out.noise;
    return out;
  }
  if (const auto repeated = noise_of_repetitions(series, out.noise.white_N)) {
    out.source = NoiseSource::kRepetitions;
    out.noise = *repeated;
  } else if (const auto smooth = noise_within_strokes(series, out.noise.white_N)) {
    out.source = NoiseSource::kStrokes;
    out.noise = *smooth;
  }
  out.weighing = noise_of_bins(series, out.noise);
  return out;
}

RestsOnNoise rests_on(const NoiseModel& noise, std::span<const Series> series,
                      std::span<const std::vector<bool>> usable) {
  const std::vector<NoiseSample> rests =
      find_rests(series, usable, series.empty() ? 0.0 : series.front().noise_reading_s);
  const double longest_s = longest_correlation_s(series);
  RestsOnNoise out{.readings = readings_of(rests)};
  out.allow =
      noise.correlation_s <= longest_s && log_likelihood_lost(rests, noise, longest_s) <= deciding().allowed_noise_log;
  return out;
}

}  // namespace isorig::identify
