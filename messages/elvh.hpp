#pragma once
#include <stdint.h>

/// All Sensors ELVH-030G-HAND-C-PSA4: the 32-bit word it sends, what it means, and whether to believe it.
///
/// Source: All Sensors DS-0376 Rev G (transfer function p. 6 and 9-10, data format and status p. 11).
///   word     D31:30 status, D29:16 pressure, D15:5 temperature, D4:0 undefined filler; sent MSB first
///   pressure P = (raw - 1638) / 13108 * 30 psi gauge       (option A: 10-90 % of 2^14; 1 count = 2.2887
///   mpsi) temp.    T = raw * 200 / 2047 - 50 degrees Celsius     (11 bit; about 0.1 degrees per count)
/// Error: +-0.25 % of span best-fit straight line, +-1 % total error band over 0..50 C (+-0.3 psi).
///
/// Traps, each met in public drivers for this family:
///  - The transfer-function letter is the `A` of `PSA4`. The one public library for the family reads the
///  wrong
///    letter and falls back to 0..2^14, which shows 3.0 psi at rest and 27 psi at 30. At rest `raw` is 1638.
///  - 1638/14746 here as in Linux hsc030pa; some code has 13107/14745 (0.008 % off). Not ratiometric.
///  - `P` in `PSA4` means parylene with diagnostics OFF: a broken bridge need not raise status 11. Hence
///  ElvhMonitor.
///  - A read faster than the conversion (0.46 ms typical) gives status 10 and the *previous* value again, not
///    garbage: it must not be counted as a new sample, and the status must not be thrown away.
///  - A floating or shorted MISO reads as 0x00000000 (status "current"!) or 0xFFFFFFFF.
///  - D4:0 are not zero: mask them. A 2-byte read leaves D15:0 to the firmware; zeros there decode to -50 C.
///
/// Freestanding (the firmware compiles this file): no heap, no exceptions, no standard library.
namespace isorig::messages {

inline constexpr int32_t kElvhOffsetCounts = 1638;
inline constexpr int32_t kElvhSpanCounts = 13108;
inline constexpr int32_t kElvhFullScaleCounts = kElvhOffsetCounts + kElvhSpanCounts;  // 14746
inline constexpr double kElvhSpanPsi = 30.0;
inline constexpr double kElvhPsiPerCount = kElvhSpanPsi / kElvhSpanCounts;
inline constexpr uint16_t kElvhMaxPressureRaw = 0x3FFF;
inline constexpr uint16_t kElvhMaxTemperatureRaw = 0x07FF;

enum class ElvhStatus : uint8_t {
  kCurrent = 0b00,
  kReserved = 0b01,  ///< "command mode" in Honeywell's HSC; never seen from a healthy ELVH
  kStale = 0b10,     ///< not updated since the last read
  kFault = 0b11,     ///< electrical fault or invalid configuration
};

struct ElvhWord {
  ElvhStatus status = ElvhStatus::kCurrent;
  uint16_t pressure_raw = 0;     ///< 14 bit
  uint16_t temperature_raw = 0;  ///< 11 bit
};

[[nodiscard]] constexpr ElvhWord unpack_elvh(uint32_t raw_word) noexcept {
  return {static_cast<ElvhStatus>(raw_word >> 30U), static_cast<uint16_t>((raw_word >> 16U) & 0x3FFFU),
          static_cast<uint16_t>((raw_word >> 5U) & 0x07FFU)};
}

/// Filler bits are zero. Fields wider than their bits are cut.
[[nodiscard]] constexpr uint32_t pack_elvh(ElvhWord word) noexcept {
  return (static_cast<uint32_t>(word.status) & 0x3U) << 30U | (word.pressure_raw & 0x3FFFU) << 16U |
         (word.temperature_raw & 0x07FFU) << 5U;
}

/// Also outside 10-90 %: 0 counts is -3.749 psi, 16383 counts is 33.747 psi.
[[nodiscard]] constexpr double elvh_pressure_psi(uint16_t pressure_raw) noexcept {
  return static_cast<double>(pressure_raw - kElvhOffsetCounts) * kElvhSpanPsi / kElvhSpanCounts;
}

[[nodiscard]] constexpr double elvh_temperature_c(uint16_t temperature_raw) noexcept {
  return static_cast<double>(temperature_raw) * 200.0 / 2047.0 - 50.0;
}

/// What the sensor would send: nearest count, saturated at the ends of the field. For simulators.
[[nodiscard]] uint32_t encode_elvh(double pressure_psi, double temperature_c,
                                   ElvhStatus status = ElvhStatus::kCurrent) noexcept;

/// Bits of ElvhReading::issues.
enum ElvhIssue : uint16_t {
  kElvhReservedStatus = 1U << 0U,
  kElvhFaultStatus = 1U << 1U,
  kElvhBusLow = 1U << 2U,   ///< pressure field all zeros: MISO shorted, sensor unpowered
  kElvhBusHigh = 1U << 3U,  ///< pressure field all ones: MISO open
  kElvhBelowRange = 1U << 4U,
  kElvhAboveRange = 1U << 5U,
  kElvhStuck = 1U << 6U,     ///< fresh conversions, but the same count for too long
  kElvhStaleRun = 1U << 7U,  ///< no fresh conversion for too long
  kElvhTooFast = 1U << 8U,   ///< changed faster than the pneumatics can
  kElvhTemperature = 1U << 9U,
};

struct ElvhReading {
  ElvhWord word;
  double pressure_psi = 0.0;
  double temperature_c = 0.0;
  uint16_t issues = 0;  ///< ElvhIssue bits
  bool fresh = false;   ///< status 00: a new conversion

