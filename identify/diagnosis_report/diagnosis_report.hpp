#pragma once
#include <filesystem>

#include "identify/diagnose/diagnosis.hpp"
#include "identify/report/page.hpp"

namespace isorig::identify {

/// `folder`/diagnosis-report.html: for people, with figures. Throws what report::Page::write throws.
void write_diagnosis_report(const Study& study, const std::filesystem::path& folder, const report::Made& made = {});

}  // namespace isorig::identify
