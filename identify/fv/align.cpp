#include "identify/fv/align.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "base/formatted.hpp"
#include "identify/fv/align_coarse.hpp"

namespace isorig::identify {
namespace {

using base::formatted;
using Vector = std::vector<double>;

struct Window {
  double t_frame_s;
  std::size_t first, last;  ///< pressure samples
};

/// Windows w round the strokes, least squares of level and drift in each and one amplitude A for all:
///
///     p(t_p) = a_w + b_w t_p + A s(t),   t = t_ref + q0 + (1 + q1) (t_p - t_ref),   ds/dt = dx/dt - exp(q2) s
///
/// q0 is the offset in s at t_ref, q1 the skew, exp(q2) the rate at which the regulator recovers. Level and drift are
/// taken off p and s alike, which leaves A = s'p / s's: the search walks over q alone (variable projection).
class WindowFit {
 public:
  WindowFit(const messages::FrameSamples& frame, const messages::PressureSamples& pressure, std::vector<Window> windows,
            double reference_s)
      : frame_(frame), pressure_(pressure), windows_(std::move(windows)), reference_s_(reference_s) {}

  /// Residual of all windows for offset, skew, ln gamma; A is eliminated. `shift` moves one window's times.
  double residual(const Eigen::Vector3d& q, Eigen::VectorXd* out, double* amplitude, long only = -1,
                  double shift_s = 0.0) const {
    const double gamma = std::exp(q[2]);
    if (gamma != cached_gamma_) {
      cached_ = response_to_motion(frame_, gamma);
      cached_gamma_ = gamma;
    }
    Vector y, s;
    std::size_t hint = 0;
    for (std::size_t w = 0; w < windows_.size(); ++w) {
      if (only >= 0 && w != static_cast<std::size_t>(only)) continue;
      const std::size_t begin = y.size();
      for (std::size_t i = windows_[w].first; i < windows_[w].last; ++i) {
        const double t = reference_s_ + q[0] + (1.0 + q[1]) * (pressure_.t_s[i] - reference_s_) + shift_s;
        s.push_back(interpolate(frame_.t_s, cached_, t, hint));
        y.push_back(pressure_.pressure_psi[i]);
      }
      flatten(y, begin);
      flatten(s, begin);
    }
    const Eigen::Map<const Eigen::VectorXd> ym(y.data(), static_cast<long>(y.size()));
    const Eigen::Map<const Eigen::VectorXd> sm(s.data(), static_cast<long>(s.size()));
    const double a = sm.squaredNorm() > 0.0 ? sm.dot(ym) / sm.squaredNorm() : 0.0;
    const Eigen::VectorXd r = ym - a * sm;
    if (out != nullptr) *out = r;
    if (amplitude != nullptr) *amplitude = a;
    return r.squaredNorm();
  }

  [[nodiscard]] const std::vector<Window>& windows() const { return windows_; }

 private:
  /// Takes off the least-squares line over the index (samples of a window are evenly spaced enough for a
  /// drift).
  static void flatten(Vector& v, std::size_t begin) {
    const double n = static_cast<double>(v.size() - begin);
    if (n < 3) return;
    double mean = 0.0, slope = 0.0, power = 0.0;
    for (std::size_t i = begin; i < v.size(); ++i) mean += v[i] / n;
    for (std::size_t i = begin; i < v.size(); ++i) {
      const double u = static_cast<double>(i - begin) - 0.5 * (n - 1.0);
      slope += u * v[i];
      power += u * u;
    }
    for (std::size_t i = begin; i < v.size(); ++i)
      v[i] -= mean + slope / power * (static_cast<double>(i - begin) - 0.5 * (n - 1.0));
  }

