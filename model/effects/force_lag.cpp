#include <array>
#include <cmath>

#include "model/effects/effects.hpp"

namespace isorig::model::effect {
namespace {

/// dF_read/dt = (F - F_read) / tau for every column; exact when the force runs straight between instants.
class Lag : public Process {
 public:
  explicit Lag(double time_constant_s) noexcept : tau_s_(time_constant_s) {}
  void reset(const Instant&) noexcept override { started_ = false; }
  void shape(const Instant& now, std::span<double> columns, std::span<const double>) noexcept override {
    const std::size_t count = std::min(columns.size(), kMost);
    if (!started_ || now.dt_s <= 0.0) {
      for (std::size_t i = 0; i < count; ++i) input_[i] = output_[i] = columns[i];
      started_ = true;
      return;
    }
    const double x = now.dt_s / tau_s_;
    const double decay = -std::expm1(-x);
    const double fresh = 1.0 - decay / x;  // weight of the newest input under a straight line
    for (std::size_t i = 0; i < count; ++i) {
      output_[i] += decay * (input_[i] - output_[i]) + fresh * (columns[i] - input_[i]);
      input_[i] = columns[i];
      columns[i] = output_[i];
    }
  }

 private:
  static constexpr std::size_t kMost = 32;
  double tau_s_;
  bool started_ = false;
  std::array<double, kMost> input_{};
  std::array<double, kMost> output_{};
};

}  // namespace

const Physics& force_lag() {
  static const Physics physics{
      "force_lag",
      Stage::kSensorLag,
      "First-order lag of the force channel.",
      "First-order filter in the load cell's amplifier (Doebelin 1990, first-order instruments).",
      "Sines of 1 mm at 0.5 to 4 Hz, or a tap: a lag rounds the corner of a ramp, a dead time moves it. On "
      "ramps "
      "alone it is nearly a dead time, nearly a parallel dashpot of negative sign, nearly a fast relaxation.",
      {{"first_order",
        "tau dF'/dt = F - F'",
        {{.name = "time_constant_s",
          .symbol = "tau",
          .lower = 2e-4,
          .upper = 2.0,
          .starts = {0.005, 0.05},
          .logarithmic = true,
          .traits = {.resolution = Resolution::kSampleInterval, .resolution_factor = 0.1},
          .sheet = {.what = "Time in which the reading has made 63 % of a step of the force.",
                    .unit = "s",
                    .range = "Instrument: 0.2 ms is a fifth of the interval at 1 kHz; 2 s is beyond the slowest filter "
                             "that an amplifier offers.",
                    .errors = "Less than a tenth of a sample interval is not claimed. Mistaken for a dead time, for a "
                              "fast relaxation, and for a dashpot of negative sign."}}},
        {},
        [](std::span<const double> p, const Reference&) { return std::make_unique<Lag>(p[0]); }}},
      {.acts_on = "force channel",
       .depends_on = {"onset"},
       .shape_of = ShapeOf::kStep,
       .words = "a force reading that lags"}};
  return physics;
}

}  // namespace isorig::model::effect
