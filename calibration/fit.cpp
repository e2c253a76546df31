#include "calibration/fit.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <stdexcept>

#include "base/number_text.hpp"

namespace isorig::calibration {
namespace {

using base::number_text;

constexpr std::size_t kLevelsForSpan = 3;
constexpr double kSameLevel = 0.02;  // of the range that was covered

double square(double x) {
  return x * x;
}

/// Which level each point belongs to: references closer than 2 % of the covered range are one.
std::vector<std::size_t> levels_of(const std::vector<Point>& points) {
  std::vector<std::size_t> order(points.size());
  for (std::size_t i = 0; i < order.size(); ++i) order[i] = i;
  std::sort(order.begin(), order.end(),
            [&](std::size_t a, std::size_t b) { return points[a].reference < points[b].reference; });
  const double range = points[order.back()].reference - points[order.front()].reference;
  std::vector<std::size_t> level(points.size(), 0);
  for (std::size_t k = 1; k < order.size(); ++k) {
    const bool same = points[order[k]].reference - points[order[k - 1]].reference <= kSameLevel * range;
    level[order[k]] = level[order[k - 1]] + (same ? 0U : 1U);
  }
  return level;
}

/// Rising (+1) or falling (-1) way to each point; the first goes where the second comes from.
std::vector<int> directions_of(const std::vector<std::size_t>& level) {
  std::vector<int> way(level.size(), 1);
  for (std::size_t i = 1; i < level.size(); ++i) {
    way[i] = level[i] > level[i - 1] ? 1 : level[i] < level[i - 1] ? -1 : way[i - 1];
  }
  return way;
}

struct Line {
  double slope = 1.0, intercept = 0.0, scatter = 0.0;
};

Line fit_line(const std::vector<Point>& points) {
  const auto n = static_cast<double>(points.size());
  double mean_x = 0.0, mean_y = 0.0, xx = 0.0, xy = 0.0;
  for (const auto& p : points) {
    mean_x += p.raw / n;
    mean_y += p.reference / n;
  }
  for (const auto& p : points) {
    xx += square(p.raw - mean_x);
    xy += (p.raw - mean_x) * (p.reference - mean_y);
  }
  if (!(xx > 0.0))
    throw std::runtime_error("the reading did not change between the points; check that the sensor is connected");
  Line line;
  line.slope = xy / xx;
  line.intercept = mean_y - line.slope * mean_x;
  double sum = 0.0;
  for (const auto& p : points) sum += square(p.reference - line.slope * p.raw - line.intercept);
  line.scatter = points.size() > 2 ? std::sqrt(sum / (n - 2.0)) : 0.0;
  return line;
}

std::vector<double> errors_of(Channel channel, const std::vector<Point>& points, Correction c) {
  std::vector<double> errors;
  errors.reserve(points.size());
  for (const auto& p : points) errors.push_back(c.apply(p.raw) - p.reference);
  // A gauge block has a length and no place.
  if (channel == Channel::kPosition) {
    const double first = errors.front();
    for (auto& e : errors) e -= first;
  }
  return errors;
}

double largest(const std::vector<double>& errors) {
  double m = 0.0;
  for (const double e : errors) m = std::max(m, std::abs(e));
  return m;
}

std::optional<double> hysteresis_of(const std::vector<double>& errors, const std::vector<std::size_t>& level,
                                    const std::vector<int>& way) {
  struct Sums {
    double sum[2] = {0.0, 0.0};
    int count[2] = {0, 0};
  };
  std::map<std::size_t, Sums> at;
  for (std::size_t i = 0; i < errors.size(); ++i) {
    const int side = way[i] > 0 ? 0 : 1;
    at[level[i]].sum[side] += errors[i];
    ++at[level[i]].count[side];
  }
  std::optional<double> worst;
  for (const auto& [index, s] : at) {
    if (s.count[0] == 0 || s.count[1] == 0) continue;
    const double width = std::abs(s.sum[0] / s.count[0] - s.sum[1] / s.count[1]);
    worst = std::max(worst.value_or(0.0), width);
  }
  return worst;
}

ForceClass class_of(const std::vector<Point>& points, Correction c, const std::vector<std::size_t>& level,
                    const std::vector<int>& way, double quantum) {
  struct AtLevel {
    std::vector<double> up, down;
    double reference = 0.0;
    double resolution = 0.0;
    int count = 0;
  };
  std::map<std::size_t, AtLevel> at;
  double largest_N = 0.0;
  for (const auto& p : points) largest_N = std::max(largest_N, std::abs(p.reference));
  ForceClass f;
  for (std::size_t i = 0; i < points.size(); ++i) {
    const auto& p = points[i];
    const double error_N = c.apply(p.raw) - p.reference;
    if (std::abs(p.reference) < 0.01 * largest_N || largest_N == 0.0) {
      if (largest_N > 0.0)
        f.zero_percent = std::max(f.zero_percent.value_or(0.0), 100.0 * std::abs(error_N) / largest_N);
      continue;
    }
    auto& l = at[level[i]];
    const double percent = 100.0 * error_N / p.reference;
    (way[i] > 0 ? l.up : l.down).push_back(percent);
    l.resolution = std::max(
        {l.resolution, 100.0 * quantum / std::abs(p.reference), 200.0 * p.standard_error / std::abs(p.reference)});
  }
  const auto mean = [](const std::vector<double>& v) {
    double sum = 0.0;
    for (const double x : v) sum += x;
    return sum / static_cast<double>(v.size());
  };
  f.levels = static_cast<int>(at.size());
  f.series = at.empty() ? 0 : 1000;
  for (const auto& [index, l] : at) {
    const auto& rising = l.up.empty() ? l.down : l.up;
    f.series = std::min(f.series, static_cast<int>(rising.size()));
    f.error_percent = std::max(f.error_percent, std::abs(mean(rising)));
    f.resolution_percent = std::max(f.resolution_percent, l.resolution);
    if (rising.size() > 1) {
      const auto [low, high] = std::minmax_element(rising.begin(), rising.end());
      f.repeatability_percent = std::max(f.repeatability_percent.value_or(0.0), *high - *low);
    }
    if (!l.up.empty() && !l.down.empty()) {
      f.reversibility_percent = std::max(f.reversibility_percent.value_or(0.0), std::abs(mean(l.up) - mean(l.down)));
    }
  }
  struct Limits {
    const char* text;
    double error, repeatability, reversibility, zero, resolution;
  };
  static constexpr Limits kClasses[] = {{"0.5", 0.5, 0.5, 0.75, 0.05, 0.25},
                                        {"1", 1.0, 1.0, 1.5, 0.1, 0.5},
                                        {"2", 2.0, 2.0, 3.0, 0.2, 1.0},
                                        {"3", 3.0, 3.0, 4.5, 0.3, 1.5}};
  f.text = "none";
  if (at.empty()) return f;
  for (const auto& k : kClasses) {
    if (f.error_percent <= k.error && f.repeatability_percent.value_or(0.0) <= k.repeatability &&
        f.reversibility_percent.value_or(0.0) <= k.reversibility && f.zero_percent.value_or(0.0) <= k.zero &&
        f.resolution_percent <= k.resolution) {
      f.text = k.text;
      break;
    }
  }
  return f;
}

}  // namespace

const char* name_of(Channel channel) noexcept {
  switch (channel) {
    case Channel::kPressure:
      return "pressure";
    case Channel::kForce:
      return "force";
    case Channel::kPosition:
      return "position";
  }
  return "";
}

const char* unit_of(Channel channel) noexcept {
  switch (channel) {
    case Channel::kPressure:
      return "psi";
    case Channel::kForce:
      return "N";
    case Channel::kPosition:
      return "mm";
  }
  return "";
}

const char* name_of(Mode mode) noexcept {
  switch (mode) {
    case Mode::kAdjust:
      return "adjust";
    case Mode::kZero:
      return "zero";
    case Mode::kCheck:
      return "check";
  }
  return "";
}

std::optional<Channel> channel_of(std::string_view name) noexcept {
  for (const auto c : kChannels) {
    if (name == name_of(c)) return c;
  }
  return std::nullopt;
}

std::optional<Mode> mode_of(std::string_view name) noexcept {
  for (const auto m : {Mode::kAdjust, Mode::kZero, Mode::kCheck}) {
    if (name == name_of(m)) return m;
  }
  return std::nullopt;
}

ChannelFacts facts_of(Channel channel) noexcept {
  switch (channel) {
    // ELVH-030G, DS-0376: one count is 30 / 13108 psi; total error band 1 % of span = 0.3 psi over 0..50 C.
    case Channel::kPressure:
      return {30.0 / 13108.0, 0.3, 0.9, 0.05};
    // A load cell's zero moves with every grip that is hung on it; its span does not.
    case Channel::kForce:
      return {0.001, 0.0, 1e9, 0.2};
    case Channel::kPosition:
      return {0.0001, 0.0, 1e9, 0.05};
  }
  return {};
}

Result calibrate(Channel channel, Mode mode, const std::vector<Point>& points, Correction before,
                 double reference_uncertainty) {
  if (points.empty()) throw std::runtime_error("there is no point; give at least one reference value");
  for (const auto& p : points) {
    if (!std::isfinite(p.reference) || !std::isfinite(p.raw)) throw std::runtime_error("a point is not a number");
  }
  const auto level = levels_of(points);
  const auto way = directions_of(level);
  const std::size_t levels = *std::max_element(level.begin(), level.end()) + 1;
  const auto facts = facts_of(channel);
  const std::string unit = unit_of(channel);

  Result r;
  r.correction = before;
  if (mode == Mode::kAdjust) {
    const std::size_t wanted = channel == Channel::kPosition ? 2 : kLevelsForSpan;
    if (levels < wanted) {
      throw std::runtime_error("zero and span need points at " + std::to_string(wanted) +
                               " levels or more, and there are " + std::to_string(levels) +
                               "; add points, or calibrate the zero alone (--mode zero)");
    }
    const auto line = fit_line(points);
    r.correction = {line.slope, line.intercept};
    r.scatter = line.scatter;
    if (channel == Channel::kPosition) {
      r.correction.offset = line.slope * before.offset / before.scale;  // the same raw value stays the zero
    }
    if (std::abs(r.correction.scale - 1.0) > facts.scale_change_max) {
      throw std::runtime_error(
          "the fitted span is " + number_text(r.correction.scale, 4) + ", more than " +
          number_text(100.0 * facts.scale_change_max, 4) +
          " % from 1: that is a wrong unit, a wrong reference or a damaged sensor, not a calibration");
    }
  } else if (mode == Mode::kZero) {
    if (channel == Channel::kPosition) {
      throw std::runtime_error(
          "the zero of position belongs to the specimen (its unpressurized rest length): set it at the frame");
    }
    double sum = 0.0;
    for (const auto& p : points) sum += p.reference - before.scale * p.raw;
    r.correction.offset = sum / static_cast<double>(points.size());
  }
  r.as_found = errors_of(channel, points, before);
  r.as_left = errors_of(channel, points, r.correction);
  r.as_found_max = largest(r.as_found);
  r.as_left_max = largest(r.as_left);
  if (mode != Mode::kAdjust && points.size() > 1) {
    double mean = 0.0, sum = 0.0;
    for (const double e : r.as_left) mean += e / static_cast<double>(points.size());
    for (const double e : r.as_left) sum += square(e - mean);
    r.scatter = std::sqrt(sum / static_cast<double>(points.size() - 1));
  }
  if (r.as_found_max > facts.implausible) {
    throw std::runtime_error("the reading is " + number_text(r.as_found_max, 4) + " " + unit +
                             " from the reference, more than " + number_text(facts.implausible, 4) + " " + unit +
                             ": check that both see the same quantity, and the reference's unit");
  }
  r.hysteresis = hysteresis_of(r.as_left, level, way);
  r.found_in_band = facts.error_band == 0.0 || r.as_found_max <= facts.error_band;
  double error2 = 0.0, drift = 0.0;
  for (const auto& p : points) {
    error2 = std::max(error2, square(p.standard_error));
    drift = std::max(drift, std::abs(p.drift));
  }
  // Nothing was adjusted away: the error that was found is the user's.
  const double bias = mode == Mode::kCheck ? r.as_found_max : 0.0;
  r.uncertainty = 2.0 * std::sqrt(square(reference_uncertainty / 2.0) + square(r.scatter) +
                                  square(r.hysteresis.value_or(0.0)) / 12.0 + square(facts.quantum) / 12.0 + error2 +
                                  square(drift) / 12.0) +
                  bias;
  if (channel == Channel::kForce) {
    r.class_found = class_of(points, before, level, way, facts.quantum);
    r.class_left = class_of(points, r.correction, level, way, facts.quantum);
  }
  return r;
}

}  // namespace isorig::calibration
