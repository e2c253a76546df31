#include <algorithm>
#include <cstdio>
#include <iostream>
#include <memory>
#include <nlohmann/json.hpp>

#include "cli/command.hpp"
#include "cli/run_argument.hpp"
#include "daemon/catalogue.hpp"
#include "messages/run_log.hpp"

/// isorig show: what one run's recording holds, read from the recording itself.
namespace isorig::cli {
namespace {

struct Options {
  RunArgument run;
  bool events = false;
  bool json = false;
};

struct Summary : messages::RunVisitor {
  struct Count {
    std::uint64_t full = 0;
    std::uint64_t averaged = 0;
    std::uint64_t intervals = 0;
    double worst_bound_us = 0.0;
  };

  void header(const isorig_msgs::run_header_t& h) override { last_header = h; }
  void session(const isorig_msgs::session_mark_t& m) override {
    if (m.kind != isorig_msgs::session_mark_t::CONTINUE) marks.push_back(m);
  }
  void frame(const isorig_msgs::frame_batch_t& m) override { full(frames, m); }
  void pressure(const isorig_msgs::pressure_batch_t& m) override { full(pressures, m); }
  void frame_average(const isorig_msgs::frame_average_batch_t& m) override { averaged(frames, m); }
  void pressure_average(const isorig_msgs::pressure_average_batch_t& m) override { averaged(pressures, m); }
  void control(const isorig_msgs::control_batch_t& m) override {
    for (std::size_t i = 0; i < static_cast<std::size_t>(m.count); ++i) {
      overruns = std::max(overruns, m.samples[i].overruns);
      worst_wakeup_ns = std::max(worst_wakeup_ns, m.samples[i].worst_wakeup_ns);
      worst_run_ns = std::max(worst_run_ns, m.samples[i].worst_run_ns);
    }
  }
  void event(const isorig_msgs::event_t& m) override { events.push_back(m); }
  void exchanges(const isorig_msgs::exchange_batch_t& m) override {
    exchange_count += static_cast<std::uint64_t>(m.count);
  }

  isorig_msgs::run_header_t last_header{};
  std::vector<isorig_msgs::session_mark_t> marks;
  std::vector<isorig_msgs::event_t> events;
  Count frames, pressures;
  std::uint64_t exchange_count = 0;
  std::int64_t overruns = 0;
  std::int32_t worst_wakeup_ns = 0;
  std::int32_t worst_run_ns = 0;

