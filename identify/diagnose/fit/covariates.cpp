#include "identify/diagnose/fit/covariates.hpp"

#include <algorithm>
#include <cmath>

#include "identify/diagnose/deciding/deciding.hpp"

namespace isorig::identify {
namespace {

/// Direction of the last motion; it stays the same in a hold, as friction does. The end of a ramp overshoots by some
/// noises of the reading, and there the reconstructed velocity varies by more than that of a slow return: only a
/// displacement of a thousandth of the whole stroke or more counts as a turn.
std::vector<int> last_directions(std::span<const Series> series, const std::vector<double>& position_mm) {
  const auto [lowest_mm, highest_mm] = std::ranges::minmax(position_mm);
  std::vector<int> out;
  for (const Series& each : series) {
    const double turn_mm = std::max(deciding().direction_turn_share * (highest_mm - lowest_mm),
                                    deciding().direction_turn_noises * each.excitation.motion.noise_mm);
    double follower_mm = each.nodes.front().position_mm;
    int last = 1;
    for (const auto& node : each.nodes) {
      const double before_mm = follower_mm;
      follower_mm = std::clamp(follower_mm, node.position_mm - 0.5 * turn_mm, node.position_mm + 0.5 * turn_mm);
      if (follower_mm != before_mm) last = follower_mm > before_mm ? 2 : 0;
      out.push_back(last);
    }
  }
  return out;
}

}  // namespace

Covariates covariates_of(std::span<const Series> series) {
  Covariates out;
  double start_s = 0.0, fastest_mm_s = 1e-9;
  for (const Series& each : series) {
    double travelled_mm = 0.0;
    for (std::size_t k = 0; k < each.nodes.size(); ++k) {
      const auto& node = each.nodes[k];
      travelled_mm += std::fabs(node.step_mm);
      out.time_s.push_back(start_s + node.t_s);
      out.position_mm.push_back(node.position_mm);
      out.strain_percent.push_back(100.0 * series[0].recording.strain(node.position_mm));
      out.rate_mm_s.push_back(node.velocity_mm_s);
      out.since_s.push_back(each.since_corner_s[k]);
      out.travel_mm.push_back(travelled_mm);
      out.pressure_psi.push_back(node.excess_pressure_psi);
      out.readings.push_back(each.count[k]);
      fastest_mm_s = std::max(fastest_mm_s, std::fabs(node.velocity_mm_s));
    }
    start_s += each.nodes.back().t_s + 1.0;
  }
  const double still_mm_s = deciding().direction_still_share * fastest_mm_s;
  for (const double rate : out.rate_mm_s) out.direction.push_back(rate > still_mm_s ? 2 : rate < -still_mm_s ? 0 : 1);
  out.last_direction = last_directions(series, out.position_mm);
  out.moves = number_moves(series);
  return out;
}

}  // namespace isorig::identify
