#pragma once
#include <cstdint>

#include "drivers/api/pressure.hpp"

namespace isorig::daemon {

/// How often the services ask for what.
struct ServiceConfig {
  std::int64_t poll_period_ns = 5'000'000;
  std::int64_t heartbeat_period_ns = 50'000'000;
  std::int64_t sync_period_ns = 1'000'000'000;     ///< time exchanges kept in steady state
  std::int64_t sync_burst_period_ns = 20'000'000;  ///< and for the first `sync_burst` of a connection
  int sync_burst = 50;
  pressure::FillLimits fill_limits;  ///< the pressure device fills within these, whoever asks
};

}  // namespace isorig::daemon
