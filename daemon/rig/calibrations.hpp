#pragma once
#include <filesystem>
#include <nlohmann/json.hpp>

#include "calibration/store.hpp"
#include "daemon/rig/config.hpp"

/// The records of calibration/ on one side, what the loop corrects with on the other.
namespace isorig::daemon {

/// Where a rig's records are: its [calibration] records, else RUNS/calibration/NAME.
[[nodiscard]] std::filesystem::path records_of(const RigConfig& rig, const std::filesystem::path& runs_root);

/// Reads the rig's records. Throws base::ConfigError.
[[nodiscard]] calibration::Store open_records(const RigConfig& rig, const std::filesystem::path& runs_root);

/// What the loop corrects with, when `store` is in force.
[[nodiscard]] Calibration corrections_of(const calibration::Store& store);

/// The rig with what its records put in force.
[[nodiscard]] RigConfig with_calibration(RigConfig rig, const std::filesystem::path& runs_root);

/// Per channel: correction, record, whether it is overdue.
[[nodiscard]] nlohmann::json to_json(const calibration::Store& store);

}  // namespace isorig::daemon
