// A protocol, compiled within the limits of the shipped rig and without any.
#include <cmath>

#include "daemon/rig/config.hpp"
#include "protocol/compile.hpp"
#include "target.hpp"
#include "tree.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace isorig;
  static const auto limits = daemon::load_rig(test::source_path("/config/rigs/sim.toml")).limits;
  for (const auto& within : {limits, protocol::Limits{}}) {
    try {
      const auto document = base::TomlDocument::parse_text(fuzz::text({data, size}), "protocol.toml");
      const auto plan = protocol::compile(document, within);
      fuzz::require(!plan.steps.empty(), "a plan without a step was taken");
      std::size_t told = 0;
      for (const auto& step : plan.steps) {
        if (++told > 100) break;
        fuzz::require(!protocol::describe(step).empty(), "a step without words");
      }
    } catch (const base::ConfigError& error) {
      fuzz::refused(error);
    }
  }
  return 0;
}
