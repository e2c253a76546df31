#include "daemon/host/http_server.hpp"

#include <unistd.h>

#include <boost/asio/io_context.hpp>
#include <boost/asio/local/stream_protocol.hpp>
#include <boost/asio/post.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/asio/write.hpp>
#include <boost/beast/core/basic_stream.hpp>
#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/http.hpp>
#include <list>
#include <optional>
#include <stdexcept>
#include <utility>

namespace isorig::daemon {
namespace {

namespace net = boost::asio;
namespace beast = boost::beast;
namespace http = beast::http;
using Protocol = net::local::stream_protocol;
using boost::system::error_code;

/// Requests below this do not count towards `all_bodies_bytes`.
constexpr std::uint64_t kSmallBody = 64 * 1024;
/// Connections taken from the backlog before those that are open have their turn. With one, a crowd that connects again
/// as fast as it is closed kept a verb waiting in the backlog for 5 s.
constexpr int kAcceptedAtOnce = 16;

int hex_digit(char c) {
  if (c >= '0' && c <= '9') return c - '0';
  if (c >= 'a' && c <= 'f') return c - 'a' + 10;
  if (c >= 'A' && c <= 'F') return c - 'A' + 10;
  return -1;
}

std::string decoded(const std::string& text) {
  std::string out;
  for (std::size_t i = 0; i < text.size(); ++i) {
    const int high = text[i] == '%' && i + 2 < text.size() ? hex_digit(text[i + 1]) : -1;
    const int low = high >= 0 ? hex_digit(text[i + 2]) : -1;
    if (low >= 0) {
      out += static_cast<char>(high * 16 + low);
      i += 2;
    } else {
      out += text[i] == '+' ? ' ' : text[i];
    }
  }
  return out;
}

void split_target(const std::string& target, HttpRequest& request) {
  const auto mark = target.find('?');
  request.path = target.substr(0, mark);
  if (mark == std::string::npos) return;
  for (std::size_t from = mark + 1; from <= target.size();) {
    const auto to = std::min(target.find('&', from), target.size());
    const auto pair = target.substr(from, to - from);
    const auto equals = pair.find('=');
    if (!pair.empty()) {
      const auto key = decoded(pair.substr(0, equals));
      auto value = equals == std::string::npos ? std::string() : decoded(pair.substr(equals + 1));
      if (!request.query.emplace(key, std::move(value)).second) request.twice = key;
    }
    from = to + 1;
  }
}

}  // namespace

struct HttpServer::Impl {
  Impl(int listening_fd, const Limits& l, Handler h, Refusal r)
      : limits(l), handler(std::move(h)), refusal(std::move(r)), acceptor(io), pause(io) {
    const int own = ::dup(listening_fd);
    if (own < 0) throw std::runtime_error("no descriptor for the API's socket");
    acceptor.assign(Protocol(), own);
    acceptor.non_blocking(true);
  }

  void accept();
  void take(Protocol::socket socket);
  void make_room();

  const Limits limits;
  const Handler handler;
  const Refusal refusal;
  std::size_t open = 0;
  std::uint64_t bodies_bytes = 0;
  net::io_context io{1};
  Protocol::acceptor acceptor;
  net::steady_timer pause;
  /// Those that wait for their client, to ask or to take an answer; the one that began to first in front.
  std::list<std::shared_ptr<Session>> waiting;
};

/// One connection. Owned by the operation that is under way on it.
class HttpServer::Session : public std::enable_shared_from_this<Session> {
 public:
  Session(Impl& server, Protocol::socket socket) : server_(server), stream_(std::move(socket)) {
    peer_ = peer_of(stream_.socket().native_handle());
    ++server_.open;
  }
  ~Session() {
    give_back();
    --server_.open;
  }
  Session(const Session&) = delete;
  Session& operator=(const Session&) = delete;

  void read() {
    give_back();
    join_queue();
    parser_.emplace();
    parser_->header_limit(server_.limits.header_bytes);
    parser_->body_limit(server_.limits.body_bytes);
    stream_.expires_after(server_.limits.header);
    http::async_read_header(stream_, buffer_, *parser_,
                            [self = shared_from_this()](error_code error, std::size_t) { self->on_header(error); });
  }

  /// There are too many: says so if it can, and closes.
  void give_up() {
    if (writing_) return close();
    refuse(503, "there are too many connections; try again");
  }

 private:
  /// Whoever answers, in whatever thread, and is slower to let go than this thread is to write, must not be the one
  /// that ends the connection: the last hold on it is given back to the thread of run().
  struct WayHome {
    explicit WayHome(std::shared_ptr<Session> s) : session(std::move(s)) {}
    ~WayHome() {
      auto& io = session->server_.io;
      if (io.stopped()) return;  // nobody is left to give it back to
      try {
        net::post(io, [held = std::move(session)] {});
      } catch (const std::exception&) {
        // Out of memory: given back here.
      }
    }
    WayHome(const WayHome&) = delete;
    WayHome& operator=(const WayHome&) = delete;
    std::shared_ptr<Session> session;
  };

  void on_header(error_code error) {
    if (given_up_) return;
    if (error) return fail(error);
    if (parser_->chunked()) return refuse(411, "the body has to come with its Content-Length, not in chunks");
    const auto length = parser_->content_length().value_or(0);
    if (length > kSmallBody) {
      if (server_.bodies_bytes + length > server_.limits.all_bodies_bytes) {
        return refuse(503, "too many long requests at once; try again");
      }
      taken_bytes_ = length;
      server_.bodies_bytes += length;
    }
    stream_.expires_after(server_.limits.body);
    if (beast::iequals(parser_->get()[http::field::expect], "100-continue")) {
      static constexpr char kContinue[] = "HTTP/1.1 100 Continue\r\n\r\n";
      writing_ = true;
      net::async_write(stream_, net::buffer(kContinue, sizeof kContinue - 1),
                       [self = shared_from_this()](error_code failed, std::size_t) {
                         self->writing_ = false;
                         if (failed) return self->fail(failed);
                         self->read_body();
                       });
      return;
    }
    read_body();
  }

