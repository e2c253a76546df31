#include "cli/provenance.hpp"

#include "cli/command.hpp"
#include "daemon/revision.hpp"
#include "daemon/version.hpp"

namespace isorig::cli {

namespace {
bool undated = false;
}

void leave_the_time_out() {
  undated = true;
}

std::string version_and_revision() {
  return std::string("isorig ") + daemon::kVersion + " (" + daemon::kRevision + ")";
}

identify::report::Made made_by_this_call(std::vector<std::pair<std::string, std::string>> inputs) {
  identify::report::Made made;
  made.command = command_line();
  made.version = version_and_revision();
  made.undated = undated;
  made.inputs = std::move(inputs);
  return made;
}

}  // namespace isorig::cli
