#include "identify/diagnose/signal/flat_line.hpp"

#include <algorithm>
#include <cmath>

#include "identify/diagnose/deciding/deciding.hpp"

namespace isorig::identify {

std::vector<FlatRun> flat_runs(std::span<const double> reading, const ChannelQuality& quality) {
  std::vector<FlatRun> out;
  if (reading.size() < 20) return out;
  const double step = quality.step, measured = quality.noise;
  const double noise = std::sqrt(std::max(measured * measured - step * step / 12.0, 0.0));
  if (noise < deciding().flat_least_noise_steps * step || measured <= 0.0)
    return out;  // too coarse for a run to mean anything
  const double repeats = std::erf(step / (2.0 * std::sqrt(2.0) * noise));
  const double longest =
      repeats > 0.0
          ? 1.0 + std::log(static_cast<double>(reading.size()) / deciding().flat_runs_by_chance) / -std::log(repeats)
          : 0.0;
  const auto shortest = static_cast<std::size_t>(std::max(deciding().flat_readings, std::ceil(longest)));
  for (std::size_t k = 0; k < reading.size();) {
    std::size_t end = k + 1;
    while (end < reading.size() && reading[end] == reading[k]) ++end;
    // At rest a coarse encoder repeats one value, as a dead channel does: only the jump of a channel that comes back to
    // life tells the two apart.
    const bool jumps = end < reading.size() &&
                       std::fabs(reading[end] - reading[k]) > deciding().flat_jump_noises * std::max(noise, step);
    if (end - k >= shortest && (step < noise || jumps)) out.push_back({k, end});
    k = end;
  }
  return out;
}

bool bridge_flat_runs(std::span<const double> t_s, std::vector<double>& reading_mm, const ChannelQuality& quality) {
  bool bridged = false;
  for (const auto& [first, end] : flat_runs(reading_mm, quality)) {
    if (end == reading_mm.size()) break;  // nothing to go on to
    bridged = true;
    const double from_mm = reading_mm[first];
    for (std::size_t k = first + 1; k < end; ++k) {
      const double share = (t_s[k] - t_s[first]) / (t_s[end] - t_s[first]);
      reading_mm[k] = from_mm + share * (reading_mm[end] - from_mm);
    }
  }
  return bridged;
}

}  // namespace isorig::identify
