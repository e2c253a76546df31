#pragma once
#include <cstdint>

/// What the sync line says of a device's clock mapping: plain numbers, to publish and record.
namespace isorig::clock {

/// One edge of the sync line, seen from both sides: what the clock mapping says of it against what the kernel saw.
struct SyncCheck {
  std::int64_t mono_ns = 0;  ///< the kernel's stamp
  double device_us = 0.0;
  double error_us = 0.0;  ///< mapped device time minus the kernel's stamp, which comes its interrupt's latency late
  double bound_us = 0.0;  ///< what the mapping claimed its error to be within,
  double repeatability_us = 0.0;  ///< and its standard deviation, but for the constant of the path's asymmetry
  bool rising = false;
  bool within = false;  ///< |error| <= bound
};

/// Since construction.
struct SyncCounts {
  std::uint32_t pairs = 0;
  std::uint32_t outside = 0;         ///< pairs whose error was beyond the bound
  std::uint32_t unseen = 0;          ///< announced by the device, and the line did not change
  std::uint32_t unannounced = 0;     ///< seen on the line, and the device said nothing
  std::uint32_t ambiguous = 0;       ///< several edges too close together to tell which is which
  std::uint32_t unmapped = 0;        ///< the mapping could not say where to look yet
  std::uint32_t wrong_polarity = 0;  ///< the line went the other way
  double mean_us = 0.0;              ///< of the pairs' errors: half the asymmetry of the path, mostly
  double rms_us = 0.0;               ///< about zero
  double worst_us = 0.0;             ///< largest |error|
  bool inverted = false;             ///< the line goes the other way each time: wired or configured upside down

  [[nodiscard]] bool operator==(const SyncCounts&) const noexcept = default;
};

}  // namespace isorig::clock
