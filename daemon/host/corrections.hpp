#pragma once
#include <string>

#include "daemon/host/host.hpp"
#include "daemon/recording/catalogue.hpp"

namespace isorig::daemon {

/// Writes a correction into the catalogue and beside the recording (amendments.hpp), and says what counts now. Throws
/// base::ConfigError for a specimen file that is wrong, std::runtime_error when it cannot be written.
std::string amend_run(Catalogue& catalogue, const RunRow& run, const Correction& correction);

}  // namespace isorig::daemon
