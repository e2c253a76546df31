#include "model/effects/effects.hpp"

namespace isorig::model::effect {
namespace {

class Slip : public Process {
 public:
  Slip(double time_s, double slip_mm, bool here) noexcept : time_s_(time_s), slip_mm_(slip_mm), here_(here) {}
  void reset(const Instant& first) noexcept override { slipped_ = first.t_s >= time_s_; }
  void move(Instant& now) noexcept override {
    if (!here_ || now.t_s < time_s_) return;
    now.position_mm -= slip_mm_;
    now.elongation_mm -= slip_mm_;
    if (!slipped_) {
      now.step_mm -= slip_mm_;
      now.slide_mm -= slip_mm_;
    }
    slipped_ = true;
  }

 private:
  double time_s_;
  double slip_mm_;
  bool here_;
  bool slipped_ = false;
};

}  // namespace

const Physics& grip_slip() {
  static const Physics physics{
      "grip_slip",
      Stage::kKinematics,
      "Sudden, irreversible slip in a grip: an event, with its time.",
      "Grips shall hold without slip (ISO 527-1:2019). A specimen under tension can only become longer between them, "
      "so the slip is positive.",
      "It is in the recording or not; marks on the specimen at the grips. A slip of the force zero would not "
      "relax.",
      {{"event",
        "x' = x - s for t >= t0",
        {{.name = "time_s",
          .symbol = "t0",
          .lower = -1e9,
          .upper = 1e9,
          .traits = {.event_time = true},
          .sheet = {.what = "When the grip slipped, on the clock of the recording.",
                    .unit = "s",
                    .range =
                        "Numerics: any time that a recording can hold; it is scanned for, from reading to reading.",
                    .errors = "Known to one sample interval. A slip that takes several intervals has no single time. "
                              "Mistaken for a jump of the force zero."}},
         {.name = "slip_mm",
          .symbol = "s",
          .lower = 0.0,
          .upper = 50.0,
          .starts = {0.05},
          .traits = {.resolution = Resolution::kPositionNoise, .resolution_factor = 4.0},
          .sheet =
              {.what = "Length of specimen that came out of the grips; positive: longer between them, so less force.",
               .unit = "mm",
               .range = "Physics: under tension nothing slides in, so it is not negative. Instrument: 50 mm is the "
                        "full scale of the position channel.",
               .errors =
                   "Only its product with the stiffness is measured, so a relative error of the stiffness is the same "
                   "relative error of the slip. Less than four times the position noise is not claimed. Mistaken for "
                   "damage of the specimen."}},
         // An event is no property of the rig: another recording does not hold it. 0: every recording does.
         {.name = "recording_id",
          .lower = 0.0,
          .upper = kLargestRecordingId,
          .starts = {0.0},
          .fixed = true,
          .traits = {.filled_by = FilledBy::kRecordingId},
          .sheet = {.what = "Number of the recording in which the slip happened; 0: in every one.",
                    .unit = "1",
                    .range = "Numerics: whole numbers up to 2^53 - 1, which a double holds exactly.",
                    .errors = "Filled in from the recording; with a wrong number the slip happens in no recording."}}},
        {},
        [](std::span<const double> p, const Reference& reference) {
          const bool here = p[2] == 0.0 || reference.recording_id == 0.0 || p[2] == reference.recording_id;
          return std::make_unique<Slip>(p[0], p[1], here);
        },
        // The specimen becomes longer between the grips, so that its force falls.
        {.event_force_step = -1.0}}},
      {.event_name = "slip",
       .acts_on = "kinematic input",
       .depends_on = {"time"},
       .shape_of = ShapeOf::kTime,
       .words = "slip in the grips"}};
  return physics;
}

}  // namespace isorig::model::effect
