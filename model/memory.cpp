#include <cmath>
#include <numbers>

#include "model/column_filter.hpp"
#include "model/elements.hpp"
#include "model/stepping.hpp"

namespace isorig::model::element {
namespace {

/// Two branches with memory of which of them the specimen is on: a relay, the unit of Preisach's model (1935). s = 1
/// once x > x1, 0 once x < x0, unchanged between; F = F1 s. Exact where a reading lies beyond each threshold that is
/// passed.
class Branch : public Process {
 public:
  Branch(double upper_mm, double lower_mm) noexcept : upper_mm_(upper_mm), lower_mm_(lower_mm) {}
  void reset(const Instant& first) noexcept override { over_ = first.position_mm > upper_mm_; }
  void force(const Instant& now, double* columns) noexcept override {
    if (now.position_mm > upper_mm_) over_ = true;
    if (now.position_mm < lower_mm_) over_ = false;
    columns[0] = over_ ? 1.0 : 0.0;
  }

 private:
  double upper_mm_, lower_mm_;
  bool over_ = false;
};

/// Structure L in [0, 1] that motion breaks and time heals (Moore 1959): dL/dt = (1 - L) / tau - |v| L / d. Over a step
/// of constant velocity, with a = dt / tau and b = |dx| / d, exactly
///
///     L <- L_inf + (L - L_inf) exp(-(a + b)),   L_inf = a / (a + b)
///
/// 1 - L weighs a Maxwell arm, dz/dt = v - z / ta, and the elongation.
class Structure : public Process {
 public:
  Structure(double arm_s, double recovery_s, double travel_mm) noexcept
      : arm_(arm_s), recovery_s_(recovery_s), travel_mm_(travel_mm) {}
  void reset(const Instant&) noexcept override {
    arm_.reset();
    structure_ = 1.0;
  }
  void force(const Instant& now, double* columns) noexcept override {
    const double z_mm = arm_.step(now.step_mm, now.dt_s);
    const double healed = now.dt_s / recovery_s_, broken = std::fabs(now.step_mm) / travel_mm_;
    if (healed + broken > 0.0) {
      const double settled = healed / (healed + broken);
      structure_ = settled + (structure_ - settled) * std::exp(-(healed + broken));
    }
    columns[0] = (1.0 - structure_) * z_mm;
    columns[1] = (1.0 - structure_) * now.elongation_mm;
  }

 private:
  MaxwellState arm_;
  double recovery_s_, travel_mm_;
  double structure_ = 1.0;
};

class Wave : public Process {
 public:
  explicit Wave(double period_s) noexcept : omega_1_s_(2.0 * std::numbers::pi / period_s) {}
  void reset(const Instant& first) noexcept override { start_s_ = first.t_s; }
  void force(const Instant& now, double* columns) noexcept override {
    const double phase = omega_1_s_ * (now.t_s - start_s_);
    columns[0] = std::sin(phase);
    columns[1] = std::cos(phase);
    columns[2] = columns[0] * now.elongation_mm;
    columns[3] = columns[1] * now.elongation_mm;
  }

