#pragma once
#include <filesystem>
#include <string>

#include "cli/screen/duration.hpp"
#include "protocol/limits.hpp"
#include "protocol/plan.hpp"

namespace isorig::cli {

/// [limits] of a rig file. Throws base::ConfigError.
[[nodiscard]] protocol::Limits read_rig_limits(const std::filesystem::path& rig_path);

/// Compiles `protocol_path`; with a rig file, against its [limits] (its other tables have other readers and
/// are not looked at). Throws one base::ConfigError with what is wrong in both files.
[[nodiscard]] protocol::Plan read_plan(const std::filesystem::path& protocol_path,
                                       const std::filesystem::path& rig_path);

}  // namespace isorig::cli
