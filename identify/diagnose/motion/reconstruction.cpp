#include "identify/diagnose/motion/reconstruction.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "identify/diagnose/deciding/deciding.hpp"
#include "identify/diagnose/motion/band_limited_motion.hpp"
#include "identify/diagnose/motion/corner_motion.hpp"
#include "identify/diagnose/motion/curved_motion.hpp"
#include "identify/diagnose/motion/pressure_reconstruction.hpp"
#include "identify/diagnose/signal/flat_line.hpp"
#include "identify/diagnose/signal/spikes.hpp"
#include "messages/recording_id.hpp"

namespace isorig::identify {
namespace {

/// A turning point at which a path may have stood.
struct Stand {
  std::size_t turn;  ///< the farthest reading
  std::size_t last;  ///< the path stands there up to this reading
  double level_mm;
};

/// Of a path whose farthest reading is `turn`, and which is seen to have left it at `leave`: where it stood and until
/// when. Least squares of a mean up to a reading and of a straight way from there to `leave`; a path that turns and
/// does not stand has its farthest reading alone on the mean's side.
Stand stand_at(const std::vector<double>& path, std::size_t turn, std::size_t leave) {
  // y is counted from the farthest reading, i from the one that has left. What both ways of drawing the path have in
  // common, the sum of y^2, tells none from the other.
  const double origin = path[turn], end = path[leave] - origin;
  double whole = 0.0;
  for (std::size_t k = turn; k < leave; ++k) whole += path[k] - origin;
  Stand best{turn, turn, origin};
  double least = std::numeric_limits<double>::infinity();
  double way = 0.0, way_i = 0.0;  // sums of y and i y of the readings between `last` and `leave`
  for (std::size_t last = leave; last-- > turn;) {
    const auto n = static_cast<double>(last - turn + 1), m = static_cast<double>(leave - last);
    const double stands = whole - way, level = stands / n;
    // On the way y = end + (level - end) i / m, i = 1 ... m - 1.
    const double slope = (level - end) / m;
    const double i1 = 0.5 * m * (m - 1.0), i2 = m * (m - 1.0) * (2.0 * m - 1.0) / 6.0;
    const double squares = (m - 1.0) * end * end + 2.0 * end * slope * i1 + slope * slope * i2 -
                           2.0 * (end * way + slope * way_i) - n * level * level;
    if (squares < least) {
      least = squares;
      best = {turn, last, origin + level};
    }
    const double y = path[last] - origin;
    way += y;
    way_i += m * y;
  }
  return best;
}

/// The same path with every reversal smaller than `least_mm` taken out: monotone from one true turning point to the
/// next. Where it stands at one, it stands at the mean of the readings until it leaves: the farthest of them lies
/// beyond the hold by some of its noise, and were the way from there to the hold a part of the next stroke, a bristle
/// would have turned back by that much during the whole hold.
std::vector<double> without_small_reversals(const std::vector<double>& path, double least_mm) {
  if (path.empty()) return {};
  std::vector<Stand> stands{{0, 0, path.front()}};
  std::size_t low = 0, high = 0;
  int direction = 0;
  for (std::size_t k = 1; k < path.size(); ++k) {
    if (path[k] > path[high]) high = k;
    if (path[k] < path[low]) low = k;
    if (direction >= 0 && path[high] - path[k] > least_mm) {
      stands.push_back(stand_at(path, high, k));
      direction = -1;
      low = k;
      high = k;
    } else if (direction <= 0 && path[k] - path[low] > least_mm) {
      stands.push_back(stand_at(path, low, k));
      direction = 1;
      low = k;
      high = k;
    }
    // Moving on in the same direction: the other extreme starts anew from here.
    if (direction > 0 && high == k) low = k;
    if (direction < 0 && low == k) high = k;
  }
  stands.push_back({path.size() - 1, path.size() - 1, path.back()});
  std::vector<double> out = path;
  for (std::size_t s = 0; s + 1 < stands.size(); ++s) {
    const double from = stands[s].level_mm, to = stands[s + 1].level_mm;
    const double least = std::min(from, to), most = std::max(from, to);
    double at = from;
    for (std::size_t k = stands[s].turn; k <= stands[s + 1].turn; ++k) {
      if (k > stands[s].last) at = std::clamp(to >= from ? std::max(at, path[k]) : std::min(at, path[k]), least, most);
      out[k] = at;
    }
  }
  return out;
}

/// Sum of |a_j| dt_j over windows of readings.
class VelocityChanges {
 public:
  VelocityChanges(std::span<const double> t_s, const Motion& motion) : t_s_(t_s), up_to_mm_s_(t_s.size(), 0.0) {
    for (std::size_t j = 1; j < t_s.size(); ++j)
      up_to_mm_s_[j] = up_to_mm_s_[j - 1] + std::fabs(motion.acceleration_mm_s2[j]) * (t_s[j] - t_s[j - 1]);
  }
  [[nodiscard]] std::size_t first(std::size_t k, std::size_t half) const { return k >= half ? k - half : 0; }
  [[nodiscard]] std::size_t last(std::size_t k, std::size_t half) const { return std::min(k + half, t_s_.size() - 1); }
  [[nodiscard]] double in_mm_s(std::size_t k, std::size_t half) const {
    const std::size_t from = first(k, half);
    return up_to_mm_s_[last(k, half)] - (from > 0 ? up_to_mm_s_[from - 1] : 0.0);
  }
  /// What the change, kept up over the window, shifts the position by.
  [[nodiscard]] double reach_mm(std::size_t k, std::size_t half) const {
    return in_mm_s(k, half) * (t_s_[last(k, half)] - t_s_[first(k, half)]);
  }

