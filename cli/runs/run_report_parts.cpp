#include "cli/runs/run_report_parts.hpp"

#include <toml++/toml.h>

#include <algorithm>
#include <cmath>

#include "cli/protocols/protocol_input.hpp"
#include "daemon/recording/session_marks.hpp"

namespace isorig::cli {
namespace {

using identify::report::Figure;
using identify::report::number_text;
using identify::report::Page;
using identify::report::Panel;
using isorig_msgs::event_t;
using isorig_msgs::session_mark_t;

constexpr std::size_t kMostEvents = 400;
constexpr std::size_t kMostLabels = 12;

struct Unit {
  const char* name;
  double per_s;  ///< of it, in a second
};

/// A time axis that a person can read: hours from 3 h on, minutes from 10 min on.
Unit unit_for(double duration_s) {
  if (duration_s >= 3.0 * 3600.0) return {"time (h)", 1.0 / 3600.0};
  if (duration_s >= 600.0) return {"time (min)", 1.0 / 60.0};
  return {"time (s)", 1.0};
}

/// Beginnings of repetitions: all when they are few, else where the pressure changes. Trips always.
std::vector<std::pair<double, std::string>> landmarks(const RunEvidence& e, const Unit& unit) {
  std::vector<std::pair<double, std::string>> out;
  std::size_t begins = 0;
  for (const auto& m : e.marks) begins += m.kind == session_mark_t::BEGIN ? 1 : 0;
  double before_psi = std::nan("");
  for (const auto& m : e.marks) {
    if (m.kind != session_mark_t::BEGIN) continue;
    const bool changes = m.session.pressure_psi != before_psi;
    before_psi = m.session.pressure_psi;
    if (begins > kMostLabels && !changes) continue;
    out.emplace_back(e.seconds(m.mono_ns) * unit.per_s, number_text(m.session.pressure_psi, 3) + " psi");
  }
  if (out.size() > 2 * kMostLabels)
    for (auto& [at, text] : out) text.clear();
  std::size_t trips = 0;
  for (const auto& event : e.events) {
    if (event.severity < event_t::PROGRAM_STOP || event.from_state == event.to_state) continue;
    if (++trips > kMostLabels) break;
    out.emplace_back(e.seconds(event.mono_ns) * unit.per_s, event.code);
  }
  return out;
}

Figure history(const RunEvidence& e, double average_interval_s) {
  const Unit unit = unit_for(e.duration_s());
  const double gap_s = std::max(2.0, 20.0 * average_interval_s);
  Figure figure{"history",
                "The whole run. Bands reach from the lowest to the highest reading of each stretch, lines are means; "
                "vertical lines are the beginnings of repetitions and what stopped the rig.",
                {}};
  figure.linked = true;
  const auto panel = [&](const identify::report::LongSignal& signal, const char* label, const char* name, int color) {
    if (signal.empty()) return;
    Panel p;
    p.y_label = label;
    p.series = signal.series(name, color, gap_s, unit.per_s);
    p.verticals = landmarks(e, unit);
    p.x_range = {{0.0, e.duration_s() * unit.per_s}};
    if (!figure.panels.empty())
      for (auto& [at, text] : p.verticals) text.clear();
    p.aspect = 0.21;
    figure.panels.push_back(std::move(p));
  };
  panel(e.force_N, "force (N)", "force", 0);
  panel(e.position_mm, "position (mm)", "position", 2);
  const std::size_t before = figure.panels.size();
  panel(e.pressure_psi, "pressure (psi)", "pressure", 1);
  if (figure.panels.size() > before && !e.setpoint_psi.empty()) {
    auto wanted = e.setpoint_psi.series("set-point", 7, gap_s, unit.per_s).back();
    wanted.mark = identify::report::Mark::kDashes;
    figure.panels.back().series.push_back(std::move(wanted));
  }
  if (!figure.panels.empty()) {
    figure.panels.back().x_label = unit.name;
    figure.panels.back().aspect = 0.24;
  }
  return figure;
}

void sessions_table(Page& page, const RunPage& all) {
  const auto& e = all.evidence;
  std::vector<std::vector<std::string>> rows;
  for (const auto& r : e.repetitions()) {
    const auto& m = r.begin;
    std::vector<std::string> row{std::to_string(m.session.repetition),
                                 number_text(m.session.pressure_psi, 4),
                                 std::to_string(m.attempt),
                                 duration_text(e.seconds(m.mono_ns)),
                                 r.ended ? duration_text(e.seconds(r.end_ns) - e.seconds(m.mono_ns)) : "",
                                 r.state_text(),
                                 std::to_string(r.frame_missing + r.pressure_missing)};
    const auto exported = std::ranges::find_if(
        all.sessions, [&](const auto& s) { return s.session == m.session.session && s.attempt == m.attempt; });
    if (exported != all.sessions.end()) {
      const auto analysed = std::ranges::find(all.analysis.recordings, exported->folder.filename().string(),
                                              &identify::RecordingResult::path);
      if (analysed != all.analysis.recordings.end()) {
        const auto& ramps = analysed->ramps.ramps;
        const auto usable = std::ranges::count_if(ramps, [](const auto& ramp) { return ramp.usable(); });
        row.push_back(std::to_string(ramps.size()));
        row.push_back(std::to_string(usable));
      }
    }
    rows.push_back(std::move(row));
  }
  page.table(
      {"repetition", "pressure (psi)", "attempt", "began after", "lasted", "state", "samples lost", "ramps", "usable"},
      rows, "Repetitions");
}

std::vector<std::string> event_row(const RunEvidence& e, const event_t& event) {
  return {number_text(e.seconds(event.mono_ns), 8), daemon::severity_text(event), event.code, event.text};
}

void events_tables(Page& page, const RunEvidence& e) {
  page.subheading("Trips and events");
  std::vector<std::vector<std::string>> grave, rest;
  std::size_t all_grave = 0;
  for (const auto& event : e.events) {
    all_grave += event.severity != event_t::INFO ? 1 : 0;
    auto& to = event.severity != event_t::INFO ? grave : rest;
    if (to.size() < kMostEvents) to.push_back(event_row(e, event));
  }
  const auto caption = [](std::size_t shown, std::size_t all, const char* whole) {
    return all > shown ? "The first " + std::to_string(shown) + " of " + std::to_string(all) +
                             "; `isorig show --events` lists all"
                       : std::string(whole);
  };
  const std::vector<std::string> header{"time (s)", "severity", "code", "what happened"};
  if (grave.empty()) {
    page.paragraph("No trip, no limit, no warning in the whole run.");
  } else {
    page.table(header, grave, caption(grave.size(), all_grave, "What had a consequence, or nearly"));
  }
  if (rest.empty()) return;
  page.begin_more("Events without consequence: steps, marks, transitions");
  page.table(header, rest, caption(rest.size(), e.events.size() - all_grave, "Times from the run's beginning"));
  page.end_more();
}

std::string count_text(std::uint64_t n) {
  return std::to_string(n);
}

std::vector<std::string> stream_row(const char* name, const daemon::RunTally::Stream& s, std::int64_t missing) {
  return {name,
          count_text(s.full),
          count_text(s.averaged),
          count_text(s.intervals),
          std::to_string(missing),
          short_time_text(s.worst_bound_us)};
}

/// One line a channel; the raw text stands beside it.
void calibration_table(Page& page, const std::string& text) {
  std::vector<std::vector<std::string>> rows;
  bool none = false;
  try {
    const auto all = toml::parse(text);
    for (const auto& [channel, node] : all) {
      const auto* one = node.as_table();
      if (one == nullptr) continue;
      const auto word = [&](const char* key) { return (*one)[key].value_or(std::string()); };
      const auto value = [&](const char* key) {
        const auto v = (*one)[key].value<double>();
        return v ? number_text(*v, 6) : std::string();
      };
      const std::string id = word("id");
      none = none || id.empty();
      rows.push_back({std::string(channel.str()), value("scale"), value("offset"), word("unit"),
                      id.empty() ? "none: factory or rig file" : id, word("made_utc"), word("due"), word("operator"),
                      word("reference"), value("uncertainty_k2")});
    }
  } catch (const toml::parse_error& e) {
    page.note("calibration.toml of this recording cannot be read: " + std::string(e.description()));
    return;
  }
  page.table({"channel", "scale", "offset", "unit", "record", "made", "due", "by", "reference", "uncertainty, k = 2"},
             rows, "Corrections in force: calibrated = scale × raw + offset; raw values are in the recording too");
  if (none) page.note("A channel without a record was never compared with a reference under this rig's name.");
}

}  // namespace

std::string short_time_text(double microseconds) {
  return std::abs(microseconds) < 999.5 ? number_text(microseconds, 3) + " µs"
                                        : number_text(1e-3 * microseconds, 3) + " ms";
}

void add_course(Page& page, const RunPage& all) {
  page.heading("Course of the run");
  if (const Figure figure = history(all.evidence, all.evidence.last_header.average_interval_s); !figure.panels.empty())
    page.figure(figure);
  sessions_table(page, all);
  events_tables(page, all.evidence);
}

void add_quality(Page& page, const RunPage& all) {
  const auto& e = all.evidence;
  page.heading("How well it was measured");
  const auto [frame, pressure, dropped] = e.losses();
  page.table({"stream", "samples in full", "samples in averages", "averages", "never came", "time bound at worst"},
             {stream_row("force and position", e.frames, frame), stream_row("pressure", e.pressures, pressure)},
             "Samples and their times");
  const double worst_us = std::max(e.frames.worst_bound_us, e.pressures.worst_bound_us);
  page.paragraph("Every sample's time is certain to within its bound. At 10 mm/s the worst of them, " +
                 short_time_text(worst_us) + ", is " + number_text(worst_us * 1e-2, 2) + " µm of crosshead. The " +
                 "clocks of the devices were compared with this computer's " + count_text(e.exchange_count) +
                 " times.");
  std::vector<std::string> items;
  if (e.last_header.virtual_time != 0) {
    items.emplace_back("Loop: virtual time has no wake-ups that could be late.");
  } else {
    items.push_back("Loop: " + std::to_string(e.overruns) + " overruns, worst wake-up " +
                    short_time_text(static_cast<double>(e.worst_wakeup_ns) * 1e-3) + ", worst turn " +
                    short_time_text(e.worst_run_ns * 1e-3) + ".");
  }
  if (e.sync_edges > 0)
    items.push_back("Sync line: " + count_text(e.sync_edges) + " edges compared, " + count_text(e.sync_outside) +
                    " outside of the claimed bound, worst error " + short_time_text(e.sync_worst_us) + ".");
  items.push_back(dropped == 0
                      ? "No record was lost between the real-time loop and the recorder."
                      : std::to_string(dropped) + " records were lost between the real-time loop and the recorder.");
  if (e.not_measured > 0)
    items.push_back(count_text(e.not_measured) +
                    " pressure words were stale or faulty; they are in the recording and in no "
                    "figure.");
  if (!all.read.has_checksums) items.emplace_back("The recording has no checksums: altered values would not show.");
  for (const std::string& note : all.read.notes) items.push_back(note);
  page.list(items);
}

void add_inputs(Page& page, const RunPage& all) {
  const auto& h = all.evidence.last_header;
  page.heading("Calibration");
  const std::string calibration = all.evidence.text("calibration.toml");
  if (calibration.empty())
    page.note("The recording names no calibration.");
  else
    calibration_table(page, calibration);
  page.heading("Inputs and versions");
  std::vector<std::vector<std::string>> rows;
  for (const auto& v : h.versions) rows.push_back({v.name, v.text});
  page.table({"what", "version"}, rows, "What the recording was made with");
  for (const auto& t : h.texts) {
    if (t.name == "operator" || t.text.empty()) continue;
    page.begin_more(t.name);
    page.code(t.name, t.text);
    page.end_more();
  }
}

}  // namespace isorig::cli
