#include "judge.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <numbers>

#include "judge_mckibben.hpp"

namespace isorig::test {
namespace {

/// dz/dt = slope(z, velocity), z(0) = `first`, by classical Runge-Kutta; `rate(z, velocity)` is how fast z may
/// turn.
template <class Slope, class Rate>
Curve integrate_from(double first, const Track& track, const Slope& slope, const Rate& rate) {
  Curve z{first};
  for (std::size_t i = 1; i < track.size(); ++i) {
    const double v = (track.position_mm[i] - track.position_mm[i - 1]) / track.step_s;
    double y = z.back(), left_s = track.step_s;
    while (left_s > 0.0) {
      const double h = std::fmin(left_s, 0.02 / std::fmax(rate(y, v), 1e-9));
      const double k1 = slope(y, v), k2 = slope(y + 0.5 * h * k1, v), k3 = slope(y + 0.5 * h * k2, v);
      const double k4 = slope(y + h * k3, v);
      y += h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4);
      left_s -= h;
      if (left_s < 1e-15) break;
    }
    z.push_back(y);
  }
  return z;
}

template <class Slope, class Rate>
Curve integrate(const Track& track, const Slope& slope, const Rate& rate) {
  return integrate_from(0.0, track, slope, rate);
}

Curve arm(const Track& track, double tau_s) {
  return integrate(
      track, [=](double z, double v) { return v - z / tau_s; }, [=](double, double) { return 1.0 / tau_s; });
}

double sign(double v) {
  return v > 0.0 ? 1.0 : v < 0.0 ? -1.0 : 0.0;
}

Curve bristle(const Track& track, double delta_mm) {
  return integrate(
      track, [=](double z, double v) { return v / delta_mm * (1.0 - z * sign(v)); },
      [=](double, double v) { return std::fabs(v) / delta_mm; });
}

/// Masing's rules for a body that slides: the first loading follows `virgin` (odd), every later branch is it
/// doubled from the last turning point, and a loop that closes is forgotten (Madelung).
class Masing {
 public:
  Masing(std::function<double(double)> virgin, double origin_mm) : virgin_(std::move(virgin)), turns_{origin_mm} {}
  double at(double x_mm) {
    const double direction = sign(x_mm - last_mm());
    if (moved_ && direction != 0.0 && direction != direction_) turns_.push_back(last_);
    if (direction != 0.0) direction_ = direction;
    moved_ = true;
    last_ = x_mm;
    for (;;) {
      const std::size_t n = turns_.size();
      if (n == 1) break;
      const double away = std::fabs(x_mm - turns_[n - 1]);
      if (n == 2) {  // one turn: past the mirror image of it, the first loading goes on
        if (away >= 2.0 * std::fabs(turns_[1] - turns_[0])) turns_.resize(1);
        break;
      }
      if (away < std::fabs(turns_[n - 1] - turns_[n - 2])) break;
      turns_.resize(n - 2);
    }
    double force = 0.0;
    for (std::size_t k = 0; k < turns_.size(); ++k) {
      const double to = k + 1 < turns_.size() ? turns_[k + 1] : x_mm;
      const double length = to - turns_[k];
      force += k == 0 ? virgin_(length) : 2.0 * virgin_(0.5 * length);
    }
    return force;
  }

