#pragma once
#include <cmath>
#include <vector>

namespace isorig::soak {

/// A straight line through a course of time, by least squares.
struct Growth {
  double slope = 0.0;  ///< per s
  double error = 0.0;  ///< its standard error, by what is left of the course
  /// Not by what the course wavers: 3.1 standard errors are one case of 1000.
  [[nodiscard]] bool surely_above(double bound) const { return slope - 3.1 * error > bound; }
};

[[nodiscard]] inline Growth growth_of(const std::vector<double>& time_s, const std::vector<double>& value) {
  const auto n = static_cast<double>(value.size());
  if (value.size() < 4 || time_s.size() != value.size()) return {};
  double t = 0.0, v = 0.0, tt = 0.0, tv = 0.0, left = 0.0;
  for (std::size_t i = 0; i < value.size(); ++i) {
    t += time_s[i] / n;
    v += value[i] / n;
  }
  for (std::size_t i = 0; i < value.size(); ++i) {
    tt += (time_s[i] - t) * (time_s[i] - t);
    tv += (time_s[i] - t) * (value[i] - v);
  }
  if (tt <= 0.0) return {};
  Growth out;
  out.slope = tv / tt;
  for (std::size_t i = 0; i < value.size(); ++i) {
    const double off = value[i] - v - out.slope * (time_s[i] - t);
    left += off * off;
  }
  out.error = std::sqrt(left / (n - 2.0) / tt);
  return out;
}

}  // namespace isorig::soak
