#include "identify/twin/cusum.hpp"

#include <algorithm>
#include <cmath>

namespace isorig::identify::twin {

double run_length(double k, double h, double shift) {
  const double b = h + 1.166, drift = shift - k;
  if (std::fabs(drift) < 1e-9) return b * b;
  return (std::exp(-2.0 * drift * b) + 2.0 * drift * b - 1.0) / (2.0 * drift * drift);
}

double run_length(double k, double h) {
  return run_length(k, h, 0.0);
}

CusumDesign cusum_design(double phi, double shift, double false_alarm_blocks) {
  CusumDesign design;
  design.phi = phi;
  design.k = 0.5 * shift * std::sqrt((1.0 - phi) / (1.0 + phi));
  // run_length grows with h: by halves, to a thousandth.
  double low = 0.0, high = 1.0;
  while (run_length(design.k, high) < 2.0 * false_alarm_blocks) high *= 2.0;
  while (high - low > 1e-3 * high) {
    const double middle = 0.5 * (low + high);
    (run_length(design.k, middle) < 2.0 * false_alarm_blocks ? low : high) = middle;
  }
  design.h = high;
  return design;
}

bool Cusum::add(double z) {
  const double e = before_ ? (z - design_.phi * *before_) / std::sqrt(1.0 - design_.phi * design_.phi) : z;
  before_ = z;
  innovation_ = e;
  high_ = std::max(0.0, high_ + e - design_.k);
  low_ = std::max(0.0, low_ - e - design_.k);
  since_high_ = high_ > 0.0 ? since_high_ + 1 : 0;
  since_low_ = low_ > 0.0 ? since_low_ + 1 : 0;
  return std::max(high_, low_) > design_.h;
}

void Correlation::add(double z) {
  if (before_) products_ += z * *before_;
  squares_ += z * z;
  before_ = z;
  ++blocks_;
}

double Correlation::phi() const {
  const double least = std::exp(-kBlock_s / kShortest_s), most = std::exp(-kBlock_s / kLongest_s);
  return squares_ > 0.0 ? std::clamp(products_ / squares_, least, most) : most;
}

}  // namespace isorig::identify::twin
