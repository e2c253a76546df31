#pragma once
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <optional>
#include <vector>

#include "base/rounding.hpp"
#include "drivers/api/clock.hpp"
#include "drivers/clock_map/envelope.hpp"
#include "drivers/clock_map/filter.hpp"
#include "drivers/clock_map/wander.hpp"

namespace isorig::clock {

struct MapOptions {
  Wander wander;
  double bound_sigmas = 5.0;          ///< wander that the bound allows for
  double rate_limit_ppm = 250.0;      ///< |device rate - 1|; a crystal is within 100, a ceramic resonator is not
  double window_s = 240.0;            ///< exchanges older than this are forgotten by the bound,
  std::size_t window_least = 32;      ///< unless fewer than this many remain
  double bin_s = 0.25;                ///< of several exchanges this close, the tightest of each side is kept
  double device_resolution_us = 1.0;  ///< how coarsely the device stamps
};

/// A sample's time on the host, with the two numbers that belong to it.
struct MappedTime {
  std::int64_t mono_ns = 0;
  /// The error is inside +-bound_ns, whatever the asymmetry of the path, and whatever of a clock that may have
  /// stepped cannot be excluded yet. kUnknown while there is no map.
  double bound_ns = kUnknown;
  /// One standard deviation of the error, but for the constant that asymmetry adds to all of them.
  double repeatability_ns = kUnknown;

  static constexpr double kUnknown = std::numeric_limits<double>::infinity();
};

/// All that mapping needs; plain numbers, so that it can be recorded.
struct MapSnapshot {
  std::int64_t host_reference_ns = 0;  ///< the host's time at device_reference_us
  double device_reference_us = 0.0;
  double rate_ppm = 0.0;                   ///< host time gained per device time: host = reference + (1 + rate) * device
  double bound_us = MappedTime::kUnknown;  ///< half-width at the reference,
  double bound_slope_ppm = 0.0;            ///< growing linearly with the distance from it
  double bound_wander_us_per_s15 = 0.0;    ///< and with its power 3/2
  double variance_us2 = 0.0;               ///< at the reference, and its growth with s, s^2 and |s|^3
  double variance_slope_us2_per_s = 0.0;
  double variance_curvature_ppm2 = 0.0;
  double variance_wander_us2_per_s3 = 0.0;
  std::uint64_t epoch = 0;      ///< counts restarts of the device's clock; 0 is none yet
  std::uint64_t exchanges = 0;  ///< accepted in this epoch
  std::uint64_t in_doubt = 0;   ///< 1: the last exchange contradicts; the bound covers both possibilities

  [[nodiscard]] bool known() const noexcept { return bound_us < MappedTime::kUnknown; }
  /// Here, since it is asked once for every sample.
  [[nodiscard]] MappedTime map(double device_us) const noexcept {
    const double ahead_us = device_us - device_reference_us;
    const double s = ahead_us * 1e-6;
    const double variance = variance_us2 + s * (variance_slope_us2_per_s + s * variance_curvature_ppm2) +
                            variance_wander_us2_per_s3 * std::abs(s) * s * s;
    return {host_reference_ns + base::rounded(ahead_us * 1e3 + s * rate_ppm * 1e3), bound_ns(device_us),
            1e3 * std::sqrt(std::max(variance, 0.0))};
  }
  /// Half-width of the bound at a device time; grows honestly when exchanges stop coming.
  [[nodiscard]] double bound_ns(double device_us) const noexcept {
    const double s = std::abs(device_us - device_reference_us) * 1e-6;
    return 1e3 * (bound_us + bound_slope_ppm * s + bound_wander_us_per_s15 * s * std::sqrt(s));
  }
};

enum class ExchangeVerdict {
  kAccepted,
  kRejected,   ///< impossible by itself: answered before it was sent, not finite, turned round slower than it
               ///< took
  kHeld,       ///< contradicts the map: the bound covers both until the next exchange tells which is wrong
  kRestarted,  ///< a second one contradicts the map and agrees with the held one: the map begins anew (device
               ///< restarted, its clock was set, or beyond Wander); so do kMostHeld that agree with nothing
};

/// Maps one device's clock to CLOCK_MONOTONIC, online. For one thread, the I/O thread that owns the device: it add()s
/// exchanges (some 50 us each, without an allocation) and dates the samples that came with them (StreamMapper).
///
/// Estimate and standard deviation come from DelayFilter, the bound from envelope(). Probe in a burst (50
/// exchanges) before the first motion, then once a second.
class DeviceClockMap {
 public:
  explicit DeviceClockMap(const MapOptions& options = {});

  ExchangeVerdict add(const Exchange& exchange);
  /// False when the map, within its bound, cannot have made this exchange: cheap, for those that are not kept. True
  /// without a map.
  [[nodiscard]] bool agrees(const Exchange& exchange) const noexcept;
  [[nodiscard]] bool in_doubt() const noexcept { return current_.in_doubt != 0; }
  /// The device said that it started anew: forget everything, begin another epoch.
  void restart();

