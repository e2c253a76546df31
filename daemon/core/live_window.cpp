#include "daemon/core/live_window.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include "messages/elvh.hpp"

namespace isorig::daemon {

void LiveWindow::drain(LiveStreams& streams) {
  FrameRecord f;
  while (streams.frame.pop(f)) {
    position_.add({f.mono_ns, double{f.raw_position_mm}, f.position_mm, f.bound_ns});
    force_.add({f.mono_ns, double{f.raw_force_N}, f.force_N, f.bound_ns});
  }
  PressureRecord p;
  while (streams.pressure.pop(p)) {
    const auto word = messages::unpack_elvh(p.raw_word);
    if (word.status != messages::ElvhStatus::kCurrent) continue;  // the last value once more, or none
    pressure_.add({p.mono_ns, messages::elvh_pressure_psi(word.pressure_raw), p.pressure_psi, p.bound_ns});
    temperature_.add({p.mono_ns, double{p.temperature_C}, double{p.temperature_C}, p.bound_ns});
  }
  lost_ = streams.frame.dropped() + streams.pressure.dropped();
}

Reading LiveWindow::over(const Ring& ring, double window_s) {
  Reading r;
  if (ring.count == 0) return r;
  const auto at = [&](std::size_t i) -> const Entry& { return ring.entries[i % Ring::kSize]; };
  const std::size_t oldest = ring.count > Ring::kSize ? ring.count - Ring::kSize : 0;
  const std::int64_t since =
      at(ring.count - 1).mono_ns - static_cast<std::int64_t>(std::min(window_s, kLongest_s) * 1e9);
  std::size_t first = ring.count - 1;
  while (first > oldest && at(first - 1).mono_ns >= since) --first;

  const std::size_t n = ring.count - first;
  const double inverse = 1.0 / static_cast<double>(n);
  r.samples = n;
  r.from_ns = at(first).mono_ns;
  r.to_ns = at(ring.count - 1).mono_ns;
  r.min = r.max = at(first).raw;
  double mean_t_s = 0.0;
  const auto seconds = [&](const Entry& e) { return static_cast<double>(e.mono_ns - r.from_ns) * 1e-9; };
  std::size_t run = 0;
  for (std::size_t i = first; i < ring.count; ++i) {
    const auto& e = at(i);
    r.raw += e.raw * inverse;
    r.calibrated += e.calibrated * inverse;
    mean_t_s += seconds(e) * inverse;
    r.min = std::min(r.min, e.raw);
    r.max = std::max(r.max, e.raw);
    r.bound_ns = std::max(r.bound_ns, double{e.bound_ns});
    run = i > first && e.raw == at(i - 1).raw ? run + 1 : 1;
    r.longest_run = std::max(r.longest_run, run);
    if (i > first) r.worst_gap_s = std::max(r.worst_gap_s, static_cast<double>(e.mono_ns - at(i - 1).mono_ns) * 1e-9);
  }
  double tt = 0.0, tx = 0.0, xx = 0.0;
  constexpr std::size_t kParts = 10;
  std::array<double, kParts> sums{};
  std::array<std::size_t, kParts> counts{};
  for (std::size_t i = first; i < ring.count; ++i) {
    const auto& e = at(i);
    const double t = seconds(e) - mean_t_s, x = e.raw - r.raw;
    tt += t * t;
    tx += t * x;
    xx += x * x;
    const std::size_t part = (i - first) * kParts / n;
    sums[part] += x;
    ++counts[part];
  }
  if (n > 1) r.sd = std::sqrt(xx / static_cast<double>(n - 1));
  if (tt > 0.0) r.drift = tx / tt * seconds(at(ring.count - 1));
  if (n >= kParts) {
    double s2 = 0.0;
    for (std::size_t k = 0; k < kParts; ++k) s2 += std::pow(sums[k] / static_cast<double>(counts[k]), 2);
    r.standard_error = std::sqrt(s2 / static_cast<double>(kParts - 1) / static_cast<double>(kParts));
  }
  return r;
}

}  // namespace isorig::daemon
