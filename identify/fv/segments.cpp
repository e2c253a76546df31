#include "identify/fv/segments.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "base/quantile.hpp"

namespace isorig::identify {

SignalNoise estimate_noise(std::span<const double> t_s, std::span<const double> values) {
  SignalNoise noise;
  const std::size_t n = values.size();
  double quantum = std::numeric_limits<double>::infinity();
  for (std::size_t i = 1; i < n; ++i) {
    const double step = std::abs(values[i] - values[i - 1]);
    // Differences of decimal fractions: what is 1e-9 of the value is rounding, not resolution.
    if (step > 1e-9 * std::abs(values[i])) quantum = std::min(quantum, step);
  }
  noise.quantum = std::isfinite(quantum) ? quantum : 0.0;
  // Distance of y_i from the line through its neighbours, y_i - w y_- - (1 - w) y_+, has the variance
  // sigma^2 (1 + w^2 + (1 - w)^2); the median of its size is Phi^-1(3/4) of its standard deviation.
  for (std::size_t stride : {std::size_t{1}, std::size_t{8}}) {
    if (n < 2 * stride + 1) continue;
    // 50 000 samples give the median to 1 %.
    const std::size_t skip = std::max<std::size_t>(1, n / 50000);
    std::vector<double> distance;
    distance.reserve(n / skip + 1);
    for (std::size_t i = stride; i + stride < n; i += skip) {
      const double w = (t_s[i + stride] - t_s[i]) / (t_s[i + stride] - t_s[i - stride]);
      const double line = w * values[i - stride] + (1.0 - w) * values[i + stride];
      distance.push_back(std::abs(values[i] - line) / std::sqrt(1.0 + w * w + (1.0 - w) * (1.0 - w)));
    }
    noise.sigma = std::max(noise.sigma, base::median(std::move(distance)) / base::kNormalQuartile);
  }
  return noise;
}

std::vector<std::size_t> polyline(std::span<const double> t_s, std::span<const double> values, double tolerance) {
  std::vector<std::size_t> kept;
  if (values.empty()) return kept;
  kept.push_back(0);
  if (values.size() == 1) return kept;
  std::vector<std::pair<std::size_t, std::size_t>> open{{0, values.size() - 1}};
  while (!open.empty()) {
    const auto [first, last] = open.back();
    open.pop_back();
    const double slope = (values[last] - values[first]) / (t_s[last] - t_s[first]);
    double worst = tolerance;
    std::size_t at = first;
    for (std::size_t i = first + 1; i < last; ++i) {
      const double off = std::abs(values[i] - values[first] - slope * (t_s[i] - t_s[first]));
      if (off > worst) {
        worst = off;
        at = i;
      }
    }
    if (at == first) {
      kept.push_back(last);
    } else {  // the left half is worked on first, so that vertices come out in order
      open.emplace_back(at, last);
      open.emplace_back(first, at);
    }
  }
  return kept;
}

double Line::se_at(double t) const noexcept {
  return std::hypot(se_mean, se_slope * (t - t_mean));
}

// slope = sum (t - t_mean)(y - y_mean) / sum (t - t_mean)^2, residuals r of n - 2 degrees of freedom with the standard
// deviation s. For a first-order autoregressive r of correlation rho, a mean of many has a variance larger by
// (1 + rho) / (1 - rho) (Bayley & Hammersley 1946):
//
//     se_mean = s sqrt((1 + rho) / (1 - rho) / n),   se_slope = s sqrt((1 + rho) / (1 - rho) / sum (t - t_mean)^2)
//
// rho counts from two of its own standard errors, 2 / sqrt(n), on.
Line fit_line(std::span<const double> t, std::span<const double> y) {
  Line line;
  line.samples = t.size();
  if (t.empty()) {
    line.mean = line.slope = line.residual_sd = line.se_mean = line.se_slope = kNaN;
    return line;
  }
  const double n = static_cast<double>(t.size());
  for (std::size_t i = 0; i < t.size(); ++i) {
    line.t_mean += (t[i] - t[0]) / n;
    line.mean += y[i] / n;
  }
  line.t_mean += t[0];
  double stt = 0.0, sty = 0.0;
  for (std::size_t i = 0; i < t.size(); ++i) {
    stt += (t[i] - line.t_mean) * (t[i] - line.t_mean);
    sty += (t[i] - line.t_mean) * (y[i] - line.mean);
  }
  line.slope = stt > 0.0 ? sty / stt : 0.0;
  double ssr = 0.0, lagged = 0.0, previous = 0.0;
  for (std::size_t i = 0; i < t.size(); ++i) {
    const double r = y[i] - line.at(t[i]);
    ssr += r * r;
    lagged += r * previous;
    previous = r;
  }
  if (t.size() < 3) {
    line.residual_sd = line.se_mean = line.se_slope = kNaN;
    return line;
  }
  line.residual_sd = std::sqrt(ssr / (n - 2.0));
  // The line itself takes about 2/n off the estimated correlation.
  const double rho = ssr > 0.0 ? std::clamp(lagged / ssr + 2.0 / n, 0.0, 0.98) : 0.0;
  const double inflation = rho > 2.0 / std::sqrt(n) ? std::sqrt((1.0 + rho) / (1.0 - rho)) : 1.0;
  line.se_mean = inflation * line.residual_sd / std::sqrt(n);
  line.se_slope = stt > 0.0 ? inflation * line.residual_sd / std::sqrt(stt) : kNaN;
  return line;
}

}  // namespace isorig::identify
