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

/// The rig with these corrections in place of its own.
[[nodiscard]] RigConfig corrected(RigConfig rig, const Calibration& calibration);

/// The rig with what its records put in force, and what follows from that. Throws base::ConfigError when a record
/// cannot be read or has a correction that no rig file may have.
[[nodiscard]] RigConfig with_calibration(RigConfig rig, const std::filesystem::path& runs_root);

/// Why `record` cannot be put in force on the rig, by the ranges of [calibration]; empty: it can.
[[nodiscard]] std::string why_not_in_force(RigConfig rig, const calibration::Record& record);

/// Per channel: correction, record, whether it is overdue.
[[nodiscard]] nlohmann::json to_json(const calibration::Store& store);

}  // namespace isorig::daemon