 private:
  [[nodiscard]] double last_mm() const { return moved_ ? last_ : turns_[0]; }
  std::function<double(double)> virgin_;
  std::vector<double> turns_;
  double last_ = 0.0, direction_ = 0.0;
  bool moved_ = false;
};

Curve masing(const Track& track, const std::function<double(double)>& virgin) {
  Masing body(virgin, track.position_mm.front());
  Curve out;
  for (const double x : track.position_mm) out.push_back(body.at(x));
  return out;
}

double jenkins_virgin(double x, double delta_mm) {
  return std::clamp(x / delta_mm, -1.0, 1.0);
}

double iwan_virgin(double x, double delta_mm) {
  double sum = 0.0;
  for (int i = 1; i <= 15; i += 2) sum += jenkins_virgin(x, delta_mm * i / 16.0);
  return sum / 8.0;
}

Curve stribeck(const Track& track, double delta_mm, double vs, double r, double power) {
  return integrate(
      track,
      [=](double z, double v) {
        const double g = 1.0 + r * std::exp(-std::pow(std::fabs(v) / vs, power));
        return v / delta_mm * (1.0 - z * sign(v) / g);
      },
      [=](double, double v) { return std::fabs(v) / delta_mm; });
}

/// Wen's own writing, dz = A dx - (beta |dx| |z|^(n-1) z + gamma dx |z|^n) in lengths, with A = 1 and the limit
/// (A / (beta + gamma))^(1/n) = delta; returned as a share of the limit.
Curve bouc_wen(const Track& track, double delta_mm, double n, double sigma) {
  const double sum = std::pow(delta_mm, -n), beta = sigma * sum, gamma = sum - beta;
  Curve out = integrate(
      track,
      [=](double z, double v) {
        const double most = std::pow(std::fabs(z), n - 1.0);
        return v - (beta * std::fabs(v) * most * z + gamma * v * most * std::fabs(z));
      },
      [=](double, double v) { return n * std::fabs(v) / delta_mm; });
  for (double& z : out) z /= delta_mm;
  return out;
}

/// Any force that follows the grid point alone.
template <class Of>
Columns pointwise(const Track& track, const Of& of) {
  Curve out;
  for (std::size_t i = 0; i < track.size(); ++i) out.push_back(of(i));
  return {out};
}

Judge at_point(std::function<double(Numbers, const Track&, std::size_t)> of) {
  return {
      .force = [of](Numbers p, const Track& t) { return pointwise(t, [&](std::size_t i) { return of(p, t, i); }); }};
}

Judge several(std::vector<Judge> judges) {
  return {.force = [judges](Numbers p, const Track& t) {
    Columns out;
    for (const Judge& judge : judges) out.push_back(judge.force(p, t).front());
    return out;
  }};
}

/// N first-order lags one behind the other, by Runge-Kutta with the input straight within the grid's step; settled
/// first.
template <std::size_t N>
Curve behind_poles(double time_constant_s, double step_s, const Curve& input) {
  std::array<double, N> y;
  y.fill(input.front());
  Curve out{input.front()};
  const auto slopes = [&](double u, const std::array<double, N>& at) {
    std::array<double, N> d;
    for (std::size_t k = 0; k < N; ++k) d[k] = ((k == 0 ? u : at[k - 1]) - at[k]) / time_constant_s;
    return d;
  };
  const auto moved = [](std::array<double, N> from, double by, const std::array<double, N>& along) {
    for (std::size_t k = 0; k < N; ++k) from[k] += by * along[k];
    return from;
  };
  for (std::size_t i = 1; i < input.size(); ++i) {
    const int parts = static_cast<int>(std::ceil(step_s / (0.02 * time_constant_s)));
    const double h = step_s / parts;
    for (int part = 0; part < parts; ++part) {
      const auto u = [&](double share) { return input[i - 1] + (part + share) / parts * (input[i] - input[i - 1]); };
      const auto k1 = slopes(u(0.0), y), k2 = slopes(u(0.5), moved(y, 0.5 * h, k1));
      const auto k3 = slopes(u(0.5), moved(y, 0.5 * h, k2)), k4 = slopes(u(1.0), moved(y, h, k3));
      for (std::size_t k = 0; k < N; ++k) y[k] += h / 6.0 * (k1[k] + 2.0 * k2[k] + 2.0 * k3[k] + k4[k]);
    }
    out.push_back(y[N - 1]);
  }
  return out;
}

double elongation(const Track& t, std::size_t i) {
  return t.position_mm[i] + t.elongation_at_zero_mm;
}

Curve travel(const Track& track) {
  Curve out{0.0};
  for (std::size_t i = 1; i < track.size(); ++i)
    out.push_back(out.back() + std::fabs(track.position_mm[i] - track.position_mm[i - 1]));
  return out;
}

Judge softened(bool of_elongation) {
  return {.force = [of_elongation](Numbers p, const Track& t) {
    const Curve s = travel(t);
    return pointwise(t, [&](std::size_t i) {
      return (1.0 - std::exp(-s[i] / p[0])) * (of_elongation ? elongation(t, i) : t.position_mm[i]);
    });
  }};
}

/// Integral of the share of fibres that are taut (logistic), Simpson's rule from far below the knee to each
/// point; points between by Hermite's cubic with the share as its slope.
Curve taut(const Curve& position_mm, double knee_mm, double width_mm) {
  const auto [low, high] = std::ranges::minmax(position_mm);
  const double h = width_mm / 100.0, from = std::fmin(low, knee_mm) - 40.0 * width_mm;
  const auto share = [&](double x) { return 1.0 / (1.0 + std::exp(-(x - knee_mm) / width_mm)); };
  Curve sum{0.0};
  for (double x = from; x < high; x += h)
    sum.push_back(sum.back() + h / 6.0 * (share(x) + 4.0 * share(x + 0.5 * h) + share(x + h)));
  Curve out;
  for (const double x : position_mm) {
    const auto k = std::min(static_cast<std::size_t>((x - from) / h), sum.size() - 2);
    const double left = from + static_cast<double>(k) * h, u = (x - left) / h;
    out.push_back(sum[k] + (sum[k + 1] - sum[k]) * u * u * (3.0 - 2.0 * u) +
                  h * u * (1.0 - u) * ((1.0 - u) * share(left) - u * share(left + h)));
  }
  return out;
}

double from_table(double x) {
  const model::Table table = some_table();
  double value = table.values.back();
  for (std::size_t i = 0; i + 1 < table.values.size(); ++i) {
    const double left = table.first + table.step * static_cast<double>(i);
    if (x >= left + table.step) continue;
    const double share = std::fmax((x - left) / table.step, 0.0);
    value = (1.0 - share) * table.values[i] + share * table.values[i + 1];
    break;
  }
  return value;
}

Judge by_direction(double wanted) {
  return {.force = [wanted](Numbers, const Track& t) {
    Curve out;
    double direction = 0.0;
    for (std::size_t i = 0; i < t.size(); ++i) {
      const double step = i > 0 ? t.position_mm[i] - t.position_mm[i - 1] : 0.0;
      if (std::fabs(step) > 1e-9) direction = sign(step);
      out.push_back(direction == wanted ? from_table(t.position_mm[i]) : 0.0);
    }
    return Columns{out};
  }};
}

void reckon_velocity(Track& track) {
  for (std::size_t i = 1; i < track.size(); ++i)
    track.velocity_mm_s[i] = (track.position_mm[i] - track.position_mm[i - 1]) / track.step_s;
}

std::map<std::string, Judge> make_elements() {
  std::map<std::string, Judge> of;
  of["spring/linear"] = at_point([](Numbers, const Track& t, std::size_t i) { return elongation(t, i); });
  of["maxwell/linear"] = {.force = [](Numbers p, const Track& t) { return Columns{arm(t, p[0])}; }};
  of["arm_start/relaxing"] = at_point([](Numbers p, const Track& t, std::size_t i) {
    return t.t_s(i) < p[3] ? 0.0 : 1.0 / std::exp((t.t_s(i) - p[3]) / p[0]);
  });
  of["dashpot/linear"] = at_point([](Numbers, const Track& t, std::size_t i) { return t.velocity_mm_s[i]; });
  of["mass/linear"] = at_point([](Numbers, const Track& t, std::size_t i) { return t.acceleration_mm_s2(i) / 1000.0; });
  of["constant/linear"] = at_point([](Numbers, const Track&, std::size_t) { return 1.0; });
  of["force_zero/recording"] = at_point([](Numbers, const Track&, std::size_t) { return 1.0; });
  of["gravity/pendulum"] =
      at_point([](Numbers p, const Track& t, std::size_t i) { return std::sin(t.position_mm[i] / p[0]); });
  of["empirical_force/position"] =
      at_point([](Numbers, const Track& t, std::size_t i) { return from_table(t.position_mm[i]); });
  of["empirical_force/rate"] = at_point(
      [](Numbers, const Track& t, std::size_t i) { return from_table(std::asinh(t.velocity_mm_s[i] / 0.01)); });
  of["empirical_force/travel"] = {.force = [](Numbers, const Track& t) {
    const Curve s = travel(t);
    return pointwise(t, [&](std::size_t i) { return from_table(s[i]); });
  }};
  of["empirical_force/pressure"] =
      at_point([](Numbers, const Track& t, std::size_t i) { return from_table(t.excess_psi[i]); });
  of["empirical_force/time"] = at_point([](Numbers, const Track& t, std::size_t i) { return from_table(t.t_s(i)); });
  of["empirical_force/extending"] = by_direction(1.0);
  of["empirical_force/shortening"] = by_direction(-1.0);
  of["empirical_memory/branch"] = {.force = [](Numbers p, const Track& t) {
    bool over = t.position_mm[0] > p[0];
    Curve out;
    for (const double x : t.position_mm) {
      over = x > p[0] ? true : x < p[1] ? false : over;
      out.push_back(over ? 1.0 : 0.0);
    }
    return Columns{out};
  }};
  of["empirical_memory/structure"] = {.force = [](Numbers p, const Track& t) {
    // What is broken, B = 1 - L: dB/dt = |v| (1 - B) / d - B / tr.
    const Curve broken = integrate(
        t, [=](double b, double v) { return std::fabs(v) * (1.0 - b) / p[2] - b / p[1]; },
        [=](double, double v) { return std::fabs(v) / p[2] + 1.0 / p[1]; });
    Columns out{arm(t, p[0]), Curve{}};
    for (std::size_t i = 0; i < t.size(); ++i) {
      out[0][i] *= broken[i];
      out[1].push_back(broken[i] * elongation(t, i));
    }
    return out;
  }};
  of["empirical_memory/wave"] = {.force = [](Numbers p, const Track& t) {
    Columns out(4);
    for (std::size_t i = 0; i < t.size(); ++i) {
      const double phase = 2.0 * std::numbers::pi * t.t_s(i) / p[0];
      out[0].push_back(std::sin(phase));
      out[1].push_back(std::cos(phase));
      out[2].push_back(std::sin(phase) * elongation(t, i));
      out[3].push_back(std::cos(phase) * elongation(t, i));
    }
    return out;
  }};
  of["empirical_response/second_order"] = {.shape = [](Numbers p, const Track& t, const Curve& force) {
    const double w = 2.0 * std::numbers::pi / p[0], damping = p[1];
    double y = force.front(), rate = 0.0;
    Curve out{y};
    for (std::size_t i = 1; i < t.size(); ++i) {
      const int parts = static_cast<int>(std::ceil(t.step_s * w / 0.01));
      const double h = t.step_s / parts;
      for (int k = 0; k < parts; ++k) {
        const auto pull = [&](double share, double at, double speed) {
          const double g = force[i - 1] + (k + share) / parts * (force[i] - force[i - 1]);
          return w * w * (g - at) - 2.0 * damping * w * speed;
        };
        const double a1 = pull(0.0, y, rate), v2 = rate + 0.5 * h * a1;
        const double a2 = pull(0.5, y + 0.5 * h * rate, v2), v3 = rate + 0.5 * h * a2;
        const double a3 = pull(0.5, y + 0.5 * h * v2, v3), v4 = rate + h * a3;
        const double a4 = pull(1.0, y + h * v3, v4);
        y += h / 6.0 * (rate + 2.0 * v2 + 2.0 * v3 + v4);
        rate += h / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4);
      }
      out.push_back(y);
    }
    return out;
  }};
  of["empirical_motion/position"] = {.move = [](Numbers, Track& t) {
    for (double& x : t.position_mm) x += from_table(x);
    reckon_velocity(t);
  }};
  return of;
}