  /// Nothing speaks against the value. A single stale word is no issue: it is the last value once more.
  [[nodiscard]] constexpr bool plausible() const noexcept { return issues == 0; }
};

/// Plausibility of a stream of words, since the part does not diagnose itself. One per sensor and one thread;
/// noexcept, no allocation: usable in the real-time loop.
class ElvhMonitor {
 public:
  struct Options {
    /// Beyond 10-90 % by more than this is implausible. 262 counts = 2 % of span = 0.6 psi: twice the total
    /// error band, so a healthy sensor at rest or at 30 psi never trips it.
    uint16_t margin_counts = 262;
    /// At rest: fresh conversions with the same count before "stuck"; 0 turns it off. Noise is not in the
    /// datasheet; 5000 (2.3 s of an ELVH, 5 s of a simulated one at 1 kHz) presume only that a live 14-bit
    /// bridge moves by one count in that time.
    uint32_t stuck_run = 5000;
    /// While a valve changes the pressure: the same count is "stuck" once the pressure must have changed by this
    /// much (109 counts) since it came. At the slowest change that update() is told of, 0.5 psi/s, half a second.
    double stuck_change_psi = 0.25;
    /// Consecutive stale words before "stale run". At 1 kHz none is expected (conversion 0.46 ms), at 4 kHz
    /// one or two between conversions.
    uint32_t stale_run = 10;
    /// Fastest credible change. Sonic flow from 30 psi through a 1.5 mm valve fills 50 ml at about 300 psi/s; below
    /// 5 ml of dead volume the option has to be raised. A loose connector is faster by far.
    double max_rate_psi_s = 2000.0;
    /// Allowed on top at any interval: noise and quantisation.
    double rate_allowance_psi = 0.1;
    double min_temperature_c = -40.0;  ///< DS-0376: operating -40..85 C
    double max_temperature_c = 85.0;

    [[nodiscard]] bool valid() const noexcept;
  };

  ElvhMonitor() noexcept = default;
  explicit ElvhMonitor(const Options& options) noexcept : options_(options) {}

  /// Takes the next word of the stream with its device time (64 bit, i.e. wrap already removed). The rate is
  /// judged between fresh words only; after a gap longer than `kMaxRateGap_us` it is not judged.
  /// `sure_rate_psi_s` is what the valves change the pressure by at least, up or down; 0 when nobody knows.
  ElvhReading update(uint32_t raw_word, int64_t device_us, double sure_rate_psi_s = 0.0) noexcept;

  /// Forgets the history, as after a reconnect.
  void reset() noexcept;

  static constexpr int64_t kMaxRateGap_us = 1'000'000;

 private:
  Options options_{};
  bool has_last_ = false;
  uint16_t last_pressure_raw_ = 0;
  int64_t last_us_ = 0;
  uint32_t same_run_ = 0;
  double expected_change_psi_ = 0.0;  // since the count last changed
  uint32_t stale_run_ = 0;
};

}  // namespace isorig::messages
