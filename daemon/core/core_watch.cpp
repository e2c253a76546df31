#include <cstring>

#include "daemon/core/core.hpp"
#include "daemon/core/fixed_text.hpp"

/// Core: what has gone wrong becomes a fault with its reaction, an event, and a line in the list of faults.
namespace isorig::daemon {
namespace {

// The driver's last words belong to a fault when they are not older.
constexpr std::int64_t kWordsNs = 3'000'000'000;
// An error that goes on is said again, but not every time.
constexpr std::int64_t kErrorAgainNs = 10'000'000'000;

bool begins(const char* text, const char* with) noexcept {
  return std::strncmp(text, with, std::strlen(with)) == 0;
}

}  // namespace

void Core::watch_itself(std::int64_t now_ns) noexcept {
  // A verb of this tick may have ended the run that a cause would stop.
  supervisor_.set_state(state_, run_open_);
  if (const Trip recorder = judge_recorder(now_ns)) {
    supervisor_.report(recorder.code, recorder.what, recorder.value, recorder.threshold);
  }
  if (loop_.unreachable()) {
    supervisor_.report("pressure.unreachable",
                       "the set-point cannot be reached; check supply, leaks and the fill valve", pressure_psi_,
                       loop_.target_psi());
  }
  // A reading that is in doubt is not one to fill by, nor to hold by.
  if (const auto& doubt = guard_.doubt()) supervisor_.report(doubt.code, doubt.what, doubt.value, doubt.threshold);
  const bool to_go_on = run_open_ && run_begun_ && (state_ == RunState::kArmed || state_ == RunState::kCountdown);
  const bool held = state_ == RunState::kPaused || (state_ == RunState::kFaulted && run_open_) || to_go_on;
  if (!held) held_since_ns_ = now_ns;
  const double held_s = static_cast<double>(now_ns - held_since_ns_) * 1e-9;
  if (const double most_s = config_.supervisor.held_max_s; most_s > 0.0 && held_s > most_s) {
    supervisor_.report("held.expired",
                       "the run was held for too long: vented; isorig resume RUN goes on from its repetition", held_s,
                       most_s);
  }
  const double stopping_s = static_cast<double>(now_ns - stopping_since_ns_) * 1e-9;
  if (state_ == RunState::kStopping && stopping_s > config_.vent_time_max_s &&
      (pressure_psi_ >= config_.vented_psi || filter_last_ns_ <= stopping_since_ns_)) {
    supervisor_.report("vent.stuck", "the actuator does not vent; shut the supply, check vent and dump valve",
                       pressure_psi_, config_.vented_psi);
  }
}

void Core::watch_zero(const FrameReport& report) noexcept {
  if (report.reference_epoch != zero_epoch_) {
    const bool first = zero_epoch_ == 0;
    zero_epoch_ = report.reference_epoch;
    if (config_.frame_zero == FrameZero::kAbsolute || (first && config_.frame_zero == FrameZero::kFirstHolds)) {
      confirmed_zero_ = zero_epoch_;
    }
    if (!first) {
      emit(report.mono_ns, Severity::kWarning, "restart.frame",
           "the frame was restarted, or is another: it may count from another zero", static_cast<double>(zero_epoch_),
           0.0);
    }
  }
  if (zero_epoch_ != confirmed_zero_) {
    supervisor_.report("frame.reference",
                       "the frame was restarted: its zero may be lost. Check the zero, isorig confirm-zero, then reset",
                       0.0, 0.0);
  }
}

bool Core::take_trips(std::int64_t now_ns, const TripList& found) noexcept {
  if (found.begin() == found.end()) return false;
  bool fresh = false;
  // What the devices did while the loop was away follows from that: it is the cause, whatever is worse follows below.
  const Trip late = found.of("loop.late");
  const Trip first = late.severity >= Severity::kProgramStop ? late : found.worst();
  if (state_ != RunState::kFaulted && first.severity >= Severity::kProgramStop) {
    trip_over(now_ns, first);
    fresh = true;
  }
  for (const auto& trip : found) {
    if (trip.severity == Severity::kWarning) {
      emit(now_ns, trip.severity, trip.code, trip.what, trip.value, trip.threshold);
    } else if (state_ == RunState::kFaulted && !is_listed(trip)) {
      if (trip.severity == Severity::kSafeState && !vented_fault_) {
        trip_over(now_ns, trip);
      } else {
        char buffer[400];
        FixedText<400> text(buffer);
        describe(now_ns, trip, text);
        list_fault(now_ns, trip, buffer);
        emit(now_ns, trip.severity, trip.code, buffer, trip.value, trip.threshold);
      }
    }
  }
  return fresh;
}

void Core::trip_over(std::int64_t now_ns, const Trip& trip) noexcept {
  // What has not begun is not held: there is nothing to go on with.
  vented_fault_ = trip.severity == Severity::kSafeState || !run_open_ || !run_begun_;
  if (vented_fault_) {
    stop_and_vent(now_ns);
    if (run_open_) {
      run_open_ = false;
      outcome_ = run_begun_ ? Outcome::kFailed : Outcome::kNotStarted;
    }
  } else {
    request_stop(now_ns);
    seal();
    if (cursor_) cursor_->pause(now_ns);
  }
  keep_ = Keep::kFull;  // the run-up to the fault goes to disk in full, and some seconds of what follows
  faulted_since_ns_ = now_ns;
  char buffer[400];
  FixedText<400> words(buffer);
  describe(now_ns, trip, words);
  if (state_ != RunState::kFaulted) {
    // An abort of a run that a fault held has reset nothing: what comes while it vents stands behind that fault.
    if (state_ != RunState::kStopping) clear_faults();
  }
  if (listed_.fault_count == 0) {
    FixedText text(now_.fault);
    text << trip.code << ": " << std::string_view(buffer);
    if (trip.threshold != 0.0) text << " (" << trip.value << ", limit " << trip.threshold << ")";
  }
  list_fault(now_ns, trip, buffer);
  transition(now_ns, RunState::kFaulted, trip.severity, trip.code, buffer, trip.value, trip.threshold);
}

/// A code that has become worse is told again. A full list takes no more.
bool Core::is_listed(const Trip& trip) const noexcept {
  if (listed_.fault_count == listed_.faults.size()) return true;
  for (std::uint32_t i = 0; i < listed_.fault_count; ++i) {
    const auto& known = listed_.faults[i];
    if (std::strcmp(known.code, trip.code) == 0 && known.severity >= trip.severity) return true;
  }
  return false;
}

void Core::clear_faults() noexcept {
  now_.fault[0] = '\0';
  listed_.fault_count = 0;
  list_changed_ = true;
}

void Core::list_fault(std::int64_t now_ns, const Trip& trip, std::string_view text) noexcept {
  if (listed_.fault_count == listed_.faults.size()) return;
  list_changed_ = true;
  auto& entry = listed_.faults[listed_.fault_count++];
  entry.mono_ns = now_ns;
  entry.severity = trip.severity;
  copy_text(entry.code, trip.code);
  FixedText line(entry.text);
  line << text;
  if (trip.threshold != 0.0) line << " (" << trip.value << ", limit " << trip.threshold << ")";
}

void Core::describe(std::int64_t now_ns, const Trip& trip, FixedText<400>& text) const noexcept {
  text << trip.what;
  const LinkHealth* link = begins(trip.code, "frame.") || std::strcmp(trip.code, "stale.frame") == 0 ? &now_.frame
                           : std::strcmp(trip.code, "stale.pressure") == 0                           ? &now_.pressure
                           : std::strcmp(trip.code, "stale.regulator") == 0                          ? &now_.regulator
                           : begins(trip.code, "interlock.l") || std::strcmp(trip.code, "stale.interlock") == 0
                               ? &now_.interlock
                               : nullptr;
  if (link == nullptr || link->detail[0] == '\0' || link->failed_ns == 0 || now_ns - link->failed_ns > kWordsNs) return;
  text << "; the driver says: " << std::string_view(link->detail);
}

const char* Core::why_not_ready(std::int64_t now_ns) const noexcept {
  const char* why = nullptr;
  if (!supervisor_.healthy(now_ns, &why)) return why;
  if (zero_epoch_ != confirmed_zero_)
    return "the frame's zero is not confirmed since it was started (isorig confirm-zero)";
  if (!now_.frame.clock_ready || !now_.pressure.clock_ready) return "the device clocks are being measured";
  if (pressure_psi_ >= config_.vented_psi)
    return "the actuator is under pressure (isorig abort vents; a vented sensor that reads this: calibrate its zero)";
  if (storage_.text[0] != '\0') return storage_.text;
  return nullptr;
}

void Core::follow_link(std::int64_t now_ns, const char* error_code, const char* reconnect_code, const LinkHealth& now,
                       LinkSeen& seen) noexcept {
  if (now.errors != seen.errors) {
    // The first of a series at once, so that it stands before what it leads to.
    if (seen.error_said_ns < 0 || now_ns - seen.error_said_ns > kErrorAgainNs) {
      char buffer[320];
      FixedText text(buffer);
      if (seen.error_said_ns >= 0) {
        text << (now.errors - seen.errors) << " more by now, the last "
             << static_cast<double>(now_ns - now.failed_ns) * 1e-9 << " s ago: ";
      }
      text << std::string_view(now.detail);
      emit(now_ns, Severity::kWarning, error_code, buffer, static_cast<double>(now.errors - seen.errors), 0.0);
      seen.error_said_ns = now_ns;
      seen.errors = now.errors;
    }
  } else if (seen.error_said_ns >= 0 && now_ns - seen.error_said_ns > kErrorAgainNs) {
    seen.error_said_ns = -1;
  }
  if (now.reconnects != seen.reconnects) {
    seen.reconnects = now.reconnects;
    emit(now_ns, Severity::kWarning, reconnect_code, now.identity, static_cast<double>(now.reconnects), 0.0);
  }
}

/// `tell_losses`: once a second, summed up.
void Core::note_clock(std::int64_t now_ns, const LinkHealth& health, ClockSeen& seen, const char* rejected,
                      const char* restarted) noexcept {
  if (health.clock_rejected != seen.rejected) {
    emit(now_ns, Severity::kWarning, "clock.rejected", rejected,
         static_cast<double>(health.clock_rejected - seen.rejected), 0.0);
  }
  // The first life is no event.
  if (health.clock_epoch != seen.epoch && seen.epoch != 0) {
    emit(now_ns, Severity::kWarning, "clock.restarted", restarted, static_cast<double>(health.clock_epoch), 0.0);
  }
  seen = {health.clock_rejected, health.clock_epoch};
}

void Core::follow_links(std::int64_t now_ns, bool tell_losses) noexcept {
  follow_link(now_ns, "error.frame", "reconnect.frame", now_.frame, frame_seen_);
  follow_link(now_ns, "error.pressure", "reconnect.pressure", now_.pressure, pressure_seen_);
  follow_link(now_ns, "error.interlock", "reconnect.interlock", now_.interlock, interlock_seen_);
  follow_link(now_ns, "error.regulator", "reconnect.regulator", now_.regulator, regulator_seen_);
  note_clock(now_ns, now_.frame, frame_clock_, "a time exchange with the frame contradicts its clock and was left out",
             "the frame's clock was set or restarted; its stamps begin anew");
  note_clock(now_ns, now_.pressure, pressure_clock_,
             "a time exchange with the Teensy contradicts its clock and was left out",
             "the Teensy's clock was set or restarted; its stamps begin anew");
  if (!tell_losses) return;
  if (now_.frame.lost > frame_seen_.lost) {
    emit(now_ns, Severity::kWarning, "lost.frame", "samples of the frame were overwritten before we read them",
         static_cast<double>(now_.frame.lost - frame_seen_.lost), 0.0);
    frame_seen_.lost = now_.frame.lost;
  }
  if (now_.pressure.lost > pressure_seen_.lost) {
    // Whether the line spoils them or they never come are two different faults.
    char buffer[160];
    FixedText text(buffer);
    text << (now_.pressure.lost - pressure_seen_.lost) << " pressure samples are missing from the sequence; "
         << (now_.pressure.corrupt - pressure_seen_.corrupt) << " frames came corrupt";
    emit(now_ns, Severity::kWarning, "lost.pressure", buffer,
         static_cast<double>(now_.pressure.lost - pressure_seen_.lost), 0.0);
    pressure_seen_.lost = now_.pressure.lost;
    pressure_seen_.corrupt = now_.pressure.corrupt;
  }
}

}  // namespace isorig::daemon
