#pragma once
#include <cstdint>
#include <mutex>

#include "sim/random.hpp"

namespace isorig::sim {

/// What the physics did in one step; linear in between. Shared by the devices, which sample it on clocks of
/// their own.
struct StepView {
  std::int64_t begin_ns = 0;
  std::int64_t length_ns = 0;
  double position_begin_mm = 0.0, position_end_mm = 0.0;
  double force_begin_N = 0.0, force_end_N = 0.0;
  double pressure_begin_psi = 0.0, pressure_end_psi = 0.0;
};

/// How a simulated device enters the rig: brings it up to now, and keeps other threads out when there are
/// any.
class Host {
 public:
  struct Visit {
    std::unique_lock<std::mutex> lock;  ///< holds nothing when the rig has one thread
    std::int64_t now_ns = 0;
  };
  virtual Visit enter() = 0;

 protected:
  ~Host() = default;
};

/// Stream numbers of the noise sources: each gets random numbers of its own from the one seed.
enum class Stream : std::uint64_t {
  kFrameClock = 1,
  kFrameForce,
  kFramePosition,
  kFrameRequest,
  kFrameReply,
  kSensorClock,
  kSensorNoise,
  kSensorRequest,
  kSensorReply,
};

[[nodiscard]] inline Random random_of(std::uint64_t seed, Stream stream) noexcept {
  return Random(seed, static_cast<std::uint64_t>(stream));
}

}  // namespace isorig::sim
