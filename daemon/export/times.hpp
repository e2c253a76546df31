#pragma once
#include <cstdint>
#include <span>
#include <vector>

#include "drivers/api/clock.hpp"

/// The times of an export's rows: mapped again from the recorded exchanges where that is better than what the daemon
/// stamped when the samples came.
namespace isorig::daemon {

/// A sample, or an averaged interval by its middle.
struct TimedRow {
  std::int64_t mono_ns = 0;
  double bound_ns = 0.0;          ///< of mono_ns; infinite where it is not known
  double repeatability_ns = 0.0;  ///< likewise
  double device_us = 0.0;
  double sequence = 0.0;
  double device_span_us = 0.0;  ///< of an interval: last minus first
  double sequence_span = 0.0;
};

struct Remapped {
  double moved_rms_us = 0.0;     ///< over all rows
  std::size_t kept = 0;          ///< rows that keep their online stamp since the mapping is not better
  std::size_t clock_breaks = 0;  ///< the device's clock began anew or stepped between two rows
};

/// Rows in the order of their time. A stretch in which the device's clock and its counter go on together is mapped as a
/// whole, and only if the result agrees with the recorded stamps within both bounds and its bounds are at most twice as
/// wide. A row that is mapped gets time, bound and deviation of the mapping; one that is not keeps all three.
Remapped remap_rows(std::vector<TimedRow*>& rows, std::span<const clock::Exchange> exchanges);

}  // namespace isorig::daemon