void add_friction(std::map<std::string, Judge>& of) {
  of["coulomb_friction/dahl"] = {.force = [](Numbers p, const Track& t) { return Columns{bristle(t, p[0])}; }};
  of["coulomb_friction/jenkins"] = {.force = [](Numbers p, const Track& t) {
    return Columns{masing(t, [&](double x) { return jenkins_virgin(x, p[0]); })};
  }};
  of["coulomb_friction/iwan"] = {.force = [](Numbers p, const Track& t) {
    return Columns{masing(t, [&](double x) { return iwan_virgin(x, p[0]); })};
  }};
  of["coulomb_friction/stribeck"] = {
      .force = [](Numbers p, const Track& t) { return Columns{stribeck(t, p[0], p[1], p[2], 2.0)}; }};
  of["coulomb_friction/stribeck_exponential"] = {
      .force = [](Numbers p, const Track& t) { return Columns{stribeck(t, p[0], p[1], p[2], 1.0)}; }};
  of["coulomb_friction/iwan_stribeck"] = {.force = [](Numbers p, const Track& t) {
    Columns out{masing(t, [&](double x) { return iwan_virgin(x, p[0]); })};
    for (std::size_t i = 0; i < t.size(); ++i)
      out[0][i] += out[0][i] * p[2] / std::exp(std::fabs(t.velocity_mm_s[i]) / p[1]);
    return out;
  }};
  of["coulomb_friction/bouc_wen_equal"] = {
      .force = [](Numbers p, const Track& t) { return Columns{bouc_wen(t, p[0], p[1], 0.5)}; }};
  of["coulomb_friction/bouc_wen"] = {
      .force = [](Numbers p, const Track& t) { return Columns{bouc_wen(t, p[0], p[1], p[2])}; }};
  of["coulomb_friction/regularised"] = at_point([](Numbers p, const Track& t, std::size_t i) {
    const double u = t.velocity_mm_s[i] / p[0];
    return u > 300.0 ? 1.0 : u < -300.0 ? -1.0 : (1.0 - std::exp(-2.0 * u)) / (1.0 + std::exp(-2.0 * u));
  });
  const Judge sliding{.force = [](Numbers p, const Track& t) {
    Columns out{bristle(t, p[0])};
    for (double& z : out[0]) z = std::fabs(z);
    return out;
  }};
  const Judge speed = at_point([](Numbers, const Track& t, std::size_t i) { return std::fabs(t.velocity_mm_s[i]); });
  of["friction_asymmetry/viscous"] = speed;
  of["friction_asymmetry/sliding"] = sliding;
  of["friction_asymmetry/both"] = several({sliding, speed});
  of["friction_with_pressure/dahl"] = {.force = [](Numbers p, const Track& t) {
    Columns out{bristle(t, p[0])};
    for (std::size_t i = 0; i < t.size(); ++i) out[0][i] *= t.nominal_pressure_psi + t.excess_psi[i];
    return out;
  }};
}

