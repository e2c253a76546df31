#pragma once
#include <filesystem>

#include "cli/run_argument.hpp"
#include "identify/report/page.hpp"

namespace isorig::cli {

/// What a run's own page is called, in the run's folder.
inline constexpr const char* kRunReport = "report.html";

/// The page of a run (docs/reports.md): who, what, when, how well it was measured, what happened, ramps and
/// force-velocity curves of all its pressures. Reads the recording and nothing else; exports it beside the page while
/// it works. Throws what export_run(), read_run() and Page::write() throw.
void write_run_report(const FoundRun& run, const std::filesystem::path& file, const identify::report::Made& made);

}  // namespace isorig::cli
