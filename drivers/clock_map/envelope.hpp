#pragma once
#include <cstddef>
#include <span>
#include <vector>

#include "drivers/clock_map/wander.hpp"

namespace isorig::clock {

/// What one exchange proves, relative to the instant in question (seconds = 0) and as host minus device time:
/// at device time `low_seconds` the request had been sent, so the difference was at least `low_us`; at
/// `high_seconds` the reply had not come, so it was at most `high_us`.
struct Interval {
  double low_seconds = 0.0;
  double low_us = 0.0;
  double high_seconds = 0.0;
  double high_us = 0.0;
};

/// Every clock that the exchanges allow, at seconds = 0.
struct Envelope {
  double low_us = 0.0;  ///< host minus device time is not outside [low_us, high_us]
  double high_us = 0.0;
  double rate_low_ppm = 0.0;  ///< nor its slope outside these
  double rate_high_ppm = 0.0;
  bool consistent = false;  ///< false: no clock within the assumptions fits (a step, a restart, a wrong stamp)
};

/// Room for the hulls below, so that one who asks often allocates once.
struct EnvelopeRoom {
  struct Point {
    double x;
    double y;
  };
  EnvelopeRoom() = default;
  explicit EnvelopeRoom(std::size_t exchanges) { high.reserve(exchanges), low.reserve(exchanges); }
  std::vector<Point> high, low;
};

/// Bound from causality alone: nothing is assumed of the delays, so it holds however asymmetric they are.
///
/// Law. For a rate r the difference at 0 is confined to [l(r), u(r)], l(r) = max(low_i - r s_i), u(r) =
/// min(high_i - r s'_i): support functions of two convex hulls, the upper hull of the requests and the lower
/// hull of the replies (Moon, Skelly & Towsley, INFOCOM 1999; Zhang, Liu & Xia, INFOCOM 2002). The result is
/// the range of l and u over all r in +-rate_limit_ppm with l(r) <= u(r). A line is not a wandering clock, so
/// every point is first moved outwards by `sigmas` standard deviations of the wander between it and 0.
/// Without noise in the delays the half-width is half the round trip; with it, more.
[[nodiscard]] Envelope envelope(std::span<const Interval> exchanges, const Wander& wander, double sigmas,
                                double rate_limit_ppm);
/// The same, without an allocation for as many exchanges as `room` is for.
[[nodiscard]] Envelope envelope(std::span<const Interval> exchanges, const Wander& wander, double sigmas,
                                double rate_limit_ppm, EnvelopeRoom& room);

}  // namespace isorig::clock
