#pragma once
#include <filesystem>
#include <optional>
#include <string>

#include "daemon/export/export.hpp"

namespace isorig::cli {

/// The specimen that the last note of a run names (`isorig note --specimen`), which counts in place of the recorded
/// one; nothing where none does. `words` says which, and where its lengths are from.
[[nodiscard]] std::optional<daemon::ExportOptions::Noted> noted_specimen(const std::filesystem::path& run,
                                                                         std::string& words);

}  // namespace isorig::cli
