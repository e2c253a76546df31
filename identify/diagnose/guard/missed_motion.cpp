#include "identify/diagnose/guard/missed_motion.hpp"

#include <algorithm>
#include <cmath>

#include "identify/diagnose/deciding/deciding.hpp"
#include "identify/diagnose/guard/gaps.hpp"

namespace isorig::identify {
namespace {

constexpr std::size_t kNeighbours = 5;

/// Fastest mean velocity over five readings that goes beyond what the noise of the position can feign.
double fastest(const messages::FrameSamples& frame, double noise_mm) {
  double most = 0.0;
  for (std::size_t k = 0; k + kNeighbours < frame.size(); ++k) {
    const double way_mm = std::fabs(frame.position_mm[k + kNeighbours] - frame.position_mm[k]);
    if (way_mm > deciding().missed_motion_noises * noise_mm)
      most = std::max(most, way_mm / (frame.t_s[k + kNeighbours] - frame.t_s[k]));
  }
  return most;
}

}  // namespace

std::vector<double> missed_motion(const messages::FrameSamples& frame, const ChannelQuality& position_quality) {
  const auto& t_s = frame.t_s;
  if (t_s.size() < 4 * kNeighbours) return {};
  const auto [low, high] = std::ranges::minmax_element(frame.position_mm);
  const double fastest_mm_s = fastest(frame, position_quality.noise),
               least_mm = deciding().missed_motion_share * (*high - *low);
  struct Gap {
    double length_s, end_s;
  };
  std::vector<Gap> gaps;
  for (std::size_t k = 0; k + 1 < t_s.size(); ++k) {
    const double length_s = t_s[k + 1] - t_s[k];
    if (length_s * fastest_mm_s > least_mm && is_gap(t_s, k)) gaps.push_back({length_s, t_s[k + 1]});
  }
  std::ranges::sort(gaps, std::greater<>(), &Gap::length_s);
  if (gaps.size() > deciding().most_missed_motions) gaps.resize(deciding().most_missed_motions);
  std::vector<double> ends;
  ends.reserve(gaps.size());
  for (const Gap& gap : gaps) ends.push_back(gap.end_s);
  std::ranges::sort(ends);
  return ends;
}

}  // namespace isorig::identify
