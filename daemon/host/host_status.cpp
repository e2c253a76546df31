#include <algorithm>
#include <cmath>

#include "daemon/host/host_run.hpp"

/// Host: what status and events show.
namespace isorig::daemon {
namespace {

nlohmann::json finite_or_null(double value) {
  return std::isfinite(value) ? nlohmann::json(value) : nlohmann::json();
}

/// Since the last reset, in the order in which they came.
nlohmann::json faults_json(const Status& s) {
  auto list = nlohmann::json::array();
  for (std::uint32_t i = 0; i < s.fault_count; ++i) {
    const auto& f = s.faults[i];
    list.push_back({{"mono_ns", f.mono_ns}, {"severity", to_text(f.severity)}, {"code", f.code}, {"text", f.text}});
  }
  return list;
}

}  // namespace

nlohmann::json Host::status_json() const {
  using nlohmann::json;
  const auto s = core_.status();
  const auto link = [](const LinkHealth& h) {
    return json{{"connected", h.connected},
                {"clock_ready", h.clock_ready},
                {"bound_us", finite_or_null(double{h.bound_ns} * 1e-3)},
                {"repeatability_us", finite_or_null(double{h.repeatability_ns} * 1e-3)},
                {"lost", h.lost},
                {"corrupt", h.corrupt},
                {"errors", h.errors},
                {"reconnects", h.reconnects},
                {"detail", h.detail}};
  };
  json out{{"rig", rig_.name},
           {"state", to_text(s.control.state)},
           {"healthy", s.healthy},
           {"not_ready", s.not_ready},
           {"fault", s.fault},
           {"faults", faults_json(s)},
           {"zero_confirmed", s.zero_confirmed},
           {"arming", rig_.core.operating.arming_required ? "required" : "none"},
           {"simulated", rig_.simulated()},
           {"operator_left_s", s.operator_left_s < 0.0F ? json() : json(s.operator_left_s)},
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
            {{"watched", rig_.unwatched_chain.empty()},
             {"not_watched", rig_.unwatched_chain},
             {"estop_closed", s.estop_closed},
             {"guard_closed", s.guard_closed},
             {"connected", s.interlock.connected},
             {"lost_edges", s.interlock.lost},
             {"errors", s.interlock.errors},
             {"reconnects", s.interlock.reconnects},
             {"detail", s.interlock.detail}}},
           {"sync_line",
            {{"pairs", s.sync.pairs},
             {"outside", s.sync.outside},
             {"unseen", s.sync.unseen},
             {"unannounced", s.sync.unannounced},
             {"ambiguous", s.sync.ambiguous},
             {"unmapped", s.sync.unmapped},
             {"wrong_polarity", s.sync.wrong_polarity},
             {"inverted", s.sync.inverted},
             {"error_us", s.sync_check.error_us},
             {"bound_us", s.sync_check.bound_us},
             {"within", s.sync_check.within},
             {"mean_us", s.sync.mean_us},
             {"rms_us", s.sync.rms_us},
             {"worst_us", s.sync.worst_us}}},
           {"invalid_pressure_words", s.invalid_pressure},
           {"records_dropped", s.records_dropped},
           {"publish_dropped", s.publish_dropped}};
  const std::lock_guard lock(mutex_);
  if (acceptance_) {
    json changes = json::array();
    for (const auto& c : acceptance_->changes())
      changes.push_back({{"key", c.key}, {"before", c.before}, {"now", c.now}});
    out["rig_file"] = {{"sign_off", rig_.core.operating.sign_off_required ? "required" : "warn"},
                       {"accepted", acceptance_->in_force()},
                       {"accepted_by", acceptance_->operator_name()},
                       {"accepted_uid", acceptance_->uid()},
                       {"accepted_utc", acceptance_->when_utc()},
                       {"changes", changes}};
  }
  if (const Run* run = run_.get(); run != nullptr) {
    // Until the loop has taken it up there is no step yet: the first that will be.
    const std::size_t at = s.control.step == kNoStep
                               ? run->plan->sessions.empty() ? 0 : run->plan->sessions[run->first_session].first_step
                               : s.control.step;
    const std::size_t index = std::min(at, run->plan->steps.size() - 1);
    const auto& step = run->plan->steps[index];
    out["run"] = {{"id", run->id},
                  {"directory", run->directory.string()},
                  {"protocol", run->plan->name},
                  {"step", index},
                  {"steps", run->plan->steps.size()},
                  {"step_text", protocol::describe(step)},
                  {"session", step.session == protocol::kNoSession ? json() : json(step.session)},
                  {"session_text", step.session == protocol::kNoSession ? "" : run->plan->sessions[step.session].label},
                  {"sessions", run->plan->sessions.size()}};
    const auto& r = recorder_status_;
    out["recorder"] = {{"disk", describe(r.disk)},
                       {"free_MiB", r.free_bytes >> 20U},
                       {"written_MiB", static_cast<double>(r.written_bytes) / 1048576.0},
                       {"lost_messages", r.lost_messages},
                       {"dropped_records", r.dropped_records},
                       {"missing_samples", r.frame_missing + r.pressure_missing},
                       {"segment", r.segment},
                       {"error", r.error}};
  } else {
    out["last_run"] = {{"id", finished_id_}, {"outcome", last_outcome_}, {"fault", last_fault_}};
  }
  return out;
}

nlohmann::json Host::events_json(std::uint64_t after) const {
  using nlohmann::json;
  std::vector<EventHistory::Entry> entries;
  std::uint64_t last = 0;
  {
    const std::lock_guard lock(mutex_);
    entries = events_.after(after);
    last = events_.last_number();
  }
  json list = json::array();
  for (const auto& e : entries) {
    list.push_back({{"number", e.number},
                    {"count", e.count},
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
  return {{"events", list}, {"last", last}};
}

nlohmann::json Host::plan_json() const {
  using nlohmann::json;
  const auto& l = rig_.limits;
  json out{{"rig", rig_.name},
           {"limits",
            {{"travel_min_mm", l.travel_min_mm},
             {"travel_max_mm", l.travel_max_mm},
             {"force_min_N", l.force_min_N},
             {"force_max_N", l.force_max_N},
             {"pressure_max_psi", l.pressure_max_psi}}},
           {"run", json()}};
  std::shared_ptr<const protocol::Plan> plan;
  std::size_t first_session = 0;
  {
    const std::lock_guard lock(mutex_);
    if (run_ == nullptr) return out;
    plan = run_->plan;
    first_session = run_->first_session;
    out["run"] = run_->id;
  }
  json steps = json::array(), sessions = json::array();
  for (const auto& s : plan->steps) {
    steps.push_back({{"do", protocol::name_of(s.kind)},
                     {"text", protocol::describe(s)},
                     {"session", s.session == protocol::kNoSession ? json() : json(s.session)},
                     {"start_s", s.start_s},
                     {"nominal_s", s.nominal_s},
                     {"worst_s", s.worst_s}});
  }
  for (const auto& s : plan->sessions) sessions.push_back(s.label);
  out.update({{"protocol", plan->name},
              {"nominal_s", plan->nominal_s},
              {"worst_s", plan->worst_s},
              {"first_step", plan->sessions[first_session].first_step},
              {"sessions", std::move(sessions)},
              {"steps", std::move(steps)}});
  return out;
}

}  // namespace isorig::daemon
