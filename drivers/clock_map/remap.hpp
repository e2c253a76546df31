#pragma once
#include <cstdint>
#include <span>
#include <vector>

#include "drivers/api/clock.hpp"
#include "drivers/clock_map/mapping.hpp"

namespace isorig::clock {

struct DeviceStamp {
  double device_us = 0.0;
  /// Roughly when, in host time (its arrival, or the online map's answer). Tells the epochs of a device that
  /// restarted apart, and is used for nothing else.
  std::int64_t near_ns = 0;
};

/// Maps recorded stamps again with all exchanges, those after a stamp as well as those before it. Estimate
/// and deviation are those of two DelayFilters, one run forwards and one backwards in time up to the stamp,
/// combined by their information (two-filter smoother, Fraser & Potter 1969); the bound is the envelope of a
/// window centred on the stamp. Exchanges are those that were recorded, in the order of their replies;
/// impossible and contradicting ones are dropped as online. Result in the order of `stamps`; within an epoch
/// later device times get later host times. Stamps without any exchange come back with an unknown bound.
[[nodiscard]] std::vector<MappedTime> remap_offline(std::span<const Exchange> exchanges,
                                                    std::span<const DeviceStamp> stamps,
                                                    const MapOptions& options = {});

/// The same for stamps between which the device's clock went on: all are mapped by the one epoch that most of their
/// `near_ns` agree with.
[[nodiscard]] std::vector<MappedTime> remap_offline_stretch(std::span<const Exchange> exchanges,
                                                            std::span<const DeviceStamp> stamps,
                                                            const MapOptions& options = {});

}  // namespace isorig::clock
