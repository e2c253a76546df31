#pragma once
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/beast/core/tcp_stream.hpp>
#include <boost/beast/http.hpp>
#include <memory>
#include <string>

#include "webserver/server.hpp"

/// What the parts of the server share; for server.cpp, http_session.cpp and live_session.cpp alone.
namespace isorig::web {

struct Server::Impl : std::enable_shared_from_this<Server::Impl> {
  Impl(boost::asio::io_context& context, Hub& h, std::uint16_t port, const ServerLimits& l);
  void accept();

  boost::asio::io_context& io;
  Hub& hub;
  const ServerLimits limits;
  boost::asio::ip::tcp::acceptor acceptor;
  boost::asio::steady_timer pause;
  std::string cookie_name;  ///< a browser sends cookies to every port of a host: each server has a name of its own
  std::size_t open = 0;
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
void serve_http(boost::beast::tcp_stream stream, OpenConnection server);
/// Takes over a connection whose request asks for a WebSocket and was found to be the server's own page.
void serve_live(boost::beast::tcp_stream stream, OpenConnection server, const Request& request, std::string session);

}  // namespace isorig::web
