#pragma once
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/beast/core/basic_stream.hpp>
#include <boost/beast/core/rate_policy.hpp>
#include <boost/beast/http.hpp>
#include <cstdint>
#include <limits>
#include <list>
#include <memory>
#include <string>

#include "webserver/server.hpp"

/// What the parts of the server share; for server.cpp, http_session.cpp and live_session.cpp alone.
namespace isorig::web {

/// Limits nothing and counts what the kernel took of what was written: Beast tells nobody else how far a message is.
class CountedWrites {
 public:
  [[nodiscard]] std::uint64_t bytes() const { return bytes_; }

 private:
  friend class boost::beast::rate_policy_access;
  static constexpr std::size_t kNoLimit = std::numeric_limits<std::size_t>::max();
  [[nodiscard]] std::size_t available_read_bytes() const noexcept { return kNoLimit; }
  [[nodiscard]] std::size_t available_write_bytes() const noexcept { return kNoLimit; }
  void transfer_read_bytes(std::size_t) noexcept {}
  void transfer_write_bytes(std::size_t n) noexcept { bytes_ += n; }
  void on_timer() noexcept {}

  std::uint64_t bytes_ = 0;
};
using TcpStream = boost::beast::basic_stream<boost::asio::ip::tcp, boost::asio::any_io_executor, CountedWrites>;

/// A connection that waits for its client, to ask or to take an answer.
class Waiting {
 public:
  virtual ~Waiting() = default;
  /// There are too many: says so if it can, and closes.
  virtual void give_up() = 0;
};

struct Server::Impl : std::enable_shared_from_this<Server::Impl> {
  Impl(boost::asio::io_context& context, Hub& h, std::uint16_t port, const ServerLimits& l);
  void accept();
  void take(boost::asio::ip::tcp::socket socket);

  boost::asio::io_context& io;
  Hub& hub;
  const ServerLimits limits;
  boost::asio::ip::tcp::acceptor acceptor;
  boost::asio::steady_timer pause;
  std::string cookie_name;  ///< a browser sends cookies to every port of a host: each server has a name of its own
  std::size_t open = 0;
  std::list<Waiting*> waiting;  ///< the one that began to first in front
};

/// Counts a connection for as long as it lives.
class OpenConnection {
 public:
  explicit OpenConnection(std::shared_ptr<Server::Impl> server) : server_(std::move(server)) { ++server_->open; }
  ~OpenConnection() {
    if (server_) --server_->open;
  }
  OpenConnection(OpenConnection&&) noexcept = default;
  OpenConnection& operator=(OpenConnection&&) = delete;

  Server::Impl* operator->() const { return server_.get(); }

 private:
  std::shared_ptr<Server::Impl> server_;
};

using Request = boost::beast::http::request<boost::beast::http::string_body>;

/// Reads requests and answers them until the connection ends or becomes a WebSocket.
void serve_http(TcpStream stream, OpenConnection server);
/// Takes over a connection whose request asks for a WebSocket and was found to be the server's own page.
void serve_live(TcpStream stream, OpenConnection server, const Request& request, std::string session);

}  // namespace isorig::web
