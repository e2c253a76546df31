#include <boost/asio/buffer.hpp>
#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/websocket.hpp>
#include <utility>

#include "webserver/server_impl.hpp"

namespace isorig::web {
namespace {

namespace net = boost::asio;
namespace beast = boost::beast;
namespace websocket = beast::websocket;
using boost::system::error_code;

/// A page asks for nothing over its WebSocket.
constexpr std::size_t kIncomingBytes = 1024;

/// One page. Owned by the operations that are under way on it, and by the hub until it is closed.
class LiveSession final : public Viewer, public std::enable_shared_from_this<LiveSession> {
 public:
  LiveSession(TcpStream stream, OpenConnection server, std::string session)
      : socket_(std::move(stream)),
        server_(std::move(server)),
        session_(std::move(session)),
        outbox_(server_->limits.queue_bytes) {}

  void begin(const Request& request) {
    auto timeout = websocket::stream_base::timeout::suggested(beast::role_type::server);
    timeout.handshake_timeout = server_->limits.request;
    timeout.idle_timeout = server_->limits.silent;  // a ping after half of it
    timeout.keep_alive_pings = true;
    socket_.set_option(timeout);
    socket_.read_message_max(kIncomingBytes);
    socket_.async_accept(request, [self = shared_from_this()](error_code error) {
      if (error) return;
      const auto now = std::chrono::steady_clock::now();
      self->open_ = true;
      self->moved_ = now;
      self->server_->hub.access().connected(self->session_, true, now);
      self->server_->hub.enter(self);
      self->read();
    });
  }

  void send(const std::shared_ptr<const Message>& message) override {
    if (!open_) return;
    if (!outbox_.put(message)) return close();
    if (!sending_) write();
  }

  void look_after(Time now) override {
    const auto written = beast::get_lowest_layer(socket_).rate_policy().bytes();
    if (std::exchange(written_, written) != written) moved_ = now;
    if (sending_ && now - moved_ > server_->limits.stalled) close();
  }

  [[nodiscard]] const std::string& session() const override { return session_; }
  void cut_off() override { close(); }

 private:
  void write() {
    sending_ = outbox_.take();
    if (!sending_) return;
    moved_ = std::chrono::steady_clock::now();
    socket_.binary(sending_->binary());
    socket_.async_write(net::buffer(sending_->bytes), [self = shared_from_this()](error_code error, std::size_t) {
      if (error) return self->close();
      self->write();
    });
  }

  /// Sees pings, pongs and the end; what comes besides is thrown away.
  void read() {
    socket_.async_read(incoming_, [self = shared_from_this()](error_code error, std::size_t) {
      if (error) return self->close();
      self->incoming_.clear();
      self->read();
    });
  }

  void close() {
    if (!std::exchange(open_, false)) return;
    server_->hub.access().connected(session_, false, std::chrono::steady_clock::now());
    server_->hub.leave(this);
    beast::get_lowest_layer(socket_).close();
  }

  websocket::stream<TcpStream> socket_;
  OpenConnection server_;
  const std::string session_;
  beast::flat_buffer incoming_;
  Outbox outbox_;
  std::shared_ptr<const Message> sending_;
  std::uint64_t written_ = 0;  // bytes, when it was last looked at
  Time moved_{};               // when the page took something last, or was first asked to
  bool open_ = false;
};

}  // namespace

void serve_live(TcpStream stream, OpenConnection server, const Request& request, std::string session) {
  const auto made = std::make_shared<LiveSession>(std::move(stream), std::move(server), std::move(session));
  made->begin(request);
}

}  // namespace isorig::web
