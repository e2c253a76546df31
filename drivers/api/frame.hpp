#pragma once
#include <cstdint>
#include <span>
#include <string>

#include "drivers/api/clock.hpp"
#include "drivers/api/error.hpp"

/// A materials-testing frame that executes motion segments by itself and counts its own samples.
/// Implementations: drivers/frame/ (Modbus gateway), sim/frame/ (virtual plant).
/// Position: crosshead, mm, extension positive, as the frame counts it (its own zero). Force: N, tension positive.
namespace isorig::frame {

/// One sample as the frame took it.
struct Sample {
  std::uint32_t sequence = 0;  ///< the frame's own sample counter, wraps at 2^32
  std::int64_t device_us = 0;  ///< the frame's own clock, extended to 64 bit
  float position_mm = 0.0F;    ///< raw: before our calibration
  float force_N = 0.0F;        ///< raw: before our calibration
  /// How far from `device_us` the values may have been taken. 0: the frame stamps its samples itself.
  float bound_us = 0.0F;
};

enum class Motion : std::uint8_t { kIdle, kMoving, kReached, kStopped, kLimit, kFault, kDisabled };

/// What the frame says of itself.
struct State {
  Motion motion = Motion::kIdle;
  std::uint16_t segment_id = 0;  ///< the segment it executes or executed last
  float target_mm = 0.0F;        ///< read back: the daemon checks it against what it sent
  float velocity_mm_s = 0.0F;    ///< read back, > 0
  std::uint16_t fault_bits = 0;  ///< FaultBit, 0 when well
  std::uint16_t heartbeat_echo = 0;
};

enum FaultBit : std::uint16_t {
  kHeartbeatLost = 1U << 0,
  kTravelLimit = 1U << 1,
  kForceLimit = 1U << 2,
  kInterlockOpen = 1U << 3,
  kDriveFault = 1U << 4,
  kSampleBufferOverrun = 1U << 5,
};

/// A motion the frame executes itself: from where it is to `target_mm` at `velocity_mm_s`.
struct Segment {
  std::uint16_t id = 0;  ///< chosen by the daemon, echoed in State
  float target_mm = 0.0F;
  float velocity_mm_s = 0.0F;  ///< magnitude, > 0
};

struct Identity {
  std::string maker, model, serial, firmware;
  double sample_rate_hz = 0.0;
  /// The same number as at the last connect(): shown to be the same frame, whose position still counts from the same
  /// zero. Another number: it was switched off, restarted or exchanged meanwhile, or nothing proves that it was not.
  /// Never 0 from a connected device. Counts in this process alone: the first connection proves nothing.
  std::uint32_t reference_epoch = 0;
};

/// One poll: the samples since the last one, the frame's state, and the time exchange that came with it.
struct Poll {
  std::size_t samples = 0;  ///< how many of `out` were filled
  std::uint32_t lost = 0;   ///< samples the frame overwrote before we came, from its counter
  State state;
  bool has_exchange = false;
  clock::Exchange exchange;
};

/// Blocking; owned by one I/O thread; throws drivers::DeviceError. Not for the real-time loop.
class Device {
 public:
  virtual ~Device() = default;
  /// Connects and reads who is there. Throws kIdentity when it is not the configured device.
  virtual Identity connect() = 0;
  virtual void disconnect() noexcept = 0;
  /// Reads all samples taken since the last call (at most out.size(); the rest stays for the next call).
  virtual Poll poll(std::span<Sample> out) = 0;
  /// Starts a segment. A segment that runs is replaced. Throws kRefused when the frame will not.
  virtual void start_segment(const Segment& segment) = 0;
  /// Decelerates and holds position. Idempotent.
  virtual void stop() = 0;
  /// Writes the heartbeat register; the frame stops by itself when it does not change for its time-out.
  virtual void heartbeat(std::uint16_t counter) = 0;
};

}  // namespace isorig::frame