 private:
  std::span<const double> t_s_;
  std::vector<double> up_to_mm_s_;
};

double least_reach_mm(const Motion& motion) {
  return deciding().corner_noises * std::max(motion.noise_mm, motion.quantisation_mm);
}

/// Readings at which the motion changes its velocity by more than its noise allows: kept up over the five readings
/// about it, the change shifts the position by more than four noises.
std::vector<bool> corners(std::span<const double> t_s, const Motion& motion) {
  const VelocityChanges changes(t_s, motion);
  std::vector<bool> out(t_s.size(), false);
  for (std::size_t k = 0; k < out.size(); ++k) out[k] = changes.reach_mm(k, 2) > least_reach_mm(motion);
  return out;
}

/// Noise hides a corner from five readings, and rounds it: windows that double up to 129 readings show it. Such a
/// window holds most of what changes in twice its length, in which a shorter window has found no corner; half of it is
/// a curve.
void add_rounded_corners(std::span<const double> t_s, const Motion& motion, std::vector<bool>& corner) {
  constexpr double kMost = 0.75;
  const VelocityChanges changes(t_s, motion);
  double fastest_mm_s = 0.0;
  for (const double v : motion.velocity_mm_s) fastest_mm_s = std::max(fastest_mm_s, std::fabs(v));
  const double least_mm_s = deciding().rounded_corner_share * fastest_mm_s;
  for (std::size_t half = 4; half <= 64; half *= 2) {
    std::vector<std::size_t> found(corner.size() + 1, 0);  // corners before a reading
    for (std::size_t k = 0; k < corner.size(); ++k) found[k + 1] = found[k] + (corner[k] ? 1 : 0);
    // Of a window that hangs over an end nobody knows what the motion was before it.
    for (std::size_t k = 2 * half; k + 2 * half < corner.size(); ++k) {
      if (motion.curves[k] || found[changes.last(k, 2 * half) + 1] > found[changes.first(k, 2 * half)]) continue;
      if (changes.reach_mm(k, half) > least_reach_mm(motion) && changes.in_mm_s(k, half) > least_mm_s &&
          changes.in_mm_s(k, half) > kMost * changes.in_mm_s(k, 2 * half))
        corner[k] = true;
    }
  }
}

/// Seconds since the last corner; 0 in a corner.
std::vector<double> since_corner(std::span<const double> t_s, const std::vector<bool>& corner) {
  std::vector<double> since(t_s.size(), 0.0);
  double last_s = t_s.empty() ? 0.0 : t_s[0] - 10.0;
  for (std::size_t k = 0; k < t_s.size(); ++k) {
    if (corner[k]) last_s = t_s[k];
    since[k] = t_s[k] - last_s;
  }
  return since;
}

/// Share of the time in which the velocity changes.
double busy_share(std::span<const double> t_s, std::span<const double> since) {
  double busy_s = 0.0;
  for (std::size_t k = 1; k < t_s.size(); ++k)
    if (since[k] < 3.0 * (t_s[k] - t_s[k - 1])) busy_s += t_s[k] - t_s[k - 1];
  return t_s.size() > 1 ? busy_s / (t_s.back() - t_s.front()) : 0.0;
}

}  // namespace

void count_pressure_from(Excitation& excitation, double psi) {
  double& from_psi = excitation.reference.nominal_pressure_psi;
  if (excitation.pressure_psi.empty() && from_psi == 0.0) return;
  for (model::Instant& now : excitation.instants) now.excess_pressure_psi += from_psi - psi;
  from_psi = psi;
}

Excitation reconstruct_excitation(const messages::Recording& recording, const RecordingQuality& quality,
                                  const MotionProgress& on_progress) {
  Excitation excitation;
  const auto& frame = recording.frame;
  const std::size_t n = frame.size();
  auto [reading_mm, spikes, reading_quality] = without_spikes(frame.t_s, frame.position_mm, quality.position);
  if (bridge_flat_runs(frame.t_s, reading_mm, reading_quality))
    reading_quality = channel_quality(frame.t_s, reading_mm);
  excitation.motion = smooth_motion(frame.t_s, reading_mm, reading_quality, on_progress);
  std::vector<bool> corner = corners(frame.t_s, excitation.motion);
  excitation.since_corner_s = since_corner(frame.t_s, corner);
  if (busy_share(frame.t_s, excitation.since_corner_s) > deciding().busy_share) {
    if (auto busy = band_limited_motion(frame.t_s, reading_mm, reading_quality)) {
      excitation.motion = std::move(busy->motion);
      excitation.width = busy->width;
    }
  }
  if (excitation.width == 1) {
    smooth_curves(frame.t_s, reading_mm, excitation.motion);
    add_rounded_corners(frame.t_s, excitation.motion, corner);
    excitation.since_corner_s = since_corner(frame.t_s, corner);
    smooth_corners(frame.t_s, reading_mm, excitation.motion);
  }
  const auto& metadata = recording.metadata;
  excitation.reference.elongation_at_zero_mm = metadata.elongation_at_zero_mm();
  excitation.reference.duration_s = n > 0 ? frame.t_s.back() - frame.t_s.front() : 0.0;
  excitation.reference.rest_length_mm = metadata.rest_length_mm.value_or(0.0);
  excitation.reference.recording_id = messages::recording_id(recording);
  if (n > 0) {
    const auto [lowest, highest] = std::ranges::minmax(excitation.motion.position_mm);
    excitation.reference.lowest_position_mm = lowest;
    excitation.reference.highest_position_mm = highest;
  }
  for (const double force_N : frame.force_N)
    if (std::isfinite(force_N))
      excitation.reference.largest_force_N = std::max(excitation.reference.largest_force_N, std::fabs(force_N));

  if (recording.pressure && recording.pressure->size() > 0) {
    ReconstructedPressure pressure =
        reconstruct_pressure(*recording.pressure, quality.pressure, frame.t_s, excitation.motion.position_mm);
    excitation.pressure_psi = std::move(pressure.pressure_psi);
    excitation.pressure_noise_psi = pressure.noise_psi;
    excitation.pressure_clock_s = pressure.clock_s;
    excitation.pressure_clock_error_s = pressure.clock_error_s;
  }
  double nominal = metadata.nominal_pressure_psi.value_or(0.0);
  if (!metadata.nominal_pressure_psi && !excitation.pressure_psi.empty()) {
    for (const double p : excitation.pressure_psi) nominal += p / static_cast<double>(n);
  }
  excitation.reference.nominal_pressure_psi = nominal;

  excitation.instants.resize(n);
  excitation.slid_mm = without_small_reversals(
      excitation.motion.position_mm,
      deciding().reversal_noises * std::max(excitation.motion.noise_mm, excitation.motion.quantisation_mm));
  for (std::size_t k = 0; k < n; ++k) {
    model::Instant& now = excitation.instants[k];
    now.t_s = frame.t_s[k];
    now.position_mm = excitation.motion.position_mm[k];
    now.elongation_mm = now.position_mm + excitation.reference.elongation_at_zero_mm;
    if (k > 0) {
      now.dt_s = now.t_s - frame.t_s[k - 1];
      now.step_mm = now.position_mm - excitation.motion.position_mm[k - 1];
      now.slide_mm = excitation.slid_mm[k] - excitation.slid_mm[k - 1];
    }
    now.velocity_mm_s = excitation.motion.velocity_mm_s[k];
    now.acceleration_mm_s2 = excitation.motion.acceleration_mm_s2[k];
    now.excess_pressure_psi = excitation.pressure_psi.empty() ? 0.0 : excitation.pressure_psi[k] - nominal;
  }
  return excitation;
}

Excitation reconstruct_excitation(const messages::Recording& recording, const MotionProgress& on_progress) {
  return reconstruct_excitation(recording, recording_quality(recording), on_progress);
}

}  // namespace isorig::identify
