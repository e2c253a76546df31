#include "proof/foreign_laws/rig.hpp"

#include <algorithm>

namespace isorig::proof::foreign {
namespace {

Drive crosshead_drive(const Path& path) {
  Drive drive;
  drive.t_s = path.grid_s();
  for (const double t : drive.t_s) {
    const Path::Point point = path.at(t);
    drive.position_mm.push_back(point.position_mm);
    drive.velocity_mm_s.push_back(point.velocity_mm_s);
    drive.acceleration_mm_s2.push_back(point.acceleration_mm_s2);
  }
  return drive;
}

Signal pressure_psi(const Rig& rig, const Drive& drive) {
  const Supply& s = rig.supply;
  constexpr double kRiseShare = 0.3;
  switch (s.air) {
    case Air::kTrappedGas:
      return trapped_gas(drive, s.nominal_psi, 0.5 * s.swing_psi / (s.nominal_psi + 14.7), rig.stroke_mm, s.time_s);
    case Air::kStill:
    case Air::kDroop:
    case Air::kHunting:
    case Air::kLeak:
      break;
  }
  Signal pressure = s.air == Air::kDroop     ? regulator_droop(drive, s.swing_psi / rig.stroke_mm, s.time_s)
                    : s.air == Air::kHunting ? hunting(drive.t_s, s.swing_psi, s.time_s, kRiseShare)
                    : s.air == Air::kLeak    ? leak_and_refill(drive.t_s, s.nominal_psi, s.time_s, s.swing_psi)
                                             : Signal(drive.size(), 0.0);
  for (double& p : pressure) p += s.nominal_psi;
  return pressure;
}

/// The drive of the grip: velocities are means of the slopes on both sides, second order on an even grid.
Drive moved(const Drive& crosshead, Signal position_mm) {
  Drive grip = crosshead;
  grip.position_mm = std::move(position_mm);
  const auto slope = [&grip](std::size_t i) {
    return (grip.position_mm[i] - grip.position_mm[i - 1]) / (grip.t_s[i] - grip.t_s[i - 1]);
  };
  const std::size_t last = grip.size() - 1;
  for (std::size_t i = 0; i <= last; ++i)
    grip.velocity_mm_s[i] = 0.5 * (slope(std::max<std::size_t>(i, 1)) + slope(std::min(i + 1, last)));
  return grip;
}

void add(Signal& sum, const Signal& one) {
  for (std::size_t i = 0; i < sum.size(); ++i) sum[i] += one[i];
}

}  // namespace

std::string_view name_of(Air air) {
  switch (air) {
    case Air::kStill:
      return "still";
    case Air::kDroop:
      return "droop";
    case Air::kHunting:
      return "hunting";
    case Air::kLeak:
      return "leak";
    case Air::kTrappedGas:
      return "trapped_gas";
  }
  return "";
}

Played play(const Rig& rig, const Path& path) {
  Played played{crosshead_drive(path), {}};
  Drive& crosshead = played.crosshead;
  crosshead.pressure_psi = pressure_psi(rig, crosshead);
  crosshead.stiffness_N_mm = rig.stiffness_N_mm;

  Drive grip = crosshead;
  for (const auto& law : rig.kinematics) grip = moved(grip, law(grip));
  for (const double x : grip.position_mm) grip.elastic_N.push_back(rig.stiffness_N_mm * (x + rig.elongation_mm));
  grip.specimen_N = grip.elastic_N;
  for (const Arm& arm : rig.arms) {
    const double viscosity = arm.stiffness_N_mm * arm.time_s;
    const SpectralArm linear[] = {{1.0, arm.time_s}};
    add(grip.specimen_N, arm.flow ? arm_force(grip, arm.stiffness_N_mm, arm.flow(viscosity))
                                  : relax(grip.t_s, grip.position_mm, linear, arm.stiffness_N_mm));
  }
  Signal force_N = grip.specimen_N;
  for (const auto& law : rig.specimen) add(force_N, law(grip));
  if (rig.envelope)
    for (double& f : force_N) f = rig.envelope(f);
  for (const auto& law : rig.fixture) add(force_N, law(crosshead));
  for (const auto& law : rig.sensor) force_N = law(crosshead, force_N);
  played.force_N = std::move(force_N);
  return played;
}

std::vector<double> frame_times_s(const Path& path, const FrameRates& rates) {
  constexpr double kBefore_s = 0.3, kAfter_s = 2.0;
  const auto windows = path.fast_windows(kBefore_s, kAfter_s);
  std::vector<double> times;
  std::size_t window = 0;
  for (double t = kSettling_s; t < path.end_s();) {
    times.push_back(t);
    while (window < windows.size() && t >= windows[window].end_s) ++window;
    const bool fast = window < windows.size() && t >= windows[window].start_s - 1e-9;
    double next = t + (fast ? 1.0 / rates.fast_Hz : 1.0 / rates.slow_Hz);
    if (!fast && window < windows.size() && windows[window].start_s > t) next = std::min(next, windows[window].start_s);
    t = std::max(next, t + 0.5 / rates.fast_Hz);
  }
  return times;
}

Trace read(const Played& played, const Path& path, const FrameRates& rates, const std::vector<double>& jitter_s) {
  Trace trace;
  trace.t_s = frame_times_s(path, rates);
  for (std::size_t i = 0; i < trace.t_s.size() && i < jitter_s.size(); ++i) trace.t_s[i] += jitter_s[i];
  for (double t = kSettling_s + 0.003; t < path.end_s(); t += 1.0 / rates.pressure_Hz) trace.pressure_t_s.push_back(t);
  const Drive& d = played.crosshead;
  const auto sample = [&d](const std::vector<double>& times, const auto& look) {
    std::size_t node = 1;
    for (const double t : times) {
      while (node + 1 < d.size() && d.t_s[node] < t) ++node;
      look(node, (t - d.t_s[node - 1]) / (d.t_s[node] - d.t_s[node - 1]));
    }
  };
  std::size_t row = 0;
  sample(trace.t_s, [&](std::size_t node, double part) {
    trace.position_mm.push_back(path.at(trace.t_s[row++]).position_mm);
    trace.force_N.push_back(within(played.force_N, node, part));
  });
  sample(trace.pressure_t_s,
         [&](std::size_t node, double part) { trace.pressure_psi.push_back(within(d.pressure_psi, node, part)); });
  for (double& t : trace.t_s) t -= kSettling_s;
  for (double& t : trace.pressure_t_s) t -= kSettling_s;
  return trace;
}

}  // namespace isorig::proof::foreign
