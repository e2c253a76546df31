#pragma once
#include <cstdint>
#include <memory>
#include <string>

#include "daemon/host/host.hpp"
#include "daemon/rig/specimen.hpp"

namespace isorig::daemon {

/// All that is known of a run before anything is written.
struct Host::Prepared {
  std::shared_ptr<Run> run;
  std::string protocol_text, protocol_name, specimen_text, specimen_name, operator_name;
  Specimen specimen;
  RunInfo info;
  RecorderOptions recording;
  std::int64_t wall_us = 0;
  std::string warnings;
  std::string changed;  ///< what is otherwise than when the run that goes on began
  bool new_folder = false;
};

}  // namespace isorig::daemon
