#pragma once
#include <algorithm>
#include <cstdint>

#include "daemon/core/records.hpp"

namespace isorig::daemon {

struct MinMaxSum {
  double sum = 0.0;
  double min = 0.0;
  double max = 0.0;
  void begin(double x) noexcept { sum = min = max = x; }
  void add(double x) noexcept {
    sum += x;
    min = std::min(min, x);
    max = std::max(max, x);
  }
};

/// What an interval's samples have in common, whatever the stream.
struct IntervalCore {
  std::int64_t first_mono_ns = 0;
  std::int64_t last_mono_ns = 0;
  std::int64_t first_device_us = 0;
  std::int64_t last_device_us = 0;
  std::uint32_t first_sequence = 0;
  std::uint32_t last_sequence = 0;
  std::uint32_t step = 0;
  std::int32_t samples = 0;
  float bound_ns = 0.0F;          // the largest
  float repeatability_ns = 0.0F;  // the largest

  template <typename Record>
  void begin(const Record& r) noexcept {
    first_mono_ns = last_mono_ns = r.mono_ns;
    first_device_us = last_device_us = r.device_us;
    first_sequence = last_sequence = r.sequence;
    step = r.step;
    samples = 1;
    bound_ns = r.bound_ns;
    repeatability_ns = r.repeatability_ns;
  }
  template <typename Record>
  void add(const Record& r) noexcept {
    last_mono_ns = r.mono_ns;
    last_device_us = r.device_us;
    last_sequence = r.sequence;
    ++samples;
    bound_ns = std::max(bound_ns, r.bound_ns);
    repeatability_ns = std::max(repeatability_ns, r.repeatability_ns);
  }
};

struct FrameAverage {
  IntervalCore core;
  double raw_position_sum = 0.0;
  double raw_force_sum = 0.0;
  MinMaxSum position_mm;
  MinMaxSum force_N;

  void begin(const FrameRecord& r) noexcept {
    core.begin(r);
    raw_position_sum = static_cast<double>(r.raw_position_mm);
    raw_force_sum = static_cast<double>(r.raw_force_N);
    position_mm.begin(r.position_mm);
    force_N.begin(r.force_N);
  }
  void add(const FrameRecord& r) noexcept {
    core.add(r);
    raw_position_sum += static_cast<double>(r.raw_position_mm);
    raw_force_sum += static_cast<double>(r.raw_force_N);
    position_mm.add(r.position_mm);
    force_N.add(r.force_N);
  }
};

/// Mean and extremes are of the sensor's current conversions alone: a stale or faulty word is no measurement.
struct PressureAverage {
  IntervalCore core;
  double raw_counts_sum = 0.0;
  double temperature_sum = 0.0;
  MinMaxSum pressure_psi;
  std::int32_t current = 0;

  /// The 14-bit bridge value stands below the two status bits of the sensor's 32-bit word.
  static double counts(const PressureRecord& r) noexcept { return static_cast<double>((r.raw_word >> 16U) & 0x3fffU); }
  void begin(const PressureRecord& r) noexcept {
    core.begin(r);
    raw_counts_sum = temperature_sum = 0.0;
    current = 0;
    take(r);
  }
  void add(const PressureRecord& r) noexcept {
    core.add(r);
    take(r);
  }

 private:
  void take(const PressureRecord& r) noexcept {
    if (r.status != 0) return;
    if (current++ == 0) {
      pressure_psi.begin(r.pressure_psi);
    } else {
      pressure_psi.add(r.pressure_psi);
    }
    raw_counts_sum += counts(r);
    temperature_sum += static_cast<double>(r.temperature_C);
  }
};

}  // namespace isorig::daemon