  [[nodiscard]] const MapSnapshot& current() const noexcept { return current_; }
  [[nodiscard]] std::uint64_t rejected() const noexcept { return rejected_; }

  /// Changes whenever current() does; for readers that cache.
  [[nodiscard]] std::uint64_t version() const noexcept { return version_; }

 private:
  void begin(const Exchange& first);
  bool take(const Exchange& exchange);
  void hold(const Exchange& exchange);
  [[nodiscard]] bool agree(const Exchange& first, const Exchange& second);
  [[nodiscard]] Interval absolute(const Exchange& exchange) const noexcept;
  void remember(const Interval& interval);

  static constexpr int kMostHeld = 5;

  MapOptions options_;
  std::int64_t host_origin_ns_ = 0;
  double device_origin_us_ = 0.0;
  DelayFilter filter_;
  std::size_t most_remembered_;
  std::vector<Interval> window_;    // absolute: seconds and us from the origins
  std::vector<Interval> relative_;  // the same and one more, from that one
  EnvelopeRoom room_;
  std::optional<Exchange> held_;
  int held_in_a_row_ = 0;
  double settled_bound_us_ = MappedTime::kUnknown;  // of current_, without the doubt
  MapSnapshot current_;
  std::uint64_t rejected_ = 0;
  std::uint64_t version_ = 0;
};

/// One stream's stamps, in the thread of its map (an I/O thread). noexcept, no allocation, no lock.
///
/// Monotone: increasing device times get increasing host times, also across a new snapshot. What the new
/// snapshot says differently is not stepped but run off: the difference decays with a time constant of 20 ms,
/// at most half of the time that passes, so mapped time always goes on at 0.5 to 1.5 times the device's
/// pace. The remaining difference is added to the bound and the deviation of each stamp. When the
/// device restarts, the first stamp comes after the last one of the old epoch. A device time not later than
/// the newest so far is mapped in its place before that one, and changes nothing.
///
/// A clock that steps between two exchanges leaves the map behind. What shows it at once: a stamp in the future of its
/// arrival, one that runs back by more than a second, and, where the device counts its samples (set_period_us, a
/// sequence), a stamp that is not as many periods after the last as the count says. From there on the stamps are *on
/// their own*, until an exchange from after the step has been accepted: not before the last one that was mapped, not
/// after their arrival, and as far apart as the device says. The bound is the range they allow.
class StreamMapper {
 public:
  explicit StreamMapper(const DeviceClockMap& map) noexcept : map_(&map) {}

  static constexpr std::int64_t kNoArrival = std::numeric_limits<std::int64_t>::max();
  [[nodiscard]] MappedTime map(double device_us, std::int64_t arrival_ns = kNoArrival) noexcept {
    return map(device_us, arrival_ns, 0, false);
  }
  /// Of a sample whose place in the device's count is known.
  [[nodiscard]] MappedTime map(double device_us, std::int64_t arrival_ns, std::uint32_t sequence) noexcept {
    return map(device_us, arrival_ns, sequence, period_us_ > 0.0);
  }
  /// The device's sampling period; 0: it does not count its samples.
  void set_period_us(double period_us) noexcept { period_us_ = period_us; }
  /// Of the snapshot in use; changes when the device's clock restarted.
  [[nodiscard]] std::uint64_t epoch() const noexcept { return snapshot_.epoch; }
  /// A step is suspected: another exchange would tell.
  [[nodiscard]] bool on_its_own() const noexcept { return alone_; }

 private:
  MappedTime map(double device_us, std::int64_t arrival_ns, std::uint32_t sequence, bool counted) noexcept;
  [[nodiscard]] bool has_stepped(double device_us, std::int64_t advance) noexcept;
  MappedTime map_alone(double device_us, std::int64_t arrival_ns, double counted_us, bool jumped) noexcept;
  void renew() noexcept;

  const DeviceClockMap* map_;
  MapSnapshot snapshot_;
  std::uint64_t version_ = 0;
  double last_device_us_ = 0.0;
  std::int64_t last_mono_ns_ = std::numeric_limits<std::int64_t>::min() + 1;
  double last_bound_ns_ = MappedTime::kUnknown;
  double lead_ns_ = 0.0;  // what was given out last minus what the snapshot says
  bool started_ = false;

  double period_us_ = 0.0;
  std::uint32_t last_sequence_ = 0;
  double jitter_us_ = 0.0;  // mean departure from whole periods
  int steady_ = 0;          // how many it was learnt from
  double allowed_us_ = 0.0;

  bool alone_ = false;
  double low_ns_ = 0.0, high_ns_ = 0.0;  // where the newest stamp on its own lies, from last_mono_ns_
  std::int64_t alone_since_ns_ = 0;
};

}  // namespace isorig::clock
