#include "identify/diagnose/explain/shape.hpp"

#include <algorithm>
#include <cmath>

#include "base/number_text.hpp"
#include "base/quantile.hpp"
#include "identify/diagnose/fit/free_parameters.hpp"
#include "model/composed.hpp"

namespace isorig::identify {
namespace {

using model::Instant;
using model::ModelSpec;
using model::ShapeOf;

/// What the recordings passed through.
struct Ranges {
  double low_mm = 1e300, high_mm = -1e300;
  double fastest_mm_s = 0.0, acceleration_mm_s2 = 0.0;
  double low_psi = 1e300, high_psi = -1e300;
  double travel_mm = 0.0, duration_s = 0.0;
  [[nodiscard]] double middle_mm() const { return 0.5 * (low_mm + high_mm); }
  [[nodiscard]] double range_mm() const { return high_mm - low_mm; }
};

Ranges ranges_of_all(std::span<const Series> series) {
  Ranges out;
  std::vector<double> accelerations;
  for (const Series& each : series) {
    double travel_mm = 0.0;
    for (const Instant& node : each.nodes) {
      out.low_mm = std::min(out.low_mm, node.position_mm);
      out.high_mm = std::max(out.high_mm, node.position_mm);
      out.low_psi = std::min(out.low_psi, node.excess_pressure_psi);
      out.high_psi = std::max(out.high_psi, node.excess_pressure_psi);
      if (node.dt_s > 0.0) out.fastest_mm_s = std::max(out.fastest_mm_s, std::fabs(node.step_mm) / node.dt_s);
      accelerations.push_back(std::fabs(node.acceleration_mm_s2));
      travel_mm += std::fabs(node.step_mm);
    }
    out.travel_mm = std::max(out.travel_mm, travel_mm);
    if (!each.nodes.empty()) out.duration_s = std::max(out.duration_s, each.nodes.back().t_s - each.nodes.front().t_s);
  }
  if (!accelerations.empty()) out.acceleration_mm_s2 = base::quantile(std::move(accelerations), 0.99);
  return out;
}

/// A motion as a model is driven by it, and the instants at which the force is looked at.
class ProbeMotion {
 public:
  ProbeMotion(double start_mm, double start_s, const model::Reference& reference)
      : zero_mm_(reference.elongation_at_zero_mm) {
    now_.t_s = start_s;
    now_.position_mm = start_mm;
    now_.elongation_mm = start_mm + zero_mm_;
    instants_.push_back(now_);
  }
  void set_pressure(double excess_psi) { now_.excess_pressure_psi = excess_psi; }
  void set_acceleration(double mm_s2) { now_.acceleration_mm_s2 = mm_s2; }
  /// In `parts` steps at constant velocity.
  void to(double position_mm, double duration_s, int parts = 1) {
    const double from_mm = now_.position_mm, from_s = now_.t_s;
    for (int i = 1; i <= parts; ++i) {
      const double share = static_cast<double>(i) / parts;
      const double at_mm = from_mm + share * (position_mm - from_mm);
      now_.dt_s = duration_s / parts;
      now_.t_s = from_s + share * duration_s;
      now_.step_mm = at_mm - now_.position_mm;
      now_.position_mm = at_mm;
      now_.elongation_mm = at_mm + zero_mm_;
      now_.velocity_mm_s = now_.dt_s > 0.0 ? now_.step_mm / now_.dt_s : 0.0;
      instants_.push_back(now_);
    }
  }
  void look(double x) {
    x_.push_back(x);
    at_.push_back(instants_.size() - 1);
  }
  [[nodiscard]] const std::vector<double>& x() const noexcept { return x_; }

  /// Force of the model where it was looked at.
  [[nodiscard]] Eigen::VectorXd force(const ModelSpec& spec, const model::Reference& reference) const {
    model::RunningModel running(spec, reference);
    running.reset(instants_.front());
    Eigen::VectorXd out(static_cast<Eigen::Index>(at_.size()));
    Eigen::Index next = 0;
    for (std::size_t i = 0; i < instants_.size(); ++i) {
      const double force_N = running.step(instants_[i]);
      while (next < out.size() && at_[static_cast<std::size_t>(next)] == i) out[next++] = force_N;
    }
    return out;
  }

