#include "daemon/core/pressure_guard.hpp"

#include <algorithm>
#include <cmath>

#include "daemon/core/valve_flow.hpp"

namespace isorig::daemon {
namespace {

constexpr double kThermalShare = 0.2;  // polytropic overshoot of a fast filling, of the change
constexpr double kThermalTimeS = 1.0;
// Over a gap as long as this nothing can be said of what happened in it.
constexpr double kLongestGapS = 0.25;
constexpr double kHoldBeginsS = 0.5;  // the approach is over
constexpr std::uint16_t kFullDuty = 1000;
constexpr double kSureRatePsiS = 0.5;  // slower than this a quiet sensor may well repeat itself

}  // namespace

PressureGuard::PressureGuard(const PressureLoopConfig& loop, double pressure_max_psi) noexcept
    : config_(loop),
      dead_duty_(std::max(PressureLoopConfig::kDeadDuty, loop.minimum_duty)),
      leak_psi_s_(loop.leak_bound_psi_s()),
      motion_psi_mm_(loop.motion_bound_psi_mm()),
      free_duty_(loop.fill_allowance()),
      fill_time_max_s_(loop.fill_time_bound_s(pressure_max_psi)) {}

void PressureGuard::on_command(std::int64_t mono_ns, const pressure::Command& command) noexcept {
  const Duties now{command.fill_permille, command.fill_permille, command.vent_permille, command.vent_permille};
  const std::int64_t slot = mono_ns / kSlotNs;
  if (newest_slot_ < 0 || slot - newest_slot_ >= kSlots) {
    slots_.fill(newest_slot_ < 0 ? now : newest_);
    newest_slot_ = slot;
  }
  while (newest_slot_ < slot) slots_[static_cast<std::size_t>(++newest_slot_ % kSlots)] = newest_;
  slots_[static_cast<std::size_t>(newest_slot_ % kSlots)].take(now);
  newest_ = now;
}

PressureGuard::Duties PressureGuard::duties_before(std::int64_t mono_ns) noexcept {
  const std::int64_t last = std::min(mono_ns / kSlotNs, newest_slot_);
  // Virtual time begins at 0: there is no slot before.
  const std::int64_t first = std::max({(mono_ns - kDelayNs) / kSlotNs, newest_slot_ - kSlots + 1, std::int64_t{0}});
  if (newest_slot_ < 0 || first > last) return newest_;  // nothing was commanded since
  const auto at = [this](std::int64_t slot) -> const Duties& {
    return slots_[static_cast<std::size_t>(slot % kSlots)];
  };
  // The range only moves on, and of its slots only the newest changes, by taking more. So those from split_ on are
  // taken together as they come, and for those before it there is a table: a range that is moved costs two steps.
  const bool goes_on = split_ >= 0 && first >= taken_first_ && first <= split_ && last >= taken_last_ &&
                       taken_first_ > newest_slot_ - kSlots;
  std::int64_t slot = taken_last_;  // it may have taken more since
  if (!goes_on) {
    split_ = slot = last;
    taken_ = at(last);
    for (std::int64_t i = last - 1; i >= first; --i) {
      auto& from = taken_from_[static_cast<std::size_t>(i % kSlots)];
      from = at(i);
      if (i + 1 < last) from.take(taken_from_[static_cast<std::size_t>((i + 1) % kSlots)]);
    }
  }
  for (; slot <= last; ++slot) taken_.take(at(slot));
  taken_first_ = first;
  taken_last_ = last;
  Duties all = taken_;
  if (first < split_) all.take(taken_from_[static_cast<std::size_t>(first % kSlots)]);
  return all;
}

void PressureGuard::restart(std::int64_t judged_from_ns) noexcept {
  judged_from_ns_ = judged_from_ns;
  last_ns_ = -1;
  short_psi_ = over_psi_ = fed_in_vain_psi_ = drained_in_vain_psi_ = hold_s_ = 0.0;
  fill_used_s_ = 0.0;
  sure_rate_psi_s_ = 0.0;
  doubt_ = {};
}

void PressureGuard::raise(const char* code, const char* what, double value, double threshold) noexcept {
  if (!doubt_) doubt_ = {code, what, value, threshold};
}

void PressureGuard::on_reading(std::int64_t mono_ns, double pressure_psi, double crosshead_velocity_mm_s,
                               bool is_holding) noexcept {
  if (!std::isfinite(pressure_psi) || mono_ns < judged_from_ns_) return;
  const double dt_s = static_cast<double>(mono_ns - last_ns_) * 1e-9;
  if (last_ns_ >= 0 && dt_s <= 0.0) return;
  const bool is_first = last_ns_ < 0 || dt_s > kLongestGapS;
  const double change_psi = pressure_psi - last_psi_;
  last_ns_ = mono_ns;
  last_psi_ = pressure_psi;
  if (is_first) {
    slow_psi_ = pressure_psi;
    short_psi_ = over_psi_ = fed_in_vain_psi_ = drained_in_vain_psi_ = hold_s_ = 0.0;
    sure_rate_psi_s_ = 0.0;
    return;
  }
  displacement_mm_ += crosshead_velocity_mm_s * dt_s;
  const double behind_psi = pressure_psi - slow_psi_;
  slow_psi_ += behind_psi * std::min(1.0, dt_s / kThermalTimeS);
  if (config_.actuator == PressureLoopConfig::Actuator::kRegulator) return;  // its flows are not ours to know

  const Duties duties = duties_before(mono_ns);
  const double full_fill = fill_rate_psi_s(config_.fill_gain_per_s, config_.supply_psi, pressure_psi);
  const double full_vent = vent_rate_psi_s(config_.vent_gain_per_s, pressure_psi);
  const auto sure = [&](std::uint16_t permille, double full) {
    return config_.response_min * std::max(0.0, 1e-3 * permille - dead_duty_) * full;
  };
  const auto possible = [&](std::uint16_t permille, double full) {
    return 1e-3 * permille * full / config_.response_min;
  };
  const double thermal_psi_s = kThermalShare * std::abs(behind_psi) / kThermalTimeS;
  const double motion_psi_s = motion_psi_mm_ * std::abs(crosshead_velocity_mm_s);
  const double slack_psi_s = leak_psi_s_ + motion_psi_s;
  // After a filling the air cools and the reading falls; after a venting it rises.
  const double low = sure(duties.fill_min, full_fill) - possible(duties.vent_max, full_vent) - slack_psi_s -
                     (behind_psi > 0.0 ? thermal_psi_s : 0.0);
  const double high = possible(duties.fill_max, full_fill) - sure(duties.vent_min, full_vent) + slack_psi_s +
                      (behind_psi < 0.0 ? thermal_psi_s : 0.0);
  short_psi_ = std::max(0.0, short_psi_ + low * dt_s - change_psi);
  over_psi_ = std::max(0.0, over_psi_ + change_psi - high * dt_s);
  if (duties.vent_max >= kFullDuty) short_psi_ = 0.0;  // the dump valve is open as well, and faster is only better

  const double sure_psi_s = std::max(sure(duties.fill_min, full_fill) - possible(duties.vent_max, full_vent),
                                     sure(duties.vent_min, full_vent) - possible(duties.fill_max, full_fill));
  sure_rate_psi_s_ = sure_psi_s - slack_psi_s > kSureRatePsiS ? sure_psi_s - slack_psi_s : 0.0;

  if (short_psi_ > config_.allowance_psi) {
    if (duties.fill_min > 0) {
      raise("pressure.no_response",
            "the fill valve is open and the reading does not rise; check the sensor's tube, the fill valve, the "
            "supply, the hoses",
            short_psi_, config_.allowance_psi);
    } else {
      raise("pressure.falls",
            "the reading falls faster than the valves can make it; check hoses, specimen and the sensor's tube",
            short_psi_, config_.allowance_psi);
    }
  } else if (over_psi_ > config_.allowance_psi) {
    if (duties.vent_min > 0) {
      raise("pressure.no_vent",
            "the vent valve is open and the reading does not fall; check the vent valve and its silencer, "
            "the fill valve, the sensor's tube",
            over_psi_, config_.allowance_psi);
    } else {
      raise("pressure.rises",
            "the reading rises faster than the valves can make it; check the fill valve (stuck open?) and the supply",
            over_psi_, config_.allowance_psi);
    }
  }
  // A duty below `minimum_duty` never reaches the valve.
  const auto fed = [&](std::uint16_t permille, double full) {
    return std::max(0.0, 1e-3 * permille - config_.minimum_duty) * full;
  };
  judge_hold(fed(duties.fill_min, full_fill) - fed(duties.vent_max, full_vent),
             fed(duties.vent_min, full_vent) - fed(duties.fill_max, full_fill), thermal_psi_s, change_psi, dt_s,
             is_holding);
  judge_fill_time(duties, dt_s);
}

void PressureGuard::judge_hold(double fed_psi_s, double drained_psi_s, double thermal_psi_s, double change_psi,
                               double dt_s, bool is_holding) noexcept {
  hold_s_ = is_holding ? hold_s_ + dt_s : 0.0;
  if (hold_s_ < kHoldBeginsS) {
    fed_in_vain_psi_ = drained_in_vain_psi_ = 0.0;
    fed_from_mm_ = drained_from_mm_ = displacement_mm_;
    return;
  }
  const double free_psi_s = leak_psi_s_ + thermal_psi_s;
  const auto add = [&](double& sum_psi, double& from_mm, double more_psi) {
    sum_psi = std::max(0.0, sum_psi + more_psi);
    if (sum_psi == 0.0) from_mm = displacement_mm_;
    return config_.hold_allowance_psi() + motion_psi_mm_ * std::abs(displacement_mm_ - from_mm);
  };
  const double fed_bound_psi = add(fed_in_vain_psi_, fed_from_mm_, (fed_psi_s - free_psi_s) * dt_s - change_psi);
  const double drained_bound_psi =
      add(drained_in_vain_psi_, drained_from_mm_, (drained_psi_s - free_psi_s) * dt_s + change_psi);
  if (fed_in_vain_psi_ > fed_bound_psi) {
    raise("pressure.hold",
          "holding the pressure takes more air than a leak may; check hoses and specimen, and whether the reading is "
          "alive",
          fed_in_vain_psi_, fed_bound_psi);
  } else if (drained_in_vain_psi_ > drained_bound_psi) {
    raise("pressure.hold",
          "holding the pressure takes venting all the time; check the fill valve, and whether the reading is alive",
          drained_in_vain_psi_, drained_bound_psi);
  }
}

void PressureGuard::judge_fill_time(const Duties& duties, double dt_s) noexcept {
  const double fill = 1e-3 * duties.fill_min;
  fill_used_s_ = std::max(0.0, fill_used_s_ + (fill - free_duty_ - 1e-3 * duties.vent_min) * dt_s);
  if (fill_used_s_ > fill_time_max_s_) {
    raise("pressure.fill_time",
          "the fill valve was open for longer than any filling takes; check supply, hoses and the sensor's tube",
          fill_used_s_, fill_time_max_s_);
  }
}

}  // namespace isorig::daemon
