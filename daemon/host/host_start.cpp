#include <algorithm>
#include <cctype>
#include <chrono>

#include "base/toml_reader.hpp"
#include "base/utc_text.hpp"
#include "daemon/host/corrections.hpp"
#include "daemon/host/host_prepared.hpp"
#include "daemon/host/host_run.hpp"
#include "daemon/host/not_there.hpp"
#include "daemon/recording/amendments.hpp"
#include "messages/segment_files.hpp"
#include "protocol/compile.hpp"

/// Host: how a run is opened.
namespace isorig::daemon {
namespace {

constexpr auto kClosePatience = std::chrono::seconds(5);

std::int64_t unix_now_us() {
  return std::chrono::duration_cast<std::chrono::microseconds>(std::chrono::system_clock::now().time_since_epoch())
      .count();
}

std::string stem_of(const std::string& file_name) {
  std::string stem = std::filesystem::path(file_name).stem().string();
  std::replace_if(
      stem.begin(), stem.end(), [](char c) { return !std::isalnum(static_cast<unsigned char>(c)) && c != '-'; }, '-');
  return stem.empty() ? "protocol" : stem;
}

/// The first segment that is not there, with a later one or a finished repetition to show that it was; "" where none is
/// known to be missing.
std::string missing_segment(const RunRow& run) {
  const auto there = messages::list_segments(run.directory);
  for (std::size_t i = 0; i < there.size(); ++i) {
    const int due = static_cast<int>(i) + 1;
    if (messages::segment_number(there[i]) != due) return messages::segment_name(due);
  }
  return there.empty() && run.sessions_done > 0 ? messages::segment_name(1) : std::string();
}

}  // namespace

Host::Result Host::start(const StartOptions& options) {
  const std::lock_guard one_at_a_time(start_mutex_);
  if (ending_) return {false, "isorigd is ending", {}};
  if (auto closed = await_closed_run(); !closed.ok) return closed;
  const auto now = core_.status();
  if (now.control.state != RunState::kReady) {
    // The loop decides again below; this spares a run directory that would be empty.
    const std::string state = to_text(now.control.state);
    return {false,
            "the rig is " + state + (now.not_ready[0] != '\0' ? std::string(": ") + now.not_ready : "") +
                "; a protocol starts from ready (isorig status)",
            {}};
  }
  armed_.reset();  // of a start before this one: if this one fails, and the rig is armed all the same, nothing runs
  // What corrects the samples has to be what the run's header says.
  if (auto taken = put_in_force(); !taken.ok) {
    return {false, "a calibration that is kept cannot be put in force: " + taken.text, {}};
  }
  auto p = std::make_unique<Prepared>();
  if (auto refused = prepare(options, *p)) return *refused;
  if (!rig_.core.operating.arming_required) return begin(now, *p, Request::Verb::kStart);
  Request request;
  request.verb = Request::Verb::kArm;
  auto result = ask(request);
  if (!result.ok) return result;
  result.text += p->warnings;
  armed_ = std::move(p);
  return result;
}

/// Opens the run and gives it to the loop. With start_mutex_ held.
Host::Result Host::begin(const Status& now, Prepared& p, Request::Verb verb) {
  if (ending_) return {false, "isorigd is ending", {}};
  auto& run = *p.run;
  run.run_number = now.runs_started + 1;
  run.epoch_unix_us = options_.epoch_unix_us();
  p.wall_us = options_.virtual_time ? unix_now_us() : run.epoch_unix_us + now.control.mono_ns / 1000;
  reserve_folder(p);
  describe_run(now, p);
  p.recording.dropped_before = recording_.dropped();
  try {
    run.recorder = std::make_unique<Recorder>(p.recording, p.info);
    run.recorder->on_session([this, id = run.id](const SessionChange& change) { catalogue_.on_session(id, change); });
    catalogue_.open_run(run.id, p.info, *run.plan, p.protocol_name, p.operator_name);
    if (!p.changed.empty()) append_amendment(run.directory, {utc_now(), p.operator_name, {}, {}, p.changed});
  } catch (...) {
    run.recorder.reset();
    std::error_code ignored;  // nothing was recorded: no folder stays that no catalogue knows
    if (p.new_folder) std::filesystem::remove_all(run.directory, ignored);
    throw;
  }
  lent_.push_back(run.plan);
  {
    const std::lock_guard lock(mutex_);
    run_ = p.run;
    recorder_status_ = run.recorder->status();
    last_fault_.clear();
  }
  note_rig_changes();

  if (ending_) {
    const std::lock_guard recording(run.recording);
    close_run(run, "refused", false, now.control.mono_ns);
    return {false, "isorigd is ending", {}};
  }
  Request request;
  request.verb = verb;
  request.plan = run.plan.get();
  request.first_session = run.first_session;
  auto result = ask(request);
  if (result.ok) {
    // The loop has taken this plan up, so it has let go of the ones before.
    lent_.erase(lent_.begin(), lent_.end() - 1);
    result.run = run.id;
    result.text = verb == Request::Verb::kStart ? "run " + run.id + " started" : "run " + run.id + ": " + result.text;
    result.text += p.warnings;
    return result;
  }
  // A loop that did not answer in time may still take the start: it must not go on without a recorder.
  core_.request_abort();
  const std::lock_guard recording(run.recording);
  if (!run.closed) close_run(run, run.resumed ? "interrupted" : "refused", false, now.control.mono_ns);
  return result;
}

/// A finished run is closed by the recorder's next turn, and until then its recorder is at work.
Host::Result Host::await_closed_run() {
  const auto deadline = std::chrono::steady_clock::now() + kClosePatience;
  while (run_open()) {
    const auto now = core_.status();
    if (now.run_loaded || now.control.state == RunState::kFaulted || std::chrono::steady_clock::now() > deadline) {
      std::string why = std::string("the rig is ") + to_text(now.control.state) + ": ";
      why += now.run_loaded ? "a run is under way; abort it first (isorig abort)"
             : now.control.state == RunState::kFaulted
                 ? "see to the cause, then isorig reset"
                 : "the run before this one is still being written; try again in a moment";
      return {false, why, {}};
    }
    if (options_.breathe) turn(now.control.mono_ns);  // one thread: there is no recorder's thread to wait for
    breathe();
  }
  return {true, {}, {}};
}

/// Everything that can be refused before something is written. Nothing: go on.
std::optional<Host::Result> Host::prepare(const StartOptions& options, Prepared& p) {
  for (const auto& text : overdue()) {
    if (rig_.calibration.refuse_overdue) {
      return Result{
          false, text + "; calibrate (isorig calibrate), or allow it with [calibration] overdue = \"warn\"", {}};
    }
    p.warnings += "\nwarning: " + text;
  }
  p.operator_name = options.operator_name;
  if (acceptance_) {
    const std::lock_guard lock(mutex_);
    if (!acceptance_->in_force() && rig_.core.operating.sign_off_required) {
      return Result{false, acceptance_->summary() + "\nlook at it, then: isorig accept-rig --operator NAME", {}};
    }
    if (!acceptance_->changes().empty()) p.warnings += "\nwarning: " + acceptance_->summary();
  }
  p.run = std::make_shared<Run>();
  auto& run = *p.run;
  p.protocol_text = options.protocol_text;
  p.protocol_name = options.protocol_name;
  p.specimen_text = options.specimen_text;
  p.specimen_name = options.specimen_name;
  if (!options.resume_run.empty()) {
    if (auto refused = take_saved_run(options, p)) return refused;
  }
  run.plan = std::make_shared<const protocol::Plan>(
      protocol::compile(base::TomlDocument::parse_text(p.protocol_text, p.protocol_name), rig_.limits));
  for (const auto& text : run.plan->warnings) p.warnings += "\nwarning: " + text;
  if (run.first_session >= run.plan->sessions.size()) {
    return Result{false, "run " + run.id + " has every repetition; nothing is left to resume", run.id};
  }
  p.specimen =
      p.specimen_text.empty() ? load_specimen(rig_.specimen) : parse_specimen(p.specimen_text, p.specimen_name);

  p.recording.average_interval_s = run.plan->recording.average_interval_s;
  p.recording.before_s = run.plan->recording.before_s;
  p.recording.sync_interval_s =
      options_.virtual_time ? rig_.recording.virtual_sync_interval_s : rig_.recording.sync_interval_s;
  p.recording.min_free_bytes = rig_.recording.min_free_bytes;
  p.recording.reserve_bytes = rig_.recording.reserve_bytes;
  p.recording.max_segment_bytes = rig_.recording.max_segment_bytes;
  p.recording.free_bytes = options_.free_bytes;
  const double full_s = run.plan->full_rate_s;
  const auto whole = estimate_bytes(full_s, run.plan->nominal_s - full_s, p.recording.average_interval_s);
  // Of a run that goes on only the rest is still to be recorded.
  const double begin_s = run.plan->steps[run.plan->sessions[run.first_session].first_step].start_s;
  const double rest = run.plan->nominal_s > 0.0 ? std::clamp(1.0 - begin_s / run.plan->nominal_s, 0.0, 1.0) : 1.0;
  const auto needed = static_cast<std::uint64_t>(rest * static_cast<double>(whole));
  std::filesystem::create_directories(options_.runs_root);
  const auto free = std::filesystem::space(options_.runs_root).available;
  if (free < needed + p.recording.min_free_bytes) {
    return Result{
        false,
        (run.first_session > 0 ? "the rest of this protocol records about " : "this protocol records about ") +
            std::to_string(needed >> 20U) + " MiB and " + std::to_string(p.recording.min_free_bytes >> 20U) +
            " MiB are kept free, but " + options_.runs_root.string() + " has " + std::to_string(free >> 20U) +
            " MiB; make room first",
        {}};
  }
  p.recording.run_dir = run.directory;
  return std::nullopt;
}

/// What a run that goes on was begun with. Another rig or specimen than that is another measurement: it has to be said.
std::optional<Host::Result> Host::take_saved_run(const StartOptions& options, Prepared& p) {
  const auto known = catalogue_.find_run(options.resume_run);
  if (!known) {
    throw NotThere("no run is called " + options.resume_run + ", nor does one name begin so; isorig runs lists them");
  }
  if (const auto why = why_not_a_folder(*known); !why.empty()) return Result{false, why, known->id};
  if (const auto gone = missing_segment(*known); !gone.empty()) {
    return Result{false,
                  "run " + known->id + " cannot go on: " + gone + " is missing from " + known->directory.string() +
                      ", and what was recorded in it; put it back, or start a new run",
                  known->id};
  }
  auto& run = *p.run;
  const auto saved = catalogue_.inputs_of(known->id);
  run.id = known->id;
  run.resumed = true;
  run.directory = saved.directory;
  run.first_session = saved.first_open_session;
  p.protocol_text = saved.protocol_text;
  p.protocol_name = saved.protocol_name;
  if (known->state == "aborted" && !options.resume_aborted) {
    const std::string command = options_.virtual_time ? "isorig run --resume " : "isorig resume ";
    return Result{false,
                  "run " + run.id +
                      " was ended before its end, by `isorig abort`, by a signal or after a stop that nobody cleared; "
                      "to go on with it "
                      "all the same: " +
                      command + run.id + " --aborted" + (options_.virtual_time ? " --rig " + rig_.path.string() : ""),
                  run.id};
  }
  if (known->rig != rig_.name) {
    if (!options.on_another_rig) {
      return Result{false,
                    "run " + run.id + " was recorded on rig \"" + known->rig + "\", and this is \"" + rig_.name +
                        "\"; to go on here all the same: --on-another-rig",
                    run.id};
    }
    p.changed = "went on on rig \"" + rig_.name + "\", begun on \"" + known->rig + "\"";
  }
  const auto recorded = parse_specimen(saved.specimen_text, saved.specimen_name);
  const bool named = !options.specimen_text.empty();
  if (!named && rig_.specimen.empty()) {  // nobody says what is mounted: what was
    p.specimen_text = saved.specimen_text;
    p.specimen_name = saved.specimen_name;
    return std::nullopt;
  }
  const auto mounted =
      named ? parse_specimen(options.specimen_text, options.specimen_name) : load_specimen(rig_.specimen);
  if (mounted.name == known->specimen) {  // which may have been put right since (isorig note)
    p.specimen_text = mounted.name == recorded.name ? saved.specimen_text : mounted.text;
    p.specimen_name = mounted.name;
    return std::nullopt;
  }
  if (!options.another_specimen) {
    return Result{false,
                  "run " + run.id + " is of specimen \"" + known->specimen + "\", and \"" + mounted.name +
                      "\" is mounted (" + (named ? options.specimen_name : rig_.specimen.string()) + "); mount \"" +
                      known->specimen +
                      "\" and name its file with --specimen, or go on with the other all the same: --another-specimen",
                  run.id};
  }
  p.specimen_text = mounted.text;
  p.specimen_name = mounted.name;
  p.changed += (p.changed.empty() ? "" : "; ") +
               ("went on with specimen \"" + mounted.name + "\", begun with \"" + known->specimen + "\"");
  return std::nullopt;
}

/// Of a new run. A name is reserved by making its folder: another process may start in the same second.
void Host::reserve_folder(Prepared& p) {
  auto& run = *p.run;
  if (run.id.empty()) {
    const auto wanted =
        base::utc_text(p.wall_us / 1'000'000, "%Y%m%d-%H%M%S") + "-" + stem_of(p.protocol_name) + "-" + p.specimen.name;
    std::error_code error;
    do {
      run.id = catalogue_.new_run_id(wanted);
      run.directory = options_.runs_root / run.id;
    } while (!std::filesystem::create_directory(run.directory, error) && !error);
    if (error) {
      throw std::runtime_error("the run's folder " + run.directory.string() + " cannot be made: " + error.message() +
                               "; nothing was started. Mend the disk, or name another place (isorigd --runs)");
    }
    p.new_folder = true;
  }
  p.recording.run_dir = run.directory;
}

nlohmann::json Host::preview(const StartOptions& options) {
  const std::lock_guard one_at_a_time(start_mutex_);
  Prepared p;
  if (const auto refused = prepare(options, p)) return {{"ok", false}, {"text", refused->text}};
  const auto& plan = *p.run->plan;
  return {{"ok", true},
          {"text", "nothing was started"},
          {"run", p.run->id},
          {"rig", rig_.name},
          {"simulated", rig_.simulated()},
          {"specimen", p.specimen.name},
          {"specimen_is_the_rigs", options.specimen_text.empty() && options.resume_run.empty()},
          {"rest_length_mm", p.specimen.rest_length_mm},
          {"operator", options.operator_name},
          {"protocol", plan.name},
          {"sessions", plan.sessions.size()},
          {"first_session", p.run->first_session},
          {"nominal_s", plan.nominal_s},
          {"worst_s", plan.worst_s},
          {"pressure_max_psi", plan.pressure_max_psi},
          {"position_min_mm", plan.position_min_mm},
          {"position_max_mm", plan.position_max_mm},
          {"changed", p.changed},
          {"warnings", p.warnings}};
}

Host::Result Host::amend(const Correction& c) {
  const auto known = catalogue_.find_run(c.run);
  if (!known) throw NotThere("no run is called " + c.run + "; isorig runs lists them");
  if (const auto why = why_not_a_folder(*known); !why.empty()) return {false, why, {}};
  return {true, amend_run(catalogue_, *known, c), known->id};
}

void Host::describe_run(const Status& now, Prepared& p) {
  const auto& run = *p.run;
  auto& info = p.info;
  info.start_mono_ns = now.control.mono_ns;
  info.epoch_unix_us = run.epoch_unix_us;
  info.virtual_time = options_.virtual_time;
  info.seed = options_.seed;
  info.rig = rig_.name;
  info.specimen = p.specimen.name;
  info.rest_length_mm = p.specimen.rest_length_mm;
  info.plan_summary = run.plan->name + ": " + std::to_string(run.plan->steps.size()) + " steps, " +
                      std::to_string(run.plan->sessions.size()) + " sessions";
  info.texts = {{"rig.toml", rig_.text},
                {"protocol.toml", p.protocol_text},
                {"specimen.toml", p.specimen.text},
                {"calibration.toml", calibration_text()}};
  info.step_words.clear();
  for (const auto& step : run.plan->steps) info.step_words.push_back(protocol::describe(step));
  info.operator_name = p.operator_name;
  info.versions = provenance(p.operator_name, now);
  p.run->elongation_at_zero_mm.clear();
  for (const auto& session : run.plan->sessions) {
    const double rest_mm = p.specimen.pressurized_rest_length_mm(session.pressure_psi);
    info.sessions.push_back({session.first_step, session.repetition, session.pressure_psi, rest_mm});
    p.run->elongation_at_zero_mm.push_back(p.specimen.rest_length_mm - rest_mm);
  }
  const auto& steps = run.plan->steps;
  p.run->longest_s = 0.0;
  for (std::size_t i = run.plan->sessions[run.first_session].first_step; i < steps.size(); ++i) {
    p.run->longest_s += steps[i].worst_s;
  }
  info.first_session = static_cast<std::int32_t>(run.first_session);
  info.run_id = run.id;
  info.started_utc = base::utc_text(p.wall_us / 1'000'000);
}

}  // namespace isorig::daemon
