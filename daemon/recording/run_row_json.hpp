#pragma once
#include <nlohmann/json.hpp>

#include "daemon/recording/catalogue.hpp"

namespace isorig::daemon {

/// A line of the catalogue as `isorig runs --json` and GET /v1/runs give it.
[[nodiscard]] nlohmann::ordered_json row_json(const RunRow& row);

}  // namespace isorig::daemon
