#pragma once
#include <algorithm>
#include <cstdint>

#include "daemon/core/seconds.hpp"

namespace isorig::daemon {

/// A stretch of time in which the loop did not run. What is old behind it is old because the loop was away: no stream
/// is called silent for that.
struct Absence {
  std::int64_t from_ns = 0, to_ns = 0;

  /// How much of the time since `mono_ns` it takes.
  [[nodiscard]] std::int64_t since(std::int64_t mono_ns) const noexcept {
    return std::max<std::int64_t>(0, to_ns - std::max(from_ns, mono_ns));
  }
};

/// How old the newest sample of a stream is: in all, and while the loop was there to take the next one.
class StreamAge {
 public:
  void on_sample(std::int64_t mono_ns, const Absence& last) noexcept {
    if (mono_ns <= seen_ns_) return;
    seen_ns_ = mono_ns;
    away_ns_ = last.since(mono_ns);
  }
  void on_absence(const Absence& absence) noexcept {
    if (is_seen()) away_ns_ += absence.since(seen_ns_);
  }
  /// From here on it is as old as if a sample had come at `now_ns`.
  void restart(std::int64_t now_ns) noexcept {
    if (is_seen()) *this = StreamAge(std::max(seen_ns_, now_ns));
  }

  [[nodiscard]] bool is_seen() const noexcept { return seen_ns_ >= 0; }
  [[nodiscard]] std::int64_t seen_ns() const noexcept { return seen_ns_; }
  /// Negative before the first sample.
  [[nodiscard]] double age_s(std::int64_t now_ns) const noexcept {
    return is_seen() ? seconds(now_ns - seen_ns_) : -1.0;
  }
  [[nodiscard]] double attended_age_s(std::int64_t now_ns) const noexcept {
    return is_seen() ? seconds(now_ns - seen_ns_ - away_ns_) : -1.0;
  }
  /// A sample has come, and it is no older than that; absences count.
  [[nodiscard]] bool is_fresh(std::int64_t now_ns, double limit_s) const noexcept {
    return is_seen() && age_s(now_ns) <= limit_s;
  }

  StreamAge() = default;

 private:
  explicit StreamAge(std::int64_t seen_ns) noexcept : seen_ns_(seen_ns) {}

  std::int64_t seen_ns_ = -1;
  std::int64_t away_ns_ = 0;  ///< of the time since then
};

}  // namespace isorig::daemon
