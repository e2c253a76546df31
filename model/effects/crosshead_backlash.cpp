#include <algorithm>
#include <cmath>

#include "model/effects/effects.hpp"

namespace isorig::model::effect {
namespace {

/// The play operator: the crosshead stays where it is until the reading has crossed the gap. Exact on monotone steps.
class Play : public Process {
 public:
  Play(double gap_mm, double start) noexcept : half_mm_(0.5 * gap_mm), start_(start) {}
  void reset(const Instant& first) noexcept override {
    at_mm_ = first.position_mm + start_ * half_mm_;
    zero_mm_ = start_ * half_mm_;
  }
  void move(Instant& now) noexcept override {
    const double before = at_mm_;
    at_mm_ = std::clamp(at_mm_, now.position_mm - half_mm_, now.position_mm + half_mm_);
    const double offset = at_mm_ - zero_mm_ - now.position_mm;  // 0 at the start: the length there is the reading's
    now.position_mm += offset;
    now.elongation_mm += offset;
    now.step_mm = now.dt_s > 0.0 ? at_mm_ - before : 0.0;
    now.slide_mm = now.step_mm;  // reversals within the gap are gone already
    if (now.dt_s > 0.0) now.velocity_mm_s = now.step_mm == 0.0 ? 0.0 : now.velocity_mm_s;
  }

 private:
  double half_mm_;
  double start_;
  double at_mm_ = 0.0;
  double zero_mm_ = 0.0;
};

/// A dead zone between the reading and a crosshead that is dragged by what lies beyond it: tau dx'/dt = dead_zone(x -
/// x'). On a straight step the crosshead leaves a flank at most once, crosses the gap and meets the other flank, so
/// that three pieces with closed forms are the whole step.
class CompliantPlay : public Process {
 public:
  CompliantPlay(double gap_mm, double time_s, double start) noexcept
      : half_mm_(0.5 * gap_mm), time_s_(time_s), start_(start) {}
  void reset(const Instant& first) noexcept override {
    at_mm_ = first.position_mm + start_ * half_mm_;
    zero_mm_ = start_ * half_mm_;
    read_mm_ = first.position_mm;
  }
  void move(Instant& now) noexcept override {
    const double before = at_mm_, read = now.position_mm;
    if (now.dt_s > 0.0) step(read, now.dt_s);
    read_mm_ = read;
    const double offset = at_mm_ - zero_mm_ - read;
    now.position_mm += offset;
    now.elongation_mm += offset;
    now.step_mm = at_mm_ - before;
    now.slide_mm = now.step_mm;  // the drag and the gap have smoothed the reading
    const double pushed = pushed_mm(read);
    const double rate = (now.velocity_mm_s - pushed / time_s_) / time_s_;
    now.velocity_mm_s = pushed / time_s_;
    now.acceleration_mm_s2 = pushed == 0.0 ? 0.0 : rate;
  }

 private:
  /// How far the reading is beyond the flank that it touches; 0 in the gap.
  [[nodiscard]] double pushed_mm(double read_mm) const noexcept {
    const double apart = read_mm - at_mm_;
    return apart - std::clamp(apart, -half_mm_, half_mm_);
  }
  /// In contact for so long: dp/dt = v - p / tau of what is pushed, and the crosshead moves by the rest of the way.
  void drag(double pushed_mm, double v_mm_s, double for_s) noexcept {
    const double decay = -std::expm1(-for_s / time_s_);
    at_mm_ += v_mm_s * for_s - (v_mm_s * time_s_ - pushed_mm) * decay;
  }
  void step(double to_mm, double dt_s) noexcept {
    const double v = (to_mm - read_mm_) / dt_s, pushed = pushed_mm(read_mm_);
    double left_s = dt_s;
    if (pushed != 0.0) {  // ends where p is 0, which only a motion back can bring about
      const double leaves_s = pushed * v < 0.0 ? time_s_ * std::log1p(-pushed / (v * time_s_)) : dt_s;
      drag(pushed, v, std::fmin(leaves_s, dt_s));
      left_s = dt_s - leaves_s;
    }
    if (left_s <= 0.0 || v == 0.0) return;
    const double flank = v > 0.0 ? half_mm_ : -half_mm_, apart = to_mm - v * left_s - at_mm_;
    left_s -= std::fmax(0.0, (flank - apart) / v);
    if (left_s > 0.0) drag(0.0, v, left_s);
  }

