#include <cmath>

#include "model/effects/effects.hpp"

namespace isorig::model::effect {
namespace {

class Unsettled : public Process {
 public:
  explicit Unsettled(double time_constant_s) noexcept : tau_s_(time_constant_s) {}
  void reset(const Instant& first) noexcept override { start_s_ = first.t_s; }
  void force(const Instant& now, double* columns) noexcept override {
    columns[0] = std::exp(-(now.t_s - start_s_) / tau_s_);
  }

 private:
  double tau_s_;
  double start_s_ = 0.0;
};

}  // namespace

const Physics& unsettled_start() {
  static const Physics physics{
      "unsettled_start",
      Stage::kSpecimen,
      "The recording starts before the specimen has come to rest.",
      "Maxwell 1867: an arm that still holds force when the recording begins.",
      "Wait longer before the first motion.",
      {{"exponential",
        "F = F0 exp(-t / tau)",
        {{.name = "time_constant_s",
          .symbol = "tau",
          .lower = 0.05,
          .upper = 100.0,
          .starts = {1.0, 20.0},
          .logarithmic = true,
          .traits = {.upper_bound_is = "zero_drift"},
          .sheet = {.what = "Time in which the force left at the start falls to 1/e.",
                    .unit = "s",
                    .range = "Instrument: 50 ms is over before the first ramp of any protocol begins; beyond 100 s it "
                             "is a drift of the force zero.",
                    .errors = "A rest before the first ramp that is shorter than it leaves it uncertain. Mistaken for "
                              "a time constant of the specimen."}}},
        {{.name = "force_N",
          .symbol = "F0",
          .sign = Sign::kFree,
          .sheet =
              {.what = "Force left over at the first reading; positive: it pulls.",
               .unit = "N",
               .range = "Physics: the specimen may have been stretched or let go before, so it has no sign.",
               .errors =
                   "A tare taken before the specimen was at rest adds to it. Mistaken for an offset of the force."}}},
        [](std::span<const double> p, const Reference&) { return std::make_unique<Unsettled>(p[0]); },
        {.counts = Counts::kTime}}},
      {.unusual = true,
       .acts_on = "arm",
       .depends_on = {"time"},
       .shape_of = ShapeOf::kTime,
       .words = "a specimen that had not settled at the start"}};
  return physics;
}

}  // namespace isorig::model::effect
