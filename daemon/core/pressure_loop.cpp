#include "daemon/core/pressure_loop.hpp"

#include <algorithm>
#include <cmath>

#include "base/rounding.hpp"
#include "base/toml_reader.hpp"
#include "daemon/core/valve_flow.hpp"

namespace isorig::daemon {
namespace {

// Far from the reference the reading may be old (start, a paused loop): no step longer than this is believed.
constexpr double kLongestStepS = 0.05;

}  // namespace

PressureLoopConfig PressureLoopConfig::read(const base::TomlTable& table) {
  PressureLoopConfig c;
  c.actuator = table.choice_or("actuator", "valves", {"valves", "regulator"}) == "regulator" ? Actuator::kRegulator
                                                                                             : Actuator::kValves;
  c.supply_psi = table.number_or("supply_psi", c.supply_psi, base::kPositive);
  c.fill_gain_per_s = table.number_or("fill_gain_per_s", c.fill_gain_per_s, base::kPositive);
  c.vent_gain_per_s = table.number_or("vent_gain_per_s", c.vent_gain_per_s, base::kPositive);
  c.proportional_per_s = table.number_or("proportional_per_s", c.proportional_per_s, base::kPositive);
  c.integral_time_s = table.number_or("integral_time_s", c.integral_time_s, base::kPositive);
  c.rate_limit_psi_s = table.number_or("rate_limit_psi_s", c.rate_limit_psi_s, base::kPositive);
  c.feedforward_psi_per_mm = table.number_or("feedforward_psi_per_mm", c.feedforward_psi_per_mm);
  c.minimum_duty = table.number_or("minimum_duty", c.minimum_duty, {0.0, 0.5});
  c.settled_tolerance_psi = table.number_or("settled_tolerance_psi", c.settled_tolerance_psi, base::kPositive);
  c.dead_zone_psi = table.number_or("dead_zone_psi", c.dead_zone_psi, {0.0, 0.1});
  c.unreachable_error_psi = table.number_or("unreachable_error_psi", c.unreachable_error_psi, base::kPositive);
  c.unreachable_after_s = table.number_or("unreachable_after_s", c.unreachable_after_s, base::kPositive);
  c.response_min = table.number_or("response_min", c.response_min, {0.05, 1.0});
  c.leak_max_psi_s = table.number_or("leak_max_psi_s", c.leak_bound_psi_s(), base::kPositive);
  c.motion_max_psi_per_mm = table.number_or("motion_max_psi_per_mm", c.motion_bound_psi_mm(), base::kPositive);
  c.allowance_psi = table.number_or("allowance_psi", c.allowance_psi, {0.02, 2.0});
  return c;
}

double PressureLoopConfig::leak_bound_psi_s() const noexcept {
  return leak_max_psi_s > 0.0 ? leak_max_psi_s : kLeakShare * fill_gain_per_s * (supply_psi + kAtmospherePsi);
}

double PressureLoopConfig::motion_bound_psi_mm() const noexcept {
  return motion_max_psi_per_mm > 0.0 ? motion_max_psi_per_mm : std::max(0.25, 3.0 * std::abs(feedforward_psi_per_mm));
}

double PressureLoopConfig::fill_allowance() const noexcept {
  const double full_psi_s = fill_gain_per_s * (supply_psi + kAtmospherePsi);
  return std::min(0.5, leak_bound_psi_s() / full_psi_s + std::max(0.5 * kDeadDuty, minimum_duty));
}

double PressureLoopConfig::fill_time_bound_s(double pressure_max_psi) const noexcept {
  return kFillings * fill_time_s(fill_gain_per_s, supply_psi, pressure_max_psi);
}

PressureLoop::PressureLoop(const PressureLoopConfig& config) noexcept
    : config_(config),
      integral_most_psi_s_(PressureLoopConfig::kIntegralShare * config.fill_gain_per_s *
                           (config.supply_psi + kAtmospherePsi) * config.integral_time_s / config.proportional_per_s) {}

void PressureLoop::set_target(double target_psi, double rate_psi_s, std::int64_t mono_ns) noexcept {
  if (mode_ != Mode::kControl) {
    reference_started_ = false;
    integral_psi_s_ = 0.0;
    last_ns_ = mono_ns;
  }
  mode_ = Mode::kControl;
  target_psi_ = target_psi;
  rate_psi_s_ = rate_psi_s > 0.0 ? std::min(rate_psi_s, config_.rate_limit_psi_s) : config_.rate_limit_psi_s;
  settled_since_ns_ = -1;
  saturated_since_ns_ = -1;
  unreachable_ = false;
}

void PressureLoop::vent() noexcept {
  mode_ = Mode::kVent;
  target_psi_ = 0.0;
  settled_since_ns_ = saturated_since_ns_ = -1;
  unreachable_ = false;
  command_ = {0, 1000, 0.0F};
}

void PressureLoop::shut() noexcept {
  mode_ = Mode::kShut;
  settled_since_ns_ = saturated_since_ns_ = -1;
  unreachable_ = false;
  command_ = {0, 0, command_.regulator_psi};
}

double PressureLoop::settled_for_s(std::int64_t mono_ns) const noexcept {
  return settled_since_ns_ < 0 ? 0.0 : static_cast<double>(mono_ns - settled_since_ns_) * 1e-9;
}

pressure::Command PressureLoop::update(std::int64_t mono_ns, double pressure_psi,
                                       double crosshead_velocity_mm_s) noexcept {
  if (mode_ != Mode::kControl || !std::isfinite(pressure_psi)) return command_;

  const double dt_s = std::clamp(static_cast<double>(mono_ns - last_ns_) * 1e-9, 0.0, kLongestStepS);
  last_ns_ = mono_ns;
  if (!reference_started_) {
    reference_psi_ = pressure_psi;
    reference_started_ = true;
  }

  const double previous_psi = reference_psi_;
  const double reach_psi = rate_psi_s_ * dt_s;
  reference_psi_ += std::clamp(target_psi_ - reference_psi_, -reach_psi, reach_psi);
  const double reference_rate = dt_s > 0.0 ? (reference_psi_ - previous_psi) / dt_s : 0.0;

  if (std::abs(pressure_psi - target_psi_) > config_.settled_tolerance_psi) {
    settled_since_ns_ = -1;
  } else if (settled_since_ns_ < 0) {
    settled_since_ns_ = mono_ns;
  }

  if (config_.actuator == PressureLoopConfig::Actuator::kRegulator) {
    // The regulator closes its own loop; ours only trims what the ELVH sees differently, slowly.
    const double error = reference_psi_ - pressure_psi;
    if (std::abs(target_psi_ - reference_psi_) < 1e-9) integral_psi_s_ += error * dt_s;
    const double trim = std::clamp(integral_psi_s_ / config_.integral_time_s, -1.0, 1.0);
    integral_psi_s_ = trim * config_.integral_time_s;
    // The fill valve, where there is one, is the regulator's supply: shut when nobody regulates.
    command_ = {1000, 0, static_cast<float>(std::clamp(reference_psi_ + trim, 0.0, config_.regulator_max_psi))};
    const bool there = std::abs(target_psi_ - reference_psi_) < 1e-9;
    if (!there || std::abs(target_psi_ - pressure_psi) <= config_.unreachable_error_psi) {
      saturated_since_ns_ = -1;
    } else if (saturated_since_ns_ < 0) {
      saturated_since_ns_ = mono_ns;
    }
  } else {
    double error = reference_psi_ - pressure_psi;
    smooth_error_psi_ += (error - smooth_error_psi_) * std::min(1.0, dt_s / PressureLoopConfig::kErrorSmoothing_s);
    const bool at_target = std::abs(target_psi_ - reference_psi_) < 1e-9;
    const double edge_psi =
        in_dead_zone_ ? PressureLoopConfig::kDeadZoneLeft * config_.dead_zone_psi : config_.dead_zone_psi;
    in_dead_zone_ = at_target && std::abs(smooth_error_psi_) < edge_psi;
    if (in_dead_zone_) {
      error = 0.0;
      integral_psi_s_ *= std::max(0.0, 1.0 - dt_s / PressureLoopConfig::kIntegralFades_s);
    }
    const double rate = reference_rate + config_.feedforward_psi_per_mm * crosshead_velocity_mm_s +
                        config_.proportional_per_s * (error + integral_psi_s_ / config_.integral_time_s);
    // Close to the supply (or to the atmosphere) a valve gives next to nothing: a floor keeps the duty finite.
    const double full =
        std::max(rate >= 0.0 ? fill_rate_psi_s(config_.fill_gain_per_s, config_.supply_psi, pressure_psi)
                             : vent_rate_psi_s(config_.vent_gain_per_s, pressure_psi),
                 1e-3);
    const double wanted = rate / full;
    const double duty = std::clamp(wanted, -1.0, 1.0);
    const bool saturated = std::abs(wanted) >= 1.0;
    if (!saturated || wanted * error < 0.0) integral_psi_s_ += error * dt_s;
    integral_psi_s_ = std::clamp(integral_psi_s_, -integral_most_psi_s_, integral_most_psi_s_);

    const double size = std::abs(duty) < config_.minimum_duty ? 0.0 : std::abs(duty);
    const auto permille = static_cast<std::uint16_t>(base::rounded(1000.0 * size));
    command_ = duty >= 0.0 ? pressure::Command{permille, 0, static_cast<float>(reference_psi_)}
                           : pressure::Command{0, permille, static_cast<float>(reference_psi_)};
    const bool short_of_it = saturated && std::abs(target_psi_ - pressure_psi) > config_.unreachable_error_psi &&
                             std::abs(error) > 0.5 * config_.unreachable_error_psi;
    if (!short_of_it) {
      saturated_since_ns_ = -1;
    } else if (saturated_since_ns_ < 0) {
      saturated_since_ns_ = mono_ns;
    }
  }
  unreachable_ = saturated_since_ns_ >= 0 &&
                 static_cast<double>(mono_ns - saturated_since_ns_) * 1e-9 > config_.unreachable_after_s;
  return command_;
}

}  // namespace isorig::daemon
