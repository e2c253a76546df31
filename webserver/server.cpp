#include "webserver/server.hpp"

#include <boost/asio/ip/address_v4.hpp>
#include <stdexcept>
#include <string>
#include <utility>

#include "webserver/server_impl.hpp"

namespace isorig::web {
namespace {

namespace net = boost::asio;
using boost::system::error_code;
constexpr auto kAcceptPause = std::chrono::milliseconds(100);
/// Connections taken from the backlog before those that are open have their turn: with one, a crowd that connects again
/// as fast as it is closed keeps an abort in the backlog (daemon/host/http_server.cpp).
constexpr int kAcceptedAtOnce = 16;
/// The kernel says that it takes more when a third of it is free. Left to itself it grows to 4 MiB: on a link of
/// 100 kB/s nothing would seem to be taken for 14 s.
constexpr int kSendBuffer = 128 * 1024;

}  // namespace

namespace {

net::ip::tcp::acceptor listen_on(net::io_context& context, std::uint16_t port) {
  try {
    return {context, net::ip::tcp::endpoint(net::ip::address_v4::loopback(), port), true};
  } catch (const boost::system::system_error& e) {
    throw std::runtime_error("cannot listen on localhost:" + std::to_string(port) + ": " + e.code().message() +
                             "; is another isorig-web there? --port takes another port, 0 any free one");
  }
}

}  // namespace

Server::Impl::Impl(net::io_context& context, Hub& h, std::uint16_t port, const ServerLimits& l)
    : io(context),
      hub(h),
      limits(l),
      acceptor(listen_on(context, port)),
      pause(context),
      cookie_name("isorig-" + std::to_string(acceptor.local_endpoint().port())) {
  acceptor.non_blocking(true);
}

void Server::Impl::accept() {
  acceptor.async_accept([self = shared_from_this()](error_code error, net::ip::tcp::socket socket) {
    if (error == net::error::operation_aborted) return;
    for (int taken = 0; !error;) {
      self->take(std::move(socket));
      if (++taken == kAcceptedAtOnce) break;
      socket = self->acceptor.accept(error);
    }
    if (error && error != net::error::would_block) {  // no descriptor left: tried again, since one may be given back
      self->pause.expires_after(kAcceptPause);
      self->pause.async_wait([self](error_code stopped) {
        if (!stopped) self->accept();
      });
      return;
    }
    self->accept();
  });
}

/// Any user of the machine may open connections and leave them: whoever has kept the server waiting longest makes room
/// for the next, which may be an abort.
void Server::Impl::take(net::ip::tcp::socket socket) {
  if (open >= limits.connections && !waiting.empty()) waiting.front()->give_up();
  // Twice too many are all being answered, or pages: the next one finds the door shut.
  if (open >= 2 * limits.connections) return;
  error_code ignored;
  socket.set_option(net::ip::tcp::no_delay(true), ignored);
  socket.set_option(net::socket_base::send_buffer_size(kSendBuffer), ignored);
  serve_http(TcpStream(std::move(socket)), OpenConnection(shared_from_this()));
}

Server::Server(net::io_context& io, Hub& hub, std::uint16_t port, const ServerLimits& limits)
    : impl_(std::make_shared<Impl>(io, hub, port, limits)) {}

Server::~Server() {
  error_code ignored;
  impl_->acceptor.close(ignored);
}

void Server::start() {
  impl_->accept();
}

std::uint16_t Server::port() const {
  return impl_->acceptor.local_endpoint().port();
}

}  // namespace isorig::web
