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
      "A specimen under tension can only become longer between the grips, so the slip is positive.",
      "It is in the recording or not; marks on the specimen at the grips. A slip of the force zero would not "
      "relax.",
      {{"event",
        "x' = x - s for t >= t0",
        {{"time_s", -1e9, 1e9, {}, false, false, {.event_time = true}},
         {"slip_mm",
          0.0,
          50.0,
          {0.05},
          false,
          false,
          {.resolution = Resolution::kPositionNoise, .resolution_factor = 4.0}},
         // An event is no property of the rig: another recording does not hold it. 0: every recording does.
         {"recording_id", 0.0, kLargestRecordingId, {0.0}, false, true, {.filled_by = FilledBy::kRecordingId}}},
        {},
        [](std::span<const double> p, const Reference& reference) {
          const bool here = p[2] == 0.0 || reference.recording_id == 0.0 || p[2] == reference.recording_id;
          return std::make_unique<Slip>(p[0], p[1], here);
        },
        // The specimen becomes longer between the grips, so that its force falls.
        {.event_force_step = -1.0}}},
      {.event_name = "slip"}};
  return physics;
}

}  // namespace isorig::model::effect
