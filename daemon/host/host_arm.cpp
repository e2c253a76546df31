#include <algorithm>
#include <chrono>
#include <cstring>

#include "daemon/core/fixed_text.hpp"
#include "daemon/host/host_prepared.hpp"
#include "daemon/host/host_run.hpp"

/// Host: the second act of a start, and who has accepted the rig file.
namespace isorig::daemon {
namespace {

constexpr std::size_t kChangesNoted = 16;

}  // namespace

Host::Result Host::go(const std::string& by) {
  const std::lock_guard one_at_a_time(start_mutex_);
  const auto now = core_.status();
  if (now.control.state != RunState::kArmed) {
    const auto state = now.control.state;
    const std::string first = state == RunState::kPaused    ? "what goes on has to be armed first (isorig resume)"
                              : state == RunState::kFaulted ? "see to the cause, then isorig reset"
                                                            : "a start has to be armed first (isorig start)";
    return {false, std::string("the rig is ") + to_text(state) + ": " + first, {}};
  }
  if (now.run_loaded) {  // a paused run that goes on
    Request request;
    request.verb = Request::Verb::kGo;
    copy_text(request.by, by);
    return ask(request);
  }
  const auto prepared = std::exchange(armed_, nullptr);
  if (!prepared) return {false, "nothing is armed any more; isorig start again", {}};
  return begin(now, *prepared, Request::Verb::kGo);
}

/// Of a run that was there before nothing is lost by a countdown that was not completed.
std::string Host::outcome_text(const Run& run, Outcome outcome) {
  switch (outcome) {
    case Outcome::kDone:
      return "done";
    case Outcome::kAborted:
      return "aborted";
    case Outcome::kNotStarted:
      return run.resumed ? "interrupted" : "not started";
    case Outcome::kNone:
    case Outcome::kFailed:
      break;
  }
  return "failed";
}

Host::Result Host::accept_rig(const std::string& operator_name, uid_t uid) {
  const std::lock_guard one_at_a_time(start_mutex_);
  if (!acceptance_) return {false, "a rig in virtual time is accepted by nobody", {}};
  const auto unix_s =
      std::chrono::duration_cast<std::chrono::seconds>(std::chrono::system_clock::now().time_since_epoch()).count();
  RigAcceptance accepted = *acceptance_;  // shown to nobody until it is on the disk
  accepted.accept(operator_name, uid, unix_s);
  const auto text = accepted.summary();
  const std::lock_guard lock(mutex_);
  acceptance_ = std::move(accepted);
  return {true, text, {}};
}

std::string Host::rig_changes() const {
  const std::lock_guard lock(mutex_);
  if (!acceptance_ || acceptance_->in_force()) return {};
  return acceptance_->summary(1000);
}

/// Into the events of the run that is being opened.
void Host::note_rig_changes() {
  std::vector<RigChange> changes;
  {
    const std::lock_guard lock(mutex_);
    if (acceptance_) changes = acceptance_->changes();
  }
  HostNote note;
  note.severity = Severity::kWarning;
  copy_text(note.code, "rig.changed");
  for (std::size_t i = 0; i < changes.size() && i < kChangesNoted; ++i) {
    copy_text(note.text, changes[i].text());
    core_.notes.push(note);
  }
  if (changes.size() > kChangesNoted) {
    copy_text(note.text, "and " + std::to_string(changes.size() - kChangesNoted) + " more keys");
    core_.notes.push(note);
  }
}

}  // namespace isorig::daemon
