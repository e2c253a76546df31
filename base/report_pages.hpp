#pragma once
#include <algorithm>
#include <array>
#include <string_view>

namespace isorig::base {

/// What the commands call their pages (docs/reports.md).
inline constexpr std::string_view kRunPage = "report.html";
inline constexpr std::array<std::string_view, 5> kReportPages{kRunPage, "fv-report.html", "campaign-report.html",
                                                              "diagnosis-report.html", "investigation-report.html"};

[[nodiscard]] constexpr bool is_report_page(std::string_view file_name) {
  return std::ranges::find(kReportPages, file_name) != kReportPages.end();
}

}  // namespace isorig::base
