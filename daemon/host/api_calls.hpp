#pragma once
#include <string>

#include "daemon/host/api_gate.hpp"
#include "daemon/host/http_server.hpp"

/// The calls that there are, and what each needs (docs/api.md).
namespace isorig::daemon {

[[nodiscard]] Needs needs_of(const HttpRequest& request);

/// Abort or pause.
[[nodiscard]] bool is_stop(const HttpRequest& request);
/// Of SOCKET.stop: one of these, or the status.
[[nodiscard]] bool is_of_the_stop_socket(const HttpRequest& request);

/// An unknown key would be ignored without a word: "", or what is wrong. Of the calls that stop the rig none is refused
/// for it.
[[nodiscard]] std::string why_not_the_query(const HttpRequest& request);

struct NoSuchCall {
  int status = 404;
  std::string text;
};
[[nodiscard]] NoSuchCall why_no_such_call(const HttpRequest& request, bool only_stops);

}  // namespace isorig::daemon
