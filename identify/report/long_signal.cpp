#include "identify/report/long_signal.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace isorig::identify::report {

void LongSignal::Stretch::take(const Stretch& other) {
  low = std::min(low, other.low);
  high = std::max(high, other.high);
  sum += other.sum;
  readings += other.readings;
}

void LongSignal::add(double x, double low, double high, double mean, double readings) {
  if (!std::isfinite(x) || !std::isfinite(low) || !std::isfinite(high) || !std::isfinite(mean) || !(readings > 0.0))
    return;
  const Stretch one{low, high, mean * readings, readings};
  const auto index = static_cast<std::int64_t>(std::floor(x / width_));
  const auto [at, fresh] = stretches_.try_emplace(index, one);
  if (!fresh) return at->second.take(one);
  while (stretches_.size() > most_) halve();
}

void LongSignal::halve() {
  width_ *= 2.0;
  std::map<std::int64_t, Stretch> wider;
  for (const auto& [index, stretch] : stretches_) {
    const auto [at, fresh] = wider.try_emplace(index >> 1, stretch);  // rounds down, below zero too (C++20)
    if (!fresh) at->second.take(stretch);
  }
  stretches_ = std::move(wider);
}

std::vector<Series> LongSignal::series(const std::string& label, int color, double gap, double scale) const {
  Series line, band;
  line.label = band.label = label;
  line.color = band.color = color;
  line.width = 1.1;
  band.mark = Mark::kBand;
  const double open = std::max(gap, 3.0 * width_);
  constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
  double before = -std::numeric_limits<double>::infinity();
  bool wide = false;
  for (const auto& [index, stretch] : stretches_) {
    const double x = (static_cast<double>(index) + 0.5) * width_;
    const auto put = [&](double at, double low, double high, double mean) {
      band.x.push_back(at * scale);
      band.y.push_back(low);
      band.y2.push_back(high);
      line.x.push_back(at * scale);
      line.y.push_back(mean);
    };
    if (std::isfinite(before) && x - before > open) put(0.5 * (x + before), kNone, kNone, kNone);
    put(x, stretch.low, stretch.high, stretch.sum / stretch.readings);
    wide = wide || stretch.high > stretch.low;
    before = x;
  }
  if (!wide) return {std::move(line)};
  return {std::move(band), std::move(line)};
}

}  // namespace isorig::identify::report
