#pragma once
#include <cstdint>
#include <deque>
#include <optional>
#include <vector>

#include "identify/diagnose/fit/fading.hpp"
#include "model/process.hpp"

namespace isorig::identify::twin {

/// One reading of the frame with what belongs to it.
struct Reading {
  std::int64_t mono_ns = 0;
  double position_mm = 0.0;
  double force_N = 0.0;
  std::uint32_t step = 0;
  bool judged = false;
};

/// Drives a model with readings as they come. What `predict` does to a whole recording (motion/reconstruction.hpp) is
/// done here to a window that moves on by kHop_s: its rows are given out once kAhead_s of readings lie beyond them,
/// since a corner of the motion is told from noise by what comes after it. So the twin is 0.15 to 0.35 s behind the
/// frame. Not taken over: averaging of a motion that changes its velocity all the time (band_limited_motion.hpp), which
/// needs the whole recording; and the droop of a gauge that is read seldom.
class LiveMotion {
 public:
  static constexpr double kHop_s = 0.2, kAhead_s = 0.15, kBehind_s = 0.4;

  explicit LiveMotion(const model::Reference& reference) : reference_(reference) {}

  struct Row {
    Reading reading;
    model::Instant instant;
  };
  /// Rows that are known now; often none. A stamp that is not after the last one is left out.
  [[nodiscard]] std::vector<Row> frame(const Reading& reading);
  void pressure(std::int64_t mono_ns, double psi);

  /// Of the readings so far.
  [[nodiscard]] ReadingNoise noise() const { return noise_; }
  [[nodiscard]] std::size_t bytes() const;

 private:
  struct Gauge {
    std::int64_t mono_ns;
    double psi;
  };
  [[nodiscard]] std::vector<Row> window();
  [[nodiscard]] std::vector<double> pressure_at(const std::vector<double>& t_s, const std::vector<double>& position_mm);
  [[nodiscard]] double seconds(std::int64_t mono_ns) const {
    return 1e-9 * static_cast<double>(mono_ns - origin_ns_.value_or(mono_ns));
  }

  model::Reference reference_;
  std::deque<Reading> readings_;
  std::deque<Gauge> gauge_;
  std::size_t given_ = 0;  // of readings_, from the front: given out already
  std::optional<std::int64_t> origin_ns_;
  ReadingNoise noise_;
  bool begun_ = false;
  double last_s_ = 0.0, last_mm_ = 0.0;
  // The path without reversals smaller than the reading's noise: it stands until the motion has turned by that much.
  double slid_mm_ = 0.0;
  int direction_ = 0;
};

}  // namespace isorig::identify::twin
