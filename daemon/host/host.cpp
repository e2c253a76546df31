#include "daemon/host/host.hpp"

#include <chrono>
#include <exception>
#include <thread>

#include "base/number_text.hpp"
#include "daemon/host/host_prepared.hpp"
#include "daemon/host/host_run.hpp"
#include "daemon/host/verb_desk.hpp"
#include "daemon/recording/run_directory.hpp"
#include "daemon/rig/calibrations.hpp"

/// Host: the recorder's turns, the verbs, the end of a run.
namespace isorig::daemon {
namespace {

constexpr std::size_t kEventsKept = 2000;
constexpr std::int64_t kTryAgainNs = 1'000'000'000;
// Between runs the disk is tried by a write and a sync: seldom while it takes them, so that it may rest and does not
// wear; soon again when it does not.
constexpr std::int64_t kStorageGoodNs = 30'000'000'000;
constexpr std::int64_t kStorageBadNs = 2'000'000'000;

/// Why a run must not go on; empty while everything is kept.
std::string trouble_of(const RecorderStatus& s) {
  if (s.disk >= DiskCondition::kLow) {
    return std::string("the recording cannot be continued: ") + describe(s.disk) +
           (s.error.empty() ? "" : " (" + s.error + ")");
  }
  if (!s.catalogue_error.empty()) return "the catalogue cannot be written: " + s.catalogue_error;
  return s.fault;
}

std::vector<std::filesystem::path> places_of(const Host::Options& options) {
  std::vector<std::filesystem::path> out{options.runs_root};
  out.insert(out.end(), options.diagnoses.begin(), options.diagnoses.end());
  return out;
}

std::string why_no_run_could_be_recorded(const std::filesystem::path& root, std::uint64_t least,
                                         const decltype(Host::Options::free_bytes)& free_bytes_of) {
  auto why = why_not_writable(root);
  if (!why.empty()) return why;
  const auto bytes = free_bytes_of ? free_bytes_of(root) : free_bytes(root);
  if (bytes >= least) return {};
  return std::to_string(bytes >> 20U) + " MiB free, " + std::to_string(least >> 20U) + " MiB are kept free";
}

}  // namespace

Host::Host(const RigConfig& rig, Core& core, Streams& recording, Options options)
    : rig_(rig),
      core_(core),
      recording_(recording),
      options_(std::move(options)),
      catalogue_(options_.runs_root),
      diagnoses_(places_of(options_)),
      desk_(core),
      events_(kEventsKept),
      records_(open_records(rig, options_.runs_root)) {
  if (!options_.virtual_time) {
    core_.set_observer(&live_);
    acceptance_.emplace(rig.name, rig.text, options_.runs_root);
    storage_.emplace(
        [root = options_.runs_root, least = rig.recording.min_free_bytes, free_bytes_of = options_.free_bytes] {
          return why_no_run_could_be_recorded(root, least, free_bytes_of);
        });
    tell_core_of_storage(storage_->look_here());  // before the first tick: never ready on a disk that nobody has tried
  }
}

Host::~Host() = default;

std::uint32_t Host::submit(Request::Verb verb) {
  Request request;
  request.verb = verb;
  return desk_.submit(request);
}

std::uint32_t Host::submit(const Request& request) {
  return desk_.submit(request);
}

std::optional<Host::Result> Host::answer_to(std::uint32_t number) {
  const auto reply = desk_.reply_to(number);
  if (!reply) return std::nullopt;
  const std::lock_guard lock(mutex_);
  return Result{reply->accepted, reply->text, run_ ? run_->id : std::string()};
}

Host::Result Host::without_answer(std::uint32_t number, Request::Verb verb) {
  desk_.withdraw(number);
  if (auto result = answer_to(number)) return *result;
  const char* then = merely_stops(verb) ? "it does this as soon as it goes on" : "if it goes on, it will not begin";
  return {false, std::string("the real-time loop did not answer within 2 s; ") + then + "; see isorig status", {}};
}

Host::Result Host::verb(Request::Verb verb) {
  Request request;
  request.verb = verb;
  auto result = ask(request);
  const std::lock_guard lock(mutex_);
  if (run_) result.run = run_->id;
  return result;
}

Host::Result Host::ask(Request request) {
  const auto number = desk_.submit(request);
  if (number == 0) return {false, "the loop does not take requests; is it running?", {}};
  const auto deadline = std::chrono::steady_clock::now() + kVerbPatience;
  do {
    if (const auto reply = desk_.reply_to(number)) return {reply->accepted, reply->text, {}};
    breathe();
  } while (std::chrono::steady_clock::now() < deadline);
  return without_answer(number, request.verb);
}

void Host::breathe() const {
  if (options_.breathe) {
    options_.breathe();
  } else {
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
}

void Host::trouble(const std::string& text) const {
  if (options_.on_trouble) options_.on_trouble(text);
}

void Host::turn(std::int64_t now_ns) noexcept {
  try {
    turn_or_throw(now_ns);
    core_.recorder_turn(now_ns);
  } catch (const std::exception& e) {
    try {
      tell_core(std::string("the recorder failed: ") + e.what());
    } catch (...) {  // no memory for a text: the turns that stay away are a program stop too
    }
  }
}

void Host::turn_or_throw(std::int64_t now_ns) {
  const auto run = take_events();
  if (storage_) look_at_storage(now_ns, run != nullptr);  // a virtual run starts at once, or is refused
  if (!run) return;
  const std::lock_guard recording(run->recording);
  if (run->closed) return;
  run->recorder->drain(recording_, now_ns);
  auto status = run->recorder->status();
  if (!run->finished) tell_core(trouble_of(status));
  {
    const std::lock_guard lock(mutex_);
    recorder_status_ = std::move(status);
  }
  close_when_over(*run, now_ns);
}

/// Also the run that is recorded, if there is one.
std::shared_ptr<Host::Run> Host::take_events() {
  std::vector<EventRecord> told;
  std::optional<EventRecord> reset;  // of a fault that ended the run that was closed last
  std::filesystem::path closed;
  std::int64_t closed_epoch_unix_us = 0;
  std::shared_ptr<Run> run;
  {
    const std::lock_guard lock(mutex_);
    EventRecord record;
    while (core_.host_events.pop(record)) {
      if (events_.add(record) && options_.on_event) told.push_back(record);
      // The first cause: what follows from it, or comes on top, is in the events.
      if (record.severity >= Severity::kProgramStop && record.from != record.to)
        last_fault_ = std::string(record.code) + ": " + record.text;
      if (!run_ && std::string_view(record.code) == "reset") {
        reset = record;
        closed = finished_directory_;
        closed_epoch_unix_us = finished_epoch_unix_us_;
      }
    }
    window_.drain(live_);
    run = run_;
    if (!run) drop_queued();  // here, so that nothing of a run that is just being opened is dropped
  }
  for (const auto& record : told) options_.on_event(record);
  if (reset && !closed.empty()) {
    try {
      append_to_last_trip(closed, *reset, closed_epoch_unix_us);
    } catch (const std::exception& e) {
      trouble(e.what());
    }
  }
  return run;
}

void Host::drop_queued() {
  FrameRecord f;
  PressureRecord p;
  ControlRecord c;
  EventRecord e;
  ExchangeRecord x;
  SyncRecord s;
  while (recording_.frame.pop(f)) {
  }
  while (recording_.pressure.pop(p)) {
  }
  while (recording_.control.pop(c)) {
  }
  while (recording_.events.pop(e)) {
  }
  while (recording_.exchanges.pop(x)) {
  }
  while (recording_.sync.pop(s)) {
  }
}

void Host::tell_core(const std::string& recorder_fault) {
  const std::lock_guard hold(tell_mutex_);
  if (recorder_fault == told_) return;
  if (!recorder_fault.empty()) trouble(recorder_fault);
  told_ = recorder_fault;
  core_.set_recorder_fault(recorder_fault);
}

/// The rig is ready only where a run could be recorded. A run that is open says by itself what its disk does.
void Host::look_at_storage(std::int64_t now_ns, bool run_open) {
  const auto answer = storage_->take();
  if (run_open) {
    next_storage_look_ns_ = 0;
    return tell_core_of_storage({});
  }
  if (answer) {
    next_storage_look_ns_ = now_ns + (answer->empty() ? kStorageGoodNs : kStorageBadNs);
    return tell_core_of_storage(*answer);
  }
  if (now_ns >= next_storage_look_ns_) storage_->ask(now_ns);
  const auto asked_ns = storage_->asked_ns();
  // In a run this would be a recorder that has not come round: a program stop.
  if (const double limit_s = rig_.core.recorder_age_max_s;
      asked_ns && 1e-9 * static_cast<double>(now_ns - *asked_ns) > limit_s)
    return tell_core_of_storage("the disk has not answered for " + base::number_text(limit_s) + " s");
}

void Host::tell_core_of_storage(const std::string& why) {
  if (why == storage_told_) return;
  if (!core_.set_storage(why.empty() ? why : "no run could be recorded: " + why)) return;  // in the next look
  if (!why.empty()) trouble("no run could be recorded in " + options_.runs_root.string() + ": " + why);
  storage_told_ = why;
}

void Host::close_when_over(Run& run, std::int64_t now_ns) {
  const auto now = core_.loop_status();
  if (now.runs_started != run.run_number || now.run_loaded || now.outcome == Outcome::kNone ||
      now.control.state == RunState::kStopping) {
    return;
  }
  if (run.over_since_ns < 0) run.over_since_ns = now_ns;
  const bool faulted = now.control.state == RunState::kFaulted;
  if (faulted && now_ns - run.over_since_ns <= kAfterFaultNs) return;
  if (now_ns < run.try_again_ns) return;
  close_run(run, outcome_text(run, now.outcome), now.outcome == Outcome::kDone, now_ns);
}

/// With run.recording held. False: not everything could be written; the run stays open, and is tried again.
bool Host::close_run(Run& run, const std::string& outcome, bool complete, std::int64_t now_ns) {
  try {
    const bool written = run.finished ? run.recorder->settle() : run.recorder->finish(recording_, complete);
    run.finished = true;
    auto status = run.recorder->status();
    // What the disk has lost it will not take when asked again.
    std::error_code ignored;
    const bool gone = !std::filesystem::exists(run.directory, ignored);
    const bool hopeless = gone || (status.disk >= DiskCondition::kUnvouched && status.catalogue_error.empty());
    if (!written && !hopeless) {
      run.try_again_ns = now_ns + kTryAgainNs;
      tell_core("run " + run.id + " is over and not written yet: " + trouble_of(status));
      const std::lock_guard lock(mutex_);
      recorder_status_ = std::move(status);
      return false;
    }
    std::string ended = outcome, fault = last_fault();
    if (ended == "done" && !status.fault.empty()) {
      ended = "failed";
      fault = status.fault;
    }
    catalogue_.close_run(run.id, ended, fault);
    run.recorder.reset();
    run.closed = true;
    tell_core("");
    const std::lock_guard lock(mutex_);
    recorder_status_ = std::move(status);
    last_outcome_ = ended;
    last_fault_ = fault;
    finished_id_ = run.id;
    finished_directory_ = run.directory;
    finished_epoch_unix_us_ = run.epoch_unix_us;
    run_.reset();
    if (options_.on_closed) options_.on_closed(run.directory);
    return true;
  } catch (const std::exception& e) {
    run.try_again_ns = now_ns + kTryAgainNs;
    tell_core("run " + run.id + " cannot be closed yet: " + e.what());
    return false;
  }
}

bool Host::shut_down(const std::function<bool()>& give_up) {
  const auto run = take_events();
  if (!run) return true;
  const auto now = core_.status();
  const bool over = now.runs_started == run->run_number && !now.run_loaded && now.outcome != Outcome::kNone;
  const bool done = over && now.outcome == Outcome::kDone;
  const std::string outcome = over ? outcome_text(*run, now.outcome) : "interrupted";
  for (;;) {
    {
      const std::lock_guard recording(run->recording);
      if (run->closed || close_run(*run, outcome, done, 0)) return true;
    }
    if (!give_up || give_up()) return false;
    std::this_thread::sleep_for(std::chrono::milliseconds(100));
  }
}

bool Host::is_between_runs() const {
  const auto state = core_.status().control.state;
  return !run_open() && (state == RunState::kIdle || state == RunState::kReady);
}

bool Host::run_open() const {
  const std::lock_guard lock(mutex_);
  return run_ != nullptr;
}

bool Host::disk_answers(std::int64_t now_ns) {
  return !storage_ || storage_->answers(now_ns);
}

std::string Host::run_id() const {
  const std::lock_guard lock(mutex_);
  return run_ ? run_->id : finished_id_;
}

double Host::longest_s() const {
  const std::lock_guard lock(mutex_);
  return run_ ? run_->longest_s : 0.0;
}

Host::Result Host::parted(const Parting& parting) {
  {
    const std::lock_guard lock(mutex_);
    if (!run_ || run_->id != parting.run)
      return {false, "run " + parting.run + " is not open: a twin parts from the muscle in the run that goes on", {}};
  }
  if (options_.on_parted) options_.on_parted(parting.run, parting.text, parting.then);
  return {true, "told whom [notify] names", parting.run};
}

std::filesystem::path Host::run_directory() const {
  const std::lock_guard lock(mutex_);
  return run_ ? run_->directory : finished_directory_;
}

std::string Host::last_outcome() const {
  const std::lock_guard lock(mutex_);
  return last_outcome_;
}

std::string Host::last_fault() const {
  const std::lock_guard lock(mutex_);
  return last_fault_;
}

RecorderStatus Host::recorder_status() const {
  const std::lock_guard lock(mutex_);
  return recorder_status_;
}

}  // namespace isorig::daemon