  void read_body() {
    if (given_up_) return;
    http::async_read(stream_, buffer_, *parser_,
                     [self = shared_from_this()](error_code error, std::size_t) { self->on_request(error); });
  }

  void on_request(error_code error) {
    if (given_up_) return;
    if (error) return fail(error);
    leave_queue();
    stream_.expires_never();
    auto message = parser_->release();
    HttpRequest request;
    request.method = std::string(message.method_string());
    request.body = std::move(message.body());
    request.peer = peer_;
    request.on_behalf = std::string(message["Isorig-For"]);
    split_target(std::string(message.target()), request);
    version_ = message.version();
    keep_alive_ = message.keep_alive();
    auto reply = [way = std::make_shared<WayHome>(shared_from_this())](HttpAnswer answer) {
      net::post(way->session->server_.io,
                [self = way->session, answer = std::move(answer)]() mutable { self->write(std::move(answer)); });
    };
    try {
      server_.handler(std::move(request), reply);
    } catch (const std::exception& e) {
      write(server_.refusal(500, std::string("isorigd could not answer: ") + e.what()));
    }
  }

  void refuse(int status, const std::string& why) {
    keep_alive_ = false;
    write(server_.refusal(status, why));
    given_up_ = true;
  }

  void write(HttpAnswer answer) {
    if (given_up_) return;
    join_queue();
    response_ = {};
    response_.result(static_cast<unsigned>(answer.status));
    response_.version(version_);
    response_.set(http::field::content_type, "application/json");
    response_.keep_alive(keep_alive_);
    response_.body() = std::move(answer.json);
    response_.prepare_payload();
    stream_.expires_after(server_.limits.answer);
    writing_ = true;
    http::async_write(stream_, response_, [self = shared_from_this()](error_code error, std::size_t) {
      self->writing_ = false;
      if (error || !self->keep_alive_) return self->close();
      self->read();
    });
  }

  void fail(error_code error) {
    if (error == http::error::header_limit) return refuse(431, "the request's header is too long");
    if (error == http::error::body_limit) return refuse(413, "the request is longer than 4 MiB");
    const bool nothing_came = error == http::error::end_of_stream || error == http::error::partial_message;
    if (!nothing_came && error.category() == make_error_code(http::error::end_of_stream).category()) {
      return refuse(400, "the request is no HTTP: " + error.message());
    }
    close();
  }

  void close() {
    given_up_ = true;
    leave_queue();
    error_code ignored;
    stream_.socket().shutdown(Protocol::socket::shutdown_both, ignored);
    stream_.close();
  }

  void join_queue() {
    leave_queue();
    place_ = server_.waiting.insert(server_.waiting.end(), shared_from_this());
  }
  void leave_queue() {
    if (place_) server_.waiting.erase(*place_);
    place_.reset();
  }
  void give_back() {
    server_.bodies_bytes -= taken_bytes_;
    taken_bytes_ = 0;
  }

  Impl& server_;
  beast::basic_stream<Protocol> stream_;
  beast::flat_buffer buffer_;
  std::optional<http::request_parser<http::string_body>> parser_;
  http::response<http::string_body> response_;
  std::optional<std::list<std::shared_ptr<Session>>::iterator> place_;
  std::uint64_t taken_bytes_ = 0;
  Peer peer_;
  unsigned version_ = 11;
  bool keep_alive_ = false;
  bool writing_ = false;
  bool given_up_ = false;  ///< the answer that is being written is the last
};

void HttpServer::Impl::accept() {
  acceptor.async_accept([this](error_code error, Protocol::socket socket) {
    if (error == net::error::operation_aborted) return;
    for (int taken = 0; !error;) {
      take(std::move(socket));
      if (++taken == kAcceptedAtOnce) break;
      socket = acceptor.accept(error);
    }
    if (!error || error == net::error::would_block) return accept();
    // No descriptor left, most likely: one was freed, and the next attempt is not made at once.
    pause.expires_after(std::chrono::milliseconds(10));
    pause.async_wait([this](error_code stopped) {
      if (!stopped) accept();
    });
  });
}

void HttpServer::Impl::take(Protocol::socket socket) {
  try {
    make_room();
    // Twice too many are all being answered: the next one finds the door shut.
    if (open < 2 * limits.connections) std::make_shared<Session>(*this, std::move(socket))->read();
  } catch (const std::exception&) {
    // Out of memory: this connection is closed, the next may find some.
  }
}

void HttpServer::Impl::make_room() {
  if (open < limits.connections || waiting.empty()) return;
  const auto longest = waiting.front();
  longest->give_up();
}

HttpServer::HttpServer(int listening_fd, const Limits& limits, Handler handler, Refusal refusal)
    : impl_(std::make_unique<Impl>(listening_fd, limits, std::move(handler), std::move(refusal))) {
  impl_->accept();
}

HttpServer::~HttpServer() = default;

void HttpServer::run() {
  for (;;) {
    try {
      impl_->io.run();
      return;
    } catch (const std::exception&) {
      // Out of memory in one connection's turn: that connection is gone, the others go on.
    }
  }
}

void HttpServer::stop() {
  impl_->io.stop();
}

void HttpServer::after(std::chrono::milliseconds delay, std::function<void()> task) {
  auto timer = std::make_shared<net::steady_timer>(impl_->io, delay);
  timer->async_wait([timer, task = std::move(task)](error_code stopped) {
    if (!stopped) task();
  });
}

}  // namespace isorig::daemon
