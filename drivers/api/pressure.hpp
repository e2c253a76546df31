#pragma once
#include <cstdint>
#include <optional>
#include <span>
#include <string>

#include "drivers/api/clock.hpp"
#include "drivers/api/error.hpp"

/// The pressure side: a sensor that streams and valves (or a regulator) that take commands.
/// Implementations: drivers/pressure/ (Teensy over serial), sim/pressure/ (virtual plant).
namespace isorig::pressure {

/// One conversion of the ELVH as the device sent it. Decoding is messages/elvh.hpp.
struct Sample {
  std::uint32_t sequence = 0;  ///< the device's own counter, wraps at 2^32
  std::int64_t device_us = 0;  ///< device clock at the conversion, extended over the 71.6 min wrap
  std::uint32_t raw_word = 0;  ///< the 32 bits from the sensor: status, pressure, temperature
};

/// What the daemon asks for, refreshed at 100 Hz or more. With valves: one of the two is zero.
struct Command {
  std::uint16_t fill_permille = 0;  ///< duty of the fill valve, 0..1000
  std::uint16_t vent_permille = 0;  ///< duty of the vent valve, 0..1000
  float regulator_psi = 0.0F;       ///< set-point when a regulator does the work; valves ignore it
};

struct Identity {
  std::string model, serial, firmware;
  std::uint16_t protocol_version = 0;
  double sample_rate_hz = 0.0;
};

/// What the device keeps to without its host: it vents, and stays so until it is asked to vent, on a reading above the
/// greatest pressure, on a fill valve that is open for longer than a filling takes, and on a sensor that says nothing
/// new while it fills.
struct FillLimits {
  double pressure_max_psi = 0.0;              ///< as the sensor reads, uncalibrated; 0: no limits were given
  std::uint16_t fill_allowance_permille = 0;  ///< duty of the fill valve that may flow for ever
  std::uint32_t fill_max_ms = 0;              ///< full-duty time above it; 0: no cap (the supply valve of a regulator)
};

/// Why the device vented by itself.
enum class VentCause : std::uint8_t { kNone, kHeartbeat, kPressureHigh, kFillTime, kSensorSilent, kSensorStuck };

struct State {
  bool vented_by_itself = false;       ///< as long as it is latched, and once if it was over before anybody looked
  VentCause cause = VentCause::kNone;  ///< of the last time
  std::uint32_t dropped = 0;           ///< samples the device discarded because the host stalled
  std::uint16_t fill_permille = 0;     ///< echoed
  std::uint16_t vent_permille = 0;
};

struct Poll {
  std::size_t samples = 0;    ///< how many of `samples_out` were filled
  std::size_t exchanges = 0;  ///< how many of `exchanges_out` were filled
  std::uint32_t lost = 0;     ///< gaps in the sequence since the last poll
  std::uint32_t corrupt = 0;  ///< frames that failed COBS, CRC or version
  State state;
};

/// The device changed its sync line at this time of its own clock.
struct SyncEdge {
  std::int64_t device_us = 0;
  bool rising = false;
};

/// Owned by one I/O thread; throws drivers::DeviceError. Not for the real-time loop.
class Device {
 public:
  virtual ~Device() = default;
  /// connect() gives them to the device and fails if that does not say the same; without limits a device does not fill.
  /// A device that is connected gets them at once, and the call fails alike.
  virtual void set_limits(const FillLimits& limits) = 0;
  virtual Identity connect() = 0;
  virtual void disconnect() noexcept = 0;
  /// True once after a device that was away has come back: connect() now, not at the end of a back-off.
  [[nodiscard]] virtual bool has_reappeared() noexcept { return false; }
  /// Takes what has arrived, waiting at most `timeout_ns` for the first byte.
  virtual Poll poll(std::span<Sample> samples_out, std::span<clock::Exchange> exchanges_out,
                    std::int64_t timeout_ns) = 0;
  virtual void command(const Command& command) = 0;
  /// Feeds the device's watchdog; without it the device vents by itself.
  virtual void heartbeat() = 0;
  /// Sends a time-sync request; the reply comes out of a later poll() as an Exchange.
  virtual void request_time_sync() = 0;
  /// The oldest edge of its sync line that poll() has brought and nobody has taken; nothing from a device without.
  virtual std::optional<SyncEdge> take_sync_edge() { return std::nullopt; }
};

}  // namespace isorig::pressure
