#include <algorithm>
#include <cmath>

#include "daemon/host/host_run.hpp"

/// Host: what status and events show.
namespace isorig::daemon {
namespace {

using nlohmann::json;

json finite_or_null(double value) {
  return std::isfinite(value) ? json(value) : json();
}

/// Since the last reset, in the order in which they came.
json faults_json(const Status& s) {
  auto list = json::array();
  for (std::uint32_t i = 0; i < s.fault_count; ++i) {
    const auto& f = s.faults[i];
    list.push_back({{"mono_ns", f.mono_ns}, {"severity", to_text(f.severity)}, {"code", f.code}, {"text", f.text}});
  }
  return list;
}

json link_json(const LinkHealth& h) {
  return {{"connected", h.connected},
          {"clock_ready", h.clock_ready},
          {"bound_us", finite_or_null(double{h.bound_ns} * 1e-3)},
          {"repeatability_us", finite_or_null(double{h.repeatability_ns} * 1e-3)},
          {"lost", h.lost},
          {"corrupt", h.corrupt},
          {"errors", h.errors},
          {"reconnects", h.reconnects},
          {"detail", h.detail}};
}

json interlock_json(const Status& s, const RigConfig& rig) {
  return {{"watched", rig.unwatched_chain.empty()},
          {"not_watched", rig.unwatched_chain},
          {"estop_closed", s.estop_closed},
          {"guard_closed", s.guard_closed},
          {"connected", s.interlock.connected},
          {"lost_edges", s.interlock.lost},
          {"errors", s.interlock.errors},
          {"reconnects", s.interlock.reconnects},
          {"detail", s.interlock.detail}};
}

json sync_line_json(const Status& s) {
  return {{"pairs", s.sync.pairs},
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
          {"worst_us", s.sync.worst_us}};
}

json rig_file_json(const RigAcceptance& acceptance, bool sign_off_required) {
  json changes = json::array();
  for (const auto& c : acceptance.changes()) changes.push_back({{"key", c.key}, {"before", c.before}, {"now", c.now}});
  return {{"sign_off", sign_off_required ? "required" : "warn"},
          {"accepted", acceptance.in_force()},
          {"accepted_by", acceptance.operator_name()},
          {"accepted_uid", acceptance.uid()},
          {"accepted_utc", acceptance.when_utc()},
          {"changes", changes}};
}

json operator_and_state_json(const Status& s, const RigConfig& rig) {
  return {{"rig", rig.name},
          {"state", to_text(s.control.state)},
          {"healthy", s.healthy},
          {"not_ready", s.not_ready},
          {"fault", s.fault},
          {"faults", faults_json(s)},
          {"zero_confirmed", s.zero_confirmed},
          {"arming", rig.core.operating.arming_required ? "required" : "none"},
          {"simulated", rig.simulated()},
          {"operator_left_s", s.operator_left_s < 0.0F ? json() : json(s.operator_left_s)},
          {"mono_ns", s.control.mono_ns}};
}

json measured_and_commanded_json(const Status& s) {
  return {{"position_mm", s.control.position_mm},
          {"force_N", s.control.force_N},
          {"pressure_psi", s.control.pressure_psi},
          {"frame_age_s", s.frame_age_s},
          {"pressure_age_s", s.pressure_age_s},
          {"setpoint_psi", s.control.setpoint_psi},
          {"fill_permille", s.control.fill_permille},
          {"vent_permille", s.control.vent_permille},
          {"sealed", s.sealed},
          {"target_mm", s.control.target_mm},
          {"velocity_mm_s", s.control.velocity_mm_s},
          {"progress", s.control.progress},
          {"remaining_s", s.control.remaining_s}};
}

json health_json(const Status& s, const RigConfig& rig) {
  return {{"loop",
           {{"ticks", s.control.ticks},
            {"overruns", s.control.overruns},
            {"worst_wakeup_us", s.worst_wakeup_ns * 1e-3},
            {"worst_run_us", s.worst_run_ns * 1e-3}}},
          {"frame", link_json(s.frame)},
          {"pressure", link_json(s.pressure)},
          {"regulator", rig.regulator ? link_json(s.regulator) : json()},
          {"interlock", interlock_json(s, rig)},
          {"sync_line", sync_line_json(s)},
          {"invalid_pressure_words", s.invalid_pressure},
          {"records_dropped", s.records_dropped},
          {"publish_dropped", s.publish_dropped}};
}

/// `loop_step` is kNoStep until the loop has taken the run up: then the step that will be the first.
json run_json(const std::string& id, const std::filesystem::path& directory, const protocol::Plan& plan,
              std::uint32_t first_session, std::uint32_t loop_step) {
  const std::size_t at = loop_step != kNoStep    ? loop_step
                         : plan.sessions.empty() ? 0
                                                 : plan.sessions[first_session].first_step;
  const std::size_t index = std::min(at, plan.steps.size() - 1);
  const auto& step = plan.steps[index];
  const bool in_session = step.session != protocol::kNoSession;
  return {{"id", id},
          {"directory", directory.string()},
          {"protocol", plan.name},
          {"step", index},
          {"steps", plan.steps.size()},
          {"step_text", protocol::describe(step)},
          {"session", in_session ? json(step.session) : json()},
          {"session_text", in_session ? plan.sessions[step.session].label : ""},
          {"sessions", plan.sessions.size()}};
}

json recorder_json(const RecorderStatus& r) {
  return {{"disk", describe(r.disk)},
          {"free_MiB", r.free_bytes >> 20U},
          {"written_MiB", static_cast<double>(r.written_bytes) / 1048576.0},
          {"lost_messages", r.lost_messages},
          {"dropped_records", r.dropped_records},
          {"missing_samples", r.frame_missing + r.pressure_missing},
          {"segment", r.segment},
          {"error", r.error}};
}

}  // namespace

nlohmann::json Host::status_json() const {
  const auto s = core_.status();
  json out = operator_and_state_json(s, rig_);
  out.update(measured_and_commanded_json(s));
  out.update(health_json(s, rig_));
  const std::lock_guard lock(mutex_);
  if (acceptance_) out["rig_file"] = rig_file_json(*acceptance_, rig_.core.operating.sign_off_required);
  if (const Run* run = run_.get(); run != nullptr) {
    out["run"] = run_json(run->id, run->directory, *run->plan, run->first_session, s.control.step);
    out["recorder"] = recorder_json(recorder_status_);
  } else {
    out["last_run"] = {{"id", finished_id_},
                       {"outcome", last_outcome_},
                       {"fault", last_fault_},
                       {"missing_samples", recorder_status_.frame_missing + recorder_status_.pressure_missing},
                       {"lost_messages", recorder_status_.lost_messages},
                       {"dropped_records", recorder_status_.dropped_records}};
  }
  return out;
}

nlohmann::json Host::events_json(std::uint64_t after) const {
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
  std::vector<double> elongation_at_zero_mm;
  {
    const std::lock_guard lock(mutex_);
    if (run_ == nullptr) return out;
    plan = run_->plan;
    elongation_at_zero_mm = run_->elongation_at_zero_mm;
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
  json references = json::array();
  for (std::size_t i = 0; i < plan->sessions.size() && i < elongation_at_zero_mm.size(); ++i) {
    references.push_back(
        {{"pressure_psi", plan->sessions[i].pressure_psi}, {"elongation_at_zero_mm", elongation_at_zero_mm[i]}});
  }
  out.update({{"protocol", plan->name},
              {"nominal_s", plan->nominal_s},
              {"worst_s", plan->worst_s},
              {"first_step", plan->sessions[first_session].first_step},
              {"sessions", std::move(sessions)},
              {"references", std::move(references)},
              {"twin", plan->twin.model.empty() ? json()
                                                : json{{"model", plan->twin.model},
                                                       {"on_parting", protocol::name_of(plan->twin.on_parting)}}},
              {"steps", std::move(steps)}});
  return out;
}

}  // namespace isorig::daemon
