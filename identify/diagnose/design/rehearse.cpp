#include "identify/diagnose/design/rehearse.hpp"

#include <algorithm>
#include <cmath>

#include "identify/diagnose/design/candidates.hpp"
#include "protocol/wave.hpp"

namespace isorig::identify {
namespace {

/// Straight from point to point.
class Path {
 public:
  void begin(double t_s, double value) {
    t_s_ = {t_s};
    value_ = {value};
    area_ = {0.0};
  }
  /// Goes on to `value` within `duration_s`.
  void go(double value, double duration_s) {
    if (duration_s <= 0.0) return;
    area_.push_back(area_.back() + 0.5 * (value_.back() + value) * duration_s);
    t_s_.push_back(t_s_.back() + duration_s);
    value_.push_back(value);
  }
  void stay(double duration_s) { go(value_.back(), duration_s); }
  [[nodiscard]] double end_s() const { return t_s_.back(); }
  [[nodiscard]] double last() const { return value_.back(); }
  [[nodiscard]] const std::vector<double>& corners_s() const { return t_s_; }

  [[nodiscard]] double at(double t_s) const {
    if (t_s <= t_s_.front()) return value_.front();
    if (t_s >= t_s_.back()) return value_.back();
    const std::size_t i = before(t_s);
    const double share = (t_s - t_s_[i]) / (t_s_[i + 1] - t_s_[i]);
    return value_[i] + share * (value_[i + 1] - value_[i]);
  }
  [[nodiscard]] double slope(double t_s) const {
    if (t_s <= t_s_.front() || t_s >= t_s_.back()) return 0.0;
    const std::size_t i = before(t_s);
    return (value_[i + 1] - value_[i]) / (t_s_[i + 1] - t_s_[i]);
  }
  /// Mean over t +- half.
  [[nodiscard]] double mean(double t_s, double half_s) const {
    return (integral(t_s + half_s) - integral(t_s - half_s)) / (2.0 * half_s);
  }

 private:
  [[nodiscard]] std::size_t before(double t_s) const {
    const auto after = std::ranges::upper_bound(t_s_, t_s);
    return static_cast<std::size_t>(after - t_s_.begin()) - 1;
  }
  [[nodiscard]] double integral(double t_s) const {
    if (t_s <= t_s_.front()) return (t_s - t_s_.front()) * value_.front();
    if (t_s >= t_s_.back()) return area_.back() + (t_s - t_s_.back()) * value_.back();
    const std::size_t i = before(t_s);
    return area_[i] + 0.5 * (value_[i] + at(t_s)) * (t_s - t_s_[i]);
  }
  std::vector<double> t_s_, value_, area_;
};

struct Stretch {
  double end_s;
  bool full;
};

struct Course {
  Path position_mm, pressure_psi;
  std::vector<Stretch> stretches;

