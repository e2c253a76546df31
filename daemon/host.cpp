#include "daemon/host.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <ctime>
#include <iomanip>
#include <sstream>
#include <thread>

#include "daemon/calibrations.hpp"
#include "daemon/specimen.hpp"
#include "daemon/version.hpp"
#include "protocol/compile.hpp"

namespace isorig::daemon {
namespace {

constexpr std::size_t kEventsKept = 2000;
constexpr std::int64_t kAfterFaultNs = 5'000'000'000;
constexpr auto kVerbPatience = std::chrono::seconds(2);

std::string utc_text(std::int64_t unix_us, const char* format) {
  const auto seconds = static_cast<std::time_t>(unix_us / 1'000'000);
  std::tm tm{};
  gmtime_r(&seconds, &tm);
  std::ostringstream out;
  out << std::put_time(&tm, format);
  return out.str();
}

std::int64_t unix_now_us() {
  return std::chrono::duration_cast<std::chrono::microseconds>(std::chrono::system_clock::now().time_since_epoch())
      .count();
}

nlohmann::json finite_or_null(double value) { return std::isfinite(value) ? nlohmann::json(value) : nlohmann::json(); }

std::string stem_of(const std::string& file_name) {
  std::string stem = std::filesystem::path(file_name).stem().string();
  std::replace_if(
      stem.begin(), stem.end(), [](char c) { return !std::isalnum(static_cast<unsigned char>(c)) && c != '-'; }, '-');
  return stem.empty() ? "protocol" : stem;
}

}  // namespace

struct Host::Run {
  std::string id;
  std::filesystem::path directory;
  protocol::Plan plan;
  std::uint32_t first_session = 0;
  std::uint64_t run_number = 0;   ///< of the core: what its status says before is about an earlier run
  std::unique_ptr<Recorder> recorder;
};

Host::Host(const RigConfig& rig, Core& core, Streams& recording, Options options)
    : rig_(rig), core_(core), recording_(recording), options_(std::move(options)), catalogue_(options_.runs_root), records_(open_records(rig, options_.runs_root)) {
  if (!options_.virtual_time) core_.set_observer(&live_);
}

Host::~Host() = default;

Host::Result Host::start(const StartOptions& options) {
  const auto now = core_.status();
  if (now.control.state != RunState::kReady) {
    // The loop decides again below; this spares a run directory that would be empty.
    const std::string state = to_text(now.control.state);
    return {false,
            "the rig is " + state + (now.not_ready[0] != '\0' ? std::string(": ") + now.not_ready : "") +
                "; a protocol starts from ready (isorig status)",
            {}};
  }

  std::string warnings;
  for (const auto& text : overdue()) {
    if (rig_.calibration.refuse_overdue) {
      return {false, text + "; calibrate (isorig calibrate), or allow it with [calibration] overdue = \"warn\"", {}};
    }
    warnings += "\nwarning: " + text;
  }

  auto run = std::make_unique<Run>();
  std::string protocol_text = options.protocol_text, protocol_name = options.protocol_name;
  std::string specimen_text = options.specimen_text, specimen_name = options.specimen_name;
  if (!options.resume_run.empty()) {
    const auto known = catalogue_.find_run(options.resume_run);
    if (!known) {
      return {false, "no run is called " + options.resume_run + ", nor does one name begin so; isorig runs lists them", {}};
    }
    const auto saved = catalogue_.inputs_of(known->id);
    run->id = known->id;
    run->directory = saved.directory;
    run->first_session = saved.first_open_session;
    protocol_text = saved.protocol_text;
    protocol_name = saved.protocol_name;
    specimen_text = saved.specimen_text;
    specimen_name = saved.specimen_name;
  }
  const auto document = base::TomlDocument::parse_text(protocol_text, protocol_name);
  run->run_number = now.runs_started + 1;
  run->plan = protocol::compile(document, rig_.limits);
  if (run->first_session >= run->plan.sessions.size()) {
    return {false, "run " + run->id + " has every repetition; nothing is left to resume", run->id};
  }
  const Specimen specimen = specimen_text.empty() ? load_specimen(rig_.specimen)
                                                  : parse_specimen(specimen_text, specimen_name);

  const std::int64_t wall_us = options_.virtual_time ? unix_now_us() : options_.epoch_unix_us + now.control.mono_ns / 1000;
  if (run->id.empty()) {
    const auto wanted = utc_text(wall_us, "%Y%m%d-%H%M%S") + "-" + stem_of(protocol_name) + "-" + specimen.name;
    std::filesystem::create_directories(options_.runs_root);
    do {  // making the directory is what reserves the name: another process may start in the same second
      run->id = catalogue_.new_run_id(wanted);
      run->directory = options_.runs_root / run->id;
    } while (!std::filesystem::create_directory(run->directory));
  }

  RunInfo info;
  info.start_mono_ns = now.control.mono_ns;
  info.epoch_unix_us = options_.epoch_unix_us;
  info.virtual_time = options_.virtual_time;
  info.seed = options_.seed;
  info.rig = rig_.name;
  info.specimen = specimen.name;
  info.rest_length_mm = specimen.rest_length_mm;
  info.plan_summary = run->plan.name + ": " + std::to_string(run->plan.steps.size()) + " steps, " +
                      std::to_string(run->plan.sessions.size()) + " sessions";
  info.texts = {{"rig.toml", rig_.text},
                {"protocol.toml", protocol_text},
                {"specimen.toml", specimen.text},
                {"calibration.toml", calibration_text()}};
  info.versions = {{"isorig", kVersion}};
  for (const auto& session : run->plan.sessions) {
    info.sessions.push_back({session.first_step, session.repetition, session.pressure_psi,
                             specimen.pressurized_rest_length_mm(session.pressure_psi)});
  }
  info.first_session = static_cast<std::int32_t>(run->first_session);
  info.run_id = run->id;
  info.started_utc = utc_text(wall_us, "%Y-%m-%dT%H:%M:%SZ");

  RecorderOptions recording;
  recording.run_dir = run->directory;
  recording.average_interval_s = run->plan.recording.average_interval_s;
  recording.before_s = run->plan.recording.before_s;
  recording.sync_interval_s =
      options_.virtual_time ? rig_.recording.virtual_sync_interval_s : rig_.recording.sync_interval_s;
  recording.min_free_bytes = rig_.recording.min_free_bytes;
  recording.reserve_bytes = rig_.recording.reserve_bytes;
  recording.max_segment_bytes = rig_.recording.max_segment_bytes;
  const double full_s = run->plan.full_rate_s;
  const auto needed = estimate_bytes(full_s, run->plan.nominal_s - full_s, recording.average_interval_s);
  std::filesystem::create_directories(options_.runs_root);
  const auto free = std::filesystem::space(options_.runs_root).available;
  if (free < needed + recording.min_free_bytes) {
    return {false,
            "this protocol records about " + std::to_string(needed >> 20U) + " MiB and " +
                std::to_string(recording.min_free_bytes >> 20U) + " MiB are kept free, but " +
                options_.runs_root.string() + " has " + std::to_string(free >> 20U) + " MiB; make room first",
            {}};
  }

  {
    std::lock_guard lock(mutex_);
    run->recorder = std::make_unique<Recorder>(recording, info);
    run->recorder->on_session([this, id = run->id](const SessionChange& change) { catalogue_.on_session(id, change); });
    catalogue_.open_run(run->id, info, run->plan, protocol_name, options.operator_name);
    run_ = std::move(run);
    closing_since_ns_ = -1;
    last_fault_.clear();
  }

  Request request;
  request.verb = Request::Verb::kStart;
  request.plan = &run_->plan;
  request.first_session = run_->first_session;
  auto result = post(request);
  std::lock_guard lock(mutex_);
  if (!result.ok) {
    // A loop that did not answer in time may still take the start: it must not go on without a recorder.
    Request never_mind;
    never_mind.verb = Request::Verb::kAbort;
    core_.requests.push(never_mind);
    close_run("refused", false);
  } else {
    result.run = run_->id;
    result.text = "run " + run_->id + " started" + warnings;
  }
  return result;
}

Host::Result Host::verb(Request::Verb verb) {
  Request request;
  request.verb = verb;
  auto result = post(request);
  std::lock_guard lock(mutex_);
  if (run_) result.run = run_->id;
  return result;
}

Host::Result Host::post(Request request) {
  std::lock_guard one_at_a_time(verb_mutex_);
  request.id = next_request_++;
  if (!core_.requests.push(request)) return {false, "the loop does not take requests; is it running?", {}};
  const auto deadline = std::chrono::steady_clock::now() + kVerbPatience;
  Reply reply;
  while (std::chrono::steady_clock::now() < deadline) {
    while (core_.replies.pop(reply)) {
      if (reply.id == request.id) return {reply.accepted, reply.text, {}};
    }
    if (options_.breathe) {
      options_.breathe();
    } else {
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
  }
  return {false, "the real-time loop did not answer within 2 s; see isorig status", {}};
}

void Host::turn(std::int64_t now_ns) {
  std::lock_guard lock(mutex_);
  take_events();
  window_.drain(live_);
  if (!run_) {
    FrameRecord f;
    PressureRecord p;
    ControlRecord c;
    EventRecord e;
    ExchangeRecord x;
    SyncRecord s;
    while (recording_.frame.pop(f)) {}
    while (recording_.pressure.pop(p)) {}
    while (recording_.control.pop(c)) {}
    while (recording_.events.pop(e)) {}
    while (recording_.exchanges.pop(x)) {}
    while (recording_.sync.pop(s)) {}
    return;
  }
  run_->recorder->drain(recording_, now_ns);
  watch_disk();
  const auto now = core_.status();
  if (now.runs_started == run_->run_number && !now.run_loaded && now.outcome != Outcome::kNone && now.control.state != RunState::kStopping) {
    if (closing_since_ns_ < 0) closing_since_ns_ = now_ns;
    const bool faulted = now.control.state == RunState::kFaulted;
    if (!faulted || now_ns - closing_since_ns_ > kAfterFaultNs) {
      const bool done = now.outcome == Outcome::kDone;
      close_run(done ? "done" : now.outcome == Outcome::kAborted ? "aborted" : "failed", done);
    }
  }
}

void Host::watch_disk() {
  const auto disk = run_->recorder->disk();
  if (disk != disk_) core_.set_recorder_fault(disk >= DiskCondition::kLow);
  disk_ = disk;
}

void Host::take_events() {
  EventRecord record;
  while (core_.host_events.pop(record)) {
    events_.push_back({next_event_++, record});
    if (events_.size() > kEventsKept) events_.pop_front();
    if (options_.on_event) options_.on_event(record);
    if (record.severity >= Severity::kProgramStop) last_fault_ = std::string(record.code) + ": " + record.text;
  }
}

void Host::close_run(const std::string& outcome, bool complete) {
  run_->recorder->finish(recording_, complete);
  last_recorder_ = run_->recorder->status();
  run_->recorder.reset();
  disk_ = DiskCondition::kOk;  // the next run asks again before it starts
  core_.set_recorder_fault(false);
  catalogue_.close_run(run_->id, outcome, last_fault_);
  last_outcome_ = outcome;
  // The loop may look at the plan of the last run it took up until it takes up the next.
  if (outcome == "refused") {
    refused_.push_back(std::move(run_));
  } else {
    finished_ = std::move(run_);
  }
  closing_since_ns_ = -1;
}

void Host::shut_down() {
  std::lock_guard lock(mutex_);
  take_events();
  if (run_) close_run("interrupted", false);
}

bool Host::run_open() const {
  std::lock_guard lock(mutex_);
  return run_ != nullptr;
}

std::string Host::run_id() const {
  std::lock_guard lock(mutex_);
  return run_ ? run_->id : finished_ ? finished_->id : std::string();
}

std::filesystem::path Host::run_directory() const {
  std::lock_guard lock(mutex_);
  return run_ ? run_->directory : finished_ ? finished_->directory : std::filesystem::path();
}

std::string Host::last_outcome() const {
  std::lock_guard lock(mutex_);
  return last_outcome_;
}

std::string Host::last_fault() const {
  std::lock_guard lock(mutex_);
  return last_fault_;
}

RecorderStatus Host::recorder_status() const {
  std::lock_guard lock(mutex_);
  return run_ ? run_->recorder->status() : last_recorder_;
}

nlohmann::json Host::status_json() const {
  using nlohmann::json;
  const auto s = core_.status();
  std::lock_guard lock(mutex_);
  const auto link = [](const LinkHealth& h) {
    return json{{"connected", h.connected},   {"clock_ready", h.clock_ready},
                {"bound_us", finite_or_null(double{h.bound_ns} * 1e-3)},
                {"repeatability_us", finite_or_null(double{h.repeatability_ns} * 1e-3)},
                {"lost", h.lost},             {"corrupt", h.corrupt},
                {"errors", h.errors},         {"reconnects", h.reconnects},
                {"detail", h.detail}};
  };
  json out{{"rig", rig_.name},
           {"state", to_text(s.control.state)},
           {"healthy", s.healthy},
           {"not_ready", s.not_ready},
           {"fault", s.fault},
           {"mono_ns", s.control.mono_ns},
           {"position_mm", s.control.position_mm},
           {"force_N", s.control.force_N},
           {"pressure_psi", s.control.pressure_psi},
           {"frame_age_s", s.frame_age_s},
           {"pressure_age_s", s.pressure_age_s},
           {"setpoint_psi", s.control.setpoint_psi},
           {"fill_permille", s.control.fill_permille},
           {"vent_permille", s.control.vent_permille},
           {"target_mm", s.control.target_mm},
           {"velocity_mm_s", s.control.velocity_mm_s},
           {"progress", s.control.progress},
           {"remaining_s", s.control.remaining_s},
           {"loop",
            {{"ticks", s.control.ticks},
             {"overruns", s.control.overruns},
             {"worst_wakeup_us", s.worst_wakeup_ns * 1e-3},
             {"worst_run_us", s.worst_run_ns * 1e-3}}},
           {"frame", link(s.frame)},
           {"pressure", link(s.pressure)},
           {"regulator", rig_.regulator ? link(s.regulator) : json()},
           {"interlock",
            {{"estop_closed", s.estop_closed}, {"guard_closed", s.guard_closed}, {"connected", s.interlock.connected},
             {"lost_edges", s.interlock.lost}, {"errors", s.interlock.errors},
             {"reconnects", s.interlock.reconnects}, {"detail", s.interlock.detail}}},
           {"sync_line",
            {{"pairs", s.sync.pairs}, {"outside", s.sync.outside}, {"unseen", s.sync.unseen},
             {"unannounced", s.sync.unannounced}, {"ambiguous", s.sync.ambiguous}, {"unmapped", s.sync.unmapped},
             {"wrong_polarity", s.sync.wrong_polarity}, {"inverted", s.sync.inverted},
             {"error_us", s.sync_check.error_us}, {"bound_us", s.sync_check.bound_us},
             {"within", s.sync_check.within}, {"mean_us", s.sync.mean_us}, {"rms_us", s.sync.rms_us},
             {"worst_us", s.sync.worst_us}}},
           {"invalid_pressure_words", s.invalid_pressure},
           {"records_dropped", s.records_dropped},
           {"publish_dropped", s.publish_dropped}};
  const Run* run = run_ ? run_.get() : nullptr;
  if (run != nullptr) {
    // Until the loop has taken it up there is no step yet: the first that will be.
    const std::size_t at = s.control.step == kNoStep ? run->plan.sessions.empty()
                                                           ? 0
                                                           : run->plan.sessions[run->first_session].first_step
                                                     : s.control.step;
    const std::size_t index = std::min(at, run->plan.steps.size() - 1);
    const auto& step = run->plan.steps[index];
    out["run"] = {{"id", run->id},
                  {"directory", run->directory.string()},
                  {"protocol", run->plan.name},
                  {"step", index},
                  {"steps", run->plan.steps.size()},
                  {"step_text", protocol::describe(step)},
                  {"session", step.session == protocol::kNoSession ? json() : json(step.session)},
                  {"session_text",
                   step.session == protocol::kNoSession ? "" : run->plan.sessions[step.session].label},
                  {"sessions", run->plan.sessions.size()}};
    const auto r = run->recorder->status();
    out["recorder"] = {{"disk", describe(r.disk)},
                       {"free_MiB", r.free_bytes >> 20U},
                       {"written_MiB", static_cast<double>(r.written_bytes) / 1048576.0},
                       {"lost_messages", r.lost_messages},
                       {"dropped_records", r.dropped_records},
                       {"missing_samples", r.frame_missing + r.pressure_missing},
                       {"segment", r.segment},
                       {"error", r.error}};
  } else {
    out["last_run"] = {{"id", finished_ ? finished_->id : ""}, {"outcome", last_outcome_}, {"fault", last_fault_}};
  }
  return out;
}

nlohmann::json Host::events_json(std::uint64_t after) const {
  std::lock_guard lock(mutex_);
  using nlohmann::json;
  json list = json::array();
  for (const auto& e : events_) {
    if (e.number <= after) continue;
    list.push_back({{"number", e.number},
                    {"mono_ns", e.record.mono_ns},
                    {"severity", to_text(e.record.severity)},
                    {"code", e.record.code},
                    {"text", e.record.text},
                    {"from", to_text(e.record.from)},
                    {"to", to_text(e.record.to)},
                    {"step", e.record.step == kNoStep ? json() : json(e.record.step)},
                    {"value", e.record.value},
                    {"threshold", e.record.threshold}});
  }
  return {{"events", list}, {"last", next_event_ - 1}};
}

}  // namespace isorig::daemon