void add_specimen(std::map<std::string, Judge>& of) {
  const Judge square =
      at_point([](Numbers, const Track& t, std::size_t i) { return t.position_mm[i] * t.position_mm[i]; });
  const Judge cube = at_point([](Numbers, const Track& t, std::size_t i) { return std::pow(t.position_mm[i], 3.0); });
  of["strain_stiffening/quadratic"] = square;
  of["strain_stiffening/cubic"] = cube;
  of["strain_stiffening/polynomial"] = several({square, cube});
  const Judge fourth = at_point([](Numbers, const Track& t, std::size_t i) { return std::pow(t.position_mm[i], 4.0); });
  const Judge fifth = at_point([](Numbers, const Track& t, std::size_t i) { return std::pow(t.position_mm[i], 5.0); });
  of["strain_stiffening/quintic"] = several({square, cube, fourth, fifth});
  of["strain_stiffening/exponential"] = at_point([](Numbers p, const Track& t, std::size_t i) {
    // k L (u^2/2! + u^3/3! + ...)
    const long double u = t.position_mm[i] / p[0];
    long double term = u, sum = 0.0L;
    for (int k = 2; k < 120; ++k) sum += term *= u / k;
    return static_cast<double>(p[0] * sum);
  });
  of["strain_stiffening/knee"] = at_point(
      [](Numbers p, const Track& t, std::size_t i) { return t.position_mm[i] > p[0] ? t.position_mm[i] - p[0] : 0.0; });
  of["strain_stiffening/smooth_knee"] = {
      .force = [](Numbers p, const Track& t) { return Columns{taut(t.position_mm, p[0], p[1])}; }};
  of["second_relaxation/arm"] = {.force = [](Numbers p, const Track& t) { return Columns{arm(t, p[0])}; }};
  of["second_relaxation/two_arms"] = {.force = [](Numbers p, const Track& t) {
    return Columns{arm(t, p[0]), arm(t, p[1])};
  }};
  of["second_relaxation/spectrum"] = {.force = [](Numbers p, const Track& t) {
    Columns out{Curve(t.size(), 0.0)};
    for (int k = 0; k < 8; ++k) {
      const Curve z = arm(t, p[0] * std::exp(std::numbers::ln10 * p[1] * k / 7.0));
      for (std::size_t i = 0; i < z.size(); ++i) out[0][i] += z[i] / 8.0;
    }
    return out;
  }};
  of["nonlinear_viscosity/power_arm"] = {.force = [](Numbers p, const Track& t) {
    const double tau = p[0], m = p[1];
    const auto flow = [=](double z) { return std::copysign(std::pow(std::fabs(z), m), z) / tau; };
    return Columns{integrate(
        t, [=](double z, double v) { return v - flow(z); },
        [=](double z, double v) {
          return m * std::pow(std::fmax(std::fabs(z), 1e-5), m - 1.0) / tau +
                 std::fabs(v) / std::fmax(std::fabs(z), 1e-2);
        })};
  }};
  of["nonlinear_viscosity/yield_arm"] = {.force = [](Numbers p, const Track& t) {
    const double tau = p[0], y = p[1];
    return Columns{integrate(
        t, [=](double z, double v) { return v - sign(z) * std::fmax(0.0, std::fabs(z) - y) / tau; },
        [=](double, double) { return std::fmax(1.0 / tau, 200.0); })};
  }};
  of["nonlinear_viscosity/power_dashpot"] = at_point([](Numbers p, const Track& t, std::size_t i) {
    const double v = t.velocity_mm_s[i];
    return v == 0.0 ? 0.0 : sign(v) * std::exp(p[0] * std::log(std::fabs(v)));
  });
  const Judge by_force = at_point([](Numbers, const Track& t, std::size_t i) { return t.excess_psi[i]; });
  const Judge by_stiffness =
      at_point([](Numbers, const Track& t, std::size_t i) { return t.excess_psi[i] * elongation(t, i); });
  of["pressure_coupling/force"] = by_force;
  of["pressure_coupling/stiffness"] = by_stiffness;
  of["pressure_coupling/both"] = several({by_force, by_stiffness});
  of["pressure_coupling/tube"] = {.force = [](Numbers p, const Track& t) {
    Curve pressure;
    for (std::size_t i = 0; i < t.size(); ++i) pressure.push_back(t.excess_psi[i]);
    return Columns{behind_poles<1>(p[0], t.step_s, pressure)};
  }};
  of["pressure_threshold/dead_zone"] = at_point([](Numbers p, const Track& t, std::size_t i) {
    const double over = t.nominal_pressure_psi + t.excess_psi[i] - p[0];
    return over > 0.0 ? over : 0.0;
  });
  of["cyclic_softening/elastic"] = softened(true);
  of["cyclic_softening/tangent"] = softened(false);
  of["cyclic_softening/overall"] = {.shape = [](Numbers p, const Track& t, const Curve& force) {
    const Curve s = travel(t);
    Curve out = force;
    for (std::size_t i = 0; i < out.size(); ++i) out[i] -= p[1] * (1.0 - std::exp(-s[i] / p[0])) * force[i];
    return out;
  }};
  of["slack/unilateral"] = {.shape = [](Numbers, const Track&, const Curve& force) {
    Curve out = force;
    for (double& f : out) f = f < 0.0 ? 0.0 : f;
    return out;
  }};
  of["viscous_drag/linear"] = at_point([](Numbers, const Track& t, std::size_t i) { return t.velocity_mm_s[i]; });
  of["unsettled_start/exponential"] =
      at_point([](Numbers p, const Track& t, std::size_t i) { return 1.0 / std::exp(t.t_s(i) / p[0]); });
}

