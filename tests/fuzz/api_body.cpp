// The bodies of the control API's calls, and what is made of them. Each reader is given every input that is JSON. What
// is none each of them has refused by the parser that they share: one is asked then, which one follows from the length.
#include <array>
#include <nlohmann/json.hpp>

#include "base/blank.hpp"
#include "calibration/record.hpp"
#include "daemon/host/api_requests.hpp"
#include "daemon/rig/specimen.hpp"
#include "protocol/compile.hpp"
#include "target.hpp"

namespace {

using namespace isorig;

constexpr std::array<void (*)(const std::string&), 8> kReaders{
    [](const std::string& body) {
      bool dry_run = false;
      const auto start = daemon::start_options(body, &dry_run);
      if (!start.specimen_text.empty()) (void)daemon::parse_specimen(start.specimen_text, start.specimen_name);
      (void)protocol::compile(base::TomlDocument::parse_text(start.protocol_text, start.protocol_name));
    },
    [](const std::string& body) {
      const auto check = daemon::check_request(body);
      (void)protocol::compile(base::TomlDocument::parse_text(check.protocol_text, check.protocol_name));
    },
    [](const std::string& body) {
      const auto correction = daemon::correction(body);
      if (!correction.specimen_text.empty())
        (void)daemon::parse_specimen(correction.specimen_text, correction.specimen_name);
    },
    [](const std::string& body) { fuzz::require(!daemon::parting(body).text.empty(), "a parting without words"); },
    [](const std::string& body) { (void)calibration::parse_record(daemon::calibration_record(body), "record.toml"); },
    [](const std::string& body) { (void)daemon::setup_request(body); },
    [](const std::string& body) { (void)daemon::jog_request(body); },
    [](const std::string& body) {
      fuzz::require(!base::is_blank(daemon::accepting_operator(body)), "an operator without a name");
    },
};

void attempt(void (*read)(const std::string&), const std::string& body) {
  try {
    read(body);
  } catch (const daemon::BadRequest& error) {
    fuzz::refused(error.what());
  } catch (const base::ConfigError& error) {
    fuzz::refused(error);
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string body(fuzz::text({data, size}));
  if (!nlohmann::json::accept(body)) {
    attempt(kReaders[size % kReaders.size()], body);
    return 0;
  }
  for (const auto read : kReaders) attempt(read, body);
  return 0;
}
