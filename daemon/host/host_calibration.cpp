#include <sched.h>
#include <sys/utsname.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <utility>

#include "base/toml_reader.hpp"
#include "calibration/date.hpp"
#include "daemon/host/host.hpp"
#include "daemon/recording/run_directory.hpp"
#include "daemon/rig/calibrations.hpp"
#include "daemon/version.hpp"

/// Host: what calibration and self-test ask for.
namespace isorig::daemon {
namespace {

using nlohmann::json;

json to_json(const Reading& r, const char* unit) {
  return {
      {"unit", unit},
      {"samples", r.samples},
      {"raw", r.raw},
      {"calibrated", r.calibrated},
      {"sd", r.sd},
      {"standard_error", r.standard_error},
      {"min", r.min},
      {"max", r.max},
      {"drift", r.drift},
      {"longest_run", r.longest_run},
      {"from_mono_ns", r.from_ns},
      {"to_mono_ns", r.to_ns},
      {"rate_hz",
       r.to_ns > r.from_ns ? static_cast<double>(r.samples - 1) * 1e9 / static_cast<double>(r.to_ns - r.from_ns) : 0.0},
      {"worst_gap_s", r.worst_gap_s},
      {"bound_us", std::isfinite(r.bound_ns) ? json(r.bound_ns * 1e-3) : json()}};
}

/// "VmLck:     1234 kB"
std::int64_t locked_kB() {
  std::ifstream in("/proc/self/status");
  std::string word;
  while (in >> word) {
    if (word == "VmLck:") {
      std::int64_t kB = 0;
      in >> kB;
      return kB;
    }
  }
  return -1;
}

/// Name, policy and priority of every thread of this process.
json threads_json() {
  json all = json::array();
  std::error_code none;
  for (const auto& entry : std::filesystem::directory_iterator("/proc/self/task", none)) {
    const auto tid = static_cast<pid_t>(std::atoi(entry.path().filename().c_str()));
    std::string name;
    std::ifstream in(entry.path() / "comm");
    std::getline(in, name);
    sched_param param{};
    const int policy = ::sched_getscheduler(tid);
    if (policy < 0 || ::sched_getparam(tid, &param) != 0) continue;
    all.push_back(
        {{"name", name}, {"fifo", (policy & ~SCHED_RESET_ON_FORK) == SCHED_FIFO}, {"priority", param.sched_priority}});
  }
  return all;
}

}  // namespace

json Host::readings_json(double window_s) const {
  const auto s = core_.status();
  std::lock_guard lock(mutex_);
  return {{"state", to_text(s.control.state)},
          {"mono_ns", s.control.mono_ns},
          {"window_s", window_s},
          {"lost", window_.lost()},
          {"position", to_json(window_.position(window_s), "mm")},
          {"force", to_json(window_.force(window_s), "N")},
          {"pressure", to_json(window_.pressure(window_s), "psi")},
          {"temperature", to_json(window_.temperature(window_s), "C")}};
}

json Host::calibrations_json() const {
  std::lock_guard lock(mutex_);
  json all = json::array();
  for (const auto& r : (waiting_ ? *waiting_ : records_).records()) {
    all.push_back({{"id", r.id},
                   {"channel", name_of(r.channel)},
                   {"mode", name_of(r.mode)},
                   {"made_utc", r.made_utc},
                   {"due", r.due},
                   {"operator", r.operator_name},
                   {"reference", r.reference.id},
                   {"scale", r.result.correction.scale},
                   {"offset", r.result.correction.offset},
                   {"uncertainty_k2", r.result.uncertainty},
                   {"supersedes", r.supersedes},
                   {"toml", to_toml(r)}});
  }
  const auto& l = rig_.limits;
  return {{"rig", rig_.name},
          {"directory", records_.directory().string()},
          {"in_force", daemon::to_json(records_)},
          {"records", all},
          {"limits",
           {{"travel_min_mm", l.travel_min_mm},
            {"travel_max_mm", l.travel_max_mm},
            {"force_min_N", l.force_min_N},
            {"force_max_N", l.force_max_N},
            {"pressure_max_psi", l.pressure_max_psi},
            {"pressure_rate_max_psi_s", std::min(l.pressure_rate_max_psi_s, l.loop_rate_max_psi_s)}}}};
}

json Host::selftest_json() const {
  const auto s = core_.status();
  const auto link = [](const LinkHealth& h) {
    return json{{"connected", h.connected}, {"clock_ready", h.clock_ready},
                {"identity", h.identity},   {"sample_rate_hz", h.sample_rate_hz},
                {"lost", h.lost},           {"corrupt", h.corrupt},
                {"errors", h.errors},       {"reconnects", h.reconnects},
                {"detail", h.detail}};
  };
  json out{{"version", kVersion},
           {"rig", rig_.name},
           {"simulated", rig_.simulated()},
           {"frame", link(s.frame)},
           {"pressure", link(s.pressure)},
           {"lateness", s.lateness},
           {"locked_kB", locked_kB()},
           {"threads", threads_json()},
           {"realtime",
            {{"enforced", rig_.realtime.enforce},
             {"priority", rig_.realtime.priority},
             {"period_us", rig_.realtime.period_ns / 1000},
             {"late_tick_max_s", rig_.core.supervisor.late_tick_max_s}}},
           {"lcm", {{"enabled", rig_.lcm.enabled}, {"url", rig_.lcm.url}}},
           {"limits",
            {{"travel_min_mm", rig_.limits.travel_min_mm},
             {"travel_max_mm", rig_.limits.travel_max_mm},
             {"speed_max_mm_s", rig_.limits.speed_max_mm_s},
             {"force_min_N", rig_.limits.force_min_N},
             {"force_max_N", rig_.limits.force_max_N},
             {"pressure_max_psi", rig_.limits.pressure_max_psi}}},
           {"runs", options_.runs_root.string()},
           {"min_free_MiB", rig_.recording.min_free_bytes >> 20U}};
  try {
    std::filesystem::create_directories(options_.runs_root);
    out["free_MiB"] = free_bytes(options_.runs_root) >> 20U;
    out["runs_writable"] = ::access(options_.runs_root.c_str(), W_OK) == 0;
  } catch (const std::exception& e) {
    out["runs_error"] = e.what();
  }
  if (rig_.sim) {
    // A simulated frame's own cabinet can be asked; a real one shows its limits on its panel.
    const auto& f = rig_.sim->frame;
    out["frame_limits"] = {{"travel_min_mm", f.travel_min_mm},
                           {"travel_max_mm", f.travel_max_mm},
                           {"force_min_N", f.force_min_N},
                           {"force_max_N", f.force_max_N},
                           {"speed_max_mm_s", f.speed_max_mm_s}};
  }
  return out;
}

Host::Result Host::add_calibration(const std::string& record_toml) {
  const auto record = calibration::parse_record(record_toml, "record");
  if (record.rig != rig_.name) {
    return {false, "the record is of rig \"" + record.rig + "\", and this is \"" + rig_.name + "\"", {}};
  }
  // Not while a run is being opened: its header has to tell the corrections that it is recorded with.
  const std::lock_guard one_at_a_time(start_mutex_);
  const auto state = core_.status().control.state;
  if (state != RunState::kIdle && state != RunState::kReady) {
    return {false, std::string("the rig is ") + to_text(state) + ": a calibration is put in force between runs", {}};
  }
  // A record that waits is followed by this one: who made it has to have seen it in force.
  if (const auto waited = put_in_force(); !waited.ok) {
    return {false, "a record before this one cannot be put in force: " + waited.text, {}};
  }
  if (const auto why = why_not_in_force(rig_, record); !why.empty()) {
    return {false, "the record " + record.id + " is not kept: " + why, {}};
  }
  // A copy is written, so that nobody who looks waits for the disk.
  auto records = [this] {
    const std::lock_guard lock(mutex_);
    return waiting_ ? *waiting_ : records_;
  }();
  records.add(record);
  {
    const std::lock_guard lock(mutex_);
    waiting_ = std::move(records);
  }
  const auto taken = put_in_force();
  if (!taken.ok) {
    return {false,
            "the record " + record.id + " is kept, and put in force before the next run starts; not now: " + taken.text,
            {}};
  }
  return {true, "calibration " + record.id + " is in force, due on " + record.due, {}};
}

/// What waits. With start_mutex_ held. The loop decides: it may have left ready meanwhile, or not answer.
Host::Result Host::put_in_force() {
  Request request;
  request.verb = Request::Verb::kCalibrate;
  {
    const std::lock_guard lock(mutex_);
    if (!waiting_) return {true, {}, {}};
    request.calibration = corrections_of(*waiting_);
    request.fill_limits = fill_limits(corrected(rig_, request.calibration));
  }
  auto taken = ask(request);
  if (!taken.ok) return taken;
  const std::lock_guard lock(mutex_);
  records_ = *std::exchange(waiting_, std::nullopt);
  return taken;
}

/// What a recording was made with. Nothing of it may differ between two machines in virtual time, where recordings are
/// compared byte by byte.
std::vector<std::pair<std::string, std::string>> Host::provenance(const std::string& operator_name,
                                                                  const Status& now) const {
  std::vector<std::pair<std::string, std::string>> all{
      {"isorig", kVersion}, {"git", options_.revision.empty() ? "unknown" : options_.revision}, {"lcm", kLcmVersion}};
  if (!operator_name.empty()) all.emplace_back("operator", operator_name);
  if (options_.virtual_time) return all;
  utsname kernel{};
  if (::uname(&kernel) == 0)
    all.emplace_back("kernel", std::string(kernel.sysname) + " " + kernel.release + " " + kernel.machine);
  for (const auto& [name, link] : {std::pair{"frame", &now.frame},
                                   {"pressure", &now.pressure},
                                   {"regulator", &now.regulator},
                                   {"interlock", &now.interlock}}) {
    if (link->identity[0] != '\0') all.emplace_back(name, link->identity);
  }
  return all;
}

std::vector<std::string> Host::overdue() const {
  std::lock_guard lock(mutex_);
  return records_.overdue(calibration::today());
}

std::string Host::calibration_text() const {
  std::lock_guard lock(mutex_);
  return records_.toml();
}

}  // namespace isorig::daemon
