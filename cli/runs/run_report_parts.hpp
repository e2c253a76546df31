#pragma once
#include <string>
#include <vector>

#include "cli/runs/run_argument.hpp"
#include "cli/runs/run_evidence.hpp"
#include "daemon/export/export.hpp"
#include "identify/fv/fv_analysis.hpp"
#include "identify/report/page.hpp"
#include "messages/read_report.hpp"

namespace isorig::cli {

/// All that the page of a run is made from.
struct RunPage {
  FoundRun run;
  RunEvidence evidence;
  messages::ReadReport read;
  std::string specimen, operator_name, started, outcome, fault;  ///< with what was put right afterwards
  double rest_length_mm = 0.0;                                   ///< likewise; 0: a note does not say it
  std::vector<daemon::ExportedSession> sessions;
  identify::FvAnalysis analysis;
  std::vector<std::string> not_analysed;  ///< which repetition, and why

  [[nodiscard]] std::uint64_t lost() const;  ///< samples that never came, and records that were dropped
};

/// "86.9 µs", "1.03 ms"
[[nodiscard]] std::string short_time_text(double microseconds);

/// Force, position and pressure over the whole run, repetitions, trips and events.
void add_course(identify::report::Page& page, const RunPage& all);
/// Samples, times, loop, losses, notes of the reader.
void add_quality(identify::report::Page& page, const RunPage& all);
/// Calibration in force, protocol, specimen and rig as they were, versions.
void add_inputs(identify::report::Page& page, const RunPage& all);

}  // namespace isorig::cli
