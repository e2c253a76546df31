#include "daemon/export/tables.hpp"

#include <algorithm>
#include <cmath>

#include "base/printable.hpp"

namespace isorig::daemon {
namespace {

constexpr double kUnknown = std::numeric_limits<double>::quiet_NaN();

Column real(const char* name, const char* unit, const char* what, int decimals = 9) {
  return {name, ColumnType::kReal, unit, what, decimals};
}
Column whole(const char* name, const char* unit, const char* what) {
  return {name, ColumnType::kWhole, unit, what};
}
Column small(const char* name, const char* what) {
  return {name, ColumnType::kSmall, "", what};
}
Column text(const char* name, const char* what) {
  return {name, ColumnType::kText, "", what};
}

/// A step of the protocol as it was carried out.
struct Done {
  std::int32_t step = -1;
  std::string kind, words;
  std::int64_t begin_ns = 0, end_ns = 0;
  bool ended = false;  ///< the next one followed, or the session's end
  double from_mm = kUnknown, to_mm = kUnknown, velocity_mm_s = kUnknown, pressure_psi = kUnknown;
};

void from_plan(Done& d, const protocol::Step& s) {
  d.kind = protocol::name_of(s.kind);
  d.words = protocol::describe(s);
  d.from_mm = s.position_before_mm;
  d.to_mm = s.position_after_mm;
  d.pressure_psi = s.pressure_psi;
  d.velocity_mm_s = 0.0;
  if (s.kind == protocol::StepKind::kWave) d.velocity_mm_s = s.velocity_mm_s;
  if (s.kind == protocol::StepKind::kRamp) d.velocity_mm_s = std::copysign(s.velocity_mm_s, d.to_mm - d.from_mm);
}

void from_targets(Done& d, const std::map<std::int32_t, StepTargets>& targets) {
  const auto found = targets.find(d.step);
  if (found == targets.end()) return;
  const auto& [target_mm, velocity_mm_s, setpoint_psi] = found->second;
  d.to_mm = target_mm;
  d.pressure_psi = setpoint_psi;
  if (found != targets.begin()) d.from_mm = std::prev(found)->second.target_mm;
  d.velocity_mm_s = d.kind == "ramp" ? std::copysign(velocity_mm_s, d.to_mm - d.from_mm) : 0.0;
}

std::vector<Done> steps_of(const TableInput& in) {
  std::vector<Done> all;
  for (const auto& e : in.session->marks.events) {
    const bool ends = e.code == "session.end";  // what is recorded behind it is the venting
    if (e.code != "step" && e.code != "mark" && !ends) continue;
    if (!all.empty() && !(ends && all.back().ended && all.back().end_ns < e.mono_ns)) {
      all.back().end_ns = e.mono_ns;
      all.back().ended = true;
    }
    if (ends) continue;
    Done d;
    d.step = e.step;
    d.kind = e.code == "mark" ? "mark" : base::printable(e.text);
    d.words = base::printable(e.text);
    d.begin_ns = e.mono_ns;
    d.end_ns = in.end_ns;
    d.ended = in.session->complete;
    const bool planned = in.plan != nullptr && e.step >= 0 && static_cast<std::size_t>(e.step) < in.plan->size();
    if (planned) {
      from_plan(d, (*in.plan)[static_cast<std::size_t>(e.step)]);
    } else {
      from_targets(d, in.session->targets);
    }
    all.push_back(std::move(d));
  }
  return all;
}

double seconds(const TableInput& in, std::int64_t ns) {
  return static_cast<double>(ns - in.start_ns) / 1e9;
}

std::vector<Column> times() {
  return {small("step", "of the plan, as in the column step of the streams"), real("t_start_s", "s", "its begin"),
          real("t_end_s", "s", "its end"), small("complete", "1: it came to its end; 0: the recording ends within it")};
}

void put_times(Table& to, const TableInput& in, const Done& d) {
  to.whole(d.step).real(seconds(in, d.begin_ns)).real(seconds(in, d.end_ns)).whole(d.ended ? 1 : 0);
}

Table step_table(const TableInput& in, const std::vector<Done>& steps) {
  TableSchema s{"steps", "the protocol's steps as they were carried out", times()};
  s.columns.insert(
      s.columns.end(),
      {text("kind", "pressurize, settle, ramp, hold, wave, mark"), text("text", "the step in words"),
       real("from_mm", "mm", "planned position before it"), real("to_mm", "mm", "planned position after it"),
       real("velocity_mm_s", "mm/s", "planned, extension positive; of a wave its peak"),
       real("pressure_psi", "psi", "set-point, gauge"), whole("start_mono_ns", "ns", "CLOCK_MONOTONIC"),
       whole("end_mono_ns", "ns", "CLOCK_MONOTONIC")});
  Table t(std::move(s));
  for (const auto& d : steps) {
    put_times(t, in, d);
    t.text(d.kind).text(d.words).real(d.from_mm).real(d.to_mm).real(d.velocity_mm_s).real(d.pressure_psi);
    t.whole(d.begin_ns).whole(d.end_ns).end_row();
  }
  return t;
}

Table ramp_table(const TableInput& in, const std::vector<Done>& steps) {
  TableSchema s{"ramps", "ramps of constant velocity", times()};
  s.columns.insert(s.columns.end(), {real("from_mm", "mm", "planned start"), real("to_mm", "mm", "planned end"),
                                     real("velocity_mm_s", "mm/s", "planned, extension positive"),
                                     real("strain_rate_per_s", "1/s", "velocity over the specimen's reference length"),
                                     real("pressure_psi", "psi", "set-point, gauge")});
  Table t(std::move(s));
  for (const auto& d : steps) {
    if (d.kind != "ramp") continue;
    put_times(t, in, d);
    const double rate_per_s = in.length_mm > 0.0 ? d.velocity_mm_s / in.length_mm : kUnknown;
    t.real(d.from_mm).real(d.to_mm).real(d.velocity_mm_s).real(rate_per_s).real(d.pressure_psi).end_row();
  }
  return t;
}

Table hold_table(const TableInput& in, const std::vector<Done>& steps) {
  TableSchema s{"holds", "stretches at rest: holds, and settling until the force no longer moves", times()};
  s.columns.insert(s.columns.end(), {text("kind", "hold, settle"), real("position_mm", "mm", "planned"),
                                     real("pressure_psi", "psi", "set-point, gauge")});
  Table t(std::move(s));
  for (const auto& d : steps) {
    if (d.kind != "hold" && d.kind != "settle") continue;
    put_times(t, in, d);
    t.text(d.kind).real(d.to_mm).real(d.pressure_psi).end_row();
  }
  return t;
}

Table event_table(const TableInput& in) {
  Table t(
      {"events",
       "what happened: transitions with their cause, the operator's marks, limits, reconnects, losses, faults",
       {real("t_s", "s", "when"), small("step", "of the plan; -1 outside"), text("severity", "info, warning, ..."),
        text("code", "stable, for machines"), text("text", "for people"), real("value", "", "what was measured", 12),
        real("threshold", "", "what it was compared with", 12), whole("mono_ns", "ns", "CLOCK_MONOTONIC")}});
  for (const auto& e : in.session->marks.events) {
    if (e.code == "step") continue;  // they have a table of their own
    t.real(seconds(in, e.mono_ns)).whole(e.step).text(severity_text(e)).text(base::printable(e.code));
    t.text(base::printable(e.text)).real(e.value).real(e.threshold).whole(e.mono_ns).end_row();
  }
  return t;
}

}  // namespace

Table session_table(const std::vector<SessionRow>& sessions) {
  Table t({"sessions",
           "one repetition at one pressure each",
           {text("name", "of the session's folder, group or file"), small("session", "index in the plan"),
            small("attempt", "the recording's attempt that it is of"), small("repetition", "from 1"),
            real("pressure_psi", "psi", "nominal, gauge"),
            real("pressurized_rest_length_mm", "mm", "length without load at this pressure"),
            small("complete", "1: carried to its end"), whole("start_mono_ns", "ns", "CLOCK_MONOTONIC where t_s is 0"),
            whole("end_mono_ns", "ns", "CLOCK_MONOTONIC of its last sample"),
            whole("start_unix_us", "us", "Unix time where t_s is 0"), whole("frame_rows", "", "rows of frame"),
            whole("pressure_rows", "", "rows of pressure")}});
  for (const auto& s : sessions) {
    t.text(s.name).whole(s.session).whole(s.attempt).whole(s.repetition).real(s.pressure_psi);
    t.real(s.pressurized_rest_length_mm).whole(s.complete ? 1 : 0).whole(s.start_mono_ns).whole(s.end_mono_ns);
    t.whole(s.start_unix_us).whole(static_cast<std::int64_t>(s.frame_rows));
    t.whole(static_cast<std::int64_t>(s.pressure_rows)).end_row();
  }
  return t;
}

std::vector<Table> tables_of(const TableInput& in) {
  const auto steps = steps_of(in);
  std::vector<Table> all;
  all.push_back(step_table(in, steps));
  all.push_back(ramp_table(in, steps));
  all.push_back(hold_table(in, steps));
  all.push_back(event_table(in));
  return all;
}

}  // namespace isorig::daemon