 private:
  double zero_mm_;
  Instant now_;
  std::vector<Instant> instants_;
  std::vector<double> x_;
  std::vector<std::size_t> at_;
};

/// One motion, or one for each velocity.
struct Probe {
  std::string of;
  std::vector<ProbeMotion> motions;
};

Probe sweep(const Ranges& r, const model::Reference& reference, double start_s, bool back) {
  constexpr int kPoints = 80;
  ProbeMotion motion(r.low_mm, start_s, reference);
  const double step_mm = r.range_mm() / kPoints, step_s = step_mm / (0.1 * r.fastest_mm_s);
  motion.look(r.low_mm);
  for (int i = 1; i <= (back ? 2 : 1) * kPoints; ++i) {
    const double at_mm = r.low_mm + step_mm * (i <= kPoints ? i : 2 * kPoints - i);
    motion.to(at_mm, step_s);
    motion.look(at_mm);
  }
  return {"position_mm", {std::move(motion)}};
}

Probe over_rate(const Ranges& r, const model::Reference& reference, double start_s) {
  constexpr int kEachWay = 15, kParts = 64;
  // As many velocities in each factor of the fastest: from a thousandth of it on.
  Probe out{"rate_mm_s", {}};
  for (int i = -kEachWay; i <= kEachWay; ++i) {
    const double share = i == 0 ? 0.0 : std::copysign(std::pow(1e-3, 1.0 - (std::abs(i) - 1.0) / (kEachWay - 1.0)), i);
    const double velocity_mm_s = share * r.fastest_mm_s, half_mm = 0.5 * r.range_mm();
    ProbeMotion motion(r.middle_mm() - std::copysign(0.5 * half_mm, share), start_s, reference);
    if (i == 0)
      motion.to(r.middle_mm() - 0.5 * half_mm, half_mm / r.fastest_mm_s);
    else
      motion.to(r.middle_mm() + std::copysign(0.5 * half_mm, share), half_mm / std::fabs(velocity_mm_s), kParts);
    motion.look(velocity_mm_s);
    out.motions.push_back(std::move(motion));
  }
  return out;
}

Probe over_time(const Ranges& r, const model::Reference& reference, double start_s) {
  constexpr int kPoints = 100;
  ProbeMotion motion(r.middle_mm(), start_s, reference);
  motion.look(start_s);
  for (int i = 1; i <= kPoints; ++i) {
    motion.to(r.middle_mm(), r.duration_s / kPoints);
    motion.look(start_s + r.duration_s * i / kPoints);
  }
  return {"time_s", {std::move(motion)}};
}

Probe after_step(const Ranges& r, const model::Reference& reference, double start_s) {
  constexpr double kShare = 0.05, kFirst_s = 1e-3;
  constexpr int kDuring = 20, kAfter = 60;
  ProbeMotion motion(r.middle_mm(), start_s, reference);
  // The ramp begins from rest, with what came before forgotten by a delay.
  motion.to(r.middle_mm(), 1.0, 10);
  motion.look(0.0);
  const double ramp_s = kShare * r.range_mm() / r.fastest_mm_s;
  for (int i = 1; i <= kDuring; ++i) {
    motion.to(r.middle_mm() + kShare * r.range_mm() * i / kDuring, ramp_s / kDuring);
    motion.look(ramp_s * i / kDuring);
  }
  const double growth = std::pow(std::max(r.duration_s / kFirst_s, 10.0), 1.0 / kAfter);
  double since_s = 0.0;
  for (double next_s = kFirst_s; next_s <= r.duration_s; next_s *= growth) {
    motion.to(r.middle_mm() + kShare * r.range_mm(), next_s - since_s);
    since_s = next_s;
    motion.look(ramp_s + since_s);
  }
  return {"time_since_step_s", {std::move(motion)}};
}

Probe over_pressure(const Ranges& r, const model::Reference& reference, double start_s) {
  constexpr int kPoints = 60;
  constexpr double kShare = 0.1;
  ProbeMotion motion(r.middle_mm() - kShare * r.range_mm(), start_s, reference);
  motion.set_pressure(r.low_psi);
  // Sliding before it is looked at.
  motion.to(r.middle_mm() - 0.5 * kShare * r.range_mm(), 0.5 * kShare * r.range_mm() / r.fastest_mm_s, 20);
  const double step_mm = kShare * r.range_mm() / kPoints;
  for (int i = 0; i <= kPoints; ++i) {
    const double excess_psi = r.low_psi + (r.high_psi - r.low_psi) * i / kPoints;
    motion.set_pressure(excess_psi);
    motion.to(r.middle_mm() - 0.5 * kShare * r.range_mm() + step_mm * i, step_mm / r.fastest_mm_s);
    motion.look(reference.nominal_pressure_psi + excess_psi);
  }
  return {"pressure_psi", {std::move(motion)}};
}

Probe over_travel(const Ranges& r, const model::Reference& reference, double start_s) {
  constexpr double kMostCycles = 4000.0;
  constexpr int kParts = 8, kPoints = 60;
  const double half_mm = 0.5 * r.range_mm(), stroke_s = half_mm / r.fastest_mm_s;
  const int cycles = static_cast<int>(std::clamp(std::ceil(r.travel_mm / (2.0 * half_mm)), 1.0, kMostCycles));
  const int every = std::max(1, cycles / kPoints);
  ProbeMotion motion(r.middle_mm() - 0.5 * half_mm, start_s, reference);
  for (int i = 0; i < cycles; ++i) {
    motion.to(r.middle_mm() + 0.5 * half_mm, stroke_s, kParts);
    if (i % every == 0) motion.look((2.0 * i + 1.0) * half_mm);
    motion.to(r.middle_mm() - 0.5 * half_mm, stroke_s, kParts);
  }
  return {"travel_mm", {std::move(motion)}};
}

Probe over_acceleration(const Ranges& r, const model::Reference& reference, double start_s) {
  constexpr int kEachWay = 15;
  ProbeMotion motion(r.middle_mm(), start_s, reference);
  for (int i = -kEachWay; i <= kEachWay; ++i) {
    const double acceleration_mm_s2 = r.acceleration_mm_s2 * i / kEachWay;
    motion.set_acceleration(acceleration_mm_s2);
    motion.to(r.middle_mm(), 1e-3);
    motion.look(acceleration_mm_s2);
  }
  return {"acceleration_mm_s2", {std::move(motion)}};
}

Probe probe_of(ShapeOf shape, const Ranges& r, const model::Reference& reference, double start_s) {
  switch (shape) {
    case ShapeOf::kPosition:
    case ShapeOf::kLoad:
      return sweep(r, reference, start_s, false);
    case ShapeOf::kLoop:
      return sweep(r, reference, start_s, true);
    case ShapeOf::kRate:
      return over_rate(r, reference, start_s);
    case ShapeOf::kTime:
      return over_time(r, reference, start_s);
    case ShapeOf::kStep:
      return after_step(r, reference, start_s);
    case ShapeOf::kPressure:
      return over_pressure(r, reference, start_s);
    case ShapeOf::kTravel:
      return over_travel(r, reference, start_s);
    case ShapeOf::kAcceleration:
      return over_acceleration(r, reference, start_s);
  }
  return {};
}

ModelSpec without_parts(ModelSpec spec, const model::Physics& effect) {
  std::erase_if(spec.parts, [&](const model::Part& part) { return part.physics == &effect; });
  return spec;
}

Eigen::VectorXd force(const Probe& probe, const ModelSpec& spec, const model::Reference& reference) {
  std::vector<Eigen::VectorXd> each;
  Eigen::Index count = 0;
  for (const ProbeMotion& motion : probe.motions) count += each.emplace_back(motion.force(spec, reference)).size();
  Eigen::VectorXd out(count);
  Eigen::Index at = 0;
  for (const Eigen::VectorXd& one : each) {
    out.segment(at, one.size()) = one;
    at += one.size();
  }
  return out;
}

}  // namespace

Shape shape_of(const Problem& problem, const ModelSpec& spec, const model::Physics& effect,
               const std::optional<NoiseModel>& fitted_under) {
  constexpr double k95 = 1.96;
  Shape out;
  const Ranges ranges = ranges_of_all(problem.series());
  if (!(ranges.range_mm() > 0.0) || !(ranges.fastest_mm_s > 0.0)) return out;
  const Series& series = problem.series()[0];
  const model::Reference& reference = series.excitation.reference;
  const Probe probe = probe_of(effect.traits.shape_of, ranges, reference, series.nodes.front().t_s);
  out.of = probe.of;
  const auto added = [&](const ModelSpec& of) -> Eigen::VectorXd {
    return force(probe, of, reference) - force(probe, without_parts(of, effect), reference);
  };
  const Eigen::VectorXd y = added(spec);
  for (const ProbeMotion& motion : probe.motions) out.x.insert(out.x.end(), motion.x().begin(), motion.x().end());
  if (effect.traits.shape_of == ShapeOf::kLoad) {
    out.of = "load_N";
    const Eigen::VectorXd load = force(probe, without_parts(spec, effect), reference);
    out.x.assign(load.data(), load.data() + load.size());
  }
  const std::vector<FreeNumber> numbers = fitted_numbers(spec);
  const Eigen::VectorXd variance_N2 = variance_by_numbers(
      spec, numbers, covariance(problem, spec, Spread::kMoves, fitted_under), differences(spec, numbers, y, added));
  for (Eigen::Index i = 0; i < y.size(); ++i) {
    const double half_N = k95 * std::sqrt(std::max(variance_N2[i], 0.0));
    out.y.push_back(y[i]);
    out.low95.push_back(y[i] - half_N);
    out.high95.push_back(y[i] + half_N);
  }
  return out;
}

std::string formula_text(const model::Law& law, std::span<const NamedValue> numbers) {
  std::string out(law.formula);
  const auto add = [&](std::string_view name, std::string_view symbol, std::string_view unit) {
    const auto found = std::ranges::find(numbers, name, &NamedValue::name);
    if (found == numbers.end() || symbol.empty()) return;
    out += ", " + std::string(symbol) + " = " + base::number_text(found->value, 4);
    if (unit != "1" && !unit.empty()) out += " " + std::string(unit);
  };
  for (const auto& coefficient : law.coefficients) add(coefficient.name, coefficient.symbol, coefficient.sheet.unit);
  for (const auto& parameter : law.parameters) add(parameter.name, parameter.symbol, parameter.sheet.unit);
  return out;
}

}  // namespace isorig::identify
