#pragma once
#include <filesystem>

#include "identify/report/page.hpp"
#include "identify/response/response_diagnosis.hpp"

namespace isorig::identify::response {

/// diagnosis-report.html in `folder`.
void write_response_report(const ResponseDiagnosis& diagnosis, const std::filesystem::path& folder,
                           const report::Made& made);

}  // namespace isorig::identify::response
