#pragma once
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <stdexcept>
#include <string>

#include "base/text_file.hpp"
#include "rig_fixture.hpp"

namespace isorig::daemon::test {

/// The shipped rig on the wire, config/rigs/sim-wire.toml, with one passage of its file replaced.
inline RigConfig wire_rig_with(const std::string& passage, const std::string& replacement) {
  std::string rig = base::read_text_file(source("config/rigs/sim-wire.toml"));
  const auto at = rig.find(passage);
  if (at == std::string::npos) throw std::runtime_error("sim-wire.toml no longer has: " + passage);
  rig.replace(at, passage.size(), replacement);
  for (auto up = rig.find("\"../"); up != std::string::npos; up = rig.find("\"../"))
    rig.replace(up + 1, 2, source("config"));
  const auto path = std::filesystem::temp_directory_path() / ("edited-rig-" + std::to_string(::getpid()) + ".toml");
  std::ofstream(path) << rig;
  struct Remove {
    const std::filesystem::path& path;
    ~Remove() { std::filesystem::remove(path); }
  } remove{path};
  return load_rig(path);
}

}  // namespace isorig::daemon::test
