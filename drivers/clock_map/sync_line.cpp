#include "drivers/clock_map/sync_line.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>

namespace isorig::clock {
namespace {

constexpr std::size_t kMostWaiting = 256;
constexpr int kInvertedAfter = 3;

}  // namespace

SyncLine::SyncLine(const Options& options) : options_(options) {
  line_.reserve(kMostWaiting);
  device_.reserve(kMostWaiting);
}

void SyncLine::line_edge(std::int64_t mono_ns, bool rising) {
  if (line_.size() == kMostWaiting) line_.erase(line_.begin()), ++counts_.unannounced;
  line_.push_back({mono_ns, rising});
}

void SyncLine::device_edge(double device_us, bool rising, const MappedTime& mapped) {
  if (!(mapped.bound_ns < static_cast<double>(options_.window_ns))) {
    ++counts_.unmapped;
    return;
  }
  if (device_.size() == kMostWaiting) device_.erase(device_.begin()), ++counts_.ambiguous;
  device_.push_back({device_us, rising, mapped});
  if (!has_begun_) {
    const std::int64_t from_ns = mapped.mono_ns - options_.window_ns;
    std::erase_if(line_, [&](const LineEdge& edge) { return edge.mono_ns < from_ns; });
    has_begun_ = true;
  }
}

std::optional<SyncCheck> SyncLine::next(std::int64_t now_ns) {
  const std::int64_t due_ns = now_ns - options_.window_ns - options_.settle_ns;
  while (!device_.empty() && device_.front().mapped.mono_ns <= due_ns) {
    const DeviceEdge edge = device_.front();
    device_.erase(device_.begin());
    const auto check = decide(edge);
    decided_ = edge;
    if (check) return check;
  }
  // What no edge of the device, waiting or yet to be announced, can claim.
  std::int64_t before_ns = due_ns - options_.window_ns;
  if (!device_.empty()) before_ns = std::min(before_ns, device_.front().mapped.mono_ns - options_.window_ns);
  if (!line_.empty() && line_.front().mono_ns < before_ns) drop_unannounced(before_ns);
  return std::nullopt;
}

void SyncLine::drop_unannounced(std::int64_t before_ns) noexcept {
  const auto claimable =
      std::find_if(line_.begin(), line_.end(), [&](const LineEdge& e) { return e.mono_ns >= before_ns; });
  if (has_begun_) counts_.unannounced += static_cast<std::uint32_t>(claimable - line_.begin());
  line_.erase(line_.begin(), claimable);
}

bool SyncLine::is_crowded(const DeviceEdge& edge) const noexcept {
  const auto near = [&](const DeviceEdge& other) {
    return other.rising == edge.rising && std::abs(other.mapped.mono_ns - edge.mapped.mono_ns) < 2 * options_.window_ns;
  };
  return (decided_ && near(*decided_)) || std::any_of(device_.begin(), device_.end(), near);
}

std::optional<SyncCheck> SyncLine::decide(const DeviceEdge& edge) {
  const auto in_window = [&](const LineEdge& seen) {
    return std::abs(seen.mono_ns - edge.mapped.mono_ns) <= options_.window_ns;
  };
  const auto fits = [&](const LineEdge& seen) { return in_window(seen) && seen.rising == edge.rising; };
  const auto fitting = std::count_if(line_.begin(), line_.end(), fits);
  if (fitting > 1 || (fitting == 1 && is_crowded(edge))) {
    ++counts_.ambiguous;
    std::erase_if(line_, fits);
    return std::nullopt;
  }
  if (fitting == 1) {
    const auto at = std::find_if(line_.begin(), line_.end(), fits);
    const std::int64_t mono_ns = at->mono_ns;
    line_.erase(at);
    return pair(edge, mono_ns);
  }
  if (std::count_if(line_.begin(), line_.end(), in_window) == 1) {
    ++counts_.wrong_polarity;
    counts_.inverted = ++opposite_in_a_row_ >= kInvertedAfter;
    std::erase_if(line_, in_window);
  } else {
    ++counts_.unseen;
  }
  return std::nullopt;
}

SyncCheck SyncLine::pair(const DeviceEdge& edge, std::int64_t mono_ns) noexcept {
  opposite_in_a_row_ = 0;
  counts_.inverted = false;
  SyncCheck check{.mono_ns = mono_ns,
                  .device_us = edge.device_us,
                  .error_us = static_cast<double>(edge.mapped.mono_ns - mono_ns) * 1e-3,
                  .bound_us = edge.mapped.bound_ns * 1e-3,
                  .repeatability_us = edge.mapped.repeatability_ns * 1e-3,
                  .rising = edge.rising};
  check.within = std::abs(check.error_us) <= check.bound_us;
  const double n = ++counts_.pairs;
  if (!check.within) ++counts_.outside;
  counts_.mean_us += (check.error_us - counts_.mean_us) / n;
  counts_.rms_us = std::sqrt(counts_.rms_us * counts_.rms_us * (n - 1.0) / n + check.error_us * check.error_us / n);
  counts_.worst_us = std::max(counts_.worst_us, std::abs(check.error_us));
  return check;
}

void SyncLine::forget() noexcept {
  line_.clear();
  device_.clear();
  decided_.reset();
  has_begun_ = false;
}

}  // namespace isorig::clock
