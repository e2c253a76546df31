#pragma once
#include <boost/asio/io_context.hpp>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>

#include "webserver/hub.hpp"

namespace isorig::web {

struct ServerLimits {
  std::size_t connections = 128;  ///< with more, the one that has kept the server waiting longest is closed
  std::size_t viewers = 16;       ///< pages without a token; as many again with one
  std::size_t header_bytes = 8 * 1024;
  std::size_t body_bytes = std::size_t{1} << 20U;  ///< a protocol's text
  std::chrono::seconds request{10};                ///< for a request to be there
  /// Samples that wait for each page; what finds it full is left out and counted (Outbox). Shared by the pages.
  std::size_t queue_bytes = std::size_t{24} << 20U;
  std::chrono::seconds stalled{10};  ///< who takes nothing of an answer or a message for so long is cut off
  /// A page that sends nothing, not even the answer to a ping, for so long is cut off. The ping goes out after half of
  /// it, and on a slow link lies behind what ssh (a window of 2 MiB) and the kernel hold: 40 kB/s bring it in time.
  std::chrono::seconds silent{120};
};

/// HTTP and WebSocket on a TCP port of the loopback, in the thread that runs the io_context (docs/web.md).
class Server {
 public:
  /// Binds and listens: port 0 is any that is free. Throws boost::system::system_error.
  Server(boost::asio::io_context& io, Hub& hub, std::uint16_t port, const ServerLimits& limits);
  ~Server();

  void start();
  [[nodiscard]] std::uint16_t port() const;

  struct Impl;

 private:
  std::shared_ptr<Impl> impl_;
};

}  // namespace isorig::web
