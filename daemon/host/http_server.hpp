#pragma once
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>

#include "daemon/host/peer.hpp"

namespace isorig::daemon {

struct HttpRequest {
  std::string method;
  std::string path;  ///< without the query
  std::map<std::string, std::string> query;
  std::optional<std::string> twice;  ///< a key that stands more than once in the query
  std::string body;
  Peer peer;              ///< the process that opened the connection
  std::string on_behalf;  ///< the header Isorig-For: of whom the sender says that he asks (api_gate.hpp)
};

struct HttpAnswer {
  int status = 200;
  std::string json;
};

/// HTTP/1.1 on a Unix socket that listens already, all connections on the one thread that calls run(). No client can
/// hold up another: nothing here waits for one, a request has to be there whole within its deadline, and when there are
/// more connections than `connections`, the one that has kept us waiting longest for a request is given up.
class HttpServer {
 public:
  struct Limits {
    std::size_t connections = 64;
    std::uint32_t header_bytes = 8 * 1024;
    std::uint64_t body_bytes = std::uint64_t{4} << 20U;
    std::uint64_t all_bodies_bytes = std::uint64_t{16} << 20U;  ///< of all requests together
    std::chrono::milliseconds header{2000};                     ///< from connecting, or from the last answer
    std::chrono::milliseconds body{10'000};
    std::chrono::milliseconds answer{10'000};  ///< for the client to take it
  };
  /// To be called once, by any thread.
  using Reply = std::function<void(HttpAnswer)>;
  /// Called by the thread in run(); must not wait.
  using Handler = std::function<void(HttpRequest, Reply)>;
  /// What the server refuses by itself, put into the form of every other answer.
  using Refusal = std::function<HttpAnswer(int status, const std::string& why)>;

  HttpServer(int listening_fd, const Limits& limits, Handler handler, Refusal refusal);
  ~HttpServer();

  /// Serves until stop(). Exceptions of handlers are answered with 500.
  void run();
  void stop();
  /// Calls `task` in the thread of run() after `delay`. From that thread.
  void after(std::chrono::milliseconds delay, std::function<void()> task);

 private:
  struct Impl;
  class Session;
  std::unique_ptr<Impl> impl_;
};

}  // namespace isorig::daemon
