#include "daemon/recording/trip_reaction.hpp"

#include <cmath>
#include <iterator>
#include <optional>
#include <utility>
#include <vector>

#include "daemon/core/seconds.hpp"
#include "messages/elvh.hpp"

namespace isorig::daemon {
namespace {

using nlohmann::ordered_json;

constexpr std::int64_t kSlopeNs = 60'000'000;  // as the daemon's own standstill (daemon/core/standstill.hpp)
constexpr double kStands_mm_s = 0.05;
constexpr double kVented_psi = 1.0;
/// Longer without a sample: what the plant did meanwhile is not known. As the supervisor's own patience by default.
constexpr std::int64_t kSilentNs = 250'000'000;

/// What is looked at for the reaction to a trip.
struct Window {
  std::int64_t trip_ns, end_ns;
  std::int64_t until_ns;  ///< the last record of any stream before the end
};

bool is_reading(const FrameRecord& r) {
  return std::isfinite(r.position_mm) && std::isfinite(r.force_N);
}

bool is_reading(const PressureRecord& r) {
  return static_cast<messages::ElvhStatus>(r.status) == messages::ElvhStatus::kCurrent && std::isfinite(r.pressure_psi);
}

/// The longest time without a sample that touches the window, in seconds from the trip; absent up to kSilentNs.
template <typename Record>
std::optional<std::pair<double, double>> silence(const std::deque<Record>& records, const Window& w) {
  const auto begin = first_from(records, w.trip_ns), end = first_from(records, w.end_ns);
  std::int64_t last_ns = w.trip_ns, from_ns = 0, to_ns = 0;
  for (auto i = begin; i != records.begin();) {
    if (!is_reading(*--i)) continue;
    last_ns = i->mono_ns;
    break;
  }
  const auto note = [&](std::int64_t now_ns) {
    if (now_ns - last_ns > std::max(kSilentNs, to_ns - from_ns)) {
      from_ns = last_ns;
      to_ns = now_ns;
    }
  };
  for (auto i = begin; i != end; ++i) {
    if (!is_reading(*i)) continue;
    note(i->mono_ns);
    last_ns = i->mono_ns;
  }
  note(w.until_ns);
  if (from_ns == to_ns) return std::nullopt;
  return std::pair{seconds(from_ns - w.trip_ns), seconds(to_ns - w.trip_ns)};
}

/// The record that tells how it was at the trip: the first after it, or the last before it when that came too late.
/// Neither: nullptr.
template <typename Record>
const Record* at_trip(const std::deque<Record>& records, const Window& w) {
  const auto begin = first_from(records, w.trip_ns), end = first_from(records, w.end_ns);
  const auto first = std::find_if(begin, end, [](const Record& r) { return is_reading(r); });
  if (first != end && first->mono_ns - w.trip_ns <= kSilentNs) return &*first;
  for (auto i = begin; i != records.begin();) {
    if (is_reading(*--i)) return &*i;
  }
  return nullptr;
}

void add_frame_reaction(ordered_json& out, const std::deque<FrameRecord>& frame, const Window& w) {
  std::vector<FrameRecord> read;
  std::copy_if(first_from(frame, w.trip_ns), first_from(frame, w.end_ns), std::back_inserter(read),
               [](const FrameRecord& r) { return is_reading(r); });
  if (!read.empty()) {
    // White noise of the position, from neighbours: it must not look like a motion.
    double sum = 0.0;
    for (std::size_t i = 1; i < read.size(); ++i) sum += std::pow(read[i].position_mm - read[i - 1].position_mm, 2);
    const double noise_mm = read.size() > 1 ? std::sqrt(0.5 * sum / static_cast<double>(read.size() - 1)) : 0.0;
    const double most_mm = kStands_mm_s * seconds(kSlopeNs) + 6.0 * noise_mm;
    double low_mm = read[0].position_mm, high_mm = low_mm, low_N = read[0].force_N, high_N = low_N;
    std::int64_t moved_ns = w.trip_ns, last_ns = w.trip_ns, seen_from_ns = w.trip_ns;
    bool still = false;
    auto behind = read.begin();
    for (auto i = read.begin(); i != read.end(); ++i) {
      low_mm = std::min(low_mm, i->position_mm);
      high_mm = std::max(high_mm, i->position_mm);
      low_N = std::min(low_N, i->force_N);
      high_N = std::max(high_N, i->force_N);
      if (i->mono_ns - last_ns > kSilentNs) {  // nobody knows what it did meanwhile
        moved_ns = seen_from_ns = i->mono_ns;
        behind = i;
        still = false;
      }
      last_ns = i->mono_ns;
      if (i->mono_ns - seen_from_ns < kSlopeNs) continue;
      while (i->mono_ns - behind->mono_ns > kSlopeNs) ++behind;
      still = std::abs(i->position_mm - behind->position_mm) <= most_mm;
      if (!still) moved_ns = i->mono_ns;
    }
    if (still && w.until_ns - last_ns <= kSilentNs) out["stood_s"] = seconds(moved_ns - w.trip_ns);
    if (const auto* at = at_trip(frame, w)) out["position_at_mm"] = at->position_mm;
    out["position_min_mm"] = low_mm;
    out["position_max_mm"] = high_mm;
    out["force_min_N"] = low_N;
    out["force_max_N"] = high_N;
  }
  out["frame_samples_after"] = read.size();
  if (const auto s = silence(frame, w)) out["frame_silent_s"] = {s->first, s->second};
}

void add_pressure_reaction(ordered_json& out, const std::deque<PressureRecord>& pressure, const Window& w) {
  std::size_t count = 0;
  double most_psi = 0.0, last_psi = 0.0;
  std::int64_t pressed_ns = w.trip_ns, last_ns = w.trip_ns;
  for (auto i = first_from(pressure, w.trip_ns), end = first_from(pressure, w.end_ns); i != end; ++i) {
    if (!is_reading(*i)) continue;
    last_psi = i->pressure_psi;
    most_psi = count++ == 0 ? last_psi : std::max(most_psi, last_psi);
    if (last_psi > kVented_psi || i->mono_ns - last_ns > kSilentNs) pressed_ns = i->mono_ns;
    last_ns = i->mono_ns;
  }
  if (count > 0) {
    if (const auto* at = at_trip(pressure, w)) out["pressure_at_psi"] = at->pressure_psi;
    out["pressure_max_psi"] = most_psi;
    out["pressure_last_psi"] = last_psi;
    if (last_psi <= kVented_psi && w.until_ns - last_ns <= kSilentNs) out["vented_s"] = seconds(pressed_ns - w.trip_ns);
  }
  out["pressure_samples_after"] = count;
  if (const auto s = silence(pressure, w)) out["pressure_silent_s"] = {s->first, s->second};
}

}  // namespace

ordered_json trip_reaction(const std::deque<FrameRecord>& frame, const std::deque<PressureRecord>& pressure,
                           const std::deque<ControlRecord>& control, std::int64_t trip_ns, std::int64_t end_ns) {
  const auto after = first_from(control, trip_ns), control_end = first_from(control, end_ns);
  std::int64_t until_ns = trip_ns;  // what came last, of anything
  const auto reaches = [&until_ns](const auto& records, auto end) {
    if (end != records.begin()) until_ns = std::max(until_ns, (end - 1)->mono_ns);
  };
  reaches(frame, first_from(frame, end_ns));
  reaches(pressure, first_from(pressure, end_ns));
  reaches(control, control_end);
  ordered_json out;
  add_frame_reaction(out, frame, {trip_ns, end_ns, until_ns});
  add_pressure_reaction(out, pressure, {trip_ns, end_ns, until_ns});
  if (after < control_end) {
    const auto& c = *after;
    out["valves"] = c.vent_permille >= 1000 ? "vent" : c.fill_permille == 0 && c.vent_permille == 0 ? "shut" : "other";
    out["valves_s"] = seconds(c.mono_ns - trip_ns);
  }
  return out;
}

}  // namespace isorig::daemon
