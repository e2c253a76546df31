#include "identify/fv/align.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <complex>
#include <limits>
#include <numeric>
#include <unsupported/Eigen/FFT>

#include "base/quantile.hpp"
#include "identify/fv/text.hpp"
#include "model/slse.hpp"

namespace isorig::identify {
namespace {

using Vector = std::vector<double>;
constexpr double kGrid_s = 0.1;
constexpr double kSmooth_s = 20.0;  ///< slower than this is level and drift

/// s(t) at the frame's own samples.
Vector response(const messages::FrameSamples& frame, double gamma_per_s) {
  Vector s(frame.size(), 0.0);
  for (std::size_t i = 1; i < frame.size(); ++i) {
    const auto r = model::relaxation(gamma_per_s * (frame.t_s[i] - frame.t_s[i - 1]));
    s[i] = s[i - 1] * r.decay + (frame.position_mm[i] - frame.position_mm[i - 1]) * r.gain;
  }
  return s;
}

/// Linear interpolation; `hint` walks forward with increasing t.
double interpolate(std::span<const double> t, std::span<const double> y, double at, std::size_t& hint) {
  while (hint + 2 < t.size() && t[hint + 1] < at) ++hint;
  while (hint > 0 && t[hint] > at) --hint;
  const double w = (at - t[hint]) / (t[hint + 1] - t[hint]);
  return (1.0 - w) * y[hint] + w * y[hint + 1];
}

/// On a uniform grid, less its own moving mean.
Vector gridded(std::span<const double> t, std::span<const double> y, double stretch) {
  const auto n = static_cast<std::size_t>((t.back() - t.front()) * stretch / kGrid_s);
  Vector out(n);
  std::size_t hint = 0;
  for (std::size_t i = 0; i < n; ++i)
    out[i] = interpolate(t, y, t.front() + static_cast<double>(i) * kGrid_s / stretch, hint);
  Vector sum(n + 1, 0.0);
  for (std::size_t i = 0; i < n; ++i) sum[i + 1] = sum[i] + out[i];
  const auto half = static_cast<std::size_t>(0.5 * kSmooth_s / kGrid_s);
  Vector flat(n);
  for (std::size_t i = 0; i < n; ++i) {
    const std::size_t a = i > half ? i - half : 0, b = std::min(n, i + half + 1);
    flat[i] = out[i] - (sum[b] - sum[a]) / static_cast<double>(b - a);
  }
  return flat;
}

struct Coarse {
  double score = 0.0;  ///< |p.s| / |s| at the best lag
  double lag_s = 0.0;  ///< frame grid start + lag is the pressure grid's start
  double skew = 0.0;
  double gamma_per_s = 1.0;
  double significance = 0.0;
  double second = 0.0;  ///< the same more than a stroke's length away
};

using Spectrum = std::vector<std::complex<double>>;

Spectrum spectrum(Eigen::FFT<double>& fft, Vector data, std::size_t size) {
  data.resize(size, 0.0);
  Spectrum out;
  fft.fwd(out, data);
  return out;
}

/// Response at every lag, for one template and one stretch of the pressure.
void correlate(Eigen::FFT<double>& fft, const Spectrum& s_spectrum, const Spectrum& p_spectrum, const Vector& s,
               std::size_t pressure_size, Coarse& best, double skew, double gamma_per_s) {
  const std::size_t size = s_spectrum.size();
  Spectrum product(size);
  for (std::size_t i = 0; i < size; ++i) product[i] = s_spectrum[i] * std::conj(p_spectrum[i]);
  Vector at_lag;
  fft.inv(at_lag, product);
  Vector energy(s.size() + 1, 0.0);
  for (std::size_t i = 0; i < s.size(); ++i) energy[i + 1] = energy[i] + s[i] * s[i];
  // p[j] meets s[j + lag].
  std::vector<std::pair<long, double>> scores;
  const long lowest = -static_cast<long>(pressure_size) + 1, highest = static_cast<long>(s.size()) - 1;
  for (long lag = lowest; lag <= highest; ++lag) {
    const long a = std::max(0L, lag), b = std::min(static_cast<long>(s.size()), lag + static_cast<long>(pressure_size));
    if (b <= a) continue;
    const double overlap = energy[static_cast<std::size_t>(b)] - energy[static_cast<std::size_t>(a)];
    if (overlap < 0.3 * energy.back()) continue;  // too few strokes in common
    const std::size_t at = lag >= 0 ? static_cast<std::size_t>(lag) : size - static_cast<std::size_t>(-lag);
    scores.emplace_back(lag, at_lag[at] / std::sqrt(overlap));
  }
  if (scores.empty()) return;
  const auto top = *std::max_element(scores.begin(), scores.end(), [](const auto& x, const auto& y) {
    return std::abs(x.second) < std::abs(y.second);
  });
  if (std::abs(top.second) <= best.score) return;
  Vector magnitude;
  double second = 0.0;
  for (const auto& [lag, score] : scores) {
    // A response and its tail reach some seconds to both sides of the best lag.
    if (std::abs(lag - top.first) < static_cast<long>(5.0 / kGrid_s)) continue;
    magnitude.push_back(std::abs(score));
    // Only a response of the same sign can be confused with it.
    if (score * top.second > 0.0) second = std::max(second, std::abs(score));
  }
  const double scatter = 1.4826 * base::median(magnitude);
  best = {std::abs(top.second),
          static_cast<double>(top.first) * kGrid_s,
          skew,
          gamma_per_s,
          scatter > 0.0 ? std::abs(top.second) / scatter : 0.0,
          second};
}

struct Window {
  double t_frame_s;
  std::size_t first, last;  ///< pressure samples
};

/// Windows round the strokes, least squares of level, drift and response in each; shared A.
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
      cached_ = response(frame_, gamma);
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

/// Lag-1 correlation of a residual as a variance inflation.
double inflation_of(const Eigen::VectorXd& r) {
  const long n = r.size();
  if (n < 10) return 1.0;
  const double rho = std::clamp(r.head(n - 1).dot(r.tail(n - 1)) / r.squaredNorm(), 0.0, 0.98);
  return (1.0 + rho) / (1.0 - rho);
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

  // Coarse: every lag, a few recoveries, skews so close that the strokes stay within half a second.
  Eigen::FFT<double> fft;
  const double span_s = std::min(frame.t_s.back() - frame.t_s.front(), pressure.t_s.back() - pressure.t_s.front());
  if (span_s < 5.0) return refuse("the streams are shorter than 5 s.");
  const int skew_steps = static_cast<int>(std::ceil(options.largest_skew * span_s / 0.5));
  Coarse best;
  const std::vector<double> gammas{0.1, 0.4, 1.5, 6.0, 25.0};
  std::vector<Vector> templates;
  for (double gamma : gammas) templates.push_back(gridded(frame.t_s, response(frame, gamma), 1.0));
  for (int k = -skew_steps; k <= skew_steps; ++k) {
    const double skew = skew_steps > 0 ? options.largest_skew * k / skew_steps : 0.0;
    const Vector p = gridded(pressure.t_s, pressure.pressure_psi, 1.0 + skew);
    std::size_t size = 1;
    while (size < p.size() + templates.front().size()) size *= 2;
    const Spectrum p_spectrum = spectrum(fft, p, size);
    for (std::size_t g = 0; g < gammas.size(); ++g)
      correlate(fft, spectrum(fft, templates[g], size), p_spectrum, templates[g], p.size(), best, skew, gammas[g]);
  }
  if (best.significance < 8.0)
    return refuse(
        formatted("the pressure shows no response to the strokes (%.1f times its own scatter at the best lag; 8 are "
                  "asked for). A well-regulated or unconnected pressure has nothing to align by.",
                  best.significance));
  if (best.second > 0.9 * best.score)
    return refuse(
        formatted("two lags explain the pressure nearly alike (%.0f %% against 100 %%): the strokes repeat too "
                  "regularly, or too few are in both streams.",
                  100.0 * best.second / best.score));

  // Fine: in windows round the strokes that move fast enough to show.
  double fastest = 0.0;
  for (const Move& m : moves)
    if (std::isfinite(m.velocity_mm_s.value)) fastest = std::max(fastest, std::abs(m.velocity_mm_s.value));
  const double start_s = frame.t_s.front() + best.lag_s;  // of the pressure grid, on the frame's clock
  auto to_pressure = [&](double t_frame) { return pressure.t_s.front() + (t_frame - start_s) / (1.0 + best.skew); };
  std::vector<Window> windows;
  double covered_to = -std::numeric_limits<double>::infinity();
  for (const Move& m : moves) {
    if (!(std::abs(m.velocity_mm_s.value) > 0.05 * fastest)) continue;
    const double begin = std::max(m.t_start_s - 3.0, covered_to), end = m.t_end_s + 6.0;
    if (begin < frame.t_s.front() + 1.0 || end > frame.t_s.back() - 1.0 || end < begin + 4.0) continue;
    const auto a =
        std::lower_bound(pressure.t_s.begin(), pressure.t_s.end(), to_pressure(begin)) - pressure.t_s.begin();
    const auto b = std::lower_bound(pressure.t_s.begin(), pressure.t_s.end(), to_pressure(end)) - pressure.t_s.begin();
    if (b - a < 12) continue;
    windows.push_back({m.t_start_s, static_cast<std::size_t>(a), static_cast<std::size_t>(b)});
    covered_to = end;
  }
  if (windows.empty()) return refuse("no stroke lies within both streams with samples round it.");
  double reference = 0.0;
  for (const Window& w : windows) reference += to_pressure(w.t_frame_s) / static_cast<double>(windows.size());
  const WindowFit fit(frame, pressure, windows, reference);
  const double reference_frame = start_s + (1.0 + best.skew) * (reference - pressure.t_s.front());
  Eigen::Vector3d q(reference_frame - reference, best.skew, std::log(best.gamma_per_s));
  const double spread_s = to_pressure(windows.back().t_frame_s) - to_pressure(windows.front().t_frame_s);
  const bool skew_known = windows.size() >= 3 && spread_s > 10.0;
  if (!skew_known) q[1] = 0.0;
  const Eigen::Vector3d step(1e-3, 1e-3 / std::max(spread_s, 10.0), 1e-3);
  Eigen::VectorXd r;
  Eigen::MatrixXd jacobian;
  double amplitude = 0.0, ssr = fit.residual(q, &r, &amplitude), damping = 1e-3;
  std::vector<int> free{0, 2};
  if (skew_known) free = {0, 1, 2};
  for (int iteration = 0; iteration < 40; ++iteration) {
    jacobian.resize(r.size(), static_cast<long>(free.size()));
    for (std::size_t k = 0; k < free.size(); ++k) {
      Eigen::Vector3d up = q, down = q;
      up[free[k]] += step[free[k]];
      down[free[k]] -= step[free[k]];
      Eigen::VectorXd ru, rd;
      fit.residual(up, &ru, nullptr);
      fit.residual(down, &rd, nullptr);
      jacobian.col(static_cast<long>(k)) = (ru - rd) / (2.0 * step[free[k]]);
    }
    Eigen::MatrixXd h = jacobian.transpose() * jacobian;
    const Eigen::VectorXd g = jacobian.transpose() * r;
    h.diagonal() *= 1.0 + damping;
    const Eigen::VectorXd move = -h.ldlt().solve(g);
    Eigen::Vector3d next = q;
    for (std::size_t k = 0; k < free.size(); ++k) next[free[k]] += move[static_cast<long>(k)];
    next[0] = std::clamp(next[0], q[0] - 0.5, q[0] + 0.5);
    next[2] = std::clamp(next[2], std::log(0.02), std::log(100.0));
    Eigen::VectorXd trial_r;
    double trial_a = 0.0;
    const double trial = fit.residual(next, &trial_r, &trial_a);
    if (trial < ssr) {
      const double gain = (ssr - trial) / ssr;
      q = next;
      r = trial_r;
      amplitude = trial_a;
      ssr = trial;
      damping = std::max(damping / 10.0, 1e-9);
      if (gain < 1e-9) break;
    } else {
      damping *= 10.0;
      if (damping > 1e9) break;
    }
  }

  Alignment& a = result.alignment;
  a.reference_s = reference;
  a.skew_known = skew_known;
  a.response = amplitude;
  a.recovery_per_s = std::exp(q[2]);
  a.significance = best.significance;
  const double n = static_cast<double>(r.size()), used = static_cast<double>(free.size() + 1 + 2 * windows.size());
  const double variance = ssr / std::max(1.0, n - used) * inflation_of(r);
  const Eigen::MatrixXd covariance = variance * (jacobian.transpose() * jacobian).inverse();
  // What each stroke alone would say: their scatter is the check that no model of the response can fool.
  double chi2 = 0.0;
  for (std::size_t w = 0; w < windows.size(); ++w) {
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
    AlignedEvent event{windows[w].t_frame_s, {-d.dot(here) / power, std::sqrt(noise / power)}};
    chi2 += std::pow(event.shift_s.value / event.shift_s.standard_error, 2);
    a.events.push_back(event);
  }
  const double freedom = static_cast<double>(windows.size()) - (skew_known ? 2.0 : 1.0);
  const double inflate = freedom >= 1.0 ? std::sqrt(std::max(1.0, chi2 / freedom)) : 1.0;
  a.offset_s = {q[0], inflate * std::sqrt(covariance(0, 0))};
  a.skew = {q[1], skew_known ? inflate * std::sqrt(covariance(1, 1)) : options.largest_skew};
  const double reach = std::max(pressure.t_s.back() - reference, reference - pressure.t_s.front());
  a.worst_error_s = std::hypot(a.offset_s.standard_error, a.skew.standard_error * reach);
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
