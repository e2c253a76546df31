#include "sim/frame/crosshead.hpp"

#include <algorithm>
#include <cmath>

namespace isorig::sim {

Crosshead::Crosshead(const FrameParameters& p, double dt_s) noexcept
    : dt_s_(dt_s), acceleration_max_(p.acceleration_max_mm_s2), brake_mm_s2_(p.brake_mm_s2) {
  const double s = p.servo_decay_1_s;
  const double w = p.servo_frequency_rad_s;
  wn2_ = s * s + w * w;
  a_ = 2.0 * s / wn2_;
  b_ = a_ - 1e-3 * p.lag_ms;
  // exp(A dt) of x'' + 2 s x' + wn2 x = 0.
  const double decay = std::exp(-s * dt_s);
  const double c = std::cos(w * dt_s);
  const double sn = std::sin(w * dt_s) / w;
  phi11_ = decay * (c + s * sn);
  phi12_ = decay * sn;
  phi21_ = -decay * wn2_ * sn;
  phi22_ = decay * (c - s * sn);
}

void Crosshead::move(double target_mm, double speed_mm_s) noexcept {
  target_mm_ = target_mm;
  speed_mm_s_ = speed_mm_s;
  resting_ = false;
}

void Crosshead::stop() noexcept {
  target_mm_ = reference_mm_;
  speed_mm_s_ = 0.0;
}

void Crosshead::release() noexcept {
  if (!braking_) return;
  braking_ = false;
  reference_mm_ = target_mm_ = position_mm_;
  velocity_mm_s_ = 0.0;
  resting_ = true;
}

void Crosshead::step_moving() noexcept {
  if (braking_) {
    const double stop_s = std::abs(velocity_mm_s_) / brake_mm_s2_;
    const double t = std::min(stop_s, dt_s_);
    const double deceleration = std::copysign(brake_mm_s2_, velocity_mm_s_);
    position_mm_ += velocity_mm_s_ * t - 0.5 * deceleration * t * t;
    velocity_mm_s_ = stop_s <= dt_s_ ? 0.0 : velocity_mm_s_ - deceleration * t;
    reference_mm_ = target_mm_ = position_mm_;
    resting_ = velocity_mm_s_ == 0.0;
    return;
  }
  const double reach_mm = speed_mm_s_ * dt_s_;
  const double to_go_mm = target_mm_ - reference_mm_;
  const double next_mm =
      std::abs(to_go_mm) <= reach_mm ? target_mm_ : reference_mm_ + std::copysign(reach_mm, to_go_mm);
  const double rate_mm_s = (next_mm - reference_mm_) / dt_s_;

  const double error_mm = position_mm_ - reference_mm_;
  const double acceleration = wn2_ * (b_ * rate_mm_s - error_mm - a_ * velocity_mm_s_);
  if (std::abs(acceleration) > acceleration_max_) {
    const double limited = std::copysign(acceleration_max_, acceleration);
    position_mm_ += velocity_mm_s_ * dt_s_ + 0.5 * limited * dt_s_ * dt_s_;
    velocity_mm_s_ += limited * dt_s_;
  } else {
    // Steady solution for this rate: e = (b - a) r' = -lag r', x' = r'. The deviation from it decays by exp(A
    // dt).
    const double steady_mm = (b_ - a_) * rate_mm_s;
    const double e = error_mm - steady_mm;
    const double u = velocity_mm_s_ - rate_mm_s;
    position_mm_ = next_mm + steady_mm + phi11_ * e + phi12_ * u;
    velocity_mm_s_ = rate_mm_s + phi21_ * e + phi22_ * u;
  }
  reference_mm_ = next_mm;
  if (reference_mm_ == target_mm_ && std::abs(position_mm_ - target_mm_) < 1e-7 && std::abs(velocity_mm_s_) < 1e-5) {
    position_mm_ = target_mm_;
    velocity_mm_s_ = 0.0;
    resting_ = true;
  }
}

}  // namespace isorig::sim
