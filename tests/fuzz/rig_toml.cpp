// A rig's file, whole, as the daemon reads it. What it names is looked for beside it, in the shipped configuration.
#include "daemon/rig/config.hpp"
#include "target.hpp"
#include "tree.hpp"

namespace {

std::filesystem::path rig_file() {
  const auto folder = isorig::fuzz::scratch() / "rigs";
  std::filesystem::create_directories(folder);
  for (const char* beside : {"frames", "specimens", "regulators", "protocols"})
    std::filesystem::create_directory_symlink(isorig::test::source_path("/config/") + beside,
                                              folder.parent_path() / beside);
  return folder / "rig.toml";
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace isorig;
  static const auto file = rig_file();
  fuzz::put(file, fuzz::text({data, size}));
  try {
    const auto rig = daemon::load_rig(file);
    fuzz::require(!rig.name.empty(), "a rig without a name was taken");
  } catch (const base::ConfigError& error) {
    fuzz::refused(error);
  }
  return 0;
}
