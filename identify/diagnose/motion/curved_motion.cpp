#include "identify/diagnose/motion/curved_motion.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

#include "identify/diagnose/motion/white_jerk.hpp"

namespace isorig::identify {
namespace {

/// Neighbouring intervals in which the polygon turns.
struct Turn {
  std::size_t first, last;
};

std::vector<Turn> turns_of(const Motion& motion) {
  constexpr std::size_t kApart = 3;
  std::vector<Turn> turns;
  for (std::size_t k = 1; k + 1 < motion.velocity_mm_s.size(); ++k) {
    if (!motion.turns[k]) continue;
    if (!turns.empty() && k - turns.back().last <= kApart)
      turns.back().last = k;
    else
      turns.push_back({k, k});
  }
  return turns;
}

/// The search for curves among the polygon's turns.
class Curves {
 public:
  Curves(std::span<const double> t_s, std::span<const double> reading_mm, Motion& motion)
      : t_s_(t_s), y_(reading_mm), noise_mm_(motion.assumed_noise_mm), motion_(motion), turns_(turns_of(motion)) {}

  void search() { consider(0, turns_.size()); }

 private:
  /// Fewer readings than this are a corner, which straight lines follow well.
  static constexpr std::size_t kFewestRows = 100;

  [[nodiscard]] double side_s(std::size_t turn) const { return t_s_[turns_[turn + 1].first] - t_s_[turns_[turn].last]; }

  /// Turns `from` to `to`, exclusive: one curve, or several between the longest of their sides.
  void consider(std::size_t from, std::size_t to) {
    if (to == from || turns_[to - 1].last - turns_[from].first < kFewestRows) return;
    if (is_curve(from, to) || to - from == 1) return;
    double longest_s = 0.0;
    for (std::size_t i = from; i + 1 < to; ++i) longest_s = std::max(longest_s, side_s(i));
    for (std::size_t begin = from, i = from; i < to; ++i) {
      if (i + 1 < to && side_s(i) < 0.5 * longest_s) continue;
      consider(begin, i + 1);
      begin = i + 1;
    }
  }

  /// The polygon at an end of a curve. The line beyond is certain to a position noise over its length; a curve may
  /// begin with any acceleration of its own size, or with a corner (a sine that starts from rest).
  [[nodiscard]] MotionEnd joint(std::size_t row, const Turn& turn, double line_s, double acceleration_mm_s2) const {
    const double noise2 = noise_mm_ * noise_mm_;
    MotionEnd end;
    end.position_mm = motion_.position_mm[row];
    end.position_variance_mm2 = std::max(motion_.position_variance_mm2[row], 1e-6 * noise2);
    end.velocity_mm_s = motion_.velocity_mm_s[row];
    end.velocity_variance_mm2_s2 = noise2 / (line_s * line_s);
    end.corner_rows = std::min(turn.last - turn.first + 2, kFewestRows);
    end.acceleration_variance_mm2_s4 = 1e4 * acceleration_mm_s2 * acceleration_mm_s2;
    return end;
  }

  /// Where it is, the motion is replaced.
  bool is_curve(std::size_t from, std::size_t to) {
    const std::size_t first = turns_[from].first - 1, last = turns_[to - 1].last + 1, rows = last - first + 1;
    double polygon = 0.0, turned_mm_s = 0.0;
    for (std::size_t k = first; k <= last; ++k) {
      polygon += motion_.log_likelihood[k];
      if (k > first) turned_mm_s += std::fabs(motion_.velocity_mm_s[k] - motion_.velocity_mm_s[k - 1]);
    }
    const double span_s = t_s_[last] - t_s_[first], row_s = span_s / static_cast<double>(rows - 1);
    const double before_s = t_s_[first] - (from > 0 ? t_s_[turns_[from - 1].last] : t_s_.front());
    const double after_s = (to < turns_.size() ? t_s_[turns_[to].first] : t_s_.back()) - t_s_[last];
    const double acceleration_mm_s2 = turned_mm_s / span_s;
    if (acceleration_mm_s2 <= 0.0) return false;
    WhiteJerkSmoother walk(t_s_.subspan(first, rows), y_.subspan(first, rows), noise_mm_,
                           joint(first, turns_[from], std::max(before_s, row_s), acceleration_mm_s2),
                           joint(last, turns_[to - 1], std::max(after_s, row_s), acceleration_mm_s2));
    const double turns = static_cast<double>(to - from);
    if (walk.filter_likeliest_from(acceleration_mm_s2 * acceleration_mm_s2 * turns / span_s) <= polygon) return false;
    const auto smoothed = walk.smooth();
    for (std::size_t k = first; k <= last; ++k) {
      const auto& [mean, variance] = smoothed[k - first];
      motion_.position_mm[k] = mean[0];
      motion_.velocity_mm_s[k] = mean[1];
      motion_.acceleration_mm_s2[k] = mean[2];
      motion_.position_variance_mm2[k] = variance;
      motion_.curves[k] = true;
    }
    return true;
  }

  std::span<const double> t_s_;
  std::span<const double> y_;
  double noise_mm_;
  Motion& motion_;
  std::vector<Turn> turns_;
};

}  // namespace

void smooth_curves(std::span<const double> t_s, std::span<const double> reading_mm, Motion& motion) {
  motion.curves.assign(t_s.size(), false);
  if (motion.turns.size() == t_s.size()) Curves(t_s, reading_mm, motion).search();
}

}  // namespace isorig::identify
