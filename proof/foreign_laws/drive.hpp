#pragma once
#include <algorithm>
#include <array>
#include <boost/numeric/odeint.hpp>
#include <cmath>
#include <span>
#include <vector>

/// What the laws of the second generator are driven by. Every law is a map from signals to a force (or from a position
/// to another one), written apart from model/ and from proof/generator/, and integrated by Boost.Odeint.
namespace isorig::proof::foreign {

/// Signals at the nodes of a time grid that has a node at every corner of the motion. Between two nodes the position is
/// the cubic that has their positions and velocities (Hermite), so the velocity is continuous.
struct Drive {
  std::vector<double> t_s;
  std::vector<double> position_mm;
  std::vector<double> velocity_mm_s;
  std::vector<double> acceleration_mm_s2;
  std::vector<double> pressure_psi;  ///< gauge, as the actuator feels it
  std::vector<double> elastic_N;     ///< of the nominal spring; what softening, damage and load act on
  std::vector<double> specimen_N;    ///< nominal spring and arms together
  double stiffness_N_mm = 1.0;       ///< of the nominal spring

  [[nodiscard]] std::size_t size() const noexcept { return t_s.size(); }

  /// Velocity a share `part` of the way from node i - 1 to node i.
  [[nodiscard]] double velocity_within(std::size_t i, double part) const noexcept {
    const double h = t_s[i] - t_s[i - 1];
    const double v0 = velocity_mm_s[i - 1], v1 = velocity_mm_s[i];
    const double mean = (position_mm[i] - position_mm[i - 1]) / h;
    return v0 * (1.0 - 4.0 * part + 3.0 * part * part) + v1 * part * (3.0 * part - 2.0) +
           mean * 6.0 * part * (1.0 - part);
  }
};

/// Straight line between the nodes of any signal.
[[nodiscard]] inline double within(std::span<const double> signal, std::size_t i, double part) noexcept {
  return signal[i - 1] + part * (signal[i] - signal[i - 1]);
}

inline constexpr double kAbsoluteTolerance = 1e-7;  ///< of a state, in its own unit (mm, N or a share)
inline constexpr double kRelativeTolerance = 1e-6;

/// Integrates dy/dt = rhs(y, node, part) from node to node with the embedded pair of Dormand & Prince (1980), steps
/// controlled to the two tolerances, and calls look(node, y) at every node. `node` is the right end of the interval
/// and `part` the share of it that has passed: discontinuities of the drive fall on nodes, where the method starts
/// anew, so its order holds.
template <std::size_t N, class Rhs, class Look>
void integrate(const Drive& drive, std::array<double, N> y, const Rhs& rhs, const Look& look) {
  namespace ode = boost::numeric::odeint;
  using State = std::array<double, N>;
  const auto stepper = ode::make_controlled(kAbsoluteTolerance, kRelativeTolerance, ode::runge_kutta_dopri5<State>{});
  look(std::size_t{0}, y);
  for (std::size_t i = 1; i < drive.size(); ++i) {
    const double h = drive.t_s[i] - drive.t_s[i - 1];
    const auto system = [&](const State& state, State& rate, double since_s) { rate = rhs(state, i, since_s / h); };
    ode::integrate_adaptive(stepper, system, y, 0.0, h, h);
    look(i, y);
  }
}

}  // namespace isorig::proof::foreign
