#pragma once
#include <cstdint>
#include <vector>

#include "base/spsc_queue.hpp"
#include "daemon/core/records.hpp"

namespace isorig::daemon {

/// What the loop hands over for readings at rest: a queue of each stream, of its own beside recorder and publisher.
struct LiveStreams {
  base::SpscQueue<FrameRecord> frame{8192};
  base::SpscQueue<PressureRecord> pressure{8192};
};

/// One channel over a window. Raw: as the device sent it, in the channel's unit.
struct Reading {
  std::size_t samples = 0;
  double raw = 0.0;             ///< mean
  double calibrated = 0.0;      ///< mean
  double sd = 0.0;              ///< of one raw sample
  double standard_error = 0.0;  ///< of the mean, from ten parts of the window: noise need not be white
  double min = 0.0, max = 0.0;  ///< raw
  double drift = 0.0;           ///< of the raw value over the window, from a straight line
  std::size_t longest_run = 0;  ///< equal raw values in a row
  std::int64_t from_ns = 0, to_ns = 0;
  double worst_gap_s = 0.0;  ///< between two samples
  double bound_ns = 0.0;     ///< the largest of a stamp
};

/// The last seconds of both streams, for averaged readings. One thread; not for the loop.
class LiveWindow {
 public:
  static constexpr double kLongest_s = 10.0;

  void drain(LiveStreams& streams);
  [[nodiscard]] Reading position(double window_s) const { return over(position_, window_s); }
  [[nodiscard]] Reading force(double window_s) const { return over(force_, window_s); }
  [[nodiscard]] Reading pressure(double window_s) const { return over(pressure_, window_s); }
  [[nodiscard]] Reading temperature(double window_s) const { return over(temperature_, window_s); }
  [[nodiscard]] std::uint64_t lost() const noexcept { return lost_; }

 private:
  struct Entry {
    std::int64_t mono_ns = 0;
    double raw = 0.0;
    double calibrated = 0.0;
    float bound_ns = 0.0F;
  };
  /// The newest `kSize`; older ones are overwritten.
  struct Ring {
    static constexpr std::size_t kSize = 1U << 15U;
    std::vector<Entry> entries;
    std::size_t count = 0;
    void add(const Entry& e) {
      if (entries.empty()) entries.resize(kSize);
      entries[count++ % kSize] = e;
    }
  };
  [[nodiscard]] static Reading over(const Ring& ring, double window_s);

  Ring position_, force_, pressure_, temperature_;
  std::uint64_t lost_ = 0;
};

}  // namespace isorig::daemon
