#pragma once
#include <filesystem>
#include <memory>
#include <string>

namespace isorig::daemon {

class Host;

/// The daemon's control API: HTTP + JSON on a Unix socket. Whoever may open the socket may move the rig: its owner,
/// group and mode are the access control (docs/api.md). Nothing listens on a network.
///
///   GET  /v1/status            everything `isorig status` and `watch` show
///   GET  /v1/events?after=N    events with a number above N
///   POST /v1/start             {"protocol": TOML text, "protocol_name", "specimen": TOML text, ...}
///   POST /v1/pause | resume | abort | reset
///
/// Answers: 200 {"ok": true, "text"}; 409 {"ok": false, "text"} when the state forbids it; 400 when the request or
/// the protocol is wrong, with every error and its place.
class Api {
 public:
  /// Binds and listens. A socket file that nobody answers on is replaced; one that answers means another daemon
  /// owns the rig. Throws std::runtime_error, saying which.
  Api(Host& host, const std::filesystem::path& socket_path, unsigned mode);
  ~Api();

  /// Serves until stop(); blocks.
  void serve();
  void stop();

 private:
  class Server;
  std::unique_ptr<Server> server_;
  std::filesystem::path path_;
};

}  // namespace isorig::daemon
