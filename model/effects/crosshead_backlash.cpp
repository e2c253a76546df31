#include <algorithm>

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

}  // namespace

/// Play between the position reading x and the crosshead x': with the gap g,
///   x'(k) = min(max(x'(k-1), x(k) - g / 2), x(k) + g / 2),   x'(0) = x(0) + start g / 2
/// (play operator, Krasnosel'skii & Pokrovskii 1989). All later stages see x' - start g / 2, so that position and
/// elongation at the start are those of the reading, wherever in the gap the crosshead stood.
/// Units: g mm, start 1 (-1 to 1: at +1 the crosshead follows a shortening at once). Range: g up to 3 mm.
/// Errors: exact for readings without noise; noise of the position opens a gap of its own size.
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
        {{.name = "gap_mm",
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
                              "is not claimed. Mistaken for friction with presliding."}},
         {.name = "start",
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
                              "flank leaves it undetermined. Mistaken for an offset of the position."}}},
        {},
        [](std::span<const double> p, const Reference&) { return std::make_unique<Play>(p[0], p[1]); }}},
      {.acts_on = "kinematic input",
       .depends_on = {"direction", "position"},
       .shape_of = ShapeOf::kLoop,
       .words = "play in the crosshead"}};
  return physics;
}

}  // namespace isorig::model::effect
