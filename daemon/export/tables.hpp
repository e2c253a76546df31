#pragma once
#include <cstdint>
#include <limits>
#include <string>
#include <vector>

#include "daemon/export/scan.hpp"
#include "daemon/export/table.hpp"
#include "protocol/plan.hpp"

/// What a protocol did in a session, as tables: nobody has to look for a ramp in the samples again.
namespace isorig::daemon {

/// A row of the table `sessions`.
struct SessionRow {
  std::string name;
  std::int32_t session = 0, attempt = 0, repetition = 0;
  double pressure_psi = 0.0;
  double pressurized_rest_length_mm = std::numeric_limits<double>::quiet_NaN();
  bool complete = false;
  std::int64_t start_mono_ns = 0, end_mono_ns = 0, start_unix_us = 0;
  std::size_t frame_rows = 0, pressure_rows = 0;
};
[[nodiscard]] Table session_table(const std::vector<SessionRow>& sessions);

/// `start_ns`: where t_s is 0; `end_ns`: of the session, which ends its last step. `steps`: of the plan, empty where it
/// is not known: then targets are what the controller said. `length_mm`: what strain counts from; NaN or 0: unknown.
struct TableInput {
  const ScannedSession* session = nullptr;
  std::int64_t start_ns = 0, end_ns = 0;
  const std::vector<protocol::Step>* plan = nullptr;
  double length_mm = std::numeric_limits<double>::quiet_NaN();
};
/// steps, ramps, holds, events.
[[nodiscard]] std::vector<Table> tables_of(const TableInput& in);

}  // namespace isorig::daemon
