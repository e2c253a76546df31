#include <array>
#include <cmath>

#include "model/effects/effects.hpp"
#include "model/stepping.hpp"

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
    const StraightLag lag(now.dt_s, tau_s_);
    for (std::size_t i = 0; i < count; ++i) {
      output_[i] = lag.next(output_[i], input_[i], columns[i]);
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

/// (1 + tau d/dt)^2 F_read = F for every column. Exact when the force runs straight between instants, F = a + s t: then
/// F_read = a + s (t - 2 tau) + (b + c t) e^(-t / tau), with b and c from value and slope at the instant before.
class TwoPoles : public Process {
 public:
  explicit TwoPoles(double time_constant_s) noexcept : tau_s_(time_constant_s) {}
  void reset(const Instant&) noexcept override { started_ = false; }
  void shape(const Instant& now, std::span<double> columns, std::span<const double>) noexcept override {
    const std::size_t count = std::min(columns.size(), kMost);
    if (!started_ || now.dt_s <= 0.0) {
      for (std::size_t i = 0; i < count; ++i) {
        input_[i] = output_[i] = columns[i];
        slope_[i] = 0.0;
      }
      started_ = true;
      return;
    }
    const double decay = std::exp(-now.dt_s / tau_s_);
    for (std::size_t i = 0; i < count; ++i) {
      const double rise = (columns[i] - input_[i]) / now.dt_s;
      const double b = output_[i] - input_[i] + 2.0 * rise * tau_s_;
      const double c = slope_[i] - rise + b / tau_s_;
      const double transient = (b + c * now.dt_s) * decay;
      output_[i] = columns[i] - 2.0 * rise * tau_s_ + transient;
      slope_[i] = rise + c * decay - transient / tau_s_;
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
  std::array<double, kMost> slope_{};
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
        [](std::span<const double> p, const Reference&) { return std::make_unique<Lag>(p[0]); }},
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
        [](std::span<const double> p, const Reference&) { return std::make_unique<TwoPoles>(p[0]); }}},
      {.acts_on = "force channel",
       .depends_on = {"onset"},
       .shape_of = ShapeOf::kStep,
       .words = "a force reading that lags"}};
  return physics;
}

}  // namespace isorig::model::effect