void add_rig_and_sensor(std::map<std::string, Judge>& of) {
  of["grip_slip/event"] = {.move = [](Numbers p, Track& t) {
    for (std::size_t i = 0; i < t.size(); ++i)
      if (t.t_s(i) > p[0] - 1e-9) t.position_mm[i] -= p[1];
  }};
  of["grip_slip/creep"] = {.move = [](Numbers p, Track& t) {
    for (std::size_t i = 0; i < t.size(); ++i)
      if (t.t_s(i) > p[0]) t.position_mm[i] -= p[1] - p[1] * std::exp((p[0] - t.t_s(i)) / p[2]);
    reckon_velocity(t);
  }};
  of["crosshead_backlash/play"] = {.move = [](Numbers p, Track& t) {
    // Play is what a stop leaves of the motion, and a stop slides by Masing's rules. Its origin is where the
    // crosshead stands in the gap.
    const double half = 0.5 * p[0], first = t.position_mm.front();
    Masing stop([=](double x) { return std::clamp(x, -half, half); }, first + p[1] * half);
    const double zero = first - stop.at(first);
    for (double& x : t.position_mm) x = x - stop.at(x) - (zero - first);
    reckon_velocity(t);
  }};
  of["crosshead_backlash/compliant"] = {.move = [](Numbers p, Track& t) {
    // What is pushed beyond a flank is a spring's length against a drag: small Runge-Kutta steps of the distance
    // between reading and crosshead.
    const double half = 0.5 * p[0];
    const Curve apart = integrate_from(
        -p[2] * half, t,
        [=](double a, double v) {
          return v - (a > half ? a - half : a < -half ? a + half : 0.0) / p[1];
        },
        [=](double, double v) { return 1.0 / p[1] + std::fabs(v) / std::fmax(half, 1e-3); });
    for (std::size_t i = 0; i < t.size(); ++i) t.position_mm[i] -= apart[i] - apart.front();
    reckon_velocity(t);
  }};
  of["fixture_inertia/rigid"] =
      at_point([](Numbers, const Track& t, std::size_t i) { return t.acceleration_mm_s2(i) / 1000.0; });
  of["fixture_inertia/sprung"] = {.force = [](Numbers p, const Track& t) {
    // How far the mass hangs behind its support, r, and how fast: r'' = a - w^2 r - 2 z w r', and its spring pulls with
    // w^2 r.
    const double w = 2.0 * std::numbers::pi / p[0], damping = 2.0 * p[1] * w;
    double r = t.acceleration_mm_s2(0) / (w * w), rate = 0.0;
    Curve out{t.acceleration_mm_s2(0) / 1000.0};
    for (std::size_t i = 1; i < t.size(); ++i) {
      const double before = t.acceleration_mm_s2(i - 1), after = t.acceleration_mm_s2(i);
      const auto pieces = static_cast<int>(std::ceil(w * t.step_s / 0.05));
      const double h = t.step_s / pieces;
      for (int k = 0; k < pieces; ++k) {
        const auto a = [&](double part) { return before + (after - before) * (k + part) / pieces; };
        const auto turn = [&](double x, double v, double part) { return a(part) - w * w * x - damping * v; };
        const double v1 = rate, a1 = turn(r, v1, 0.0);
        const double v2 = rate + 0.5 * h * a1, a2 = turn(r + 0.5 * h * v1, v2, 0.5);
        const double v3 = rate + 0.5 * h * a2, a3 = turn(r + 0.5 * h * v2, v3, 0.5);
        const double v4 = rate + h * a3, a4 = turn(r + h * v3, v4, 1.0);
        r += h / 6.0 * (v1 + 2.0 * v2 + 2.0 * v3 + v4);
        rate += h / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4);
      }
      out.push_back(w * w * r / 1000.0);
    }
    return Columns{out};
  }};
  of["force_lag/first_order"] = {
      .shape = [](Numbers p, const Track& t, const Curve& force) { return behind_poles<1>(p[0], t.step_s, force); }};
  of["force_lag/two_poles"] = {
      .shape = [](Numbers p, const Track& t, const Curve& force) { return behind_poles<2>(p[0], t.step_s, force); }};
  of["force_delay/dead_time"] = {.shape = [](Numbers p, const Track& t, const Curve& force) {
    Curve out;
    for (std::size_t i = 0; i < t.size(); ++i) {
      const double at = std::fmax(0.0, static_cast<double>(i) - p[0] / t.step_s);
      const auto k = std::min(static_cast<std::size_t>(at), t.size() - 2);
      const double share = at - static_cast<double>(k);
      out.push_back((1.0 - share) * force[k] + share * force[k + 1]);
    }
    return out;
  }};
  of["cell_nonlinearity/quadratic"] = {.shape = [](Numbers p, const Track&, const Curve& force) {
    Curve out = force;
    for (double& f : out) f += p[0] / 1000.0 * f * f;
    return out;
  }};
  of["cell_nonlinearity/ceiling"] = {.shape = [](Numbers p, const Track&, const Curve& force) {
    Curve out = force;
    for (double& f : out)
      if (f != 0.0) f = std::copysign(std::pow(std::pow(std::fabs(f), -p[1]) + std::pow(p[0], -p[1]), -1.0 / p[1]), f);
    return out;
  }};
  of["zero_drift/linear"] = at_point([](Numbers, const Track& t, std::size_t i) { return t.t_s(i) / 3600.0; });
  of["zero_drift/settling"] =
      at_point([](Numbers p, const Track& t, std::size_t i) { return 1.0 - std::exp(-t.t_s(i) / p[0]); });
  std::vector<Judge> waves;
  for (int k = 1; k <= 6; ++k)
    waves.push_back(at_point([k](Numbers p, const Track& t, std::size_t i) {
      return std::cos(k * std::numbers::pi * std::fmin(t.t_s(i), p[0]) / p[0]);
    }));
  of["zero_drift/wander"] = several(waves);
}

