#include "webserver/mint.hpp"

#include <spdlog/spdlog.h>

#include <nlohmann/json.hpp>

#include "base/printable.hpp"

namespace isorig::web {
namespace {

using nlohmann::json;

constexpr std::size_t kNameBytes = 64;
/// Owner and group, as the daemon's socket: the group is that of the process.
constexpr unsigned kMode = 0660;

daemon::HttpAnswer answered(int status, json body) {
  body["ok"] = status == 200;
  return {status, body.dump(-1, ' ', false, json::error_handler_t::replace)};
}

}  // namespace

Mint::Mint(const std::filesystem::path& socket, Access& access, std::uint16_t port)
    : access_(access),
      port_(port),
      listener_(socket, kMode),
      server_(
          listener_.fd(), {},
          [this](const daemon::HttpRequest& q, const daemon::HttpServer::Reply& reply) { reply(answer(q)); },
          [](int status, const std::string& why) {
            return answered(status, {{"text", why}});
          }) {}

daemon::HttpAnswer Mint::answer(const daemon::HttpRequest& q) {
  if (q.method != "POST" || q.path != "/v1/link") {
    return answered(404, {{"text", "this socket has POST /v1/link alone; the rig is at the daemon's"}});
  }
  const auto body = q.body.empty() ? json::object() : json::parse(q.body, nullptr, false);
  if (!body.is_object()) return answered(400, {{"text", "the body has to be a JSON object"}});
  std::string name;
  for (const auto& [key, value] : body.items()) {
    if (key != "name" || !value.is_string()) return answered(400, {{"text", "takes `name` only, a text"}});
    name = value.get<std::string>();
  }
  if (name.empty()) name = daemon::user_name(q.peer.uid);
  if (name.size() > kNameBytes || base::printable(name) != name) {
    return answered(400, {{"text", "the name has to be printable and at most 64 bytes long"}});
  }
  try {
    const auto token =
        access_.mint({name, q.peer.uid, q.peer.gid, q.peer.groups, {}}, std::chrono::steady_clock::now());
    spdlog::info("a link for {} (uid {}, process {})", name, q.peer.uid, q.peer.pid);
    return answered(200, {{"text", "http://localhost:" + std::to_string(port_) + "/enter?token=" + token},
                          {"path", "/enter?token=" + token},
                          {"port", port_},
                          {"name", name}});
  } catch (const std::exception& e) {
    return answered(503, {{"text", e.what()}});
  }
}

}  // namespace isorig::web