 private:
  template <typename Message>
  static void full(Count& c, const Message& m) {
    c.full += static_cast<std::uint64_t>(m.count);
    bounds(c, m);
  }
  template <typename Message>
  static void averaged(Count& c, const Message& m) {
    c.intervals += static_cast<std::uint64_t>(m.count);
    for (std::size_t i = 0; i < static_cast<std::size_t>(m.count); ++i) {
      c.averaged += static_cast<std::uint64_t>(m.samples[i]);
    }
    bounds(c, m);
  }
  template <typename Message>
  static void bounds(Count& c, const Message& m) {
    for (std::size_t i = 0; i < static_cast<std::size_t>(m.count); ++i) {
      c.worst_bound_us = std::max(c.worst_bound_us, static_cast<double>(m.bound_ns[i]) * 1e-3);
    }
  }
};

const char* severity_text(std::int8_t severity) {
  static constexpr const char* kTexts[] = {"info", "warning", "program stop", "safe state"};
  return severity >= 0 && severity < 4 ? kTexts[severity] : "?";
}

nlohmann::ordered_json to_json(const Summary::Count& c) {
  return {{"full", c.full},
          {"averaged", c.averaged},
          {"intervals", c.intervals},
          {"worst_bound_us", c.worst_bound_us}};
}

int print_json(const FoundRun& found, const Summary& s, const messages::ReadReport& report) {
  const auto& h = s.last_header;
  nlohmann::ordered_json out{{"id", found.id},
                             {"directory", found.directory.string()},
                             {"specimen", h.specimen},
                             {"rig", h.rig},
                             {"plan", h.plan_summary},
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
                             {"whole", report.whole()},
                             {"complaints", report.complaints()}};
  out["sessions"] = nlohmann::ordered_json::array();
  for (const auto& m : s.marks) {
    out["sessions"].push_back({{"session", m.session.session},
                               {"repetition", m.session.repetition},
                               {"pressure_psi", m.session.pressure_psi},
                               {"attempt", m.attempt},
                               {"mark", m.kind == isorig_msgs::session_mark_t::BEGIN ? "begin" : "end"},
                               {"complete", m.complete != 0},
                               {"mono_ns", m.mono_ns}});
  }
  out["events"] = nlohmann::ordered_json::array();
  for (const auto& e : s.events) {
    out["events"].push_back({{"mono_ns", e.mono_ns},
                             {"severity", severity_text(e.severity)},
                             {"code", e.code},
                             {"text", e.text},
                             {"step", e.step},
                             {"value", e.value},
                             {"threshold", e.threshold}});
  }
  std::cout << out.dump(2) << '\n';
  return report.whole() ? kOk : kDataLost;
}

void print_text(const FoundRun& found, const Summary& s, const messages::ReadReport& report,
                bool all_events) {
  const auto& h = s.last_header;
  std::printf("%s\n  %s\n  specimen %s, rig %s%s, attempt %d\n  %s\n", found.id.c_str(),
              found.directory.c_str(), h.specimen.c_str(), h.rig.c_str(),
              h.virtual_time != 0 ? " (virtual time)" : "", h.attempt, h.plan_summary.c_str());
  std::printf("  %.1f MB in %zu segments\n", static_cast<double>(report.bytes) * 1e-6, report.segments);
  const auto stream = [](const char* name, const Summary::Count& c) {
    std::printf("  %-8s %llu samples in full, %llu in %llu averages; times within %.0f us\n", name,
                static_cast<unsigned long long>(c.full), static_cast<unsigned long long>(c.averaged),
                static_cast<unsigned long long>(c.intervals), c.worst_bound_us);
  };
  stream("frame", s.frames);
  stream("pressure", s.pressures);
  std::printf("  loop     %lld overruns, worst wake-up %.0f us, worst run %.0f us\n",
              static_cast<long long>(s.overruns), s.worst_wakeup_ns * 1e-3, s.worst_run_ns * 1e-3);
  std::int64_t start_ns = s.marks.empty() ? 0 : s.marks.front().mono_ns;
  std::printf("sessions (repetition, pressure):\n");
  for (std::size_t i = 0; i < s.marks.size(); ++i) {
    const auto& m = s.marks[i];
    if (m.kind != isorig_msgs::session_mark_t::BEGIN) continue;
    const bool ended = i + 1 < s.marks.size() && s.marks[i + 1].kind == isorig_msgs::session_mark_t::END;
    const char* state = !ended ? "cut off or running" : s.marks[i + 1].complete != 0 ? "complete" : "stopped";
    std::printf("  %3d  rep %d  %5.1f psi  from %10.1f s  %s%s\n", m.session.session, m.session.repetition,
                m.session.pressure_psi, static_cast<double>(m.mono_ns - start_ns) * 1e-9, state,
                m.attempt > 1 ? " (further attempt)" : "");
  }
  std::size_t hidden = 0;
  bool titled = false;
  for (const auto& e : s.events) {
    if (!all_events && e.severity == isorig_msgs::event_t::INFO) {
      ++hidden;
      continue;
    }
    if (!titled) std::printf("events:\n");
    titled = true;
    std::printf("  %10.3f s  %-12s  %-18s  %s\n", static_cast<double>(e.mono_ns - start_ns) * 1e-9,
                severity_text(e.severity), e.code.c_str(), e.text.c_str());
  }
  if (hidden > 0) std::printf("%zu events without consequence are shown by --events\n", hidden);
}

int show(const Options& options) {
  const auto found = find_run(options.run);
  Summary summary;
  const auto report = messages::read_run(found.directory, summary);
  if (options.json) return print_json(found, summary, report);
  print_text(found, summary, report, options.events);
  for (const auto& line : report.complaints()) std::cerr << "isorig show: " << line << '\n';
  return report.whole() ? kOk : kDataLost;
}

Command add_show(CLI::App& app) {
  auto options = std::make_shared<Options>();
  auto* sub = app.add_subcommand("show", "What a run's recording holds: sessions, samples, events, losses");
  options->run.add_to(*sub);
  sub->add_flag("--events", options->events, "All events, also those without consequence");
  sub->add_flag("--json", options->json, "For scripts: everything, as JSON");
  return {sub, [options] { return show(*options); }};
}

const Registration kShow(30, add_show);

}  // namespace
}  // namespace isorig::cli
