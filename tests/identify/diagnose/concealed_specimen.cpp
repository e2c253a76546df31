#include "concealed_specimen.hpp"

#include <algorithm>
#include <cmath>
#include <ostream>
#include <random>
#include <tuple>
#include <utility>

namespace isorig::test {
namespace {

constexpr double kStep_s = 1e-3;
constexpr double kRestLength_mm = 90.0, kNominal_psi = 15.0, kAbsolute_psi = kNominal_psi + 14.696;

struct Script {
  std::vector<double> position_mm{0.0};  // per millisecond, before the corners are rounded
  std::vector<std::pair<double, double>> dense;

  void to(double target_mm, double velocity_mm_s, bool watch) {
    const double from_mm = position_mm.back(), start_s = time_s();
    const auto steps = static_cast<int>(std::fabs(target_mm - from_mm) / velocity_mm_s / kStep_s);
    for (int i = 1; i <= steps; ++i) position_mm.push_back(from_mm + (target_mm - from_mm) * i / steps);
    if (watch) dense.emplace_back(start_s - 0.5, time_s() + 3.0);
  }
  void hold(double seconds) {
    position_mm.insert(position_mm.end(), static_cast<std::size_t>(seconds / kStep_s), position_mm.back());
  }
  void sine(double amplitude_mm, double frequency_Hz, int cycles) {
    const double zero = position_mm.back(), start_s = time_s();
    const auto steps = static_cast<int>(cycles / frequency_Hz / kStep_s);
    for (int i = 1; i <= steps; ++i)
      position_mm.push_back(zero + amplitude_mm * std::sin(2.0 * M_PI * frequency_Hz * i * kStep_s));
    dense.emplace_back(start_s - 0.5, time_s() + 2.0);
  }
  [[nodiscard]] double time_s() const { return static_cast<double>(position_mm.size() - 1) * kStep_s; }

