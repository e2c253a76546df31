#pragma once
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "drivers/api/error.hpp"

/// GPIO lines as the driver needs them, over libgpiod 1.6 (gpio_port_v1.cpp) or 2.x (gpio_port_v2.cpp), whichever
/// the distribution has. Levels and edges are logical: active_low is taken care of below this interface.
namespace isorig::interlock {

enum class Bias : std::uint8_t { kAsIs, kDisabled, kPullUp, kPullDown };

struct GpioLine {
  std::string line;  ///< its name; a whole number is its offset
  bool active_low = false;
  Bias bias = Bias::kAsIs;
};

struct GpioRequest {
  std::string chip;      ///< its label: the number in /dev/gpiochipN changes when it is plugged in again
  std::string consumer;  ///< what others see as the holder of the lines
  std::vector<GpioLine> inputs;
  std::optional<GpioLine> output;  ///< requested inactive
};

struct GpioEdge {
  std::size_t input = 0;
  bool active = false;        ///< the level that the kernel saw after the edge
  std::int64_t stamp_ns = 0;  ///< the kernel's, on the clock that StampClock finds out
};

struct GpioEdges {
  std::size_t count = 0;
  /// Edges that the kernel threw away because its queue (16 for each line) was full. libgpiod 2 numbers them; with 1.6
  /// this counts the times that a full queue was found, since more may have been lost.
  std::uint32_t lost = 0;
};

/// Lines that are held; the destructor gives them back. Owned by one I/O thread. Everything throws
/// drivers::DeviceError: kDisconnected when the chip is gone.
class GpioPort {
 public:
  virtual ~GpioPort() = default;
  /// True when an edge is waiting, or something to complain about.
  virtual bool wait(std::int64_t timeout_ns) = 0;
  /// What has come, oldest first per input; never waits.
  virtual GpioEdges read_edges(std::span<GpioEdge> out) = 0;
  virtual bool level(std::size_t input) = 0;
  virtual void set_output(bool active) = 0;
};

using GpioOpener = std::function<std::unique_ptr<GpioPort>(const GpioRequest&)>;

/// Throws drivers::DeviceError: kDisconnected without such a chip, kIdentity when several have the label or the
/// line is not there, kRefused when a line is held by someone else, naming who.
[[nodiscard]] std::unique_ptr<GpioPort> open_gpio_port(const GpioRequest& request);

/// What one read takes at most, per input: the length of the kernel's queue.
inline constexpr std::size_t kGpioQueue = 16;

}  // namespace isorig::interlock
