#pragma once
#include <cstdint>
#include <filesystem>
#include <string>

#include "daemon/host/http_server.hpp"
#include "daemon/host/unix_listener.hpp"
#include "webserver/rules/access.hpp"

namespace isorig::web {

/// A Unix socket on which `isorig web` asks for a one-time link: who may open the socket may control the rig, as on
/// the daemon's own. In a thread of its own.
class Mint {
 public:
  Mint(const std::filesystem::path& socket, Access& access, std::uint16_t port);

  /// Serves until stop().
  void run() { server_.run(); }
  void stop() { server_.stop(); }

 private:
  [[nodiscard]] daemon::HttpAnswer answer(const daemon::HttpRequest& request);

  Access& access_;
  std::uint16_t port_;
  daemon::UnixListener listener_;
  daemon::HttpServer server_;
};

}  // namespace isorig::web
