#include "cli/runs/run_report.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <set>

#include "cli/protocols/protocol_input.hpp"
#include "cli/runs/noted_specimen.hpp"
#include "cli/runs/run_evidence.hpp"
#include "cli/runs/run_report_parts.hpp"
#include "daemon/export/export.hpp"
#include "daemon/recording/amendments.hpp"
#include "identify/fv/fv_report.hpp"

namespace isorig::cli {
namespace {

using identify::report::Figure;
using identify::report::Made;
using identify::report::Mood;
using identify::report::number_text;
using identify::report::Page;
using identify::report::Panel;

/// The recordings of the run while the page is made; gone with it.
class ExportFolder {
 public:
  explicit ExportFolder(std::filesystem::path path) : path_(std::move(path)) { std::filesystem::remove_all(path_); }
  ~ExportFolder() {
    std::error_code ignored;
    std::filesystem::remove_all(path_, ignored);
  }
  ExportFolder(const ExportFolder&) = delete;
  ExportFolder& operator=(const ExportFolder&) = delete;
  [[nodiscard]] const std::filesystem::path& path() const { return path_; }

 private:
  std::filesystem::path path_;
};

/// How much is done when the recording was read for the page, twice more for its export, and analysed. Measured on the
/// paper's protocol in virtual time (23 h); what is left is drawing.
constexpr double kRead = 0.2, kExported = 0.75, kAnalysed = 0.95;

/// As `isorig export` and `isorig fv` do it.
void analyse(const FoundRun& run, const std::filesystem::path& folder, RunPage& all,
             const std::function<void(double, const char*)>& on_progress) {
  const ExportFolder out(folder / ".report.part");
  daemon::ExportOptions how;
  std::string noted_words;
  how.noted = noted_specimen(run.directory, noted_words);
  how.lean = true;  // for isorig fv's eyes alone
  how.run_id = run.id;
  how.still_written = run.still_written;
  if (run.row) {
    how.operator_name = run.row->operator_name;
    how.outcome = run.row->state;
  }
  how.on_progress = [&](double fraction) {
    on_progress(kRead + (kExported - kRead) * fraction, "reading it for curves");
  };
  auto exported = daemon::export_run(run.directory, out.path(), how);
  all.sessions = std::move(exported.sessions);
  for (const auto& s : exported.skipped) all.not_analysed.push_back(s.why);
  identify::FvOptions options;
  options.whole_series = options.history = false;  // `isorig fv` has the first, this page the second for all of the run
  std::vector<identify::RecordingResult> results;
  std::set<double> whole_psi;
  for (const auto& session : all.sessions)
    if (session.complete) whole_psi.insert(session.pressure_psi);
  std::size_t analysed = 0;
  for (const auto& session : all.sessions) {
    on_progress(kExported + (kAnalysed - kExported) * static_cast<double>(analysed++) /
                                static_cast<double>(all.sessions.size()),
                "ramps and curves");
    const std::string name = session.folder.filename().string();
    // What was cut off in mid-motion can look like a ramp that it is not.
    if (!session.complete && whole_psi.contains(session.pressure_psi)) {
      all.not_analysed.push_back(name + " was not carried to its end and is not in the curves.");
      continue;
    }
    try {
      results.push_back(identify::analyse_recording(messages::read_recording(session.folder), name, options));
    } catch (const std::exception& e) {
      all.not_analysed.push_back(name + ": " + e.what());
    }
  }
  if (!results.empty()) all.analysis = identify::analyse_curves(std::move(results), identify::FvModel::kSlse1);
}

/// "none" only of a recording that is all there and has its end: nobody else has counted.
bool is_counted(const RunPage& all) {
  return all.read.ended && all.read.gone() == 0 && all.read.state() != messages::RecordingState::kDamaged;
}

identify::report::Fact losses_of(const RunPage& all) {
  const bool none = all.lost() == 0;
  std::string what = "samples that never came, records dropped";
  if (all.read.gone() > 0) what += "; " + std::to_string(all.read.gone()) + " messages of the recording are missing";
  if (!all.read.ended) what += "; after the last session's end nobody has counted yet";
  return {"Losses",
          !none             ? std::to_string(all.lost())
          : is_counted(all) ? "none"
                            : "none was counted",
          what,
          !none             ? Mood::kBad
          : is_counted(all) ? Mood::kGood
          : all.read.ended  ? Mood::kBad
                            : Mood::kInfo};
}

Mood mood_of(const RunPage& all) {
  const std::string& outcome = all.outcome;
  if (outcome == "failed" || outcome == "refused" || all.read.state() == messages::RecordingState::kDamaged)
    return Mood::kBad;
  if (all.run.still_written) return Mood::kInfo;
  return (outcome == "done" || outcome.empty()) && all.read.state() == messages::RecordingState::kWhole &&
                 all.lost() == 0
             ? Mood::kGood
             : Mood::kWarning;
}

std::string lead_text(const RunPage& all) {
  std::size_t complete = 0;
  std::set<std::int32_t> done;
  for (const auto& m : all.evidence.marks)
    if (m.kind == isorig_msgs::session_mark_t::END && m.complete != 0) done.insert(m.session.session);
  complete = done.size();
  const std::size_t planned = all.evidence.last_header.sessions.size();
  std::string text = std::to_string(complete) + " of " + std::to_string(planned) +
                     (planned == 1 ? " planned repetition" : " planned repetitions") + " complete in " +
                     duration_text(all.evidence.duration_s()) + "; " +
                     (all.lost() == 0 ? is_counted(all) ? "nothing was lost" : "no loss was counted"
                                      : std::to_string(all.lost()) + " samples or records were lost") +
                     ".";
  if (!all.fault.empty()) text += " First fault: " + all.fault + ".";
  std::size_t ramps = 0, usable = 0;
  for (const auto& r : all.analysis.recordings)
    for (const auto& p : r.ramps.ramps) {
      ++ramps;
      usable += p.usable() ? 1 : 0;
    }
  if (ramps > 0)
    text += " " + std::to_string(usable) + " of " + std::to_string(ramps) + " iso-velocity ramps can be used" +
            (identify::r_squared_of(all.analysis).empty() ? "" : ", " + identify::r_squared_of(all.analysis)) + ".";
  return text;
}

void add_facts(Page& page, const RunPage& all) {
  const auto& e = all.evidence;
  const auto& h = e.last_header;
  const bool virtual_time = h.virtual_time != 0;
  std::vector<identify::report::Fact> facts{
      {"Specimen", all.specimen,
       all.rest_length_mm > 0.0 ? number_text(all.rest_length_mm, 5) + " mm at rest, without pressure"
                                : "by a note that does not say its length"},
      {"Rig", h.rig,
       virtual_time    ? "simulated, in virtual time: no sample is of a real specimen"
       : e.simulated() ? "simulated, in real time: no sample is of a real specimen"
                       : ""},
      {"Operator", all.operator_name.empty() ? "nobody named" : all.operator_name},
      {"Started", all.started.empty() ? "not known" : all.started, "lasted " + duration_text(e.duration_s())},
      {"Protocol", h.plan_summary},
      {"Outcome", all.outcome.empty() ? "in no catalogue" : all.outcome, all.fault, mood_of(all)},
      {"Recording", all.read.state_text(),
       number_text(static_cast<double>(all.read.bytes) * 1e-6, 3) + " MB in " + std::to_string(all.read.segments) +
           (all.read.segments == 1 ? " segment" : " segments")},
      losses_of(all),
      {"Clock",
       "within " + short_time_text(std::max(e.frames.worst_bound_us, e.pressures.worst_bound_us)) + " at worst",
       "bound of every sample's time"}};
  if (h.attempt > 1) facts.push_back({"Attempts", std::to_string(h.attempt), "gone on with after an interruption"});
  if (e.has_temperature)
    facts.push_back({"Temperature", number_text(e.coldest_C, 3) + " to " + number_text(e.warmest_C, 3) + " °C",
                     "of the pressure sensor's die, not of the specimen"});
  if (virtual_time) facts.push_back({"Seed", std::to_string(h.seed), "of the simulated noise"});
  page.facts(facts);
}

void add_curves(Page& page, const RunPage& all) {
  page.heading("Force-velocity curves");
  for (const std::string& why : all.not_analysed) page.note(why);
  const auto curves = identify::all_curves_figure(all.analysis, "force_velocity_curves");
  if (curves.panels.empty()) {
    page.paragraph("No repetition of this run has iso-velocity ramps that give a force-velocity point.");
    return;
  }
  page.figure(curves);
  identify::add_parameters_table(page, all.analysis);
  if (const auto over = identify::parameters_over_pressure(all.analysis)) page.figure(*over);
  std::vector<std::string> refused;
  for (const auto& c : all.analysis.curves)
    if (!c.result.fit) refused.push_back(identify::title_of(c) + ": " + c.result.refusal);
  page.list(refused);
}

void add_ramps(Page& page, const RunPage& all) {
  if (std::ranges::all_of(all.analysis.recordings, [](const auto& r) { return r.ramps.ramps.empty(); })) return;
  page.heading("Ramps");
  Figure figure{"ramps_overlaid",
                "Force over F0 during and after the ramps of the first repetition at each pressure, both directions; "
                "one colour a speed.",
                {}};
  for (const auto& c : all.analysis.curves) {
    identify::Curve first = c;
    first.recordings.resize(std::min<std::size_t>(1, first.recordings.size()));
    Panel panel = identify::overlay_panel(all.analysis, first);
    panel.title = identify::title_of(c);
    if (!panel.series.empty()) figure.panels.push_back(std::move(panel));
  }
  figure.columns = figure.panels.size() > 1 ? 2 : 1;
  if (!figure.panels.empty()) page.figure(figure);

  constexpr std::size_t kMostRows = 60;
  std::map<std::string, std::size_t> counts;
  double farthest_mm = 0.0;
  std::vector<std::vector<std::string>> rows;
  std::size_t ramps = 0, deviating = 0;
  for (const auto& r : all.analysis.recordings)
    for (const auto& p : r.ramps.ramps) {
      ++ramps;
      if (p.flags.empty()) continue;
      ++deviating;
      std::string what;
      for (const auto flag : p.flags) {
        ++counts[std::string(identify::text(flag))];
        what += (what.empty() ? "" : "; ") + std::string(identify::text(flag));
        if (flag == identify::RampFlag::kOvershot) farthest_mm = std::max(farthest_mm, p.overshoot_mm);
        if (flag == identify::RampFlag::kOvershot) what += " by " + number_text(1000.0 * p.overshoot_mm, 3) + " µm";
      }
      if (rows.size() < kMostRows)
        rows.push_back({r.path, number_text(p.move.t_start_s, 6), number_text(p.move.velocity_mm_s.value, 4),
                        p.usable() ? "yes" : "no", what});
    }
  page.subheading("Deviations");
  if (deviating == 0) {
    page.paragraph("None: all " + std::to_string(ramps) +
                   " ramps rested before, reached their speed and stopped at their target.");
    return;
  }
  std::vector<std::vector<std::string>> summary;
  summary.reserve(counts.size());
  const std::string overshot(identify::text(identify::RampFlag::kOvershot));
  for (const auto& [what, n] : counts)
    summary.push_back(
        {what, std::to_string(n),
         what == overshot ? "by " + number_text(1000.0 * farthest_mm, 3) + " µm at most" : std::string()});
  page.table({"what", "ramps", "how much"}, summary,
             std::to_string(deviating) + " of " + std::to_string(ramps) + " ramps deviate");
  page.begin_more("Each of them");
  page.table({"repetition", "start (s)", "velocity (mm/s)", "usable", "what"}, rows,
             deviating > rows.size() ? "The first " + std::to_string(rows.size()) + " of " + std::to_string(deviating) +
                                           "; `isorig fv` lists all"
                                     : "Times from the repetition's first sample");
  page.end_more();
}

void add_limits(Page& page, const RunPage& all) {
  page.heading("What this page does not show");
  std::vector<std::string> items{
      "Whether the model is right: the curves are fitted with one Maxwell arm beside a spring (1-SLSE), of a sheathed "
      "specimen too. A small residual at ramps does not test it elsewhere; `isorig diagnose` does.",
      "What happened between the readings, faster than the sampling of frame and pressure.",
      "The specimen's own temperature, humidity and slip in the grips: nothing measures them.",
      "Whether the calibration holds today: it says when it was made and when it is due."};
  if (all.evidence.simulated())
    items.insert(items.begin(), "Anything about a real muscle: rig, specimen and noise are simulated.");
  page.list(items);
}

}  // namespace

std::uint64_t RunPage::lost() const {
  std::uint64_t sum = read.dropped_records + read.lost_messages;
  const auto losses = evidence.losses();
  sum += static_cast<std::uint64_t>(losses.frame + losses.pressure);
  return sum;
}

void write_run_report(const FoundRun& run, const std::filesystem::path& file, const Made& made,
                      const std::function<void(double, const char*)>& on_progress) {
  const auto tell = [&](double fraction, const char* doing) {
    if (on_progress) on_progress(fraction, doing);
  };
  RunPage all;
  all.run = run;
  all.read = messages::read_run(run.directory, all.evidence,
                                [&](double fraction) { tell(kRead * fraction, "reading the recording"); });
  all.outcome = run.row ? run.row->state : std::string();
  all.fault = run.row ? run.row->fault : std::string();
  all.read.set_against(all.outcome, run.still_written);
  const auto& h = all.evidence.last_header;
  all.specimen = h.specimen;
  all.rest_length_mm = h.rest_length_mm;
  all.operator_name = all.evidence.text("operator");
  if (all.operator_name.empty() && run.row) all.operator_name = run.row->operator_name;
  all.started = run.row ? run.row->started_utc : std::string();
  const auto amendments = daemon::shown_amendments(run.directory);
  std::string noted_words;
  if (const auto noted = noted_specimen(run.directory, noted_words)) {
    all.specimen = noted->specimen;
    all.rest_length_mm = noted->rest_length_mm;
  }
  for (const auto& a : amendments) {
    if (!a.operator_name.empty()) all.operator_name = a.operator_name;
  }
  const std::filesystem::path folder = std::filesystem::absolute(file).parent_path();
  std::filesystem::create_directories(folder);
  try {
    analyse(run, folder, all, tell);
  } catch (const std::exception& e) {
    all.not_analysed.emplace_back(std::string("The force-velocity analysis was not made: ") + e.what());
  }

  tell(kAnalysed, "drawing");
  Page page("Run", all.specimen.empty() ? run.id : all.specimen);
  page.subtitle(run.id + (all.started.empty() ? "" : ", started " + all.started));
  page.made(made);
  if (folder == std::filesystem::absolute(run.directory)) {
    page.link("Protocol, specimen and rig as they were", "inputs/");
    page.link("Identity and versions (run.toml)", "run.toml");
    page.link("All runs", "../");
  }
  page.lead(mood_of(all),
            all.run.still_written ? "still running"
            : all.outcome.empty() ? "recorded"
                                  : all.outcome,
            lead_text(all));
  for (const auto& a : amendments)
    page.note("Put right " + a.at_utc + (a.by.empty() ? "" : " by " + a.by) + ": " +
                  (a.specimen.empty() ? "" : "specimen " + a.specimen + "; ") +
                  (a.operator_name.empty() ? "" : "operator " + a.operator_name + "; ") + a.text,
              Mood::kInfo);
  for (const auto& line : all.read.complaints()) page.note(line);
  add_facts(page, all);
  add_curves(page, all);
  add_course(page, all);
  add_ramps(page, all);
  add_quality(page, all);
  add_inputs(page, all);
  add_limits(page, all);
  page.write(folder, file.filename().string());
}

}  // namespace isorig::cli
