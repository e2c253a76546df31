#pragma once
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <random>
#include <vector>

#include "messages/recording.hpp"
#include "model/force_velocity.hpp"

namespace isorig::identify::testing {

/// Recordings of the paper's protocol with everything known: own exact stepping, so that nothing of the
/// analysis is in what it is tested on.
struct IsoVelocityTest {
  std::vector<double> speeds_mm_s{2, 4, 6, 8, 10};
  double stroke_mm = 2.0;
  double return_speed_mm_s = 0.01;
  double hold_s = 30.0;
  bool precondition = true;
  double rest_length_mm = 91.0;
  double pressurized_length_mm = 79.0;
  std::vector<model::StandardLinearSolid> elements{{200.0, 160.0, 40.0}};
  double force_noise_N = 0.02;
  double position_noise_mm = 0.0005;
  double dense_step_s = 0.005;  ///< round the ramps; 0.2 s elsewhere
  /// Second-order crosshead: 0 follows the command; damping below 1 overshoots.
  double bandwidth_per_s = 0.0;
  double damping = 1.0;
  double acceleration_limit_mm_s2 = 0.0;  ///< 0: corners as sharp as they come
  double force_drift_N_s = 0.0;
  double stiffening_N = 0.0;        ///< times strain change cubed: elastic force the SLS does not have
  double arrival_margin_mm = 1e-6;  ///< of `Truth`, which counts this close as arrived
  unsigned seed = 1;
};

struct Truth {
  double velocity_mm_s;
  double t_start_s;
  double t_arrival_s;  ///< NaN: never arrived
  double force_before_N;
  double force_at_arrival_N;
};

inline messages::Recording simulate(const IsoVelocityTest& test, std::vector<Truth>* truth = nullptr) {
  struct Piece {
    double to_mm, speed_mm_s, dense_until_s;  // speed 0: hold, to_mm is its duration
  };
  std::vector<Piece> pieces{{40.0, 0, 0}};
  if (test.precondition) {
    for (double to : {4.0, -4.0, 0.0}) pieces.push_back({to, test.return_speed_mm_s, 0});
    pieces.push_back({40.0, 0, 0});
  }
  for (double v : test.speeds_mm_s)
    for (double sign : {1.0, -1.0}) {
      pieces.push_back({sign * test.stroke_mm, v, 1.0});
      pieces.push_back({test.hold_s, 0, 0});
      pieces.push_back({0.0, test.return_speed_mm_s, 0});
      pieces.push_back({test.hold_s, 0, 0});
    }
  std::mt19937 random(test.seed);
  std::normal_distribution<double> unit;
  std::uniform_real_distribution<double> jitter(-0.04, 0.04);
  messages::Recording out;
  out.metadata.specimen = "simulated";
  out.metadata.rest_length_mm = test.rest_length_mm;
  out.metadata.pressurized_rest_length_mm = test.pressurized_length_mm;
  out.metadata.nominal_pressure_psi = 10.0;

  double t = 0.0, command = 0.0, x = 0.0, speed = 0.0;
  std::vector<double> arms(test.elements.size(), 0.0);  // strain of each series spring
  auto force = [&] {
    const double strain = out.metadata.strain(x);
    const double bend = x / test.pressurized_length_mm;
    double f = test.force_drift_N_s * t + test.stiffening_N * bend * bend * bend;
    for (std::size_t i = 0; i < arms.size(); ++i) f += test.elements[i].k1_N * strain + test.elements[i].k2_N * arms[i];
    return f;
  };
  double next_sample = 0.0;
  auto advance = [&](double dt, double command_rate, bool dense) {
    command += command_rate * dt;
    const double before = x;
    if (test.bandwidth_per_s > 0.0) {
      const double w = test.bandwidth_per_s;
      speed += dt * (w * w * (command - x) - 2.0 * test.damping * w * speed);
      x += dt * speed;
    } else {
      x = command;
    }
    for (std::size_t i = 0; i < arms.size(); ++i) {
      const double u = dt * test.elements[i].gamma_per_s();
      arms[i] = std::exp(-u) * arms[i] + (x - before) / test.pressurized_length_mm * model::maxwell_ramp_share(u);
    }
    t += dt;
    if (dense) next_sample = std::min(next_sample, t + test.dense_step_s);
    if (t >= next_sample) {
      out.frame.t_s.push_back(t);
      out.frame.position_mm.push_back(x + test.position_noise_mm * unit(random));
      out.frame.force_N.push_back(force() + test.force_noise_N * unit(random));
      next_sample = t + (dense ? test.dense_step_s : 0.2) * (1.0 + jitter(random));
    }
  };
  for (std::size_t k = 0; k < pieces.size(); ++k) {
    const Piece& p = pieces[k];
    if (p.speed_mm_s == 0.0) {
      const bool ramp_next = k + 1 < pieces.size() && pieces[k + 1].dense_until_s > 0;
      const bool ramp_before = k > 0 && pieces[k - 1].dense_until_s > 0;
      const double end = t + p.to_mm;
      const double dt = 0.0005;
      const double begin = t;
      while (t < end - dt / 2) {
        const bool dense = (ramp_next && end - t < 0.8) || (ramp_before && t - begin < 3.0);
        advance(dt, 0.0, dense);
        if (ramp_before && truth != nullptr && !truth->empty() && std::isnan(truth->back().t_arrival_s)) {
          const double goal = std::copysign(test.stroke_mm, truth->back().velocity_mm_s);
          if ((x - goal) * (goal > 0 ? 1 : -1) >= -test.arrival_margin_mm) {
            truth->back().t_arrival_s = t;
            truth->back().force_at_arrival_N = force();
          }
        }
      }
      continue;
    }
    const double start = command;
    const double direction = p.to_mm > start ? 1.0 : -1.0;
    const bool ramp = p.dense_until_s > 0;
    if (ramp && truth != nullptr)
      truth->push_back({direction * p.speed_mm_s, t, std::numeric_limits<double>::quiet_NaN(), force(), 0.0});
    double rate = test.acceleration_limit_mm_s2 > 0.0 && ramp ? 0.0 : p.speed_mm_s;
    while (direction * (p.to_mm - command) > 1e-9) {
      const double left = direction * (p.to_mm - command);
      if (test.acceleration_limit_mm_s2 > 0.0 && ramp) {
        const double stop = std::sqrt(2.0 * test.acceleration_limit_mm_s2 * left);
        rate = std::min({p.speed_mm_s, rate + test.acceleration_limit_mm_s2 * 0.0005, std::max(stop, 0.02)});
      }
      const double dt = std::min(0.0005, left / rate);
      advance(dt, direction * rate, ramp);
      if (ramp && truth != nullptr && std::isnan(truth->back().t_arrival_s) &&
          direction * (x - p.to_mm) >= -test.arrival_margin_mm) {
        truth->back().t_arrival_s = t;
        truth->back().force_at_arrival_N = force();
      }
    }
  }
  return out;
}

}  // namespace isorig::identify::testing
