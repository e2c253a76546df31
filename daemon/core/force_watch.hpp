#pragma once
#include <array>
#include <cstddef>
#include <cstdint>

namespace isorig::daemon {

/// What a load cell's readings say of the cell and of the specimen: how fast the force changes, whether it has died,
/// and whether the specimen broke.
class ForceWatch {
 public:
  ForceWatch(double window_s, double frozen_max_s) noexcept
      : window_ns_(static_cast<std::int64_t>(window_s * 1e9)), frozen_max_s_(frozen_max_s) {}

  struct Finding {
    double rate_N_s = 0.0;  ///< magnitude, over the window; 0 while there is not enough
    double before_N = 0.0;  ///< the force at the window's begin
    double window_s = 0.0;  ///< so long: more than was asked for behind a gap in the samples
    bool has_window = false;
    double frozen_s = 0.0;  ///< > 0: the reading has not changed for so long, and it should have
  };
  /// `raw_N` as the frame sent it, `force_N` calibrated; `moving`: the crosshead is.
  Finding add(std::int64_t mono_ns, float raw_N, double force_N, bool moving) noexcept;
  /// After a gap or another calibration: the window starts afresh. What is known of the cell's noise stays.
  void restart() noexcept {
    count_ = back_ = 0;
    same_since_ns_ = -1;
    run_ = 0;
  }
  /// The reading stands still although the cell's noise, as it was before, does not allow that.
  [[nodiscard]] bool is_frozen() const noexcept { return frozen_; }

 private:
  static constexpr std::size_t kHistory = 64;
  /// Changes that have to be seen before the cell's noise counts as known.
  static constexpr double kChangesKnown = 100.0;
  /// By chance a reading stands still for longer once in so many samples: 1e12 are 30 years at 1 kHz.
  static constexpr double kChanceLog = 27.6;

  struct Sample {
    std::int64_t mono_ns = 0;
    double force_N = 0.0;
  };
  [[nodiscard]] std::size_t find_window(std::int64_t mono_ns, bool in_order) noexcept;

  std::int64_t window_ns_;
  double frozen_max_s_;
  std::array<Sample, kHistory> history_{};
  std::size_t count_ = 0;
  std::size_t back_ = 0;     ///< what find_window() said of the last sample
  std::size_t ordered_ = 0;  ///< so many of the newest samples have stamps that do not decrease
  float same_N_ = 0.0F;
  std::int64_t same_since_ns_ = -1;
  std::int64_t still_since_ns_ = -1;      ///< likewise, while the crosshead moves
  double run_ = 0.0;                      ///< repeats of the present value
  double repeats_ = 0.0, changes_ = 0.0;  ///< with fading memory
  bool frozen_ = false;
};

}  // namespace isorig::daemon
