#pragma once
#include <stdint.h>

#include "messages/elvh.hpp"

namespace isorig::firmware {

/// An ELVH on the other end of the SPI bus, and the muscle it measures, for the emulated board and the tests.
/// Integers only. Time is whatever the caller passes, in nanoseconds, and never goes back.
class SimulatedElvh {
 public:
  enum class Fault : uint8_t {
    kNone,
    kAbsent,        ///< MISO pulled up: all ones
    kShorted,       ///< MISO low: all zeros, which says "current"
    kSilent,        ///< converts no more: stale for ever
    kStuckCurrent,  ///< never says stale
    kDiagnostic,    ///< status 11
    kStuckCount,    ///< one and the same count, status 00
  };

  static constexpr uint32_t kPeriod_ns = 460'000;  ///< response time, DS-0376 p. 4
  static constexpr uint16_t kRestRaw = messages::kElvhOffsetCounts;
  static constexpr uint16_t kSupplyRaw = 12'562;    ///< 25 psi
  static constexpr uint16_t kTemperatureRaw = 747;  ///< 23 degrees Celsius

  explicit SimulatedElvh(uint32_t period_ns = kPeriod_ns) noexcept : period_ns_(period_ns) {}

  void set_fault(Fault fault) noexcept {
    fault_ = fault;
    stuck_raw_ = pressure_raw();
  }
  /// A count up, a count down, as of a live bridge; off at the start, so that a word is what the pressure makes it.
  void set_noise(bool is_noisy) noexcept { is_noisy_ = is_noisy; }
  /// Duties of the air paths, not of the coils.
  void set_valves(uint64_t now_ns, uint16_t fill_permille, uint16_t vent_permille) noexcept {
    advance(now_ns);
    fill_permille_ = fill_permille;
    vent_permille_ = vent_permille;
  }

  /// SS falls: what is shifted out in this frame is settled now.
  void select(uint64_t now_ns) noexcept {
    advance(now_ns);
    const bool is_new = conversions_ != read_ || fault_ == Fault::kStuckCurrent;
    read_ = conversions_;
    messages::ElvhStatus status = is_new ? messages::ElvhStatus::kCurrent : messages::ElvhStatus::kStale;
    if (fault_ == Fault::kDiagnostic) status = messages::ElvhStatus::kFault;
    const auto raw = static_cast<uint16_t>(pressure_raw() + (is_noisy_ ? conversions_ & 1U : 0U));
    shift_ = messages::pack_elvh({status, fault_ == Fault::kStuckCount ? stuck_raw_ : raw, kTemperatureRaw}) | kFiller;
    if (fault_ == Fault::kAbsent) shift_ = 0xFFFFFFFFU;
    if (fault_ == Fault::kShorted) shift_ = 0;
  }
  uint16_t shift_word() noexcept {
    const auto word = static_cast<uint16_t>(shift_ >> 16U);
    shift_ <<= 16U;
    return word;
  }

  [[nodiscard]] uint16_t pressure_raw() const noexcept { return static_cast<uint16_t>(pressure_q16_ >> 16U); }
  /// When the conversion happened that the last read returned: what stamps are measured against.
  [[nodiscard]] uint64_t converted_ns() const noexcept { return converted_ns_; }
  [[nodiscard]] uint32_t conversions() const noexcept { return conversions_; }

 private:
  static constexpr uint32_t kFiller = 0x15;  ///< D4:0 are undefined, so not zero
  /// A conversion moves the pressure by this part of the way at full duty: a time constant of 59 ms.
  static constexpr int64_t kRelaxation = 128;

  void advance(uint64_t now_ns) noexcept {
    if (fault_ == Fault::kSilent) {
      next_ns_ = now_ns + period_ns_;
      return;
    }
    // After a very long pause only the last conversions matter.
    if (now_ns > next_ns_ + uint64_t{kMaxCatchUp} * period_ns_) {
      const uint64_t skipped = (now_ns - next_ns_) / period_ns_ - kMaxCatchUp;
      next_ns_ += skipped * period_ns_;
      conversions_ += static_cast<uint32_t>(skipped);
    }
    for (; next_ns_ <= now_ns; next_ns_ += period_ns_) {
      converted_ns_ = next_ns_;
      ++conversions_;
      const int64_t to_supply = (int64_t{kSupplyRaw} << 16) - pressure_q16_;
      const int64_t to_rest = (int64_t{kRestRaw} << 16) - pressure_q16_;
      pressure_q16_ += (to_supply * fill_permille_ + to_rest * vent_permille_) / (kRelaxation * 1000);
    }
  }

  static constexpr uint32_t kMaxCatchUp = 4096;

  uint32_t period_ns_;
  Fault fault_ = Fault::kNone;
  uint16_t stuck_raw_ = 0;
  bool is_noisy_ = false;
  uint16_t fill_permille_ = 0;
  uint16_t vent_permille_ = 1000;
  int64_t pressure_q16_ = int64_t{kRestRaw} << 16;
  uint64_t next_ns_ = 3'000'000;  // start-up time, p. 4
  uint64_t converted_ns_ = 0;
  uint32_t conversions_ = 0;
  uint32_t read_ = 0;
  uint32_t shift_ = 0;
};

}  // namespace isorig::firmware
