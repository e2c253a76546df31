#pragma once
#include <stdexcept>
#include <string>

#include "daemon/host/host.hpp"

namespace isorig::daemon {

/// A request's body is not what its call takes; what() says what is wrong in it.
class BadRequest : public std::runtime_error {
  using std::runtime_error::runtime_error;
};

/// The body of POST /v1/start; `dry_run`: what of it is only to be shown. Throws BadRequest.
[[nodiscard]] StartOptions start_options(const std::string& body, bool* dry_run = nullptr);

struct CheckRequest {
  std::string protocol_text, protocol_name;
};
/// The body of POST /v1/check. Throws BadRequest.
[[nodiscard]] CheckRequest check_request(const std::string& body);

/// The body of POST /v1/notes. Throws BadRequest.
[[nodiscard]] Correction correction(const std::string& body);

/// The body of POST /v1/parted. Throws BadRequest.
[[nodiscard]] Parting parting(const std::string& body);

/// The record in the body of POST /v1/calibrations. Throws BadRequest.
[[nodiscard]] std::string calibration_record(const std::string& body);

/// The body of POST /v1/setup: nothing, or `off`. Throws BadRequest.
[[nodiscard]] Request setup_request(const std::string& body);

/// The body of POST /v1/jog. Throws BadRequest.
[[nodiscard]] Request jog_request(const std::string& body);

/// Who signs, in the body of POST /v1/accept-rig. Throws BadRequest.
[[nodiscard]] std::string accepting_operator(const std::string& body);

/// What is wanted, in the body of POST /v1/control: take, take-over, give-back or keep. Throws BadRequest.
[[nodiscard]] std::string control_action(const std::string& body);

/// What a body says, for one line of a log: long texts as their length, and a body of more than 4 KiB too, unless
/// `long` ones may be read. Never throws.
[[nodiscard]] std::string short_arguments(const std::string& body, bool may_read_long);

}  // namespace isorig::daemon
