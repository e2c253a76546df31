#include <cmath>

#include "model/column_filter.hpp"
#include "model/effects/effects.hpp"
#include "model/stepping.hpp"

namespace isorig::model::effect {
namespace {

/// dF_read/dt = (F - F_read) / tau for every column; exact when the force runs straight between instants.
struct Lag {
  double tau_s;
  [[nodiscard]] auto over(double dt_s) const noexcept {
    return [lag = StraightLag(dt_s, tau_s)](FilteredColumn& column, double input) noexcept {
      column.output = lag.next(column.output, column.input, input);
    };
  }
};

/// (1 + tau d/dt)^2 F_read = F for every column. Exact when the force runs straight between instants, F = a + s t: then
/// F_read = a + s (t - 2 tau) + (b + c t) e^(-t / tau), with b and c from value and slope at the instant before.
struct TwoPoles {
  double tau_s;
  [[nodiscard]] auto over(double dt_s) const noexcept {
    return [dt_s, tau = tau_s, decay = std::exp(-dt_s / tau_s)](FilteredColumn& column, double input) noexcept {
      const double rise = (input - column.input) / dt_s;
      const double b = column.output - column.input + 2.0 * rise * tau;
      const double c = column.rate - rise + b / tau;
      const double transient = (b + c * dt_s) * decay;
      column.output = input - 2.0 * rise * tau + transient;
      column.rate = rise + c * decay - transient / tau;
    };
  }
};

}  // namespace

const Physics& force_lag() {
  static const Physics physics{
      "force_lag",
      Stage::kSensorLag,
      "Lag of the force channel: its amplifier's filter.",
      "Filter in the load cell's amplifier, of first order (Doebelin 1990, first-order instruments) or with two equal "
      "poles (the same, second-order instruments, damping ratio 1).",
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
        [](std::span<const double> p, const Reference&) { return std::make_unique<ColumnFilter<Lag>>(Lag{p[0]}); }},
       {"two_poles",
        "(1 + tau d/dt)^2 F' = F",
        {{.name = "time_constant_s",
          .symbol = "tau",
          .lower = 2e-4,
          .upper = 2.0,
          .starts = {0.005, 0.05},
          .logarithmic = true,
          .traits = {.resolution = Resolution::kSampleInterval, .resolution_factor = 0.1},
          .sheet = {.what = "Time constant of each of the two poles; the reading has made 26 % of a step of the force "
                            "after it, and 59 % after two.",
                    .unit = "s",
                    .range = "Instrument: 0.2 ms is a fifth of the interval at 1 kHz; 2 s is beyond the slowest filter "
                             "that an amplifier offers.",
                    .errors = "Less than a tenth of a sample interval is not claimed. Nearer to a dead time of two "
                              "time constants than a first-order lag is, and mistaken for it."}}},
        {},
        [](std::span<const double> p, const Reference&) {
          return std::make_unique<ColumnFilter<TwoPoles>>(TwoPoles{p[0]});
        }}},
      {.acts_on = "force channel",
       .depends_on = {"onset"},
       .shape_of = ShapeOf::kStep,
       .words = "a force reading that lags"}};
  return physics;
}

}  // namespace isorig::model::effect
