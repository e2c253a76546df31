#include "daemon/core/force_watch.hpp"

#include <algorithm>
#include <cmath>

namespace isorig::daemon {

/// The newest sample that is at least a window old, counted back from the present one, which is 1; 0: there is none.
std::size_t ForceWatch::find_window(std::int64_t mono_ns, bool in_order) noexcept {
  const auto is_old = [&](std::size_t back) {
    return mono_ns - history_[(count_ - back) % kHistory].mono_ns >= window_ns_;
  };
  const std::size_t reach = std::min(count_, kHistory);
  ordered_ = in_order ? std::min(ordered_ + 1, kHistory) : 1;
  // As long as stamps only grow, what was old for the sample before is old now, and the place moves on by a step or
  // two.
  if (back_ > 0 && back_ < reach && ordered_ >= back_ + 1) {
    std::size_t back = back_ + 1;
    while (back > 2 && is_old(back - 1)) --back;
    return back;
  }
  for (std::size_t back = 2; back <= reach; ++back) {
    if (is_old(back)) return back;
  }
  return 0;
}

ForceWatch::Finding ForceWatch::add(std::int64_t mono_ns, float raw_N, double force_N, bool moving) noexcept {
  Finding found;
  const bool in_order = count_ > 0 && mono_ns >= history_[(count_ - 1) % kHistory].mono_ns;
  history_[count_ % kHistory] = {mono_ns, force_N};
  ++count_;
  back_ = find_window(mono_ns, in_order);
  if (back_ > 0) {
    const auto& old = history_[(count_ - back_) % kHistory];
    found.window_s = static_cast<double>(mono_ns - old.mono_ns) * 1e-9;
    found.rate_N_s = std::abs(force_N - old.force_N) / found.window_s;
    found.before_N = old.force_N;
    found.has_window = true;
  }

  const bool same = raw_N == same_N_ && same_since_ns_ >= 0;
  if (!same) {
    if (same_since_ns_ >= 0) {
      // Learnt only when the run has ended: a cell that has died must not teach that it is quiet.
      constexpr double kFading = 0.9995;
      repeats_ = repeats_ * kFading + run_;
      changes_ = changes_ * kFading + 1.0;
    }
    same_N_ = raw_N;
    same_since_ns_ = still_since_ns_ = mono_ns;
    run_ = 0.0;
    frozen_ = false;
    return found;
  }
  run_ += 1.0;
  if (!moving) still_since_ns_ = mono_ns;
  const double same_s = static_cast<double>(mono_ns - same_since_ns_) * 1e-9;
  if (same_s <= frozen_max_s_) return found;
  // While the crosshead moves the force of any specimen does, and so does the cell's last digit.
  if (static_cast<double>(mono_ns - still_since_ns_) * 1e-9 > frozen_max_s_) frozen_ = true;
  // At rest the noise has to be known: a value that repeats with probability p stands for n more samples with p^n.
  if (changes_ >= kChangesKnown) {
    const double p = (repeats_ + 1.0) / (repeats_ + changes_ + 1.0);
    if (run_ * -std::log(p) > kChanceLog) frozen_ = true;
  }
  if (frozen_) found.frozen_s = same_s;
  return found;
}

}  // namespace isorig::daemon
