#pragma once
#include <stdint.h>

#include "messages/elvh.hpp"
#include "messages/teensy/wire.hpp"

namespace isorig::messages::teensy {

/// What the device knows of filling without its host: the last that stands between a host that is wrong and a burst
/// muscle. Integers only; freestanding.
///
/// - A reading above the greatest pressure, four conversions in a row, in whatever state: kPressureHigh.
/// - The fill valve's time, in full-duty time above an allowance that may flow for ever (leaks). Venting gives back
///   what it lets out: kFillTime.
/// - While filling, no conversion to believe for 100 ms (status, range, a line that is low or high): kSensorSilent. The
///   sensor is read while the valve is shut too, so an opening gives it no time of its own.
/// - While filling, one and the same count in fifty conversions or more, though the valve was open for 100 ms of full
///   duty since it came, which is a change of hundreds of counts: kSensorStuck. Added up over all openings, however
///   short, until the count changes or the vent has been fully open for a second.
///
/// A host that opens and shuts the valve quickly gets no more from it than one that leaves it open.
class FillGuard {
 public:
  static constexpr uint16_t kHighRun = 4;
  static constexpr uint32_t kSilent_us = 100'000;
  static constexpr uint32_t kStuck_us = 100'000;  ///< of full duty
  static constexpr uint16_t kStuckRun = 50;       ///< conversions
  /// Of full vent, after which what was filled before is out. A muscle that was never filled, as without air in the
  /// supply, is at the same count before and after; its next filling has to begin from nothing.
  static constexpr uint32_t kVented_us = 1'000'000;
  static constexpr uint16_t kMarginCounts = 262;  ///< beyond the sensor's range; as ElvhMonitor

  /// Whether limits are such as a host may set: the greatest pressure within the sensor's range.
  [[nodiscard]] static constexpr bool is_valid(const Limits& limits) noexcept {
    return limits.pressure_max_raw > kElvhOffsetCounts && limits.pressure_max_raw <= kElvhFullScaleCounts &&
           limits.fill_allowance_permille <= 500 && limits.fill_max_ms <= 60'000;
  }

  /// False, and nothing changed, for limits that are not valid.
  bool set_limits(const Limits& limits) noexcept {
    if (!is_valid(limits)) return false;
    limits_ = limits;
    has_limits_ = true;
    return true;
  }
  [[nodiscard]] bool has_limits() const noexcept { return has_limits_; }
  [[nodiscard]] const Limits& limits() const noexcept { return limits_; }

  /// The valves as they are driven from now on.
  void apply(uint16_t fill_permille, uint16_t vent_permille, uint64_t now_us) noexcept {
    advance(now_us);
    fill_permille_ = fill_permille;
    vent_permille_ = vent_permille;
  }

  /// `is_conversion`: not a mere report of what the line shows (firmware/elvh_reader.hpp).
  [[nodiscard]] VentCause sample(uint32_t raw_word, uint64_t now_us, bool is_conversion = true) noexcept {
    advance(now_us);
    if (!is_conversion) return VentCause::kNone;
    const ElvhWord word = unpack_elvh(raw_word);
    if (word.status != ElvhStatus::kCurrent || word.pressure_raw == kElvhMaxPressureRaw ||
        word.pressure_raw < kElvhOffsetCounts - kMarginCounts) {
      return VentCause::kNone;
    }
    if (word.pressure_raw != count_) {
      count_ = word.pressure_raw;
      open_since_change_ = 0;
      same_run_ = 0;
    } else if (same_run_ < kStuckRun) {
      ++same_run_;
    }
    if (word.pressure_raw <= kElvhFullScaleCounts + kMarginCounts) believed_us_ = now_us;
    if (!has_limits_) return VentCause::kNone;
    high_run_ = word.pressure_raw > limits_.pressure_max_raw ? static_cast<uint16_t>(high_run_ + 1) : uint16_t{0};
    if (high_run_ >= kHighRun) {
      high_run_ = kHighRun;
      return VentCause::kPressureHigh;
    }
    const bool is_stuck = same_run_ >= kStuckRun && open_since_change_ > uint64_t{kStuck_us} * kFull;
    return is_capped() && fill_permille_ > 0 && is_stuck ? VentCause::kSensorStuck : VentCause::kNone;
  }

  [[nodiscard]] VentCause tick(uint64_t now_us) noexcept {
    advance(now_us);
    if (fill_permille_ == 0) return VentCause::kNone;
    if (now_us > believed_us_ + kSilent_us) return VentCause::kSensorSilent;
    return is_capped() && used_ > uint64_t{limits_.fill_max_ms} * 1000U * kFull ? VentCause::kFillTime
                                                                                : VentCause::kNone;
  }

  /// Full-duty time that counts towards the cap now.
  [[nodiscard]] uint16_t fill_used_ms() const noexcept {
    const uint64_t ms = used_ / (1000U * kFull);
    return ms > UINT16_MAX ? uint16_t{UINT16_MAX} : static_cast<uint16_t>(ms);
  }

 private:
  static constexpr uint64_t kFull = 1000;

  [[nodiscard]] bool is_capped() const noexcept { return has_limits_ && limits_.fill_max_ms > 0; }
  void advance(uint64_t now_us) noexcept {
    const uint64_t passed_us = now_us > last_us_ ? now_us - last_us_ : 0;
    last_us_ = now_us;
    const uint64_t in = passed_us * fill_permille_;
    const uint64_t out = passed_us * (uint64_t{limits_.fill_allowance_permille} + vent_permille_);
    used_ += in;
    used_ = used_ > out ? used_ - out : 0;
    open_since_change_ += in;
    vented_us_ = vent_permille_ == kFull ? vented_us_ + passed_us : 0;
    if (vented_us_ >= kVented_us) open_since_change_ = 0;
  }

  Limits limits_;
  bool has_limits_ = false;
  uint16_t fill_permille_ = 0;
  uint16_t vent_permille_ = 0;
  uint64_t last_us_ = 0;
  uint64_t used_ = 0;               // permille x us
  uint64_t open_since_change_ = 0;  // permille x us
  uint64_t vented_us_ = 0;          // fully open for so long
  uint64_t believed_us_ = 0;
  uint16_t count_ = 0;
  uint16_t same_run_ = 0;
  uint16_t high_run_ = 0;
};

}  // namespace isorig::messages::teensy