/// Every product of docs/effects.md, "A law without a name".
void add_products(std::map<std::string, Judge>& of) {
  using Of = std::function<Curve(Numbers, const Track&)>;
  const std::map<std::string, Of> states{
      {"elastic",
       [](Numbers, const Track& t) { return pointwise(t, [&](std::size_t i) { return elongation(t, i); })[0]; }},
      {"arm", [](Numbers p, const Track& t) { return arm(t, p[0]); }},
      {"dashpot", [](Numbers, const Track& t) { return t.velocity_mm_s; }},
      {"friction", [](Numbers p, const Track& t) { return bristle(t, p[0]); }}};
  const auto farthest = [](const Track& t) {
    Curve out;
    for (const double x : t.position_mm)
      out.push_back(std::max(out.empty() ? 0.0 : out.back(), std::fabs(x - t.position_mm[0])));
    return out;
  };
  const std::map<std::string, std::function<Curve(const Track&, const Curve&)>> factors{
      {"alone", [](const Track& t, const Curve&) { return Curve(t.size(), 1.0); }},
      {"position", [](const Track& t, const Curve&) { return t.position_mm; }},
      {"position_squared",
       [](const Track& t, const Curve&) {
         Curve out = t.position_mm;
         for (double& x : out) x *= x;
         return out;
       }},
      {"magnitude",
       [](const Track&, Curve state) {
         for (double& s : state) s = std::fabs(s);
         return state;
       }},
      {"rate",
       [](const Track& t, const Curve&) {
         Curve out = t.velocity_mm_s;
         for (double& v : out) v = std::fabs(v);
         return out;
       }},
      {"pressure", [](const Track& t, const Curve&) { return t.excess_psi; }},
      {"travel", [](const Track& t, const Curve&) { return travel(t); }},
      {"farthest", [=](const Track& t, const Curve&) { return farthest(t); }}};
  for (const auto& [state_name, state] : states)
    for (const auto& [factor_name, factor] : factors)
      of["discovered/" + state_name + "_" + factor_name] = {.force = [state, factor](Numbers p, const Track& t) {
        Curve out = state(p, t);
        const Curve by = factor(t, out);
        for (std::size_t i = 0; i < out.size(); ++i) out[i] *= by[i];
        return Columns{out};
      }};
}

