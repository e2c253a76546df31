// The bodies of the control API's calls, each reader with every input, and what is made of them.
#include <functional>
#include <nlohmann/json.hpp>

#include "calibration/record.hpp"
#include "daemon/host/api_requests.hpp"
#include "daemon/rig/specimen.hpp"
#include "protocol/compile.hpp"
#include "target.hpp"

namespace {

using namespace isorig;

void attempt(const std::function<void()>& read) {
  try {
    read();
  } catch (const daemon::BadRequest& error) {
    fuzz::refused(error.what());
  } catch (const base::ConfigError& error) {
    fuzz::refused(error);
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string body(fuzz::text({data, size}));
  attempt([&] {
    bool dry_run = false;
    const auto start = daemon::start_options(body, &dry_run);
    if (!start.specimen_text.empty()) (void)daemon::parse_specimen(start.specimen_text, start.specimen_name);
    (void)protocol::compile(base::TomlDocument::parse_text(start.protocol_text, start.protocol_name));
  });
  attempt([&] {
    const auto check = daemon::check_request(body);
    (void)protocol::compile(base::TomlDocument::parse_text(check.protocol_text, check.protocol_name));
  });
  attempt([&] {
    const auto correction = daemon::correction(body);
    if (!correction.specimen_text.empty())
      (void)daemon::parse_specimen(correction.specimen_text, correction.specimen_name);
  });
  attempt([&] { fuzz::require(!daemon::parting(body).text.empty(), "a parting without words"); });
  attempt([&] { (void)calibration::parse_record(daemon::calibration_record(body), "record.toml"); });
  attempt([&] { (void)daemon::setup_request(body); });
  attempt([&] { (void)daemon::jog_request(body); });
  attempt([&] { fuzz::require(!daemon::accepting_operator(body).empty(), "an operator without a name"); });
  return 0;
}
