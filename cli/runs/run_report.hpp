#pragma once
#include <filesystem>
#include <functional>

#include "cli/runs/run_argument.hpp"
#include "identify/report/page.hpp"

namespace isorig::cli {

/// What a run's own page is called, in the run's folder.
inline constexpr const char* kRunReport = "report.html";

/// The page of a run (docs/reports.md): who, what, when, how well it was measured, what happened, ramps and
/// force-velocity curves of all its pressures. Reads the recording and nothing else; exports it beside the page while
/// it works. Throws what export_run(), read_run() and Page::write() throw.
/// `on_progress` is told how much of it is done, 0 to 1, and what is being done.
void write_run_report(const FoundRun& run, const std::filesystem::path& file, const identify::report::Made& made,
                      const std::function<void(double fraction, const char* doing)>& on_progress = {});

}  // namespace isorig::cli
