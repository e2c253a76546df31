#pragma once
#include <toml++/toml.h>

#include <cstdint>
#include <string>

#include "daemon/export/rows.hpp"
#include "daemon/export/scan.hpp"
#include "daemon/export/table.hpp"

/// The columns of the three streams, and how a row fills them.
namespace isorig::daemon {

/// What a run says of the origin of its numbers; empty where it does not.
struct StreamOrigin {
  std::string frame_device, pressure_device;                          ///< as they named themselves, else the rig
  toml::table calibration;                                            ///< by channel: what corrected the readings
  double position_step = 0.0, force_step = 0.0, pressure_step = 0.0;  ///< of the readings; 0: not known
  bool remapped = false;  ///< times were mapped again: the columns say whose bound they give
};
[[nodiscard]] StreamOrigin origin_of(const isorig_msgs::run_header_t& header, const Scan& scan);

[[nodiscard]] TableSchema schema_of(Stream stream, const StreamOrigin& origin);

/// One row; `start_ns` is where t_s is 0.
void fill(Table& block, Stream stream, const Row& row, std::int64_t start_ns);

}  // namespace isorig::daemon
