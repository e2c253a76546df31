#include "proof/generator/rig.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

namespace isorig::proof {
namespace {

constexpr double kTau = 2.0 * std::numbers::pi;

class ArmState {
 public:
  explicit ArmState(const Arm& arm) : arm_(arm) {}
  double step(double velocity_mm_s, double dt_s) noexcept {
    if (arm_.exponent == 1.0 && arm_.yield_N == 0.0) {  // trapezoidal rule
      const double half = 0.5 * dt_s / arm_.time_constant_s;
      stretch_mm_ = (stretch_mm_ * (1.0 - half) + velocity_mm_s * dt_s) / (1.0 + half);
    } else {  // midpoint rule
      const double middle_mm = stretch_mm_ + 0.5 * dt_s * (velocity_mm_s - flow_mm_s(stretch_mm_));
      stretch_mm_ += dt_s * (velocity_mm_s - flow_mm_s(middle_mm));
    }
    return arm_.stiffness_N_mm * stretch_mm_;
  }

 private:
  [[nodiscard]] double flow_mm_s(double stretch_mm) const noexcept {
    const double force_N = arm_.stiffness_N_mm * stretch_mm;
    const double driving_N = std::fmax(0.0, std::abs(force_N) - arm_.yield_N);
    const double viscosity = arm_.stiffness_N_mm * arm_.time_constant_s;
    return std::copysign(std::pow(driving_N, 1.0 / arm_.exponent) / viscosity, force_N);
  }
  Arm arm_;
  double stretch_mm_ = 0.0;
};

/// Jenkin elements in parallel: springs that slide at their own force.
class Sliders {
 public:
  explicit Sliders(const Hidden& h) : hidden_(h) {
    for (std::size_t i = 0; i < kCount; ++i) {
      reach_mm_[i] = h.presliding_mm * (0.4 + 0.6 * static_cast<double>(i));
      stiffness_N_mm_[i] = h.friction_N / kCount / reach_mm_[i];
    }
  }
  double step(double move_mm, double velocity_mm_s) noexcept {
    double force_N = 0.0;
    for (std::size_t i = 0; i < kCount; ++i) {
      stretch_mm_[i] = std::clamp(stretch_mm_[i] + move_mm, -reach_mm_[i], reach_mm_[i]);
      force_N += stiffness_N_mm_[i] * stretch_mm_[i];
    }
    const double speed = std::abs(velocity_mm_s) / hidden_.stribeck_mm_s;
    return force_N * (1.0 - hidden_.stribeck_share * (1.0 - std::exp(-speed)));
  }

 private:
  static constexpr std::size_t kCount = 4;
  Hidden hidden_;
  std::array<double, kCount> reach_mm_{};
  std::array<double, kCount> stiffness_N_mm_{};
  std::array<double, kCount> stretch_mm_{};
};

class DeadTime {
 public:
  DeadTime(double delay_s, double dt_s) : steps_(delay_s / dt_s) { past_.resize(static_cast<std::size_t>(steps_) + 2); }
  double step(double value) noexcept {
    if (count_ == 0) std::ranges::fill(past_, value);
    past_[count_ % past_.size()] = value;
    const std::size_t whole = static_cast<std::size_t>(steps_);
    const double part = steps_ - static_cast<double>(whole);
    const auto back = [&](std::size_t n) { return past_[(count_ + past_.size() - n) % past_.size()]; };
    const double out = (1.0 - part) * back(whole) + part * back(whole + 1);
    ++count_;
    return out;
  }

 private:
  double steps_;
  std::vector<double> past_;
  std::size_t count_ = 0;
};

/// Everything that moves, one step at a time.
class Plant {
 public:
  Plant(const RigParameters& rig, double dt_s)
      : rig_(rig), h_(rig.hidden), dt_s_(dt_s), friction_(rig.hidden), delay_(rig.hidden.delay_s, dt_s) {
    for (const Arm& arm : rig.specimen.arms) arms_.emplace_back(arm);
    for (const Arm& arm : rig.hidden.further_arms) further_.emplace_back(arm);
    pressure_psi_ = rig.air.nominal_psi;
  }

  void step(double t_s, const Motion::Point& reference) noexcept {
    move_crosshead(reference);
    breathe(t_s);
    double force_N = specimen_force(t_s, grip_position(t_s));
    if (h_.slack) force_N = std::fmax(0.0, force_N);
    force_N += h_.mass_kg * acceleration_mm_s2_ * 1e-3;
    force_N_ = read(t_s, force_N);
  }

