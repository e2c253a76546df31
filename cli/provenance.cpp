#include "cli/provenance.hpp"

#include "cli/command.hpp"
#include "daemon/revision.hpp"
#include "daemon/version.hpp"

namespace isorig::cli {

identify::report::Made made_by_this_call(std::vector<std::pair<std::string, std::string>> inputs) {
  identify::report::Made made;
  made.command = command_line();
  made.version = std::string("isorig ") + daemon::kVersion + " (" + daemon::kRevision + ")";
  made.inputs = std::move(inputs);
  return made;
}

}  // namespace isorig::cli
