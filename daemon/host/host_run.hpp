#pragma once
#include <cstdint>
#include <filesystem>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "daemon/host/host.hpp"

namespace isorig::daemon {

/// A run that is open. What is not guarded is set before other threads see it.
struct Host::Run {
  std::string id;
  std::filesystem::path directory;
  std::shared_ptr<const protocol::Plan> plan;
  std::uint32_t first_session = 0;
  std::vector<double> elongation_at_zero_mm;  ///< of each session: rest length minus that at the session's pressure
  bool resumed = false;
  std::int64_t epoch_unix_us = 0;
  double longest_s = 0.0;        ///< from first_session on, each step with its longest
  std::uint64_t run_number = 0;  ///< of the core: what its status says before is about an earlier run

  std::mutex recording;  ///< guards all below, over disk and catalogue
  std::unique_ptr<Recorder> recorder;
  std::int64_t over_since_ns = -1;
  std::int64_t try_again_ns = 0;
  bool finished = false;  ///< the recorder has been given the last record
  bool closed = false;
};

}  // namespace isorig::daemon