const std::map<std::string, Judge>& judges() {
  static const std::map<std::string, Judge> all = [] {
    std::map<std::string, Judge> of = make_elements();
    add_friction(of);
    add_specimen(of);
    add_rig_and_sensor(of);
    add_mckibben(of);
    add_products(of);
    return of;
  }();
  return all;
}

/// Places in the order of docs/effects.md.
int place_of(std::string_view physics) {
  static const std::map<std::string_view, int> other{{"empirical_motion", 0},
                                                     {"grip_slip", 0},
                                                     {"crosshead_backlash", 0},
                                                     {"slack", 2},
                                                     {"mass", 3},
                                                     {"fixture_inertia", 3},
                                                     {"cell_nonlinearity", 4},
                                                     {"force_lag", 4},
                                                     {"empirical_response", 4},
                                                     {"force_delay", 5},
                                                     {"zero_drift", 6},
                                                     {"constant", 6},
                                                     {"force_zero", 6}};
  const auto found = other.find(physics);
  return found == other.end() ? 1 : found->second;
}

}  // namespace

model::Table some_table() {
  return {-1.25, 0.5, {0.4, 0.1, -0.2, 0.05, 0.3, 0.35, -0.1}};
}

const Judge* judge_of(std::string_view physics, std::string_view law) {
  const auto found = judges().find(std::string(physics) + "/" + std::string(law));
  return found == judges().end() ? nullptr : &found->second;
}

Curve judged_force(const model::ModelSpec& spec, Track track) {
  Curve force;
  for (int place = 0; place <= 6; ++place) {
    // What acts on the sum comes after what is summed in the same place.
    for (const bool acts_on_sum : {false, true}) {
      for (const model::Part& part : spec.parts) {
        const Judge& judge = *judge_of(part.physics->name, part.law->name);
        if (place_of(part.physics->name) != place || static_cast<bool>(judge.shape) != acts_on_sum) continue;
        if (judge.move) judge.move(part.parameters, track);
        force.resize(track.size(), 0.0);
        if (judge.shape) force = judge.shape(part.parameters, track, force);
        if (!judge.force) continue;
        const Columns columns = judge.force(part.parameters, track);
        for (std::size_t c = 0; c < columns.size(); ++c)
          for (std::size_t i = 0; i < force.size(); ++i) force[i] += part.coefficients[c] * columns[c][i];
      }
    }
  }
  return force;
}

}  // namespace isorig::test
