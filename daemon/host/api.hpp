#pragma once
#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <filesystem>
#include <functional>
#include <memory>
#include <mutex>
#include <string>

#include "daemon/host/http_server.hpp"
#include "daemon/host/unix_listener.hpp"

namespace isorig::daemon {

class Host;

/// The daemon's control API: HTTP + JSON on two Unix sockets. Whoever may open them may move the rig: their owner,
/// group and mode are the access control (docs/api.md has the calls). Nothing listens on a network.
///
/// The second socket, SOCKET.stop, takes abort, pause and status alone and has a thread of its own: what is asked of
/// the first one cannot keep the rig from being stopped. What waits for disk or a compiler is done by a third thread.
class Api {
 public:
  /// Who did what with which answer, a line each.
  using Audit = std::function<void(const std::string&)>;

  /// Binds and listens. Throws std::runtime_error (unix_listener.hpp).
  Api(Host& host, const std::filesystem::path& socket_path, unsigned mode, Audit audit = {});
  ~Api();

  /// Each serves until stop() and has a thread to itself.
  void serve();
  void serve_stops();
  void work();
  void stop();
  /// Takes the socket files away: for a process that leaves without its destructors.
  void unlink() noexcept {
    listener_.unlink();
    stop_listener_.unlink();
  }

 private:
  void handle(HttpServer& server, const HttpRequest& request, const HttpServer::Reply& reply);
  bool answer_at_once(HttpServer& server, const HttpRequest& request, const HttpServer::Reply& reply);
  struct Wait {
    std::uint32_t number = 0;
    HttpRequest request;
    HttpServer::Reply reply;
    std::chrono::steady_clock::time_point deadline;
  };
  void await(HttpServer& server, const std::shared_ptr<Wait>& wait);
  void later(const HttpRequest& request, const HttpServer::Reply& reply, std::function<HttpAnswer()> task);
  void note(const HttpRequest& request, const HttpAnswer& answer) const;

  Host& host_;
  Audit audit_;
  UnixListener listener_;
  UnixListener stop_listener_;
  std::mutex mutex_;
  std::condition_variable more_;
  std::deque<std::function<void()>> tasks_;  // guarded by mutex_
  bool stopping_ = false;                    // guarded by mutex_
  // Last: no connection outlives what its answers refer to.
  HttpServer server_;
  HttpServer stop_server_;
};

}  // namespace isorig::daemon
