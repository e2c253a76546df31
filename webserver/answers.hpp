#pragma once
#include <nlohmann/json.hpp>
#include <string>

#include "webserver/hub.hpp"

/// What a page is answered.
namespace isorig::web {

/// JSON; a byte that is not UTF-8 becomes U+FFFD.
[[nodiscard]] inline std::string dump(const nlohmann::json& body) {
  return body.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
}

/// In one sentence; a refusal with any `status` but 200.
[[nodiscard]] inline Hub::Answer answer(int status, const std::string& text) {
  return {status, dump({{"ok", status == 200}, {"text", text}})};
}

}  // namespace isorig::web