  [[nodiscard]] double position_mm() const noexcept { return position_mm_; }
  [[nodiscard]] double force_N() const noexcept { return force_N_; }
  [[nodiscard]] double pressure_psi() const noexcept { return pressure_psi_; }

 private:
  void move_crosshead(const Motion::Point& reference) noexcept {
    const Crosshead& c = rig_.crosshead;
    const double wanted = c.bandwidth_1_s * c.bandwidth_1_s * (reference.position_mm - position_mm_) +
                          2.0 * c.damping * c.bandwidth_1_s * (reference.velocity_mm_s - velocity_mm_s_);
    acceleration_mm_s2_ = std::clamp(wanted, -c.acceleration_mm_s2, c.acceleration_mm_s2);
    velocity_mm_s_ += acceleration_mm_s2_ * dt_s_;
    position_mm_ += velocity_mm_s_ * dt_s_;
  }

  void breathe(double t_s) noexcept {
    const Air& a = rig_.air;
    droop_psi_ += dt_s_ * (-droop_psi_ / a.recovery_s) + a.droop_psi_mm * velocity_mm_s_ * dt_s_;
    pressure_psi_ = a.nominal_psi + droop_psi_ + a.swing_psi * std::sin(kTau * t_s / a.swing_period_s);
  }

  /// Where the specimen's end is: after play and slip.
  double grip_position(double t_s) noexcept {
    const double half_mm = 0.5 * h_.backlash_mm;
    played_mm_ = std::clamp(played_mm_, position_mm_ - half_mm, position_mm_ + half_mm);
    constexpr double kSlipLasts_s = 0.004;
    const double slipped = std::clamp((t_s - h_.slip_at_s) / kSlipLasts_s, 0.0, 1.0);
    return played_mm_ - h_.slip_mm * slipped;
  }

  double specimen_force(double t_s, double grip_mm) noexcept {
    const double move_mm = grip_mm - grip_mm_;
    const double velocity_mm_s = move_mm / dt_s_;
    grip_mm_ = grip_mm;
    travel_mm_ += std::abs(move_mm);

    const Specimen& s = rig_.specimen;
    const double elongation_mm = grip_mm + s.rest_length_mm - s.pressurized_rest_length_mm;
    const double above_psi = pressure_psi_ - rig_.air.nominal_psi;
    const double soft = 1.0 - h_.softening * (1.0 - std::exp(-travel_mm_ / h_.softening_travel_mm));
    const double warm = 1.0 + h_.thermal_share * std::sin(kTau * t_s / h_.thermal_period_s);
    double force_N = s.stiffness_N_mm * elongation_mm * soft * warm;
    force_N += (h_.quadratic_N_mm2 + h_.cubic_N_mm3 * grip_mm) * grip_mm * grip_mm;
    force_N += h_.exponential_N * (std::exp(grip_mm / h_.exponential_mm) - 1.0 - grip_mm / h_.exponential_mm);
    if (h_.knee_N_mm != 0.0)
      force_N += h_.knee_N_mm * h_.knee_width_mm * std::log1p(std::exp((grip_mm - h_.knee_at_mm) / h_.knee_width_mm));
    force_N += above_psi * (h_.force_per_pressure_N_psi + h_.stiffness_per_pressure_N_mm_psi * elongation_mm);

    structure_ += dt_s_ * ((1.0 - structure_) / h_.thixotropy_s - 0.5 * std::abs(velocity_mm_s) * structure_);
    double viscous_N = 0.0;
    for (ArmState& arm : arms_) viscous_N += arm.step(velocity_mm_s, dt_s_);
    force_N += viscous_N * (1.0 - h_.thixotropy * (1.0 - structure_));
    for (ArmState& arm : further_) force_N += arm.step(velocity_mm_s, dt_s_);

    force_N += friction_.step(move_mm, velocity_mm_s);
    force_N += h_.ripple_N * std::sin(kTau * grip_mm / h_.ripple_pitch_mm);
    if (grip_mm > h_.snap_at_mm) snapped_ = true;
    if (grip_mm < h_.snap_at_mm - h_.snap_width_mm) snapped_ = false;
    return snapped_ ? force_N - h_.snap_N : force_N;
  }

