#include "daemon/host/callout.hpp"

#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <csignal>
#include <cstring>
#include <string_view>
#include <vector>

#include "base/formatted.hpp"
#include "base/printable.hpp"
#include "daemon/host/child_process.hpp"

namespace isorig::daemon {
namespace {

using steady_clock = std::chrono::steady_clock;

constexpr auto kCommandLook = std::chrono::milliseconds(20);

std::chrono::nanoseconds nanoseconds_of(double s) {
  return std::chrono::nanoseconds(static_cast<std::int64_t>(s * 1e9));
}

std::vector<std::string> environment_of(std::string_view event, std::string_view run, std::string_view text,
                                        std::string_view state) {
  std::vector<std::string> out = child_environment();
  const auto add = [&](const char* name, std::string_view value) { out.push_back(name + base::printable(value)); };
  add("ISORIG_EVENT=", event);
  add("ISORIG_RUN=", run);
  add("ISORIG_TEXT=", text);
  add("ISORIG_STATE=", state);
  return out;
}

}  // namespace

std::optional<std::string> Callout::name_of(const EventRecord& event) {
  const std::string_view code = event.code;
  if (code == "run.done") return "done";
  if (code == "run.aborted") return "aborted";
  if (code == "held.expired") return "held";
  if (event.from == event.to) return std::nullopt;
  if (event.to == RunState::kFaulted) return "faulted";
  if (event.to == RunState::kPaused && code == "pause") return "paused";
  return std::nullopt;
}

void Callout::on_event(const EventRecord& event, const std::string& run) {
  if (config_.command.empty()) return;
  if (const auto name = name_of(event))
    queue({*name, run, std::string(event.code) + ": " + event.text + cause_of(*name, run), to_text(event.to)});
}

void Callout::on_parted(const std::string& run, const std::string& text, const std::string& then, RunState state) {
  if (config_.command.empty()) return;
  {
    const std::lock_guard lock(mutex_);
    // A client that repeats itself must not take the places of what else there is to tell.
    if (std::ranges::any_of(calls_, [](const Call& c) { return c.event == "parted"; })) return;
    parting_ = {run, then, text, steady_clock::now()};
  }
  queue({"parted", run, text, to_text(state)});
}

/// The daemon knows a pause by the twin only as one that a client asked for.
std::string Callout::cause_of(const std::string& name, const std::string& run) {
  const std::lock_guard lock(mutex_);
  const bool by_the_twin =
      parting_.run == run && steady_clock::now() - parting_.at < kPartingActs &&
      ((name == "paused" && parting_.then == "pause") || (name == "aborted" && parting_.then == "abort"));
  return by_the_twin ? "; asked for by isorig-web: " + parting_.text : std::string();
}

void Callout::watch(const Status& status, const std::string& run, double longest_s) {
  watch_held(status, run);
  watch_duration(status, run, longest_s);
}

void Callout::watch_duration(const Status& status, const std::string& run, double longest_s) {
  if (std::exchange(run_number_, status.runs_started) != status.runs_started) {
    began_ns_ = -1;
    overdue_told_ = false;
  }
  if (config_.command.empty() || !status.run_loaded || !(longest_s > 0.0)) return;
  const auto now_ns = status.control.mono_ns;
  if (began_ns_ < 0) {
    // Armed it waits for somebody; a pause may come before this has seen it running.
    if (status.control.state != RunState::kRunning && status.control.state != RunState::kPaused) return;
    began_ns_ = now_ns;
  }
  const double taken_s = static_cast<double>(now_ns - began_ns_) * 1e-9;
  if (overdue_told_ || taken_s < longest_s + std::max(kOverdueLeast_s, kOverdueShare * longest_s)) return;
  overdue_told_ = true;
  queue({"overdue", run,
         base::formatted("the run has taken %.1f min, and its plan takes %.1f min at the longest", taken_s / 60.0,
                         longest_s / 60.0),
         to_text(status.control.state)});
}

void Callout::watch_held(const Status& status, const std::string& run) {
  const auto state = status.control.state;
  const bool held = status.run_loaded && state != RunState::kRunning && state != RunState::kStopping;
  if (!held || config_.command.empty() || config_.held_s <= 0.0) {
    held_since_ns_ = -1;
    held_told_ = false;
    return;
  }
  if (held_since_ns_ < 0) held_since_ns_ = status.control.mono_ns;
  const double held_s = static_cast<double>(status.control.mono_ns - held_since_ns_) * 1e-9;
  if (held_told_ || held_s < config_.held_s) return;
  held_told_ = true;
  const std::string why = status.fault[0] != '\0' ? std::string(": ") + status.fault : std::string();
  queue({"held", run, "the run has been held for " + std::to_string(static_cast<int>(held_s)) + " s" + why,
         to_text(state)});
}

void Callout::queue(Call call) {
  {
    const std::lock_guard lock(mutex_);
    if (calls_.size() >= kQueued) {
      ++dropped_;
      return;
    }
    calls_.push_back(std::move(call));
  }
  more_.notify_one();
}

void Callout::stop() {
  {
    const std::lock_guard lock(mutex_);
    if (stopping_) return;
    stopping_ = true;
    give_up_ = steady_clock::now() + kStopPatience;
  }
  more_.notify_one();
}

void Callout::run() {
  auto next = steady_clock::now();
  for (;;) {
    Call due;
    std::size_t dropped = 0;
    {
      std::unique_lock lock(mutex_);
      more_.wait(lock, [this] { return stopping_ || !calls_.empty(); });
      more_.wait_until(lock, next, [this] { return stopping_; });
      if (stopping_ && (calls_.empty() || steady_clock::now() > give_up_)) return;
      if (calls_.empty()) continue;
      due = std::move(calls_.front());
      calls_.pop_front();
      dropped = std::exchange(dropped_, 0);
    }
    next = steady_clock::now() + nanoseconds_of(config_.interval_s);
    if (dropped > 0)
      note("notify: " + std::to_string(dropped) +
           " calls are given up: they came faster than [notify] interval_s lets them go");
    call(due);
  }
}

void Callout::call(const Call& due) {
  const std::string what = "notify: " + config_.command.string() + " (" + due.event + ") ";
  const ChildWords words;
  pid_t pid = 0;
  if (const int error = spawn_child({config_.command.string(), due.event},
                                    environment_of(due.event, due.run, due.text, due.state), words.fd(), pid);
      error != 0) {
    note(what + "cannot be started: " + std::strerror(error));
    return;
  }
  int status = 0;
  if (!wait_for(pid, steady_clock::now() + nanoseconds_of(config_.timeout_s), status)) {
    ::kill(-pid, SIGTERM);
    if (!wait_for(pid, steady_clock::now() + kTermGrace, status)) {
      ::kill(-pid, SIGKILL);
      ::waitpid(pid, &status, 0);
    }
    note(what + "was ended: it took longer than [notify] timeout_s" + words.first());
  } else if (WIFSIGNALED(status)) {
    note(what + "was killed by signal " + std::to_string(WTERMSIG(status)) + words.first());
  } else if (WEXITSTATUS(status) != 0) {
    note(what + "failed with exit code " + std::to_string(WEXITSTATUS(status)) + words.first());
  }
  ::kill(-pid, SIGKILL);  // what it has left in its group
}

/// False: it still runs.
bool Callout::wait_for(int pid, steady_clock::time_point deadline, int& status) {
  for (;;) {
    const pid_t got = ::waitpid(pid, &status, WNOHANG);
    if (got == pid) return true;
    if (got < 0 && errno != EINTR) {
      status = 0;
      return true;
    }
    std::unique_lock lock(mutex_);
    if (steady_clock::now() >= std::min(deadline, give_up_)) return false;
    more_.wait_for(lock, kCommandLook);
  }
}

}  // namespace isorig::daemon
