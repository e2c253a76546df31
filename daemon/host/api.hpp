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

#include "daemon/core/core.hpp"
#include "daemon/host/api_gate.hpp"
#include "daemon/host/http_server.hpp"
#include "daemon/host/unix_listener.hpp"

namespace isorig::daemon {

class Host;

/// The daemon's control API: HTTP + JSON on two Unix sockets (docs/api.md has the calls). Their owner, group and mode
/// say who may come in, groups who may do what there, and one at a time has control (api_gate.hpp). Nothing listens on
/// a network.
///
/// The second socket, SOCKET.stop, takes abort, pause and status alone and has a thread of its own: what is asked of
/// the first one cannot keep the rig from being stopped. What waits for disk or a compiler is done by a third thread.
class Api {
 public:
  /// Who did what with which answer, a line each.
  using Audit = std::function<void(const std::string&)>;

  /// Binds and listens. Throws std::runtime_error (unix_listener.hpp). `audit_log` may be null.
  Api(Host& host, const std::filesystem::path& socket_path, unsigned mode, Audit audit = {}, Roles roles = {},
      AuditLog* audit_log = nullptr);
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
  using Pass = std::shared_ptr<ApiGate::Pass>;
  void handle(HttpServer& server, const HttpRequest& request, HttpServer::Reply reply);
  bool answer_at_once(HttpServer& server, const Pass& pass, const HttpServer::Reply& reply);
  bool answer_later(const Pass& pass, const HttpServer::Reply& reply);
  HttpAnswer with_control(const Pass& pass, const std::function<HttpAnswer()>& call);
  struct Wait {
    std::uint32_t number = 0;
    Request::Verb verb = Request::Verb::kAbort;
    HttpServer::Reply reply;
    std::chrono::steady_clock::time_point deadline;
  };
  void await(HttpServer& server, const std::shared_ptr<Wait>& wait);
  void later(const Pass& pass, const HttpServer::Reply& reply, std::function<HttpAnswer()> task);

  Host& host_;
  ApiGate gate_;
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
