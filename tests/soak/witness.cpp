#include "witness.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "base/formatted.hpp"

namespace isorig::soak {
namespace {

using daemon::RunState;

// docs/faults.md, what a cell is held to.
constexpr double kOverSetpoint_psi = 3.0;
constexpr double kOverLimit_psi = 1.5;
constexpr double kForceShare = 0.05;
constexpr double kMoving_mm_s = 0.05;  // less is the crosshead's regulation; the slowest stroke is slower, below
constexpr double kStill_mm = 0.02;
constexpr double kVented_psi = 0.7;  // CoreConfig::vented_psi and the sensor's error
constexpr double kStop_s = 0.82;     // the frame's watchdog, its brake, two polls
constexpr std::int64_t kLookAtDaemonNs = 10'000'000;

}  // namespace

Witness::Witness(const daemon::RigConfig& config) : config_(config) {}

void Witness::look(daemon::VirtualRig& rig) {
  now_ns_ = rig.now_ns();
  const auto truth = rig.rig().truth();
  const auto state = rig.core().state();
  const double speed_mm_s = std::abs(truth.velocity_mm_s);
  if (state == RunState::kFaulted && last_state_ != RunState::kFaulted && trip_ns_ < 0) {
    trip_ns_ = now_ns_;
    moved_at_trip_ = speed_mm_s > 1e-3;
  }
  last_state_ = state;
  if (speed_mm_s > kMoving_mm_s) moved_ns_ = now_ns_;
  if (truth.pressure_psi > 1.0) pressed_ns_ = now_ns_;
  if (truth.pressure_psi > 4.0) pressed_4_ns_ = now_ns_;
  if (now_ns_ % kLookAtDaemonNs == 0) follow_segment(rig, truth);

  const auto& limits = config_.limits;
  extremes_.pressure_psi = std::max(extremes_.pressure_psi, truth.pressure_psi);
  extremes_.over_setpoint_psi = std::max(extremes_.over_setpoint_psi, truth.pressure_psi - ceiling_.psi());
  extremes_.force_min_N = std::min(extremes_.force_min_N, truth.force_N);
  extremes_.force_max_N = std::max(extremes_.force_max_N, truth.force_N);
  if (truth.pressure_psi > ceiling_.psi() + kOverSetpoint_psi)
    breach("pressure over its set-point", truth.pressure_psi, ceiling_.psi() + kOverSetpoint_psi);
  if (truth.pressure_psi > limits.pressure_max_psi + kOverLimit_psi)
    breach("pressure over its limit", truth.pressure_psi, limits.pressure_max_psi + kOverLimit_psi);
  const double margin_N = kForceShare * (limits.force_max_N - limits.force_min_N);
  if (truth.force_N > limits.force_max_N + margin_N) breach("force", truth.force_N, limits.force_max_N + margin_N);
  if (truth.force_N < limits.force_min_N - margin_N) breach("force", truth.force_N, limits.force_min_N - margin_N);
  const double off_mm = std::max({0.0, truth.position_mm - high_mm_, low_mm_ - truth.position_mm});
  const double off_old_mm = std::max({0.0, truth.position_mm - old_high_mm_, old_low_mm_ - truth.position_mm});
  extremes_.off_path_mm = std::max(extremes_.off_path_mm, std::min(off_mm, off_old_mm));
  if (off_mm > over_mm_ && off_old_mm > old_over_mm_) breach("off its path, in mm", off_mm, over_mm_);
  if (state == RunState::kReady) {
    if (speed_mm_s > kMoving_mm_s) breach("ready while it moves", speed_mm_s, kMoving_mm_s);
    if (truth.pressure_psi > kVented_psi && !reading_lies_)
      breach("ready under pressure", truth.pressure_psi, kVented_psi);
  }
}

/// Where the crosshead may be: between where it was when a segment was commanded and its target, with what
/// docs/faults.md gives it beyond. The segment before counts until the next: its frame may still be about to take the
/// new one.
void Witness::follow_segment(daemon::VirtualRig& rig, const sim::Truth& truth) {
  const auto status = rig.core().loop_status();
  const auto& c = status.control;
  ceiling_.follow(status, config_.core.pressure_loop.rate_limit_psi_s, 1e-9 * kLookAtDaemonNs);
  const double target_mm = double{c.target_mm}, speed_mm_s = double{c.velocity_mm_s};
  if (target_mm == target_mm_ && speed_mm_s == speed_mm_s_) return;
  target_mm_ = target_mm;
  speed_mm_s_ = speed_mm_s;
  old_low_mm_ = low_mm_;
  old_high_mm_ = high_mm_;
  old_over_mm_ = over_mm_;
  low_mm_ = std::min(truth.position_mm, target_mm);
  high_mm_ = std::max(truth.position_mm, target_mm);
  const auto& s = config_.core.supervisor;
  const double v = std::abs(speed_mm_s);
  over_mm_ = std::min(s.following_error_max_mm + 0.05 * v, s.following_error_min_mm + 0.25 * v) + v * kStop_s +
             kStill_mm + 0.01 * v;  // and this is looked at every 10 ms
}

void Witness::strike(daemon::VirtualRig& rig) noexcept {
  const auto truth = rig.rig().truth();
  now_ns_ = strike_ns_ = moved_ns_ = pressed_ns_ = pressed_4_ns_ = rig.now_ns();
  trip_ns_ = -1;
  moved_at_trip_ = false;
  began_psi_ = truth.pressure_psi;
  began_mm_s_ = truth.velocity_mm_s;
  last_state_ = rig.core().state();
}

void Witness::breach(const char* kind, double value, double bound) {
  if (std::find(kinds_.begin(), kinds_.end(), kind) != kinds_.end()) return;
  kinds_.emplace_back(kind);
  breaches_.push_back(base::formatted("%s: %.4g, bound %.4g, after %.3f s, %s", kind, value, bound,
                                      since_strike(now_ns_), daemon::to_text(last_state_)));
}

std::vector<std::string> Witness::take_breaches() {
  kinds_.clear();
  return std::exchange(breaches_, {});
}

}  // namespace isorig::soak
