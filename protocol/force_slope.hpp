#pragma once
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>

namespace isorig::protocol {

/// Least-squares slope of a sampled signal over a sliding window, O(1) per sample, fixed storage.
///
/// Samples are averaged in N equal bins of the window (at least 0.1 s each, so that a frame polled at 20 Hz
/// fills every bin); the slope is that of the straight line through the last N bin means y_0..y_{N-1}:
///     slope = 12 / (dt N (N^2 - 1)) * sum_k (k - (N-1)/2) y_k
/// with sum y and sum k*y carried along as the window slides. For white noise of sigma per sample and n
/// samples in the window T the slope's standard deviation is sigma * sqrt(12 / n) / T: 0.03 N at 1 kHz over
/// 10 s gives 1e-4 N/s. The estimate is that of the middle of the window: it lags by T/2. A bin without any
/// sample empties the window: missing data never looks like a settled force.
class ForceSlope {
 public:
  static constexpr std::size_t kMaxBins = 128;
  static constexpr double kMinBin_s = 0.1;
  static constexpr double kMinWindow_s = 1.0;

  void reset(std::int64_t now_ns, double window_s) noexcept {
    bins_ = std::clamp(static_cast<std::size_t>(window_s / kMinBin_s), std::size_t{8}, kMaxBins);
    bin_s_ = window_s / static_cast<double>(bins_);
    bin_ns_ = static_cast<std::int64_t>(bin_s_ * 1e9);
    restart(now_ns);
  }

  /// Forgets all samples, keeps the window.
  void restart(std::int64_t now_ns) noexcept {
    bin_end_ns_ = now_ns + bin_ns_;
    filled_ = next_ = samples_ = 0;
    sum_ = sum_y_ = sum_ky_ = 0.0;
  }

  /// True when a bin was completed, so that slope() is new.
  bool add(std::int64_t now_ns, double force_N) noexcept {
    bool completed = false;
    if (now_ns >= bin_end_ns_) {
      if (samples_ == 0 || now_ns - bin_end_ns_ >= bin_ns_) {  // a bin passed without a sample
        restart(now_ns);
      } else {
        push(sum_ / static_cast<double>(samples_));
        bin_end_ns_ += bin_ns_;
        completed = true;
      }
      sum_ = 0.0;
      samples_ = 0;
    }
    sum_ += force_N;
    ++samples_;
    return completed;
  }

  [[nodiscard]] bool full() const noexcept { return filled_ == bins_; }
  /// N/s; meaningful when full().
  [[nodiscard]] double slope_N_s() const noexcept {
    const double n = static_cast<double>(bins_);
    return 12.0 * (sum_ky_ - 0.5 * (n - 1.0) * sum_y_) / (bin_s_ * n * (n * n - 1.0));
  }

 private:
  void push(double y) noexcept {
    // Values relative to the first keep the sums small: forces of 100 N and slopes of 1e-3 N/s share them.
    if (filled_ == 0) origin_ = y;
    y -= origin_;
    if (filled_ < bins_) {
      sum_ky_ += static_cast<double>(filled_) * y;
      sum_y_ += y;
      ring_[next_] = y;
      ++filled_;
    } else {
      const double oldest = ring_[next_];
      sum_ky_ += oldest - sum_y_ + static_cast<double>(bins_ - 1) * y;
      sum_y_ += y - oldest;
      ring_[next_] = y;
    }
    next_ = next_ + 1 == bins_ ? 0 : next_ + 1;
  }

  std::array<double, kMaxBins> ring_{};
  std::size_t bins_ = 8, filled_ = 0, next_ = 0, samples_ = 0;
  double bin_s_ = 0.0, sum_ = 0.0, sum_y_ = 0.0, sum_ky_ = 0.0, origin_ = 0.0;
  std::int64_t bin_ns_ = 0, bin_end_ns_ = 0;
};

}  // namespace isorig::protocol