  /// Mean over 40 ms: what an acceleration limit makes of corners.
  void round_corners() {
    constexpr int kHalf = 20;
    std::vector<double> sum(position_mm.size() + 1, 0.0);
    for (std::size_t i = 0; i < position_mm.size(); ++i) sum[i + 1] = sum[i] + position_mm[i];
    std::vector<double> rounded(position_mm.size());
    for (std::size_t i = 0; i < position_mm.size(); ++i) {
      const std::size_t from = i > kHalf ? i - kHalf : 0, to = std::min(position_mm.size(), i + kHalf + 1);
      rounded[i] = (sum[to] - sum[from]) / static_cast<double>(to - from);
    }
    position_mm = std::move(rounded);
  }
};

/// Volume of a braid of unit threads that is `length` long, but for a factor.
double volume(double length) {
  return length * (1.0 - length * length);
}

messages::Recording run(const ConcealedSpecimen& b, Script script, bool noise) {
  script.round_corners();
  const auto& x = script.position_mm;
  const std::size_t n = x.size();
  std::mt19937 random(b.seed);
  std::normal_distribution<double> normal;
  // Pressure wanders whether or not the specimen cares.
  std::vector<double> pressure(n), force(n);
  double wander = 0.0;
  for (std::size_t i = 0; i < n; ++i) {
    wander += -wander * kStep_s / 60.0 + b.pressure_wander_psi * std::sqrt(2.0 * kStep_s / 60.0) * normal(random);
    pressure[i] = wander;
  }
  double arm = 0.0, second = 0.0, bristle = 0.0, seen = x[0], travel = 0.0, lagged = 0.0, entering = 0.0, colour = 0.0;
  const double thread_mm = kRestLength_mm / std::cos(b.braid_angle_deg * M_PI / 180.0);
  const auto length = [&](double at_mm) { return (kRestLength_mm + at_mm) / thread_mm; };
  double content = kAbsolute_psi * std::pow(volume(length(x[0])), b.gas_exponent);
  double largest_mm = x[0], largest_elongation_mm = std::fabs(x[0] + b.elongation_at_zero_mm);
  for (std::size_t i = 0; i < n; ++i) {
    const double t = static_cast<double>(i) * kStep_s;
    const double before = seen;
    seen = std::clamp(seen, x[i] - 0.5 * b.gap_mm, x[i] + 0.5 * b.gap_mm);
    if (b.slip_mm > 0.0) {
      const double inside = b.slip_creep_s > 0.0 ? std::exp2(-(t - b.slip_s) / b.slip_creep_s) : 0.0;
      seen = x[i] - (t >= b.slip_s ? b.slip_mm * (1.0 - inside) : 0.0);
      for (const auto& [slip_s, slip_mm] : b.further_slips) seen -= t >= slip_s ? slip_mm : 0.0;
    }
    const double dx = i == 0 ? 0.0 : seen - before;
    travel += std::fabs(dx);
    const auto arm_s = [&](double z) {
      return b.arm_s * std::exp(b.relaxation_1_mm * (seen - 0.5 * dx)) * (z < 0.0 ? b.shortening_ratio : 1.0);
    };
    const auto flow = [&](double z) { return std::copysign(std::pow(std::fabs(z), b.power), z) / arm_s(z); };
    const double driven = dx * std::exp(b.fung_1_mm * (seen - 0.5 * dx));
    const double middle = arm + 0.5 * (driven - kStep_s * flow(arm));
    arm += driven - kStep_s * flow(middle);
    const double middle2 = second + 0.5 * (dx - kStep_s * second / b.second_arm_s);
    second += dx - kStep_s * middle2 / b.second_arm_s;
    constexpr int kFine = 50;  // a bristle bends over less than what passes in a millisecond
    const bool wen = b.wen_exponent != 1.0 || b.wen_sigma != 1.0;
    for (int j = 0; j < kFine && dx != 0.0; ++j) {
      const double along = bristle * (dx > 0.0 ? 1.0 : -1.0);
      const double held = !wen          ? along
                          : along > 0.0 ? std::pow(along, b.wen_exponent)
                                        : std::pow(-along, b.wen_exponent) * (1.0 - 2.0 * b.wen_sigma);
      bristle += dx / kFine / b.presliding_mm * (1.0 - held);
    }
    const double e = seen + b.elongation_at_zero_mm;
    double f = b.stiffness_N_mm * e + b.arm_N_mm * arm + b.second_arm_N_mm * second + b.friction_N * bristle;
    f += b.quadratic_N_mm2 * seen * seen + b.coupling_N_mm_psi * pressure[i] * e;
    f -= b.softening_N_mm * e * (1.0 - std::exp(-travel / b.softening_travel_mm));
    f += b.ripple_N * std::sin(2.0 * M_PI * seen / b.ripple_mm);
    f += b.drag_N_s2_mm2 * std::fabs(dx) * dx / (kStep_s * kStep_s) + b.drag_N_s_mm2 * seen * dx / kStep_s +
         b.friction_N_mm2 * seen * seen * bristle;
    f += (b.arm_N_mm3 * seen * seen + b.arm_N_s_mm2 * std::fabs(dx) / kStep_s) * arm;
    f += (dx > 0.0 ? b.lengthening_N_s_mm : b.shortening_N_s_mm) * dx / kStep_s;
    f += b.lock_N_mm * seen * seen / (b.lock_mm - seen);
    const double stretch = 1.0 + seen / b.rubber_mm;
    f += b.rubber_N_mm *
         (2.0 * b.rubber_mm / (3.0 * b.rubber_exponent) *
              (std::pow(stretch, b.rubber_exponent - 1.0) - std::pow(stretch, -0.5 * b.rubber_exponent - 1.0)) -
          seen);
    f += b.snap_N_mm * seen * (1.0 - 2.0 * b.snap_mm / std::hypot(seen, b.snap_mm));
    if (b.gas_N_psi > 0.0) {
      // What is in the chamber changes by the valve alone; the mean of both ends of the step drives it.
      const double earlier = std::pow(volume(length(seen - dx)), b.gas_exponent);
      const double power = std::pow(volume(length(seen)), b.gas_exponent), out_psi = kAbsolute_psi + pressure[i];
      const double entering_psi = 0.5 * (earlier + power) * out_psi;
      const double half = i == 0 ? 0.0 : 0.5 * kStep_s / b.gas_s;
      content = (content * (1.0 - half) + 2.0 * half * entering_psi) / (1.0 + half);
      const double lever = (1.0 - 3.0 * length(seen) * length(seen)) / (1.0 - 3.0 * length(0.0) * length(0.0));
      f += b.gas_N_psi * lever * (content / power - out_psi);
    }
    largest_mm = std::max(largest_mm, seen);
    largest_elongation_mm = std::max(largest_elongation_mm, std::fabs(e));
    const double unloaded_mm2 = largest_elongation_mm * largest_elongation_mm - e * e;
    f -= b.mullins_N_mm * e * (1.0 - std::erfc(unloaded_mm2 / (b.mullins_mm * b.mullins_mm)));
    f -= b.set_N_mm * (largest_mm - x[0]);
    f += b.load_share * bristle * f;
    if (b.slack) f = std::max(0.0, f);
    if (b.mass_kg > 0.0 && i > 0 && i + 1 < n)
      f += b.mass_kg * 1e-3 * (x[i + 1] - 2.0 * x[i] + x[i - 1]) / (kStep_s * kStep_s);
    if (b.lag_s > 0.0) {
      // Trapezoids: the mean of what enters over the step. The newest value alone would be a lag one step
      // short.
      const double half = 0.5 * kStep_s / b.lag_s;
      if (i == 0) lagged = entering = f;
      lagged = (lagged * (1.0 - half) + half * (f + entering)) / (1.0 + half);
      entering = f;
      f = lagged;
    }
    force[i] = f;
  }
  if (b.delay_s > 0.0) {
    const auto shift = static_cast<std::size_t>(std::lround(b.delay_s / kStep_s));
    for (std::size_t i = n; i-- > 0;) force[i] = force[i >= shift ? i - shift : 0];
  }
  messages::Recording out;
  out.metadata.specimen = "bench";
  out.metadata.rest_length_mm = kRestLength_mm;
  out.metadata.pressurized_rest_length_mm = kRestLength_mm - b.elongation_at_zero_mm;
  out.metadata.nominal_pressure_psi = kNominal_psi;
  out.pressure.emplace();
  double next_s = 0.0, next_pressure_s = 0.003, last_s = 0.0;
  std::uniform_real_distribution<double> jitter(-2e-4, 2e-4);
  while (next_s < script.time_s() - 0.01) {
    const double t = std::max(0.0, next_s + jitter(random));
    const auto i = static_cast<std::size_t>(t / kStep_s);
    const double share = t / kStep_s - static_cast<double>(i);
    const double at = x[i] + share * (x[i + 1] - x[i]);
    double f = force[i] + share * (force[i + 1] - force[i]) + b.drift_N_h * t / 3600.0;
    if (noise) {
      const double keep = std::exp(-(t - last_s) / b.coloured_s);
      colour = colour * keep + b.coloured_N * std::sqrt(1.0 - keep * keep) * normal(random);
      f += b.force_noise_N * normal(random) + colour;
      f = std::round(f / b.force_step_N) * b.force_step_N;
    }
    last_s = t;
    out.frame.t_s.push_back(t);
    out.frame.position_mm.push_back(std::round((at + b.position_noise_mm * normal(random)) * 1e5) / 1e5);
    out.frame.force_N.push_back(f);
    const bool dense =
        std::ranges::any_of(script.dense, [&](const auto& d) { return next_s >= d.first && next_s <= d.second; });
    next_s += dense ? b.fast_interval_s : 0.2;
    if (next_s >= next_pressure_s) {
      const auto k = std::min(n - 1, static_cast<std::size_t>(next_pressure_s / kStep_s));
      out.pressure->t_s.push_back(next_pressure_s);
      out.pressure->pressure_psi.push_back(kNominal_psi + pressure[k] + 0.005 * normal(random));
      next_pressure_s += 0.2;
    }
  }
  for (int s = 0; s < b.spikes; ++s)
    out.frame.force_N[random() % out.frame.size()] += (s % 2 == 0 ? 1.0 : -1.0) * (1.0 + s % 3);
  return out;
}

}  // namespace

messages::Recording record(const ConcealedSpecimen& specimen) {
  Script s;
  s.hold(20.0);
  s.to(4.0, 0.05, false);
  s.to(-4.0, 0.05, false);
  s.to(0.0, 0.05, false);
  s.hold(25.0);
  for (const double v : {2.0, 4.0, 6.0, 8.0, 10.0}) {
    for (const double side : {1.0, -1.0}) {
      s.to(2.0 * side, v, true);
      s.hold(25.0);
      s.to(0.0, 0.05, false);
      s.hold(25.0);
    }
  }
  return run(specimen, s, true);
}

messages::Recording record_other(const ConcealedSpecimen& specimen) {
  Script s;
  s.hold(10.0);
  for (const double v : {1.0, 5.0}) {
    for (const double side : {1.0, -1.0}) {
      s.to(1.5 * side, v, true);
      s.hold(10.0);
      s.to(0.0, 0.05, false);
      s.hold(10.0);
    }
  }
  s.sine(0.75, 0.5, 4);
  s.hold(5.0);
  return run(specimen, s, false);
}

messages::Recording seldom_read_at_rest(const messages::Recording& recording, double interval_s) {
  constexpr double kStill_mm = 3e-3;  // the slowest motion has 10 um between readings, and their noise is 0.4 um
  messages::Recording out = recording;
  out.frame = {};
  const auto& [t_s, x_mm, f_N] = std::tie(recording.frame.t_s, recording.frame.position_mm, recording.frame.force_N);
  double last_s = t_s.front() - interval_s;
  for (std::size_t i = 0; i < t_s.size(); ++i) {
    const bool rests = i > 0 && i + 1 < t_s.size() && std::fabs(x_mm[i] - x_mm[i - 1]) < kStill_mm &&
                       std::fabs(x_mm[i + 1] - x_mm[i]) < kStill_mm;
    if (rests && t_s[i] < last_s + interval_s) continue;
    last_s = t_s[i];
    out.frame.t_s.push_back(t_s[i]);
    out.frame.position_mm.push_back(x_mm[i]);
    out.frame.force_N.push_back(f_N[i]);
  }
  return out;
}

void PrintTo(const ConcealedSpecimen& specimen, std::ostream* out) {
  static constexpr std::pair<const char*, double ConcealedSpecimen::*> kNumbers[] = {
      {"stiffness_N_mm", &ConcealedSpecimen::stiffness_N_mm},
      {"arm_N_mm", &ConcealedSpecimen::arm_N_mm},
      {"arm_s", &ConcealedSpecimen::arm_s},
      {"elongation_at_zero_mm", &ConcealedSpecimen::elongation_at_zero_mm},
      {"friction_N", &ConcealedSpecimen::friction_N},
      {"presliding_mm", &ConcealedSpecimen::presliding_mm},
      {"wen_exponent", &ConcealedSpecimen::wen_exponent},
      {"wen_sigma", &ConcealedSpecimen::wen_sigma},
      {"quadratic_N_mm2", &ConcealedSpecimen::quadratic_N_mm2},
      {"second_arm_N_mm", &ConcealedSpecimen::second_arm_N_mm},
      {"second_arm_s", &ConcealedSpecimen::second_arm_s},
      {"power", &ConcealedSpecimen::power},
      {"coupling_N_mm_psi", &ConcealedSpecimen::coupling_N_mm_psi},
      {"softening_N_mm", &ConcealedSpecimen::softening_N_mm},
      {"softening_travel_mm", &ConcealedSpecimen::softening_travel_mm},
      {"lag_s", &ConcealedSpecimen::lag_s},
      {"delay_s", &ConcealedSpecimen::delay_s},
      {"mass_kg", &ConcealedSpecimen::mass_kg},
      {"drift_N_h", &ConcealedSpecimen::drift_N_h},
      {"slip_mm", &ConcealedSpecimen::slip_mm},
      {"slip_s", &ConcealedSpecimen::slip_s},
      {"slip_creep_s", &ConcealedSpecimen::slip_creep_s},
      {"gap_mm", &ConcealedSpecimen::gap_mm},
      {"fung_1_mm", &ConcealedSpecimen::fung_1_mm},
      {"relaxation_1_mm", &ConcealedSpecimen::relaxation_1_mm},
      {"shortening_ratio", &ConcealedSpecimen::shortening_ratio},
      {"lengthening_N_s_mm", &ConcealedSpecimen::lengthening_N_s_mm},
      {"shortening_N_s_mm", &ConcealedSpecimen::shortening_N_s_mm},
      {"mullins_N_mm", &ConcealedSpecimen::mullins_N_mm},
      {"mullins_mm", &ConcealedSpecimen::mullins_mm},
      {"set_N_mm", &ConcealedSpecimen::set_N_mm},
      {"load_share", &ConcealedSpecimen::load_share},
      {"lock_N_mm", &ConcealedSpecimen::lock_N_mm},
      {"lock_mm", &ConcealedSpecimen::lock_mm},
      {"rubber_N_mm", &ConcealedSpecimen::rubber_N_mm},
      {"rubber_mm", &ConcealedSpecimen::rubber_mm},
      {"rubber_exponent", &ConcealedSpecimen::rubber_exponent},
      {"snap_N_mm", &ConcealedSpecimen::snap_N_mm},
      {"snap_mm", &ConcealedSpecimen::snap_mm},
      {"gas_N_psi", &ConcealedSpecimen::gas_N_psi},
      {"gas_s", &ConcealedSpecimen::gas_s},
      {"braid_angle_deg", &ConcealedSpecimen::braid_angle_deg},
      {"gas_exponent", &ConcealedSpecimen::gas_exponent},
      {"ripple_N", &ConcealedSpecimen::ripple_N},
      {"ripple_mm", &ConcealedSpecimen::ripple_mm},
      {"drag_N_s_mm2", &ConcealedSpecimen::drag_N_s_mm2},
      {"drag_N_s2_mm2", &ConcealedSpecimen::drag_N_s2_mm2},
      {"friction_N_mm2", &ConcealedSpecimen::friction_N_mm2},
      {"arm_N_mm3", &ConcealedSpecimen::arm_N_mm3},
      {"arm_N_s_mm2", &ConcealedSpecimen::arm_N_s_mm2},
      {"force_noise_N", &ConcealedSpecimen::force_noise_N},
      {"coloured_N", &ConcealedSpecimen::coloured_N},
      {"coloured_s", &ConcealedSpecimen::coloured_s},
      {"position_noise_mm", &ConcealedSpecimen::position_noise_mm},
      {"force_step_N", &ConcealedSpecimen::force_step_N},
      {"fast_interval_s", &ConcealedSpecimen::fast_interval_s},
      {"pressure_wander_psi", &ConcealedSpecimen::pressure_wander_psi}};
  const ConcealedSpecimen usual;
  const char* between = "";
  const auto say = [&](const char* name, auto value, auto usual_value) {
    if (value != usual_value) *out << std::exchange(between, ",") << name << '=' << value;
  };
  for (const auto& [name, number] : kNumbers) say(name, specimen.*number, usual.*number);
  say("slack", specimen.slack, usual.slack);
  say("further_slips", specimen.further_slips.size(), usual.further_slips.size());
  say("spikes", specimen.spikes, usual.spikes);
  say("seed", specimen.seed, usual.seed);
  if (*between == '\0') *out << "usual";
}

}  // namespace isorig::test
