#pragma once
#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

namespace isorig::cli {

/// RUN/trip-N.json (daemon/recording/trip_evidence.hpp), by number. One that cannot be read is told in `complaints`.
[[nodiscard]] nlohmann::ordered_json read_trips(const std::filesystem::path& run_dir,
                                                std::vector<std::string>& complaints);

/// A trip as a short story: what was being done, what went first, what the daemon did, what the plant did, how it
/// ended.
[[nodiscard]] std::string tell_trip(const nlohmann::ordered_json& trip);

}  // namespace isorig::cli
