#pragma once
#include <cstddef>

#include "calibration/record.hpp"
#include "cli/rig/client.hpp"

/// What `isorig calibrate` prints.
namespace isorig::cli {

/// One point, as it is taken, on stderr.
void print_point(std::size_t number, const calibration::Point& p, calibration::Correction before, const char* unit);
void print_result(const calibration::Record& r);
/// What is in force, and every record. Returns an ExitCode.
int list_calibrations(const Client& client, bool as_json);

}  // namespace isorig::cli
