#include <cstdio>
#include <iostream>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>

#include "base/printable.hpp"
#include "base/utc_text.hpp"
#include "cli/command.hpp"
#include "cli/protocols/protocol_input.hpp"
#include "cli/runs/run_argument.hpp"
#include "cli/screen/progress.hpp"
#include "cli/screen/show_trips.hpp"
#include "daemon/recording/amendments.hpp"
#include "daemon/recording/catalogue.hpp"
#include "daemon/recording/run_tally.hpp"
#include "daemon/recording/session_marks.hpp"

/// isorig show: what one run's recording holds, read from the recording itself.
namespace isorig::cli {
namespace {

struct ShowOptions {
  RunArgument run;
  bool events = false;
  bool json = false;
};

nlohmann::ordered_json to_json(const daemon::RunTally::Stream& c) {
  return {{"full", c.full}, {"averaged", c.averaged}, {"intervals", c.intervals}, {"worst_bound_us", c.worst_bound_us}};
}

/// What a person wants to read without asking for all: everything with a consequence, and each link that came back.
bool worth_reading(const isorig_msgs::event_t& e) {
  if (e.severity != isorig_msgs::event_t::INFO) return true;
  for (const char* word : {"reconnect", "restart", "connected", "clock.", "resume", "operator"}) {
    if (e.code.find(word) != std::string::npos) return true;
  }
  return false;
}

std::string utc_of(const daemon::RunTally& s) {
  return base::utc_text((s.first_epoch_unix_us + s.first_sample_ns / 1000) / 1'000'000);
}

std::string started_of(const FoundRun& found, const daemon::RunTally& s) {
  if (found.row && !found.row->started_utc.empty()) return found.row->started_utc;
  return s.last_header.virtual_time != 0 ? std::string() : utc_of(s);  // a virtual recording does not know the date
}

std::string operator_of(const FoundRun& found, const daemon::RunTally& s) {
  const std::string recorded = s.text("operator");
  return recorded.empty() && found.row ? found.row->operator_name : recorded;
}

int exit_code(const messages::ReadReport& report) {
  const bool only_begun = report.still_written && report.state() == messages::RecordingState::kInterrupted;
  return only_begun || report.state() == messages::RecordingState::kWhole ? kOk : kDataLost;
}

int print_json(const FoundRun& found, const daemon::RunTally& s, const messages::ReadReport& report) {
  const auto& h = s.last_header;
  nlohmann::ordered_json out{{"id", found.id},
                             {"directory", found.directory.string()},
                             {"specimen", h.specimen},
                             {"rig", h.rig},
                             {"plan", h.plan_summary},
                             {"started_utc", started_of(found, s)},
                             {"duration_s", static_cast<double>(s.last_sample_ns - s.first_sample_ns) * 1e-9},
                             {"operator", operator_of(found, s)},
                             {"outcome", found.row ? found.row->state : ""},
                             {"fault", found.row ? found.row->fault : ""},
                             {"attempts", h.attempt},
                             {"seed", h.seed},
                             {"virtual_time", h.virtual_time != 0},
                             {"segments", report.segments},
                             {"bytes", report.bytes},
                             {"frame", to_json(s.frames)},
                             {"pressure", to_json(s.pressures)},
                             {"exchanges", s.exchange_count},
                             {"overruns", s.overruns},
                             {"worst_wakeup_ns", s.worst_wakeup_ns},
                             {"worst_run_ns", s.worst_run_ns},
                             {"state", report.state_text()},
                             {"whole", report.state() == messages::RecordingState::kWhole},
                             {"checksums", report.has_checksums},
                             {"complaints", report.complaints()},
                             {"notes", report.notes}};
  out["versions"] = nlohmann::ordered_json::object();
  for (const auto& v : h.versions) out["versions"][v.name] = v.text;
  out["losses"] = nlohmann::ordered_json::array();
  for (const auto& [attempt, m] : s.lost) {
    out["losses"].push_back({{"attempt", attempt},
                             {"frame_missing", m.frame_missing},
                             {"pressure_missing", m.pressure_missing},
                             {"dropped_records", m.dropped_records}});
  }
  out["amendments"] = nlohmann::ordered_json::array();
  for (const auto& a : daemon::shown_amendments(found.directory)) {
    out["amendments"].push_back({{"at_utc", a.at_utc},
                                 {"by", a.by},
                                 {"specimen", a.specimen},
                                 {"operator", a.operator_name},
                                 {"text", a.text}});
  }
  out["sessions"] = nlohmann::ordered_json::array();
  for (std::size_t i = 0; i < s.marks.size(); ++i) {
    const auto& m = s.marks[i];
    out["sessions"].push_back({{"session", m.session.session},
                               {"repetition", m.session.repetition},
                               {"pressure_psi", m.session.pressure_psi},
                               {"attempt", m.attempt},
                               {"mark", m.kind == isorig_msgs::session_mark_t::BEGIN ? "begin" : "end"},
                               {"complete", m.complete != 0},
                               {"frame_missing", m.frame_missing},  // so far in this attempt
                               {"pressure_missing", m.pressure_missing},
                               {"mono_ns", m.mono_ns - s.mark_shift_ns[i]}});
  }
  out["events"] = nlohmann::ordered_json::array();
  for (std::size_t i = 0; i < s.events.size(); ++i) {
    const auto& e = s.events[i];
    out["events"].push_back({{"mono_ns", e.mono_ns - s.event_shift_ns[i]},
                             {"severity", daemon::severity_text(e)},
                             {"code", e.code},
                             {"text", e.text},
                             {"step", e.step},
                             {"value", e.value},
                             {"threshold", e.threshold}});
  }
  std::vector<std::string> complaints;
  out["trips"] = read_trips(found.directory, complaints);
  for (const auto& line : complaints) std::cerr << "isorig show: note: " << line << '\n';
  // Bytes of a damaged text need not be UTF-8.
  std::cout << out.dump(2, ' ', false, nlohmann::ordered_json::error_handler_t::replace) << '\n';
  return exit_code(report);
}

void print_identity(const FoundRun& found, const daemon::RunTally& s, const messages::ReadReport& report) {
  using base::printable;
  const auto& h = s.last_header;
  const auto protocol = found.row ? found.row->protocol : std::string();
  std::printf("%s\n  %s\n  specimen %s, rig %s%s\n  %s%s\n", printable(found.id).c_str(),
              printable(found.directory.string()).c_str(), printable(h.specimen).c_str(), printable(h.rig).c_str(),
              h.virtual_time != 0 ? " (virtual time)" : "",
              protocol.empty() ? "" : ("protocol " + printable(protocol) + ": ").c_str(),
              printable(h.plan_summary).c_str());
  const auto started = started_of(found, s), who = operator_of(found, s);
  std::printf("  %s%s of rig time, %s%d attempt%s\n",
              started.empty() ? "" : ("started " + printable(started) + ", ").c_str(),
              duration_text(static_cast<double>(s.last_sample_ns - s.first_sample_ns) * 1e-9).c_str(),
              who.empty() ? "" : ("operator " + printable(who) + ", ").c_str(), h.attempt, h.attempt == 1 ? "" : "s");
  if (found.row) {
    const char* then = found.row->fault.empty() ? "" : found.row->state == "done" ? "; a fault on the way: " : ", ";
    std::printf("  outcome: %s%s%s\n", found.row->state.c_str(), then, printable(found.row->fault).c_str());
  }
  std::string made;
  for (const auto& v : h.versions) {
    if (v.name != "operator") made += (made.empty() ? "" : "; ") + printable(v.name) + " " + printable(v.text);
  }
  if (!made.empty()) std::printf("  made with %s\n", made.c_str());
  std::printf("  recording: %s%s; %.1f MB in %zu segment%s\n", report.state_text(),
              report.has_checksums ? "" : ", without checksums (an older isorig made it)",
              static_cast<double>(report.bytes) * 1e-6, report.segments, report.segments == 1 ? "" : "s");
}

void print_sessions(const daemon::RunTally& s, std::int64_t start_ns) {
  std::printf("sessions (repetition, pressure):\n");
  for (const auto& r : s.repetitions()) {
    const auto lost = r.frame_missing + r.pressure_missing == 0
                          ? std::string()
                          : ", without " + std::to_string(r.frame_missing) + " samples of the frame and " +
                                std::to_string(r.pressure_missing) + " of the pressure sensor";
    std::printf("  %3d  rep %d  %5.1f psi  from %10.1f s  %s%s%s\n", r.begin.session.session,
                r.begin.session.repetition, r.begin.session.pressure_psi,
                static_cast<double>(r.begin.mono_ns - start_ns) * 1e-9, r.state_text(), lost.c_str(),
                r.begin.attempt > 1 ? " (further attempt)" : "");
  }
}

void print_events(const daemon::RunTally& s, std::int64_t start_ns, bool all) {
  std::size_t hidden = 0;
  bool titled = false;
  for (const auto& e : s.events) {
    if (!all && !worth_reading(e)) {
      ++hidden;
      continue;
    }
    if (!titled) std::printf("events:\n");
    titled = true;
    std::printf("  %10.3f s  %-12s  %-18s  %s\n", static_cast<double>(e.mono_ns - start_ns) * 1e-9,
                daemon::severity_text(e), base::printable(e.code).c_str(), base::printable(e.text).c_str());
  }
  if (hidden > 0) std::printf("%zu events without consequence are shown by --events\n", hidden);
}

/// What the recorder has counted, and how far: its counts stand in the marks of the sessions' ends.
void print_losses(const daemon::RunTally& s, const messages::ReadReport& report) {
  const auto [frame, pressure, dropped] = s.losses();
  if (frame + pressure + dropped > 0) {
    std::printf(
        "losses: %lld samples of the frame and %lld of the pressure sensor never came; %lld records were dropped",
        static_cast<long long>(frame), static_cast<long long>(pressure), static_cast<long long>(dropped));
  } else if (report.ended && report.gone() == 0) {
    std::printf("losses: none");
  } else {
    std::printf("losses: none was counted");
  }
  if (report.gone() > 0)
    std::printf("; %llu messages of the recording are missing", static_cast<unsigned long long>(report.gone()));
  if (!report.ended) std::printf("; after the last session's end nobody has counted yet");
  std::printf("\n");
}

void print_text(const FoundRun& found, const daemon::RunTally& s, const messages::ReadReport& report, bool all_events) {
  print_identity(found, s, report);
  const auto stream = [](const char* name, const daemon::RunTally::Stream& c) {
    std::printf("  %-8s %llu samples in full, %llu in %llu averages; times within %.0f us\n", name,
                static_cast<unsigned long long>(c.full), static_cast<unsigned long long>(c.averaged),
                static_cast<unsigned long long>(c.intervals), c.worst_bound_us);
  };
  stream("frame", s.frames);
  stream("pressure", s.pressures);
  std::printf("  loop     %lld overruns, worst wake-up %.0f us, worst run %.0f us\n",
              static_cast<long long>(s.overruns), static_cast<double>(s.worst_wakeup_ns) * 1e-3, s.worst_run_ns * 1e-3);
  const std::int64_t start_ns = s.marks.empty() ? s.first_sample_ns : s.marks.front().mono_ns;
  print_sessions(s, start_ns);
  print_events(s, start_ns, all_events);
  print_losses(s, report);
}

/// What was put right afterwards: it counts more than what the recording says.
void print_amendments(const FoundRun& found) {
  for (const auto& a : daemon::shown_amendments(found.directory)) {
    std::printf("noted%s%s%s%s:", a.at_utc.empty() ? "" : " ", a.at_utc.c_str(), a.by.empty() ? "" : " by ",
                base::printable(a.by).c_str());
    if (!a.specimen.empty()) std::printf(" specimen %s;", base::printable(a.specimen).c_str());
    if (!a.operator_name.empty()) std::printf(" operator %s;", base::printable(a.operator_name).c_str());
    std::printf(" %s\n", base::printable(a.text).c_str());
  }
}

int show(const ShowOptions& options) {
  const auto found = find_run(options.run);
  daemon::RunTally summary;
  std::optional<Progress> progress(std::in_place, "show");
  auto report = messages::read_run(found.directory, summary, [&](double fraction) { progress->at(fraction); });
  progress.reset();
  report.set_against(found.row ? found.row->state : "", found.still_written);
  if (!report.has_header && report.foreign == report.events) {
    std::cerr << "isorig show: " << found.directory.string()
              << (report.events == 0
                      ? ": not one message in it: its writer was interrupted before the first, or it was emptied\n"
                      : ": a log, but no recording of isorig's: no header, and none of its channels\n");
    return report.events == 0 ? kDataLost : kBadInput;
  }
  if (options.json) return print_json(found, summary, report);
  print_text(found, summary, report, options.events);
  std::vector<std::string> complaints;
  for (const auto& trip : read_trips(found.directory, complaints)) std::fputs(tell_trip(trip).c_str(), stdout);
  std::fflush(stdout);
  print_amendments(found);
  for (const auto& line : complaints) std::cerr << "isorig show: note: " << line << '\n';
  for (const auto& line : report.notes) std::cerr << "isorig show: note: " << line << '\n';
  for (const auto& line : report.complaints()) std::cerr << "isorig show: " << line << '\n';
  return exit_code(report);
}

Command add_show(CLI::App& app) {
  auto options = std::make_shared<ShowOptions>();
  auto* sub = app.add_subcommand("show", "What a run's recording holds: sessions, samples, events, losses");
  options->run.add_to(*sub);
  sub->add_flag("--events", options->events, "All events, also those without consequence");
  sub->add_flag("--json", options->json, "For scripts: everything, as JSON");
  return {sub, [options] { return show(*options); }};
}

const Registration kShow(39, add_show);

}  // namespace
}  // namespace isorig::cli
