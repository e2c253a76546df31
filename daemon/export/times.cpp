#include "daemon/export/times.hpp"

#include <algorithm>
#include <cmath>

#include "base/quantile.hpp"
#include "drivers/clock_map/remap.hpp"

namespace isorig::daemon {
namespace {

/// Exchanges this long before and after a stretch still say something about it.
constexpr std::int64_t kMarginNs = 600'000'000'000;
/// How far clock and counter of a device may drift apart between two rows without a break: its own jitter, and its rate
/// against the median.
constexpr double kJitter_us = 2'000.0;
constexpr double kRate = 1e-3;
/// A mapping is worse when its bounds are this many times as wide.
constexpr double kWider = 2.0;
/// Of a clock that breaks all the time nothing is mapped: stretches of fewer rows than this stay as they are,
constexpr std::size_t kLeast = 8;
/// and a row is looked for in so many of the latest stretches.
constexpr std::size_t kLookBack = 8;

double median_or_zero(std::vector<double> values) {
  return values.empty() ? 0.0 : base::quantile(std::move(values), 0.5);
}

/// The devices count in 32 bits.
double counts_between(double from, double to) {
  return std::remainder(to - from, 4'294'967'296.0);
}

/// Of one count of the device's, in its own time.
double period_us(const std::vector<TimedRow*>& rows) {
  std::vector<double> periods;
  for (std::size_t i = 1; i < rows.size(); ++i) {
    const double counts = counts_between(rows[i - 1]->sequence, rows[i]->sequence);
    if (counts > 0.0) periods.push_back((rows[i]->device_us - rows[i - 1]->device_us) / counts);
  }
  return median_or_zero(std::move(periods));
}

bool goes_on(double device_us, double counts, double period) {
  if (device_us < 0.0 || counts < 0.0) return false;
  return std::abs(device_us - counts * period) <= kJitter_us + kRate * device_us;
}

class Stretch {
 public:
  Stretch(std::span<TimedRow*> rows, std::span<const clock::Exchange> exchanges) : rows_(rows) {
    const auto before = [](const clock::Exchange& e, std::int64_t ns) { return e.host_recv_ns < ns; };
    const auto from = std::lower_bound(exchanges.begin(), exchanges.end(), rows.front()->mono_ns - kMarginNs, before);
    const auto to = std::lower_bound(from, exchanges.end(), rows.back()->mono_ns + kMarginNs, before);
    std::vector<clock::DeviceStamp> stamps;
    stamps.reserve(rows.size());
    for (const auto* r : rows) stamps.push_back({r->device_us, r->mono_ns});
    mapped_ = clock::remap_offline_stretch({from, to}, stamps);
    std::vector<double> bounds;
    for (const auto& m : mapped_) {
      if (std::isfinite(m.bound_ns)) bounds.push_back(m.bound_ns);
    }
    usual_bound_ns_ = median_or_zero(std::move(bounds));
  }

  /// Two statements about one time, each with a bound: where the bounds do not meet one of them is wrong.
  [[nodiscard]] bool better() const {
    double online_ns = 0.0, offline_ns = 0.0;
    std::size_t compared = 0;
    for (std::size_t i = 0; i < rows_.size(); ++i) {
      if (!std::isfinite(rows_[i]->bound_ns) || !std::isfinite(mapped_[i].bound_ns)) continue;
      const auto apart_ns = std::abs(static_cast<double>(mapped_[i].mono_ns - rows_[i]->mono_ns));
      if (apart_ns > rows_[i]->bound_ns + mapped_[i].bound_ns) return false;
      online_ns += rows_[i]->bound_ns;
      offline_ns += mapped_[i].bound_ns;
      ++compared;
    }
    return compared > 0 && offline_ns <= kWider * online_ns;
  }

  /// Returns how many rows keep their stamp; adds the squares of what the others moved by.
  std::size_t apply(double& squares_us2) {
    std::size_t kept = 0;
    for (std::size_t i = 0; i < rows_.size(); ++i) {
      const auto& m = mapped_[i];
      if (!(m.bound_ns <= std::max(kWider * usual_bound_ns_, rows_[i]->bound_ns)) || !std::isfinite(m.bound_ns)) {
        ++kept;
        continue;
      }
      const double moved_us = static_cast<double>(m.mono_ns - rows_[i]->mono_ns) * 1e-3;
      squares_us2 += moved_us * moved_us;
      // The recorded bound is that of the recorded time: the mapped one may be off by more.
      rows_[i]->mono_ns = m.mono_ns;
      rows_[i]->bound_ns = m.bound_ns;
      rows_[i]->repeatability_ns = m.repeatability_ns;
    }
    return kept;
  }

 private:
  std::span<TimedRow*> rows_;
  std::vector<clock::MappedTime> mapped_;
  double usual_bound_ns_ = 0.0;
};

}  // namespace

Remapped remap_rows(std::vector<TimedRow*>& rows, std::span<const clock::Exchange> exchanges) {
  Remapped result;
  if (rows.empty()) return result;
  const double period = period_us(rows);
  // By the clock, not by the stamps: where those were wrong for a moment, rows of two stretches are among each other.
  std::vector<std::vector<TimedRow*>> stretches;
  for (auto* row : rows) {
    if (!goes_on(row->device_span_us, row->sequence_span, period)) {
      ++result.kept;  // the break lies in this interval: its middle has no time of the device's
      ++result.clock_breaks;
      continue;
    }
    const auto oldest = stretches.rbegin() + static_cast<std::ptrdiff_t>(std::min(kLookBack, stretches.size()));
    const auto found = std::find_if(stretches.rbegin(), oldest, [&](const auto& s) {
      return goes_on(row->device_us - s.back()->device_us, counts_between(s.back()->sequence, row->sequence), period);
    });
    if (found != oldest) {
      found->push_back(row);
      continue;
    }
    if (!stretches.empty()) ++result.clock_breaks;
    stretches.push_back({row});
  }
  double squares_us2 = 0.0;
  for (auto& s : stretches) {
    if (s.size() < kLeast) {
      result.kept += s.size();
      continue;
    }
    Stretch stretch(s, exchanges);
    result.kept += stretch.better() ? stretch.apply(squares_us2) : s.size();
  }
  result.moved_rms_us = std::sqrt(squares_us2 / static_cast<double>(rows.size()));
  return result;
}

}  // namespace isorig::daemon
