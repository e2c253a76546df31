#include "identify/fv/ramps.hpp"

#include <algorithm>
#include <cmath>
#include <iomanip>
#include <sstream>

#include "identify/fv/ramp_measurement.hpp"
#include "messages/interruptions.hpp"

namespace isorig::identify {
namespace {

constexpr double kLongestInterval_s = 0.2;  // between samples; the paper's 2 mm take 0.2 to 1 s

/// Saturation shows as runs of the recording's own extreme value. A quantised but healthy channel also
/// repeats values, so a run counts when it is longer than any run of the other values.
std::vector<char> find_clipping(std::span<const double> values, std::size_t& count) {
  std::vector<char> clipped(values.size(), 0);
  count = 0;
  if (values.size() < 20) return clipped;
  const auto [low_it, high_it] = std::minmax_element(values.begin(), values.end());
  const double low = *low_it, high = *high_it;
  if (low == high) {
    count = values.size();
    std::fill(clipped.begin(), clipped.end(), 1);
    return clipped;
  }
  std::size_t longest_inside = 1;
  auto each_run = [&](auto&& use) {
    for (std::size_t i = 0; i < values.size();) {
      std::size_t j = i + 1;
      while (j < values.size() && values[j] == values[i]) ++j;
      use(i, j);
      i = j;
    }
  };
  each_run([&](std::size_t i, std::size_t j) {
    if (values[i] != low && values[i] != high) longest_inside = std::max(longest_inside, j - i);
  });
  const std::size_t limit = std::max<std::size_t>(5, 2 * longest_inside);
  each_run([&](std::size_t i, std::size_t j) {
    if ((values[i] == low || values[i] == high) && j - i >= limit) {
      std::fill(clipped.begin() + static_cast<std::ptrdiff_t>(i), clipped.begin() + static_cast<std::ptrdiff_t>(j), 1);
      count += j - i;
    }
  });
  return clipped;
}

/// A force at rest that is another one before each ramp from one position is not of the ramps: the zero drifts, or the
/// specimen creeps, or its pressure wanders. The recording does not tell which. If it is the zero, which was right when
/// the recording began, F0 = F0_i - z_i and the force at the target is F_i - z_i.
std::string weigh_wandering_rest(std::vector<Ramp>& ramps, double begin_s) {
  constexpr double kSamePositionShare = 0.02;  // of the stroke: the elastic force there differs by as little
  constexpr double kSteadyShare = 0.01;        // of F0: what the curve's heights are changed by at most
  std::string statement;
  std::vector<char> done(ramps.size(), 0);
  for (std::size_t i = 0; i < ramps.size(); ++i) {
    std::vector<double> t_s, f0_N;
    std::vector<std::size_t> same;
    double error_N = 0.0;
    for (std::size_t j = i; j < ramps.size(); ++j) {
      const Ramp& ramp = ramps[j];
      if (done[j] != 0 || !ramp.usable() ||
          std::abs(ramp.move.from_mm - ramps[i].move.from_mm) >
              kSamePositionShare * std::abs(ramps[i].move.stroke_mm())) {
        continue;
      }
      done[j] = 1;
      same.push_back(j);
      t_s.push_back(ramp.move.t_start_s - begin_s);
      f0_N.push_back(ramp.start_force_N->value);
      error_N = std::max(error_N, ramp.start_force_N->standard_error);
    }
    if (same.size() < 3) continue;
    const auto [low_N, high_N] = std::minmax_element(f0_N.begin(), f0_N.end());
    if (*high_N - *low_N <= std::max(5.0 * error_N, kSteadyShare * f0_N.front())) continue;
    const double at_zero_N = f0_N.front() - fit_line(t_s, f0_N).slope * t_s.front();
    for (std::size_t k = 0; k < same.size() && at_zero_N > 0.0; ++k) {
      Ramp& ramp = ramps[same[k]];
      ramp.normalized_force_if_zero_drifts = (ramp.peak_force_N->value - f0_N[k] + at_zero_N) / at_zero_N;
    }
    if (!statement.empty()) continue;
    std::ostringstream text;
    text << std::setprecision(3) << "The force at rest goes from " << *low_N << " to " << *high_N << " N over the "
         << same.size() << " ramps from " << std::round(100.0 * ramps[i].move.from_mm) / 100.0
         << " mm. A zero that drifts bends the curve, a specimen that creeps does not; this recording does not tell "
            "which.";
    statement = text.str();
  }
  return statement;
}

}  // namespace

bool Ramp::has(RampFlag flag) const noexcept {
  return std::find(flags.begin(), flags.end(), flag) != flags.end();
}

bool Ramp::usable() const noexcept {
  return normalized_force && strain_rate_per_s && initial_strain && strain_step && !has(RampFlag::kNeverReachedSpeed) &&
         !has(RampFlag::kInterrupted);
}

RampAnalysis analyse_ramps(const messages::Recording& recording, const RampOptions& options) {
  RampAnalysis out;
  const auto& frame = recording.frame;
  if (frame.size() < 8) {
    out.statements.push_back("The recording has only " + std::to_string(frame.size()) +
                             (frame.size() == 1 ? " sample." : " samples."));
    return out;
  }
  out.position_noise_mm = estimate_noise(frame.t_s, frame.position_mm);
  out.force_noise_N = estimate_noise(frame.t_s, frame.force_N);
  RampChannels c{recording,
                 frame.t_s,
                 frame.position_mm,
                 frame.force_N,
                 std::max(out.position_noise_mm.sigma, out.position_noise_mm.quantum / std::sqrt(12.0)),
                 std::max(out.force_noise_N.sigma, out.force_noise_N.quantum / std::sqrt(12.0)),
                 {}};
  c.clipped = find_clipping(frame.force_N, out.clipped_samples);
  // From the word to the crosshead's standing: a part of a ramp ends so long after a pause, and begins so long after
  // `resume`.
  constexpr double kStopTakes_s = 1.0;
  const std::vector<double> interruptions_s = messages::interruptions_s(recording.metadata);
  out.moves = find_moves(frame.t_s, frame.position_mm, options);
  for (std::size_t k = 0; k < out.moves.size(); ++k) {
    const Move& m = out.moves[k];
    if (m.kind != MoveKind::kIsoVelocity) continue;
    // The target is known when the specimen stayed there.
    const std::size_t next = k + 1 < out.moves.size() ? out.moves[k + 1].first : frame.size() - 1;
    const bool hold_after = frame.t_s[next] - frame.t_s[m.last] >= options.shortest_hold_s;
    out.ramps.push_back(measure_ramp(c, m, options, hold_after));
    const bool interrupted = std::ranges::any_of(interruptions_s, [&](double at_s) {
      return at_s > m.t_start_s - kStopTakes_s && at_s < m.t_end_s + kStopTakes_s;
    });
    if (interrupted) out.ramps.back().flags.push_back(RampFlag::kInterrupted);
  }
  if (auto statement = weigh_wandering_rest(out.ramps, frame.t_s.front()); !statement.empty())
    out.statements.push_back(std::move(statement));
  if (const auto n = std::ranges::count_if(out.ramps, [](const Ramp& r) { return r.has(RampFlag::kInterrupted); });
      n > 0)
    out.statements.push_back(std::to_string(n) + (n == 1 ? " ramp was" : " ramps were") +
                             " interrupted by a pause (both parts of a ramp count as one each), and not used.");
  if (out.moves.empty()) {
    const auto [low, high] = std::minmax_element(frame.position_mm.begin(), frame.position_mm.end());
    const double interval_s = (frame.t_s.back() - frame.t_s.front()) / static_cast<double>(frame.size() - 1);
    if (interval_s > kLongestInterval_s && *high - *low > 0.1) {
      // From one such sample to the next a stroke is as large as noise, and its noise estimate takes it for that.
      std::ostringstream text;
      text << "No motion can be told from noise: the samples are " << std::setprecision(2) << interval_s
           << " s apart, and between them the position moves by up to " << *high - *low
           << " mm. A ramp needs some ten samples; record or export at a higher rate.";
      out.statements.push_back(text.str());
    } else {
      out.statements.push_back("Nothing moves in this recording: no motion exceeds the noise of the position.");
    }
  } else if (out.ramps.empty()) {
    out.statements.push_back("There is no iso-velocity ramp in this recording: " + std::to_string(out.moves.size()) +
                             " motions, none of which is a stroke between two holds that is not a slow return.");
  }
  if (out.clipped_samples > 0)
    out.statements.push_back("The force stays at its own extreme value for " + std::to_string(out.clipped_samples) +
                             " samples: the channel is saturated there.");
  if (!recording.metadata.rest_length_mm)
    out.statements.push_back(
        "recording.toml has no rest_length_mm: without a length there are no strains and no force-velocity points. "
        "State it, and pressurized_rest_length_mm of a McKibben.");
  else if (!recording.metadata.pressurized_rest_length_mm)
    out.statements.push_back(
        "recording.toml has no pressurized_rest_length_mm: strains are of the rest length, and the elastic "
        "model of "
        "the paper (F0 = k1 eps0) does not apply.");
  return out;
}

}  // namespace isorig::identify