  double half_mm_;
  double time_s_;
  double start_;
  double at_mm_ = 0.0;
  double zero_mm_ = 0.0;
  double read_mm_ = 0.0;
};

const Parameter kGap{
    .name = "gap_mm",
    .symbol = "g",
    .lower = 0.0,
    .upper = 3.0,
    .starts = {0.01, 0.08},
    .traits = {.resolution = Resolution::kPositionNoise, .resolution_factor = 8.0},
    .sheet = {.what = "Distance that the reading travels after a reversal before the crosshead follows.",
              .unit = "mm",
              .range = "Physics: a gap is not negative; 3 mm is more than half of the rig's travel of 5 mm to "
                       "either side, which an operator sees.",
              .errors = "Noise of the position opens a gap of its own size, so less than eight times the noise "
                        "is not claimed. Mistaken for friction with presliding."}};
const Parameter kStart{
    .name = "start",
    .symbol = "u",
    .lower = -1.0,
    .upper = 1.0,
    .starts = {0.0, 1.0, -1.0},
    .traits = {.initial_state = true},
    .sheet = {.what = "Where in the gap the crosshead stood when the recording began; +1: shortening is followed "
                      "at once, extension only after the whole gap.",
              .unit = "1",
              .range = "Physics: the crosshead is between the two flanks, -1 and +1.",
              .errors = "Only the motion up to the first two reversals depends on it; a record that starts on a "
                        "flank leaves it undetermined. Mistaken for an offset of the position."}};
const Parameter kContactTime{
    .name = "contact_time_s",
    .symbol = "tau",
    .lower = 1e-3,
    .upper = 1.0,
    .starts = {0.01, 0.1},
    .logarithmic = true,
    .traits = {.resolution = Resolution::kSampleInterval, .resolution_factor = 0.1, .lower_limit_law = "play"},
    .sheet = {
        .what = "Drag of what lies beyond the gap over the stiffness of the contact: at a steady speed v the crosshead "
                "hangs back by another v tau.",
        .unit = "s",
        .range = "Instrument: 1 ms is one interval at 1 kHz, below which the contact is stiff; 1 s is a contact that "
                 "hangs back by 10 mm at the fastest stroke.",
        .errors = "Told from the gap by strokes of different speeds alone. Mistaken for a lag of the force channel "
                  "(force_lag), which a pure contact without a gap is, and for a dead time."}};

}  // namespace

/// Play between the position reading x and the crosshead x': with the gap g,
///   x'(k) = min(max(x'(k-1), x(k) - g / 2), x(k) + g / 2),   x'(0) = x(0) + start g / 2
/// (play operator, Krasnosel'skii & Pokrovskii 1989). All later stages see x' - start g / 2, so that position and
/// elongation at the start are those of the reading, wherever in the gap the crosshead stood.
/// `compliant`: the flanks are springs and what lies beyond them is dragged (grips on guides, a damped load train),
///   tau dx'/dt = d(x - x'),   d(a) = a - min(max(a, -g / 2), g / 2),
/// a dead zone (Nordin & Gutman 2002) with tau = drag / stiffness of the contact. For tau to 0 x' is that of the play.
/// In contact p = x - x' -+ g / 2 obeys dp/dt = v - p / tau. Later stages get velocity and acceleration of x'; behind
/// the play, whose x' has no acceleration at a flank, they get the reading's.
/// Units: g mm, start 1 (-1 to 1: at +1 the crosshead follows a shortening at once), tau s.
/// Range: g up to 3 mm, tau 1 ms to 1 s.
/// Errors: exact for readings without noise that run straight between instants; noise of the position opens a gap of
/// its own size. The specimen's pull does not bend the contact: with it tau would change with its stiffness.
/// Sources: Krasnosel'skii & Pokrovskii 1989; Nordin & Gutman 2002, Automatica 38:1633 (gears and screws).
const Physics& crosshead_backlash() {
  static const Physics physics{
      "crosshead_backlash",
      Stage::kKinematics,
      "Play between the position reading and the crosshead.",
      "Play operator: Krasnosel'skii & Pokrovskii 1989; backlash of screws and gears: Nordin & Gutman 2002, Automatica "
      "38:1633.",
      "Triangles of 2 mm at 5 mm/s, and of a few times the gap: after every reversal the force stays as it is over the "
      "same travel of the reading, whatever the stiffness. Mistaken for friction (coulomb_friction).",
      {{"play",
        "x' stays until |x - x'| reaches g / 2; x' - x = u g / 2 at the start",
        {kGap, kStart},
        {},
        [](std::span<const double> p, const Reference&) { return std::make_unique<Play>(p[0], p[1]); }},
       {"compliant",
        "tau dx'/dt = (x - x') - clip(x - x', -g / 2, g / 2); x' - x = u g / 2 at the start",
        {kGap, kContactTime, kStart},
        {},
        [](std::span<const double> p, const Reference&) { return std::make_unique<CompliantPlay>(p[0], p[1], p[2]); }}},
      {.acts_on = "kinematic input",
       .depends_on = {"direction", "position"},
       .shape_of = ShapeOf::kLoop,
       .words = "play in the crosshead"}};
  return physics;
}

}  // namespace isorig::model::effect
