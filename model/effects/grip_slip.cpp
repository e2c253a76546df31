#include <cmath>

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

/// The specimen creeps out of the grips once they have begun to let go. Position, velocity and acceleration are exact
/// at every instant; between two of them the chord stands for the exponential, as behind a play.
class Creep : public Process {
 public:
  Creep(double time_s, double slip_mm, double time_constant_s, bool here) noexcept
      : time_s_(time_s), slip_mm_(here ? slip_mm : 0.0), tau_s_(time_constant_s) {}
  void reset(const Instant& first) noexcept override { out_mm_ = out_at(first.t_s); }
  void move(Instant& now) noexcept override {
    if (now.t_s < time_s_) return;
    const double out_mm = out_at(now.t_s), velocity_mm_s = (slip_mm_ - out_mm) / tau_s_;
    now.position_mm -= out_mm;
    now.elongation_mm -= out_mm;
    now.step_mm -= out_mm - out_mm_;
    now.slide_mm -= out_mm - out_mm_;
    now.velocity_mm_s -= velocity_mm_s;
    now.acceleration_mm_s2 += velocity_mm_s / tau_s_;
    out_mm_ = out_mm;
  }

 private:
  [[nodiscard]] double out_at(double t_s) const noexcept {
    return t_s < time_s_ ? 0.0 : -slip_mm_ * std::expm1(-(t_s - time_s_) / tau_s_);
  }

  double time_s_;
  double slip_mm_;
  double tau_s_;
  double out_mm_ = 0.0;
};

bool happened_in(double recording_id, const Reference& reference) noexcept {
  return recording_id == 0.0 || reference.recording_id == 0.0 || recording_id == reference.recording_id;
}

Parameter begin(std::string_view what, std::string_view errors) {
  return {
      .name = "time_s",
      .symbol = "t0",
      .lower = -1e9,
      .upper = 1e9,
      .traits = {.event_time = true},
      .sheet = {.what = what,
                .unit = "s",
                .range = "Numerics: any time that a recording can hold; it is scanned for, from reading to reading.",
                .errors = errors}};
}

Parameter length(std::string_view what, std::string_view errors) {
  return {
      .name = "slip_mm",
      .symbol = "s",
      .lower = 0.0,
      .upper = 50.0,
      .starts = {0.05},
      .traits = {.resolution = Resolution::kPositionNoise, .resolution_factor = 4.0},
      .sheet = {.what = what,
                .unit = "mm",
                .range = "Physics: under tension nothing slides in, so it is not negative. Instrument: 50 mm is the "
                         "full scale of the position channel.",
                .errors = errors}};
}

/// An event is no property of the rig: another recording does not hold it. 0: every recording does.
Parameter recording_id() {
  return {.name = "recording_id",
          .lower = 0.0,
          .upper = kLargestRecordingId,
          .starts = {0.0},
          .fixed = true,
          .traits = {.filled_by = FilledBy::kRecordingId},
          .sheet = {.what = "Number of the recording in which the slip happened; 0: in every one.",
                    .unit = "1",
                    .range = "Numerics: whole numbers up to 2^53 - 1, which a double holds exactly.",
                    .errors = "Filled in from the recording; with a wrong number the slip happens in no recording."}};
}

}  // namespace

const Physics& grip_slip() {
  static const Physics physics{
      "grip_slip",
      Stage::kKinematics,
      "Irreversible slip in a grip, sudden or creeping: an event, with its time.",
      "Grips shall hold without slip (ISO 527-1:2019). A specimen under tension can only become longer between them, "
      "so the slip is positive. What follows an event slips on at a falling rate (afterslip of faults: Marone, Scholz "
      "& Bilham 1991, with the logarithm of time; the exponential of `creep` has a single number and an end).",
      "It is in the recording or not; marks on the specimen at the grips. A slip of the force zero would not "
      "relax.",
      {{"event",
        "x' = x - s for t >= t0",
        {begin("When the grip slipped, on the clock of the recording.",
               "Known to one sample interval. A slip that takes several intervals has no single time. Mistaken for a "
               "jump "
               "of the force zero."),
         length("Length of specimen that came out of the grips; positive: longer between them, so less force.",
                "Only its product with the stiffness is measured, so a relative error of the stiffness is the same "
                "relative error of the slip. Less than four times the position noise is not claimed. Mistaken for "
                "damage of the specimen."),
         recording_id()},
        {},
        [](std::span<const double> p, const Reference& reference) {
          return std::make_unique<Slip>(p[0], p[1], happened_in(p[2], reference));
        },
        // The specimen becomes longer between the grips, so that its force falls.
        {.event_force_step = -1.0}},
       {"creep",
        "x' = x - s (1 - exp(-(t - t0) / T)) for t >= t0",
        {begin("When the grip began to let go, on the clock of the recording.",
               "Known to a share of T that falls with the noise. Mistaken for the begin of a drift."),
         length("Length of specimen that has come out of the grips in the end; positive: longer between them, so less "
                "force.",
                "Only its product with the stiffness is measured. Where the recording ends within T it hangs together "
                "with T. Less than four times the position noise is not claimed."),
         {.name = "time_constant_s",
          .symbol = "T",
          .lower = 0.5,
          .upper = 1000.0,
          .starts = {5.0},
          .logarithmic = true,
          .traits = {.lower_limit_law = "a sudden slip"},
          .sheet = {.what = "Time in which 63 % of the slip has happened.",
                    .unit = "s",
                    .range = "Numerics: below 0.5 s the slip is sudden. One that goes on for longer than its recording "
                             "shows before it is not claimed: it would be a drift of the force zero.",
                    .errors = "An afterslip that goes with the logarithm of time has no single one: the fit takes that "
                              "of its longest stretch. A slow arm, which settles after the slip, shifts it."}},
         recording_id()},
        {},
        [](std::span<const double> p, const Reference& reference) {
          return std::make_unique<Creep>(p[0], p[1], p[2], happened_in(p[3], reference));
        },
        {.event_force_step = -1.0}}},
      {.event_name = "slip",
       .acts_on = "kinematic input",
       .depends_on = {"time"},
       .shape_of = ShapeOf::kTime,
       .words = "slip in the grips"}};
  return physics;
}

}  // namespace isorig::model::effect
