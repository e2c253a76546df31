#include <string>

#include "base/printable.hpp"
#include "c_abi.hpp"
#include "isorig_model.h"
#include "messages/crc32c.hpp"
#include "messages/run_log.hpp"

namespace {

using namespace isorig;
using c_abi::guarded, c_abi::require;

thread_local std::string last_complaints;

}  // namespace

extern "C" {

int isorig_run_state(const char* path, const char* outcome, int still_written, int* state) {
  return guarded(
      [&] {
        require(path, "the path");
        require(outcome, "the outcome");
        require(state, "the place for the state");
        messages::RunVisitor nothing;
        messages::ReadReport report = messages::read_run(path, nothing);
        report.set_against(outcome, still_written != 0);
        *state = static_cast<int>(report.state());
        last_complaints.clear();
        for (const std::string& each : report.complaints()) last_complaints += base::printable(each) + "\n";
        return 0;
      },
      -1);
}

const char* isorig_run_complaints(void) {
  return last_complaints.c_str();
}

uint32_t isorig_crc32c(const uint8_t* bytes, size_t count, uint32_t before) {
  return messages::crc32c({bytes, count}, before);
}

}  // extern "C"
