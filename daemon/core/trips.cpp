#include "daemon/core/trips.hpp"

namespace isorig::daemon {
namespace {

constexpr auto kNone = Severity::kInfo;
constexpr auto kWarn = Severity::kWarning;
constexpr auto kStop = Severity::kProgramStop;
constexpr auto kSafe = Severity::kSafeState;

constexpr TripRule kRules[] = {
    // code                    moving  holding after   between
    {"limit.travel", kStop, kStop, kStop, kNone},
    {"limit.force", kStop, kSafe, kSafe, kSafe},
    {"limit.force_rate", kStop, kStop, kNone, kNone},
    {"limit.pressure", kSafe, kSafe, kSafe, kSafe},
    {"force.frozen", kStop, kStop, kStop, kNone},
    {"specimen.broken", kSafe, kSafe, kNone, kNone},
    {"frame.lags", kWarn, kWarn, kNone, kNone},
    {"frame.following", kStop, kStop, kNone, kNone},
    {"frame.stopped", kStop, kStop, kNone, kNone},
    {"frame.segment", kStop, kStop, kNone, kNone},
    {"frame.stop", kSafe, kSafe, kSafe, kNone},
    {"frame.fault", kSafe, kSafe, kSafe, kNone},
    {"frame.heartbeat", kSafe, kSafe, kSafe, kNone},
    {"frame.number", kSafe, kSafe, kSafe, kNone},
    {"frame.reference", kSafe, kSafe, kNone, kNone},
    {"interlock.frame", kSafe, kSafe, kSafe, kNone},
    {"interlock.lost", kSafe, kSafe, kSafe, kNone},
    {"interlock.estop", kSafe, kSafe, kSafe, kNone},
    {"interlock.guard", kSafe, kSafe, kSafe, kNone},
    {"stale.frame", kSafe, kSafe, kSafe, kNone},
    {"stale.pressure", kSafe, kSafe, kSafe, kNone},
    {"stale.regulator", kSafe, kSafe, kSafe, kNone},
    {"stale.interlock", kSafe, kSafe, kSafe, kNone},
    {"regulator.fault", kSafe, kSafe, kSafe, kNone},
    {"regulator.disagrees", kSafe, kSafe, kSafe, kNone},
    {"pressure.unreachable", kSafe, kSafe, kNone, kNone},
    {"pressure.frozen", kSafe, kSafe, kSafe, kNone},
    {"pressure.watchdog", kSafe, kSafe, kSafe, kNone},
    {"pressure.no_response", kSafe, kSafe, kSafe, kNone},
    {"pressure.no_vent", kSafe, kSafe, kSafe, kNone},
    {"pressure.falls", kSafe, kSafe, kSafe, kNone},
    {"pressure.rises", kSafe, kSafe, kSafe, kNone},
    {"pressure.hold", kSafe, kSafe, kSafe, kNone},
    {"pressure.fill_time", kSafe, kSafe, kSafe, kNone},
    {"teensy.pressure", kSafe, kSafe, kSafe, kNone},
    {"teensy.fill_time", kSafe, kSafe, kSafe, kNone},
    {"teensy.sensor", kSafe, kSafe, kSafe, kNone},
    {"teensy.stuck", kSafe, kSafe, kSafe, kNone},
    {"vent.stuck", kSafe, kSafe, kSafe, kSafe},
    {"held.expired", kSafe, kSafe, kNone, kNone},
    {"loop.late", kStop, kStop, kStop, kNone},
    {"recorder", kStop, kStop, kNone, kNone},
    {"recorder.overflow", kStop, kStop, kNone, kNone},
    {"recorder.stalled", kStop, kStop, kNone, kNone},
    {"protocol", kSafe, kSafe, kNone, kNone},
};

}  // namespace

std::span<const TripRule> trip_rules() noexcept {
  return kRules;
}

Severity severity_of(std::string_view code, Phase phase) noexcept {
  for (const auto& rule : kRules) {
    if (code == rule.code) return rule.in(phase);
  }
  return kSafe;
}

void TripList::note(const Trip& trip) noexcept {
  for (std::size_t i = 0; i < count_; ++i) {
    if (std::string_view(items_[i].code) != trip.code) continue;
    if (trip.severity > items_[i].severity) items_[i] = trip;
    return;
  }
  if (count_ < items_.size()) {
    items_[count_++] = trip;
    return;
  }
  // More causes at once than there is room for: a worse one takes the place of the last.
  if (trip.severity > items_.back().severity) items_.back() = trip;
}

Trip TripList::of(std::string_view code) const noexcept {
  for (const auto& trip : *this) {
    if (code == trip.code) return trip;
  }
  return {};
}

Trip TripList::worst() const noexcept {
  Trip worst;
  for (const auto& trip : *this) {
    if (trip.severity > worst.severity) worst = trip;
  }
  return worst;
}

}  // namespace isorig::daemon