  /// Load cell and amplifier.
  double read(double t_s, double force_N) noexcept {
    if (h_.resonance_Hz > 0.0) {
      const double omega = kTau * h_.resonance_Hz;
      if (!started_) ringing_N_ = force_N;
      ringing_rate_ +=
          dt_s_ * (omega * omega * (force_N - ringing_N_) - 2.0 * h_.resonance_damping * omega * ringing_rate_);
      ringing_N_ += dt_s_ * ringing_rate_;
      force_N = ringing_N_;
    }
    if (h_.lag_s > 0.0) {
      if (!started_) lagged_N_ = entering_N_ = force_N;
      const double half = 0.5 * dt_s_ / h_.lag_s;
      lagged_N_ = (lagged_N_ * (1.0 - half) + half * (force_N + entering_N_)) / (1.0 + half);
      entering_N_ = force_N;
      force_N = lagged_N_;
    }
    started_ = true;
    if (h_.delay_s > 0.0) force_N = delay_.step(force_N);
    constexpr double kDriftOver_s = 4000.0;
    force_N +=
        h_.drift_time_s > 0.0 ? h_.drift_N * (1.0 - std::exp(-t_s / h_.drift_time_s)) : h_.drift_N * t_s / kDriftOver_s;
    if (force_N > h_.range_from_N) force_N += h_.range_gain * (force_N - h_.range_from_N);
    return force_N;
  }

  const RigParameters& rig_;
  const Hidden& h_;
  double dt_s_;
  std::vector<ArmState> arms_;
  std::vector<ArmState> further_;
  Sliders friction_;
  DeadTime delay_;
  double position_mm_ = 0.0;
  double velocity_mm_s_ = 0.0;
  double acceleration_mm_s2_ = 0.0;
  double droop_psi_ = 0.0;
  double pressure_psi_ = 0.0;
  double played_mm_ = 0.0;
  double grip_mm_ = 0.0;
  double travel_mm_ = 0.0;
  double structure_ = 1.0;
  bool snapped_ = false;
  double ringing_N_ = 0.0;
  double ringing_rate_ = 0.0;
  double lagged_N_ = 0.0;
  double entering_N_ = 0.0;
  double force_N_ = 0.0;
  bool started_ = false;
};

}  // namespace

std::vector<double> frame_times(const Motion& motion, const Sampling& sampling) {
  std::vector<double> times;
  auto window = motion.windows().begin();
  double t_s = 0.0;
  while (t_s < motion.end_s()) {
    times.push_back(t_s);
    while (window != motion.windows().end() && t_s >= window->end_s) ++window;
    const bool dense = window != motion.windows().end() && t_s >= window->start_s - 1e-9;
    double next_s = t_s + (dense ? sampling.dense_s : sampling.sparse_s);
    // The first dense sample falls on the window's start, whatever the sparse grid.
    if (!dense && window != motion.windows().end()) next_s = std::fmin(next_s, window->start_s);
    if (next_s - t_s < 0.5 * sampling.dense_s) next_s = t_s + sampling.dense_s;
    t_s = next_s;
  }
  return times;
}

Trace simulate(const RigParameters& rig, const Motion& motion, const Sampling& sampling,
               const std::vector<double>& jitter_s, double step_s) {
  Trace trace;
  trace.t_s = frame_times(motion, sampling);
  for (std::size_t i = 0; i < trace.t_s.size() && i < jitter_s.size(); ++i)
    trace.t_s[i] = std::fmax(0.0, trace.t_s[i] + jitter_s[i]);
  for (double t = sampling.pressure_from_s; t < motion.end_s(); t += sampling.pressure_s)
    trace.pressure_t_s.push_back(t);

  Plant plant(rig, step_s);
  std::size_t cursor = 0;
  plant.step(0.0, motion.at(0.0, cursor));
  double position_mm = plant.position_mm(), force_N = plant.force_N(), pressure_psi = plant.pressure_psi();
  std::size_t frame = 0, gauge = 0;
  for (std::size_t n = 1; frame < trace.t_s.size() || gauge < trace.pressure_t_s.size(); ++n) {
    const double now_s = static_cast<double>(n) * step_s;
    const double before_s = now_s - step_s;
    plant.step(now_s, motion.at(now_s, cursor));
    for (; frame < trace.t_s.size() && trace.t_s[frame] <= now_s; ++frame) {
      const double part = (trace.t_s[frame] - before_s) / step_s;
      trace.position_mm.push_back(position_mm + part * (plant.position_mm() - position_mm));
      trace.force_N.push_back(force_N + part * (plant.force_N() - force_N));
    }
    for (; gauge < trace.pressure_t_s.size() && trace.pressure_t_s[gauge] <= now_s; ++gauge) {
      const double part = (trace.pressure_t_s[gauge] - before_s) / step_s;
      trace.pressure_psi.push_back(pressure_psi + part * (plant.pressure_psi() - pressure_psi));
    }
    position_mm = plant.position_mm();
    force_N = plant.force_N();
    pressure_psi = plant.pressure_psi();
  }
  return trace;
}

}  // namespace isorig::proof
