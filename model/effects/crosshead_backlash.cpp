#include <algorithm>

#include "model/effects/effects.hpp"

namespace isorig::model::effect {
namespace {

/// Play: the crosshead stays where it is until the reading has crossed the gap. Exact on monotone steps.
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
    const double offset = at_mm_ - zero_mm_ - now.position_mm;  // nothing is off at the start: the force was
    now.position_mm += offset;
    now.elongation_mm += offset;
    now.step_mm = now.dt_s > 0.0 ? at_mm_ - before : 0.0;
    now.slide_mm = now.step_mm;  // play has taken out small reversals itself
    if (now.dt_s > 0.0) now.velocity_mm_s = now.step_mm == 0.0 ? 0.0 : now.velocity_mm_s;
  }

 private:
  double half_mm_;
  double start_;
  double at_mm_ = 0.0;
  double zero_mm_ = 0.0;
};

}  // namespace

const Physics& crosshead_backlash() {
  static const Physics physics{
      "crosshead_backlash",
      Stage::kKinematics,
      "Play between the position reading and the crosshead.",
      "Gap in the ball screw or the coupling; the play operator (Prandtl 1928; Krasnosel'skii & Pokrovskii 1989).",
      "Triangles of 2 mm at 5 mm/s, and of a few times the gap: the force stands still after every reversal "
      "over "
      "the same distance, whatever the stiffness. Mistaken for friction (coulomb_friction).",
      {{"play",
        "x' stays until |x - x'| reaches gap / 2",
        {{.name = "gap_mm",
          .lower = 0.0,
          .upper = 3.0,
          .starts = {0.01, 0.08},
          .traits = {.resolution = Resolution::kPositionNoise, .resolution_factor = 8.0},
          .sheet = {.what = "Distance that the reading travels after a reversal before the crosshead follows.",
                    .unit = "mm",
                    .range = "Physics: a gap is not negative; 3 mm is more than half of the rig's travel of 5 mm to "
                             "either side, and seen by eye.",
                    .errors = "Noise of the position opens a gap of its own size, so less than eight times the noise "
                              "is not claimed. Mistaken for friction with presliding."}},
         {.name = "start",
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
        [](std::span<const double> p, const Reference&) { return std::make_unique<Play>(p[0], p[1]); }}}};
  return physics;
}

}  // namespace isorig::model::effect