  void wait(double duration_s) {
    position_mm.stay(duration_s);
    pressure_psi.stay(duration_s);
  }
  void move(double to_mm, double duration_s) {
    position_mm.go(to_mm, duration_s);
    pressure_psi.stay(duration_s);
  }
};

void walk(const protocol::Step& step, Course& course) {
  using protocol::StepKind;
  const double start_s = course.position_mm.end_s();
  switch (step.kind) {
    case StepKind::kMark:
      return;
    case StepKind::kSettle:
      course.wait(step.nominal_s);
      break;
    case StepKind::kHold:
      course.wait(step.duration_s);
      break;
    case StepKind::kPressurize: {
      const double ramp_s = std::fabs(step.pressure_psi - course.pressure_psi.last()) / step.rate_psi_s;
      course.pressure_psi.go(step.pressure_psi, ramp_s);
      course.position_mm.stay(ramp_s);
      course.wait(step.settled_for_s);
      break;
    }
    case StepKind::kRamp:
      course.move(step.target_mm, step.nominal_s);
      course.wait(kTurn_s);
      break;
    case StepKind::kWave:
      for (std::uint32_t stroke = 0; stroke < protocol::wave::strokes(step); ++stroke) {
        const double from = course.position_mm.last(), to = protocol::wave::target_mm(step, stroke);
        const std::uint32_t chords = protocol::wave::chords(step, stroke);
        const double chord_s = protocol::wave::stroke_s(step, stroke) / chords;
        double gone_mm = 0.0;
        for (std::uint32_t chord = 0; chord < chords; ++chord) {
          gone_mm += protocol::wave::chord_speed_mm_s(step, stroke, chord) * chord_s;
          course.move(chord + 1 == chords ? to : from + std::copysign(gone_mm, to - from), chord_s);
        }
        course.wait(kTurn_s);
      }
      break;
  }
  const double end_s = course.position_mm.end_s();
  const bool full = step.keep == protocol::Keep::kFull;
  if (!full && !course.stretches.empty() && course.stretches.back().full) {
    // The seconds after a motion that are still kept in full.
    course.stretches.back().end_s = std::min(end_s, std::max(start_s, course.stretches.back().end_s));
  }
  course.stretches.push_back({end_s, full});
  if (full && step.full_after_s > 0.0) course.stretches.push_back({end_s + step.full_after_s, true});
}

}  // namespace

Series rehearse(const protocol::Plan& plan, const model::Reference& reference, const Sampling& sampling) {
  Series series;
  series.name = plan.name;
  series.excitation.reference = reference;
  Course course;
  std::size_t first = 0;
  double begun_s = 0.0, filled_psi = reference.nominal_pressure_psi;
  if (!plan.steps.empty() && plan.steps.front().kind == protocol::StepKind::kPressurize) {
    begun_s = plan.steps.front().nominal_s;
    filled_psi = plan.steps.front().pressure_psi;
    first = 1;
  }
  course.position_mm.begin(begun_s, plan.steps.empty() ? 0.0 : plan.steps.front().position_before_mm);
  course.pressure_psi.begin(begun_s, filled_psi);
  for (std::size_t i = first; i < plan.steps.size(); ++i) walk(plan.steps[i], course);

  constexpr double kHalf_s = 0.03, kFine_s = 0.004, kCoarsest_s = 2.0, kShareOfElapsed = 0.05;
  const Path& path = course.position_mm;
  const auto& corners = path.corners_s();
  std::size_t corner = 0, stretch = 0;
  const double end_s = path.end_s();
  double last_corner_s = begun_s - 10.0;
  for (double t = begun_s; t < end_s;) {
    while (corner < corners.size() && corners[corner] + kHalf_s <= t) last_corner_s = corners[corner++];
    const bool turning = corner < corners.size() && corners[corner] - kHalf_s <= t;
    double step_s = turning ? kFine_s : std::clamp(kShareOfElapsed * (t - last_corner_s), kFine_s, kCoarsest_s);
    if (!turning && corner < corners.size())
      step_s = std::min(step_s, std::max(corners[corner] - kHalf_s - t, kFine_s));
    model::Instant now;
    now.t_s = t + 0.5 * step_s;
    now.position_mm = path.mean(now.t_s, kHalf_s);
    now.elongation_mm = now.position_mm + reference.elongation_at_zero_mm;
    now.velocity_mm_s = (path.at(now.t_s + kHalf_s) - path.at(now.t_s - kHalf_s)) / (2.0 * kHalf_s);
    now.acceleration_mm_s2 = (path.slope(now.t_s + kHalf_s) - path.slope(now.t_s - kHalf_s)) / (2.0 * kHalf_s);
    now.excess_pressure_psi = course.pressure_psi.mean(now.t_s, kHalf_s) - reference.nominal_pressure_psi;
    if (!series.nodes.empty()) {
      now.dt_s = now.t_s - series.nodes.back().t_s;
      now.step_mm = now.position_mm - series.nodes.back().position_mm;
    }
    now.slide_mm = now.step_mm;
    while (stretch + 1 < course.stretches.size() && course.stretches[stretch].end_s <= t) ++stretch;
    const bool full = stretch < course.stretches.size() && course.stretches[stretch].full;
    series.nodes.push_back(now);
    series.count.push_back(step_s / (full ? sampling.full_s : sampling.averaged_s));
    series.since_corner_s.push_back(turning ? 0.0 : t - last_corner_s);
    t += step_s;
  }
  series.force_N.assign(series.nodes.size(), 0.0);
  series.excitation.reference.duration_s = end_s;
  series.excitation.reference.recording_id = model::kPlannedRecordingId;
  return series;
}

}  // namespace isorig::identify
