#pragma once
#include <array>
#include <cstddef>
#include <cstdint>

namespace isorig::daemon {

/// Whether a crosshead stands, judged by its own samples: the slope of the newest ones against what their noise can
/// explain. The noise is taken from second differences, in which a constant speed does not show. A frame that says
/// "stopped" and moves is seen, and so is one that says nothing.
class Standstill {
 public:
  /// Samples over which a slope is taken: the shortest that tells standing from moving is enough.
  static constexpr std::array<double, 3> kWindows_s{0.06, 0.12, 0.2};
  static constexpr double kSlowest_mm_s = 0.02;  ///< slower than this is standing
  static constexpr double kSpeedShare = 0.005;   ///< ... or than this share of the speed that was left
  static constexpr double kNoiseSigmas = 4.0;
  static constexpr std::size_t kLeastSamples = 4;
  /// A slow line has not so many in the longest window: they may be as old as this then. An 8800 at 30 ms an answer
  /// gives one every 0.14 s.
  static constexpr double kLongest_s = 1.0;

  /// From the first sample that counts to the one that tells, where samples come this often: while their noise is small
  /// enough for the shortest window that holds enough of them. Infinite: never.
  [[nodiscard]] static double tells_after_s(double spacing_s) noexcept;

  /// Forgets everything: only samples from now on count. `speed_mm_s`: what it moves at, as far as is known.
  void restart(double speed_mm_s) noexcept;
  void add(std::int64_t mono_ns, double position_mm) noexcept;

  /// Below what noise explains; false while there are too few samples to say. Once it stands, twice the bound is
  /// needed to make it move again, so that noise does not.
  [[nodiscard]] bool stands() noexcept;
  /// Of the last stands(), over the window that decided.
  [[nodiscard]] double velocity_mm_s() const noexcept { return velocity_mm_s_; }
  [[nodiscard]] double bound_mm_s() const noexcept { return bound_mm_s_; }
  /// Mean position of the newest window; meaningful when there was a stands().
  [[nodiscard]] double position_mm() const noexcept { return mean_mm_; }

 private:
  struct Point {
    std::int64_t mono_ns = 0;
    double position_mm = 0.0;
  };
  static constexpr std::size_t kCapacity = 512;

  [[nodiscard]] const Point& back(std::size_t i) const noexcept { return points_[(count_ - 1 - i) % kCapacity]; }
  /// True when the window is full; sets velocity, bound, mean and whether it swings. `stretches`: as far as it takes
  /// to have kLeastSamples, up to kLongest_s.
  bool fit(double window_s, bool stretches) noexcept;

  std::array<Point, kCapacity> points_{};
  std::size_t count_ = 0;
  double floor_mm_s_ = kSlowest_mm_s;
  double velocity_mm_s_ = 0.0;
  double bound_mm_s_ = 0.0;
  double mean_mm_ = 0.0;
  bool stood_ = false;
  bool swings_ = false;
};

}  // namespace isorig::daemon