  const messages::FrameSamples& frame_;
  const messages::PressureSamples& pressure_;
  std::vector<Window> windows_;
  double reference_s_;
  mutable Vector cached_;
  mutable double cached_gamma_ = -1.0;
};

/// Factor on the variance of what is fitted, for a residual of lag-1 correlation rho: (1 + rho) / (1 - rho).
double inflation_of(const Eigen::VectorXd& r) {
  const long n = r.size();
  if (n < 10) return 1.0;
  const double rho = std::clamp(r.head(n - 1).dot(r.tail(n - 1)) / r.squaredNorm(), 0.0, 0.98);
  return (1.0 + rho) / (1.0 - rho);
}

/// The pressure's clock for a moment of the frame's, as far as the coarse search knows it.
struct CoarseMap {
  double first_pressure_s;
  double first_frame_s;  ///< where the pressure's grid begins, on the frame's clock
  double skew;
  [[nodiscard]] double pressure_s(double frame_s) const {
    return first_pressure_s + (frame_s - first_frame_s) / (1.0 + skew);
  }
};

/// Round the strokes that move fast enough to show, where both streams have samples.
std::vector<Window> windows_round(std::span<const Move> moves, const messages::FrameSamples& frame,
                                  const messages::PressureSamples& pressure, const CoarseMap& map) {
  double fastest = 0.0;
  for (const Move& m : moves)
    if (std::isfinite(m.velocity_mm_s.value)) fastest = std::max(fastest, std::abs(m.velocity_mm_s.value));
  std::vector<Window> windows;
  double covered_to = -std::numeric_limits<double>::infinity();
  for (const Move& m : moves) {
    if (!(std::abs(m.velocity_mm_s.value) > 0.05 * fastest)) continue;
    const double begin = std::max(m.t_start_s - 3.0, covered_to), end = m.t_end_s + 6.0;
    if (begin < frame.t_s.front() + 1.0 || end > frame.t_s.back() - 1.0 || end < begin + 4.0) continue;
    const auto sample_at = [&](double frame_s) {
      return std::lower_bound(pressure.t_s.begin(), pressure.t_s.end(), map.pressure_s(frame_s)) - pressure.t_s.begin();
    };
    const auto a = sample_at(begin), b = sample_at(end);
    if (b - a < 12) continue;
    windows.push_back({m.t_start_s, static_cast<std::size_t>(a), static_cast<std::size_t>(b)});
    covered_to = end;
  }
  return windows;
}

/// Offset, skew, ln gamma at the least sum of squares, and what it is made of there.
struct Refined {
  Eigen::Vector3d q;
  std::vector<int> free;  ///< of q; the columns of `jacobian`
  Eigen::VectorXd residual;
  Eigen::MatrixXd jacobian;
  double ssr = 0.0;
  double amplitude = 0.0;
};

Eigen::MatrixXd differences(const WindowFit& fit, const Refined& at, const Eigen::Vector3d& step) {
  Eigen::MatrixXd jacobian(at.residual.size(), static_cast<long>(at.free.size()));
  for (std::size_t k = 0; k < at.free.size(); ++k) {
    const int j = at.free[k];
    Eigen::Vector3d up = at.q, down = at.q;
    up[j] += step[j];
    down[j] -= step[j];
    Eigen::VectorXd ru, rd;
    fit.residual(up, &ru, nullptr);
    fit.residual(down, &rd, nullptr);
    jacobian.col(static_cast<long>(k)) = (ru - rd) / (2.0 * step[j]);
  }
  return jacobian;
}

/// Levenberg 1944, Marquardt 1963, with the damping as further rows of a least-squares problem, so that the condition
/// number of the Jacobian is not squared (More 1978).
Refined refine(const WindowFit& fit, const Eigen::Vector3d& start, bool skew_known, double spread_s) {
  Refined at;
  at.q = start;
  at.free = skew_known ? std::vector<int>{0, 1, 2} : std::vector<int>{0, 2};
  at.ssr = fit.residual(at.q, &at.residual, &at.amplitude);
  const Eigen::Vector3d step(1e-3, 1e-3 / std::max(spread_s, 10.0), 1e-3);
  double damping = 1e-3;
  for (int iteration = 0; iteration < 40; ++iteration) {
    at.jacobian = differences(fit, at, step);
    const long rows = at.jacobian.rows(), columns = at.jacobian.cols();
    Eigen::MatrixXd damped(rows + columns, columns);
    damped << at.jacobian,
        Eigen::MatrixXd((std::sqrt(damping) * at.jacobian.colwise().norm().transpose()).asDiagonal());
    Eigen::VectorXd target = Eigen::VectorXd::Zero(rows + columns);
    target.head(rows) = -at.residual;
    const Eigen::VectorXd move = damped.colPivHouseholderQr().solve(target);
    Eigen::Vector3d next = at.q;
    for (std::size_t k = 0; k < at.free.size(); ++k) next[at.free[k]] += move[static_cast<long>(k)];
    next[0] = std::clamp(next[0], at.q[0] - 0.5, at.q[0] + 0.5);
    next[2] = std::clamp(next[2], std::log(0.02), std::log(100.0));
    Eigen::VectorXd residual;
    double amplitude = 0.0;
    const double ssr = fit.residual(next, &residual, &amplitude);
    if (ssr < at.ssr) {
      const double gain = (at.ssr - ssr) / at.ssr;
      at.q = next;
      at.residual = std::move(residual);
      at.amplitude = amplitude;
      at.ssr = ssr;
      damping = std::max(damping / 10.0, 1e-9);
      if (gain < 1e-9) break;
    } else {
      damping *= 10.0;
      if (damping > 1e9) break;
    }
  }
  return at;
}

/// What each stroke alone would say: their scatter is the check that no model of the response can fool.
std::vector<AlignedEvent> strokes_alone(const WindowFit& fit, const Eigen::Vector3d& q) {
  std::vector<AlignedEvent> events;
  for (std::size_t w = 0; w < fit.windows().size(); ++w) {
    const double h = 1e-3;
    Eigen::VectorXd up, down, here;
    double level = 0.0;
    const auto only = static_cast<long>(w);
    fit.residual(q, &here, &level, only);
    fit.residual(q, &up, nullptr, only, h);
    fit.residual(q, &down, nullptr, only, -h);
    const Eigen::VectorXd d = (up - down) / (2.0 * h);
    const double power = d.squaredNorm();
    const double noise =
        here.squaredNorm() / std::max(1.0, static_cast<double>(here.size()) - 4.0) * inflation_of(here);
    events.push_back({fit.windows()[w].t_frame_s, {-d.dot(here) / power, std::sqrt(noise / power)}});
  }
  return events;
}

/// Offset and skew with their standard errors: from the residual, and no smaller than the strokes' own scatter says.
Alignment alignment_of(const WindowFit& fit, const Refined& at, bool skew_known, const AlignOptions& options) {
  Alignment a;
  a.skew_known = skew_known;
  a.response = at.amplitude;
  a.recovery_per_s = std::exp(at.q[2]);
  a.events = strokes_alone(fit, at.q);
  const double strokes = static_cast<double>(fit.windows().size());
  const double n = static_cast<double>(at.residual.size());
  const double used = static_cast<double>(at.free.size() + 1) + 2.0 * strokes;
  const double variance = at.ssr / std::max(1.0, n - used) * inflation_of(at.residual);
  const Eigen::MatrixXd covariance = variance * (at.jacobian.transpose() * at.jacobian).inverse();
  double chi2 = 0.0;
  for (const auto& event : a.events) chi2 += std::pow(event.shift_s.value / event.shift_s.standard_error, 2);
  const double freedom = strokes - (skew_known ? 2.0 : 1.0);
  const double inflate = freedom >= 1.0 ? std::sqrt(std::max(1.0, chi2 / freedom)) : 1.0;
  a.offset_s = {at.q[0], inflate * std::sqrt(covariance(0, 0))};
  a.skew = {at.q[1], skew_known ? inflate * std::sqrt(covariance(1, 1)) : options.largest_skew};
  return a;
}

/// Why the coarse search is nothing to go on from; empty when it is.
std::string objection_to(const CoarseAlignment& coarse) {
  constexpr double kPlainResponse = 0.3;  // of the pressure's squares: no noise of some seconds is so like the strokes
  if (coarse.significance < 8.0 && coarse.explained_share > kPlainResponse)
    return formatted(
        "the pressure follows the strokes (%.0f %% of its changes), and nearly alike at many lags: the strokes repeat "
        "too regularly. A pause or a stroke of another size would tell them apart.",
        100.0 * coarse.explained_share);
  if (coarse.significance < 8.0)
    return formatted(
        "the pressure's response to the strokes does not stand out (%.1f times its own scatter at the best lag; 8 are "
        "asked for). A well-regulated or unconnected pressure has nothing to align by.",
        coarse.significance);
  if (coarse.second > 0.9 * coarse.score)
    return formatted(
        "two lags explain the pressure nearly alike (%.0f %% against 100 %%): the strokes repeat too "
        "regularly, or too few are in both streams.",
        100.0 * coarse.second / coarse.score);
  return {};
}

}  // namespace

AlignResult align(const messages::FrameSamples& frame, const messages::PressureSamples& pressure,
                  const AlignOptions& options) {
  AlignResult result;
  auto refuse = [&](std::string why) {
    result.refusal = "Not aligned: " + std::move(why);
    return result;
  };
  if (frame.size() < 20 || pressure.size() < 20) return refuse("one of the streams has fewer than 20 samples.");
  const auto moves = find_moves(frame.t_s, frame.position_mm);
  if (moves.empty()) return refuse("nothing moves in the frame's stream, so there is no event to look for.");
  if (std::min(frame.t_s.back() - frame.t_s.front(), pressure.t_s.back() - pressure.t_s.front()) < 5.0)
    return refuse("the streams are shorter than 5 s.");
  constexpr double kSearch = 0.5;  // of the time, about: the fit to the strokes takes the rest
  const auto coarse = find_coarse_alignment(frame, pressure, options.largest_skew, [&](double done) {
    if (options.on_progress) options.on_progress(kSearch * done);
  });
  if (options.on_progress) options.on_progress(kSearch);
  if (const auto why = objection_to(coarse); !why.empty()) return refuse(why);

  const CoarseMap map{pressure.t_s.front(), frame.t_s.front() + coarse.lag_s, coarse.skew};
  const auto windows = windows_round(moves, frame, pressure, map);
  if (windows.empty()) return refuse("no stroke lies within both streams with samples round it.");
  double reference_s = 0.0;
  for (const Window& w : windows) reference_s += map.pressure_s(w.t_frame_s) / static_cast<double>(windows.size());
  const WindowFit fit(frame, pressure, windows, reference_s);
  const double spread_s = map.pressure_s(windows.back().t_frame_s) - map.pressure_s(windows.front().t_frame_s);
  const bool skew_known = windows.size() >= 3 && spread_s > 10.0;
  const double reference_frame_s = map.first_frame_s + (1.0 + coarse.skew) * (reference_s - map.first_pressure_s);
  const auto refined =
      refine(fit, {reference_frame_s - reference_s, skew_known ? coarse.skew : 0.0, std::log(coarse.gamma_per_s)},
             skew_known, spread_s);

  Alignment& a = result.alignment;
  a = alignment_of(fit, refined, skew_known, options);
  a.reference_s = reference_s;
  a.significance = coarse.significance;
  const double reach_s = std::max(pressure.t_s.back() - reference_s, reference_s - pressure.t_s.front());
  a.worst_error_s = std::hypot(a.offset_s.standard_error, a.skew.standard_error * reach_s);
  if (!(a.worst_error_s <= options.largest_error_s))
    return refuse(
        formatted("the mapping would be uncertain by %.2g s (1 sigma) at the end of the record; %.2g s are allowed.",
                  a.worst_error_s, options.largest_error_s));
  if (skew_known && std::abs(a.skew.value) > options.largest_skew + 3.0 * a.skew.standard_error)
    return refuse(formatted("the skew comes out at %.0f ppm, beyond the %.0f ppm that two clocks can differ by.",
                            1e6 * a.skew.value, 1e6 * options.largest_skew));
  result.aligned = true;
  return result;
}

}  // namespace isorig::identify
