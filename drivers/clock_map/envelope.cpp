#include "drivers/clock_map/envelope.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

namespace isorig::clock {
namespace {

using Point = EnvelopeRoom::Point;

/// Leaves the lower hull (monotone chain, Andrew 1979): the points that are least in y - r x for some r.
void keep_lower_hull(std::vector<Point>& points) {
  const auto before = [](const Point& a, const Point& b) { return a.x < b.x || (a.x == b.x && a.y < b.y); };
  if (!std::is_sorted(points.begin(), points.end(), before)) std::sort(points.begin(), points.end(), before);
  std::size_t kept = 0;  // in place: no more are kept than were looked at
  for (const auto p : points) {
    while (kept >= 2) {
      const auto& a = points[kept - 2];
      const auto& b = points[kept - 1];
      if ((b.x - a.x) * (p.y - a.y) - (b.y - a.y) * (p.x - a.x) > 0.0) break;
      --kept;
    }
    points[kept++] = p;
  }
  points.resize(kept);
}

class Hulls {
 public:
  Hulls(std::span<const Interval> exchanges, const Wander& wander, double sigmas, EnvelopeRoom& room)
      : high_(room.high), negated_low_(room.low) {
    high_.clear();
    negated_low_.clear();
    for (const auto& e : exchanges) {
      const double strays_us = sigmas * wander.departure_us(e.high_seconds);
      high_.push_back({e.high_seconds, e.high_us + strays_us});
      // A device that stamps once has both ends at one time, and the exponential in it is most of the work here.
      negated_low_.push_back(
          {e.low_seconds,
           (e.low_seconds == e.high_seconds ? strays_us : sigmas * wander.departure_us(e.low_seconds)) - e.low_us});
    }
    keep_lower_hull(high_);
    keep_lower_hull(negated_low_);
  }

  double upper(double rate) const {
    double least = std::numeric_limits<double>::infinity();
    for (const auto& p : high_) least = std::min(least, p.y - rate * p.x);
    return least;
  }
  double lower(double rate) const {
    double least = std::numeric_limits<double>::infinity();
    for (const auto& p : negated_low_) least = std::min(least, p.y + rate * p.x);
    return -least;
  }

 private:
  std::vector<Point>& high_;
  std::vector<Point>& negated_low_;
};

/// The greatest value of a concave function on [a, b] and where it is (golden section; flat tops are fine).
struct Greatest {
  double at;
  double value;
};
template <typename F>
Greatest greatest(double a, double b, const F& f) {
  constexpr double kGolden = 0.6180339887498949;
  double c = b - kGolden * (b - a), d = a + kGolden * (b - a);
  double fc = f(c), fd = f(d);
  for (int i = 0; i < 60 && b - a > 1e-8; ++i) {
    if (fc < fd) {
      a = c;
      c = d;
      fc = fd;
      d = a + kGolden * (b - a);
      fd = f(d);
    } else {
      b = d;
      d = c;
      fd = fc;
      c = b - kGolden * (b - a);
      fc = f(c);
    }
  }
  Greatest best{c, fc};
  for (const double x : {a, d, b}) {
    if (const double y = f(x); y > best.value) best = {x, y};
  }
  return best;
}

/// The end of {f >= 0} between `inside` and `outside`, never short of it.
template <typename F>
double edge(double inside, double outside, const F& f) {
  if (f(outside) >= 0.0) return outside;
  for (int i = 0; i < 60 && std::abs(outside - inside) > 1e-7; ++i) {
    const double middle = 0.5 * (inside + outside);
    (f(middle) >= 0.0 ? inside : outside) = middle;
  }
  return outside;
}

}  // namespace

Envelope envelope(std::span<const Interval> exchanges, const Wander& wander, double sigmas, double rate_limit_ppm) {
  EnvelopeRoom room(exchanges.size());
  return envelope(exchanges, wander, sigmas, rate_limit_ppm, room);
}

Envelope envelope(std::span<const Interval> exchanges, const Wander& wander, double sigmas, double rate_limit_ppm,
                  EnvelopeRoom& room) {
  Envelope out;
  if (exchanges.empty()) return out;
  const Hulls hulls(exchanges, wander, sigmas, room);
  const auto gap = [&](double rate) { return hulls.upper(rate) - hulls.lower(rate); };
  const auto safest = greatest(-rate_limit_ppm, rate_limit_ppm, gap);
  out.consistent = safest.value >= 0.0;
  if (!out.consistent) return out;
  out.rate_low_ppm = edge(safest.at, -rate_limit_ppm, gap);
  out.rate_high_ppm = edge(safest.at, rate_limit_ppm, gap);
  // 1 ns covers what is left of the searches.
  out.high_us = greatest(out.rate_low_ppm, out.rate_high_ppm, [&](double r) { return hulls.upper(r); }).value + 1e-3;
  out.low_us = -greatest(out.rate_low_ppm, out.rate_high_ppm, [&](double r) { return -hulls.lower(r); }).value - 1e-3;
  return out;
}

}  // namespace isorig::clock
