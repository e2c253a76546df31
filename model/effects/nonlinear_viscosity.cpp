#include <cmath>

#include "model/effects/effects.hpp"
#include "model/stepping.hpp"

namespace isorig::model::effect {
namespace {

/// Maxwell arm whose dashpot follows a power law. In the elongation z of the arm's spring the law holds no
/// stiffness: dz/dt = v - (|z| / 1 mm)^(m-1) z / tau. Exponential midpoint: second order, stable at any step;
/// steps are cut until the rate changes little within one (tests hold it to 1e-4 of the peak).
class PowerArm : public Process {
 public:
  PowerArm(double time_constant_s, double exponent) noexcept : tau_s_(time_constant_s), exponent_(exponent) {}
  void reset(const Instant&) noexcept override { z_ = 0.0; }
  void force(const Instant& now, double* columns) noexcept override {
    if (now.dt_s > 0.0) {
      const double v = now.step_mm / now.dt_s;
      double left_s = now.dt_s;
      for (int guard = 0; left_s > 0.0 && guard < kMostCuts; ++guard) {
        const double scale = std::fmax(std::fabs(z_), 5e-3);
        const double change = std::fabs(v) / scale + std::fabs(exponent_ - 1.0) * rate(z_);
        const double h = guard == kMostCuts - 1 ? left_s : std::fmin(left_s, 0.3 / std::fmax(change, 1e-12));
        const double middle = advance(z_, v, 0.5 * h, rate(z_));
        z_ = advance(z_, v, h, rate(middle));
        left_s -= h;
      }
    }
    columns[0] = z_;
  }

 private:
  [[nodiscard]] double rate(double z) const noexcept {
    // Bounded: for exponents below 1 the rate grows without limit as z goes to zero.
    return std::fmin(std::pow(std::fmax(std::fabs(z), 1e-6), exponent_ - 1.0) / tau_s_, 1e6);
  }
  static double advance(double z, double v, double h, double r) noexcept {
    const double x = h * r;
    if (x < 1e-9) return z + v * h;
    return z - std::expm1(-x) * (v / r - z);
  }

  static constexpr int kMostCuts = 20;
  double tau_s_;
  double exponent_;
  double z_ = 0.0;
};

/// Maxwell arm whose dashpot yields: it flows only beyond a yield elongation y of its spring (Bingham).
class YieldArm : public Process {
 public:
  YieldArm(double time_constant_s, double yield_mm) noexcept : tau_s_(time_constant_s), yield_mm_(yield_mm) {}
  void reset(const Instant&) noexcept override { z_ = 0.0; }
  void force(const Instant& now, double* columns) noexcept override {
    step(now.step_mm, now.dt_s);
    columns[0] = z_;
  }

 private:
  // Exact: rigid within the yield limit, a linear arm about +-y outside of it.
  void step(double step_mm, double dt_s) noexcept {
    for (int part = 0; part < 4 && dt_s > 0.0; ++part) {
      const double v = step_mm / dt_s;
      const double side = std::fabs(z_) > yield_mm_   ? sign_of(z_)
                          : std::fabs(z_) < yield_mm_ ? 0.0
                                                      : sign_of(v);
      if (side == 0.0 || (std::fabs(z_) == yield_mm_ && side != sign_of(z_))) {
        const double target = sign_of(v) * yield_mm_;
        const double needed_s = v == 0.0 ? dt_s : (target - z_) / v;
        if (needed_s >= dt_s) {
          z_ += step_mm;
          return;
        }
        z_ = target;
        step_mm -= v * needed_s;
        dt_s -= needed_s;
        continue;
      }
      const double edge = side * yield_mm_;
      const double decay = -std::expm1(-dt_s / tau_s_);
      const double after = (z_ - edge) + decay * (v * tau_s_ - (z_ - edge));
      if (after * side >= 0.0) {
        z_ = edge + after;
        return;
      }
      // It comes back to the edge within the step, after t with (w - v tau) exp(-t / tau) + v tau = 0.
      const double w = z_ - edge;
      const double needed_s = std::clamp(tau_s_ * std::log((w - v * tau_s_) / (-v * tau_s_)), 0.0, dt_s);
      z_ = edge - side * 1e-12;
      step_mm -= v * needed_s;
      dt_s -= needed_s;
    }
  }

  double tau_s_;
  double yield_mm_;
  double z_ = 0.0;
};

class PowerDashpot : public Process {
 public:
  explicit PowerDashpot(double exponent) noexcept : exponent_(exponent) {}
  void reset(const Instant&) noexcept override {}
  void force(const Instant& now, double* columns) noexcept override {
    columns[0] = sign_of(now.velocity_mm_s) * std::pow(std::fabs(now.velocity_mm_s), exponent_);
  }

 private:
  double exponent_;
};

}  // namespace

const Physics& nonlinear_viscosity() {
  static const Physics physics{
      "nonlinear_viscosity",
      Stage::kSpecimen,
      "A dashpot that is not linear in rate: power law or yield.",
      "Ostwald-de Waele power law; Bingham yield (Carbopol gels, as in the paper's sheaths, follow both: "
      "Herschel-Bulkley).",
      "Ramps over three decades of velocity: the time constant seen in a hold falls with the force. Mistaken "
      "for a "
      "second relaxation time at one amplitude; a second amplitude tells them apart.",
      {{"power_arm",
        "F = k z, dz/dt = v - (|z| / 1 mm)^(m-1) z / tau",
        {{"time_constant_s", 1e-3, 1e4, {0.5, 3.0}, true}, {"exponent", 0.4, 6.0, {0.7, 1.5}, true}},
        {{"stiffness_N_mm", Sign::kNonNegative}},
        [](std::span<const double> p, const Reference&) { return std::make_unique<PowerArm>(p[0], p[1]); },
        true},
       {"yield_arm",
        "F = k z, dz/dt = v - sign(z) max(0, |z| - y) / tau",
        {{"time_constant_s", 1e-3, 1e4, {0.5, 3.0}, true}, {"yield_mm", 1e-3, 3.0, {0.05, 0.4}, true}},
        {{"stiffness_N_mm", Sign::kNonNegative}},
        [](std::span<const double> p, const Reference&) { return std::make_unique<YieldArm>(p[0], p[1]); },
        true},
       {"power_dashpot",
        "F = c sign(v) |v / (1 mm/s)|^n",
        {{"exponent", 0.05, 3.0, {0.3, 2.0}, true}},
        {{"viscosity_N", Sign::kNonNegative}},
        [](std::span<const double> p, const Reference&) { return std::make_unique<PowerDashpot>(p[0]); }}}};
  return physics;
}

}  // namespace isorig::model::effect