 private:
  double omega_1_s_;
  double start_s_ = 0.0;
};

/// F'' / w^2 + 2 zeta F' / w + F = G for every column; exact when G runs straight between instants. A straight G of
/// slope g is followed, once settled, by G - 2 zeta g / w. The distance d from there obeys the homogeneous equation, so
/// over a step h, with a = zeta w, b = w sqrt(1 - zeta^2), c = exp(-a h) cos(b h) and s = exp(-a h) sin(b h) / b
///
///     d  <- (c + a s) d + s d'
///     d' <- -w^2 s d + (c - a s) d'
struct Response {
  double period_s, damping;
  [[nodiscard]] auto over(double dt_s) const noexcept {
    const double omega_1_s = 2.0 * std::numbers::pi / period_s;
    const double decay = damping * omega_1_s, ringing = omega_1_s * std::sqrt(1.0 - damping * damping);
    const double e = std::exp(-decay * dt_s);
    const double c = e * std::cos(ringing * dt_s), s = e * std::sin(ringing * dt_s) / ringing;
    const double lag_s = 2.0 * damping / omega_1_s;
    return [=](FilteredColumn& column, double input) noexcept {
      // About the straight line that it would follow, late by lag_s, once settled.
      const double slope = (input - column.input) / dt_s;
      const double away = column.output - (column.input - lag_s * slope), away_rate = column.rate - slope;
      const double next = (c + decay * s) * away + s * away_rate;
      const double next_rate = -omega_1_s * omega_1_s * s * away + (c - decay * s) * away_rate;
      column.output = input - lag_s * slope + next;
      column.rate = slope + next_rate;
    };
  }
};

}  // namespace

const Physics& empirical_memory() {
  static const Physics physics{
      "empirical_memory",
      Stage::kSpecimen,
      "A force without a law yet that depends on what was before.",
      "Relay of Preisach 1935; structure kinetics of Moore 1959; a wave in the time since the start.",
      "The same position come to from both sides; rests of different length; the same motion again later.",
      {{"branch",
        "F = F1 s, s = 1 beyond x1, 0 below x0, between them as before",
        {{.name = "upper_mm", .lower = -1e3, .upper = 1e3, .starts = {0.5}, .fixed = true},
         {.name = "lower_mm", .lower = -1e3, .upper = 1e3, .starts = {-0.5}, .fixed = true}},
        {{.name = "force_N", .sign = Sign::kFree}},
        [](std::span<const double> p, const Reference&) { return std::make_unique<Branch>(p[0], p[1]); }},
       {"structure",
        "F = (k z + ke e) (1 - L), dz/dt = v - z / ta, dL/dt = (1 - L) / tr - |v| L / d",
        {{.name = "arm_s", .lower = 1e-3, .upper = 1e5, .starts = {0.3, 3.0}, .logarithmic = true},
         {.name = "recovery_s", .lower = 0.1, .upper = 1e4, .starts = {10.0, 60.0}, .logarithmic = true},
         {.name = "travel_mm", .lower = 1e-2, .upper = 1e3, .starts = {2.0}, .logarithmic = true}},
        {{.name = "arm_N_mm", .sign = Sign::kFree}, {.name = "elastic_N_mm", .sign = Sign::kFree}},
        [](std::span<const double> p, const Reference&) { return std::make_unique<Structure>(p[0], p[1], p[2]); }},
       {"wave",
        "F = (a + b e) sin(2 pi t / T) + (c + d e) cos(2 pi t / T), t since the start",
        {{.name = "period_s", .lower = 1.0, .upper = 1e5, .starts = {600.0}, .logarithmic = true}},
        {{.name = "sine_N", .sign = Sign::kFree},
         {.name = "cosine_N", .sign = Sign::kFree},
         {.name = "sine_N_mm", .sign = Sign::kFree},
         {.name = "cosine_N_mm", .sign = Sign::kFree}},
        [](std::span<const double> p, const Reference&) { return std::make_unique<Wave>(p[0]); },
        {.counts = Counts::kTime}}}};
  return physics;
}

const Physics& empirical_response() {
  static const Physics physics{
      "empirical_response",
      Stage::kSensorLag,
      "A force channel that answers late, or rings.",
      "Second-order response, the first mode of a load train on its cell.",
      "A tap; the corners of fast ramps.",
      {{"second_order",
        "F'' / w^2 + 2 zeta F' / w + F = G, w = 2 pi / T",
        {{.name = "period_s", .lower = 2e-3, .upper = 2.0, .starts = {0.1, 0.03}, .logarithmic = true},
         {.name = "damping", .lower = 5e-3, .upper = 0.95, .starts = {0.08, 0.4}, .logarithmic = true}},
        {},
        [](std::span<const double> p, const Reference&) {
          return std::make_unique<ColumnFilter<Response>>(Response{p[0], p[1]});
        }}}};
  return physics;
}

}  // namespace isorig::model::element
