#include "messages/elvh.hpp"

namespace isorig::messages {
namespace {

// Nearest integer in [0, max]; NaN gives 0 (a comparison with NaN is false).
uint16_t saturate(double value, uint16_t max) noexcept {
  if (!(value > 0.0)) return 0;
  if (value >= max) return max;
  // The firmware is built without <cmath>. Adding a half errs only next to 0.5 and from 2^52 on; half a count is no
  // matter.
  return static_cast<uint16_t>(value + 0.5);  // NOLINT(bugprone-incorrect-roundings)
}

}  // namespace

uint32_t encode_elvh(double pressure_psi, double temperature_c, ElvhStatus status) noexcept {
  const double pressure = pressure_psi / kElvhPsiPerCount + kElvhOffsetCounts;
  const double temperature = (temperature_c + 50.0) * 2047.0 / 200.0;
  return pack_elvh({status, saturate(pressure, kElvhMaxPressureRaw), saturate(temperature, kElvhMaxTemperatureRaw)});
}

bool ElvhMonitor::Options::valid() const noexcept {
  return margin_counts <= kElvhOffsetCounts && stale_run > 0 && stuck_change_psi > 0.0 && max_rate_psi_s > 0.0 &&
         rate_allowance_psi >= 0.0 && min_temperature_c < max_temperature_c;
}

ElvhReading ElvhMonitor::update(uint32_t raw_word, int64_t device_us, double sure_rate_psi_s) noexcept {
  ElvhReading reading;
  reading.word = unpack_elvh(raw_word);
  reading.pressure_psi = elvh_pressure_psi(reading.word.pressure_raw);
  reading.temperature_c = elvh_temperature_c(reading.word.temperature_raw);
  reading.fresh = reading.word.status == ElvhStatus::kCurrent;

  const uint16_t raw = reading.word.pressure_raw;
  uint16_t issues = 0;
  const auto flag = [&issues](bool is_set, ElvhIssue issue) {
    if (is_set) issues = static_cast<uint16_t>(issues | issue);
  };

  flag(reading.word.status == ElvhStatus::kReserved, kElvhReservedStatus);
  flag(reading.word.status == ElvhStatus::kFault, kElvhFaultStatus);
  flag(raw == 0, kElvhBusLow);
  flag(raw == kElvhMaxPressureRaw, kElvhBusHigh);
  flag(raw < kElvhOffsetCounts - options_.margin_counts, kElvhBelowRange);
  flag(raw > kElvhFullScaleCounts + options_.margin_counts, kElvhAboveRange);
  flag(reading.temperature_c < options_.min_temperature_c || reading.temperature_c > options_.max_temperature_c,
       kElvhTemperature);

  if (reading.fresh) {
    stale_run_ = 0;
    if (has_last_) {
      const int64_t gap_us = device_us - last_us_;
      if (raw != last_pressure_raw_ || sure_rate_psi_s == 0.0) {
        expected_change_psi_ = 0.0;
      } else if (gap_us > 0 && gap_us <= kMaxRateGap_us) {
        expected_change_psi_ += sure_rate_psi_s * 1e-6 * static_cast<double>(gap_us);
      }
      same_run_ = raw == last_pressure_raw_ ? same_run_ + 1 : 0;
      if (gap_us > 0 && gap_us <= kMaxRateGap_us) {
        const double step_psi = static_cast<double>(raw - last_pressure_raw_) * kElvhPsiPerCount;
        const double allowed_psi =
            options_.rate_allowance_psi + options_.max_rate_psi_s * 1e-6 * static_cast<double>(gap_us);
        flag(step_psi > allowed_psi || -step_psi > allowed_psi, kElvhTooFast);
      }
    }
    // A run that never ends must not come round to 0 and look healthy.
    if (same_run_ == UINT32_MAX) --same_run_;
    has_last_ = true;
    last_pressure_raw_ = raw;
    last_us_ = device_us;
  } else if (stale_run_ < UINT32_MAX) {
    ++stale_run_;
  }
  flag(options_.stuck_run > 0 &&
           (same_run_ + 1 >= options_.stuck_run || expected_change_psi_ >= options_.stuck_change_psi),
       kElvhStuck);
  flag(stale_run_ >= options_.stale_run, kElvhStaleRun);

  reading.issues = issues;
  return reading;
}

void ElvhMonitor::reset() noexcept {
  has_last_ = false;
  same_run_ = 0;
  stale_run_ = 0;
  expected_change_psi_ = 0.0;
}

}  // namespace isorig::messages
