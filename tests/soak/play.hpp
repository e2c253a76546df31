#pragma once
#include <cstdint>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>

namespace isorig::soak {

struct PlayOptions {
  std::string rig, protocol;        ///< files
  std::filesystem::path runs_root;  ///< empty folder of its own; left to whoever calls
  int faults = 12;
};

/// One seed: the protocol from its start to its end with the faults that the seed draws. What was seen, as JSON:
/// `findings` is empty when every bound was kept.
[[nodiscard]] nlohmann::ordered_json play(std::uint64_t seed, const PlayOptions& options);

/// Of this process.
[[nodiscard]] double resident_MB();
[[nodiscard]] int open_descriptors();

}  // namespace isorig::soak
