#include "identify/fv/align_coarse.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <complex>
#include <unsupported/Eigen/FFT>
#include <utility>

#include "base/quantile.hpp"
#include "model/slse.hpp"

namespace isorig::identify {
namespace {

using Vector = std::vector<double>;
constexpr double kGrid_s = 0.1;
constexpr double kSmooth_s = 20.0;  ///< slower than this is level and drift

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

using Spectrum = std::vector<std::complex<double>>;

Spectrum spectrum(Eigen::FFT<double>& fft, Vector data, std::size_t size) {
  data.resize(size, 0.0);
  Spectrum out;
  fft.fwd(out, data);
  return out;
}

/// Matched filter of the pressure p with a template s, the response that the motion would cause: for every lag l
///
///     score(l) = sum_j s_j+l p_j / sqrt(sum over the overlap of s_j+l^2)
///
/// The numerator is the inverse transform of S conj(P), both padded with zeros (the correlation theorem); in white
/// noise of sigma the score has the standard deviation sigma at every lag, so that lags of different overlap can be
/// compared.
void correlate(Eigen::FFT<double>& fft, const Spectrum& s_spectrum, const Spectrum& p_spectrum, const Vector& s,
               const Vector& pressure, CoarseAlignment& best, double skew, double gamma_per_s) {
  const std::size_t pressure_size = pressure.size();
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
  double squares = 0.0;
  for (const double p : pressure) squares += p * p;
  const double scatter = base::median(magnitude) / base::kNormalQuartile;
  best = {std::abs(top.second),
          static_cast<double>(top.first) * kGrid_s,
          skew,
          gamma_per_s,
          scatter > 0.0 ? std::abs(top.second) / scatter : 0.0,
          second,
          squares > 0.0 ? top.second * top.second / squares : 0.0};
}

}  // namespace

std::vector<double> response_to_motion(const messages::FrameSamples& frame, double gamma_per_s) {
  std::vector<double> s(frame.size(), 0.0);
  for (std::size_t i = 1; i < frame.size(); ++i) {
    const auto r = model::relaxation(gamma_per_s * (frame.t_s[i] - frame.t_s[i - 1]));
    s[i] = s[i - 1] * r.decay + (frame.position_mm[i] - frame.position_mm[i - 1]) * r.gain;
  }
  return s;
}

double interpolate(std::span<const double> t, std::span<const double> y, double at, std::size_t& hint) {
  while (hint + 2 < t.size() && t[hint + 1] < at) ++hint;
  while (hint > 0 && t[hint] > at) --hint;
  const double w = (at - t[hint]) / (t[hint + 1] - t[hint]);
  return (1.0 - w) * y[hint] + w * y[hint + 1];
}

CoarseAlignment find_coarse_alignment(const messages::FrameSamples& frame, const messages::PressureSamples& pressure,
                                      double largest_skew, const std::function<void(double)>& on_progress) {
  constexpr std::array kGammas_per_s{0.1, 0.4, 1.5, 6.0, 25.0};
  const double span_s = std::min(frame.t_s.back() - frame.t_s.front(), pressure.t_s.back() - pressure.t_s.front());
  const int skew_steps = static_cast<int>(std::ceil(largest_skew * span_s / 0.5));
  Eigen::FFT<double> fft;
  CoarseAlignment best;
  std::vector<Vector> templates;
  templates.reserve(kGammas_per_s.size());
  for (double gamma : kGammas_per_s) templates.push_back(gridded(frame.t_s, response_to_motion(frame, gamma), 1.0));
  for (int k = -skew_steps; k <= skew_steps; ++k) {
    if (on_progress) on_progress(static_cast<double>(k + skew_steps) / (2 * skew_steps + 1));
    const double skew = skew_steps > 0 ? largest_skew * k / skew_steps : 0.0;
    const Vector p = gridded(pressure.t_s, pressure.pressure_psi, 1.0 + skew);
    std::size_t size = 1;
    while (size < p.size() + templates.front().size()) size *= 2;
    const Spectrum p_spectrum = spectrum(fft, p, size);
    for (std::size_t g = 0; g < kGammas_per_s.size(); ++g)
      correlate(fft, spectrum(fft, templates[g], size), p_spectrum, templates[g], p, best, skew, kGammas_per_s[g]);
  }
  return best;
}

}  // namespace isorig::identify
