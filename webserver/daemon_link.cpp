#include "webserver/daemon_link.hpp"

#include <array>
#include <boost/asio/buffer.hpp>
#include <boost/asio/local/stream_protocol.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/beast/core/basic_stream.hpp>
#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/http.hpp>
#include <cstdint>
#include <utility>

#include "daemon/host/paths.hpp"

namespace isorig::web {
namespace {

namespace net = boost::asio;
namespace beast = boost::beast;
namespace http = beast::http;
using Protocol = net::local::stream_protocol;
using boost::system::error_code;

constexpr auto kStatusPeriod = std::chrono::milliseconds(200);
constexpr auto kReconnect = std::chrono::seconds(1);
constexpr auto kPollPatience = std::chrono::seconds(5);
constexpr std::size_t kGroupsSent = 512;  // a header ends at 8 KiB; who is in more has fewer rights, not other ones
constexpr std::uint64_t kAnswerBytes = std::uint64_t{64} << 20U;  // a plan may have 50,000 steps

/// One call on a connection of its own. Owned by the operation that is under way on it.
class Call : public std::enable_shared_from_this<Call> {
 public:
  Call(net::io_context& io, std::chrono::seconds patience, std::function<void(DaemonAnswer)> then)
      : stream_(io), patience_(patience), then_(std::move(then)) {
    parser_.body_limit(kAnswerBytes);
  }

  void begin(const std::string& socket, const std::string& method, const std::string& path, std::string body,
             const std::string& on_behalf) {
    socket_ = socket;
    request_.method(http::string_to_verb(method));
    request_.target(path);
    request_.version(11);
    request_.set(http::field::host, "localhost");
    if (!on_behalf.empty()) request_.set("Isorig-For", on_behalf);
    request_.keep_alive(false);
    request_.body() = std::move(body);
    request_.prepare_payload();
    try {
      stream_.expires_after(patience_);
      stream_.async_connect(Protocol::endpoint(socket), [self = shared_from_this()](error_code error) {
        if (error) return self->fail(error);
        self->write();
      });
    } catch (const boost::system::system_error& e) {
      fail(e.code());  // the path is too long for a socket
    }
  }

 private:
  void write() {
    http::async_write(stream_, request_, [self = shared_from_this()](error_code, std::size_t) {
      // What was refused unread may have been answered all the same.
      http::async_read(self->stream_, self->buffer_, self->parser_,
                       [self](error_code error, std::size_t) { self->on_answer(error); });
    });
  }

  void on_answer(error_code error) {
    if (error) return fail(error);
    DaemonAnswer answer;
    answer.status = static_cast<int>(parser_.get().result_int());
    answer.text = std::move(parser_.get().body());
    answer.body = nlohmann::json::parse(answer.text, nullptr, false);
    if (!answer.body.is_object()) return finish({0, {{"text", "isorigd's answer is not JSON"}}, {}, "silent"});
    finish(std::move(answer));
  }

  void fail(error_code error) {
    const char* none = "silent";
    std::string why = "isorigd on " + socket_ + " does not answer: " + error.message();
    if (error == boost::system::errc::no_such_file_or_directory || error == boost::system::errc::connection_refused) {
      why = "isorigd does not run: nothing answers on " + socket_;
      none = "gone";
    } else if (error == boost::system::errc::permission_denied) {
      why = "isorig-web may not open " + socket_ + "; its user has to be in the group of that file";
      none = "refused";
    }
    finish({0, {{"ok", false}, {"text", why}}, {}, none});
  }

  void finish(DaemonAnswer answer) {
    error_code ignored;
    stream_.socket().close(ignored);
    std::exchange(then_, nullptr)(std::move(answer));
  }

  beast::basic_stream<Protocol> stream_;
  beast::flat_buffer buffer_;
  http::request<http::string_body> request_;
  http::response_parser<http::string_body> parser_;
  std::string socket_;
  std::chrono::seconds patience_;
  std::function<void(DaemonAnswer)> then_;
};

}  // namespace

std::string on_behalf_of(const Who& who) {
  auto groups = who.groups;
  if (groups.size() > kGroupsSent) groups.resize(kGroupsSent);
  // ASCII alone: it stands in a header.
  return nlohmann::json{{"uid", who.uid}, {"gid", who.gid}, {"groups", groups}, {"name", who.name}, {"page", who.page}}
      .dump(-1, ' ', true, nlohmann::json::error_handler_t::replace);
}

struct DaemonLink::Impl : std::enable_shared_from_this<DaemonLink::Impl> {
  Impl(net::io_context& context, std::string s, Listener l)
      : io(context), socket(std::move(s)), listener(std::move(l)), samples(io), again(io), poll(io) {}

  void connect() {
    reader = {};
    samples = Protocol::socket(io);
    try {
      samples.async_connect(Protocol::endpoint(daemon::sample_socket_of(socket).string()),
                            [self = shared_from_this()](error_code error) {
                              if (error) return self->reconnect("");
                              self->listener.log("samples: connected to " + self->socket);
                              self->read();
                            });
    } catch (const boost::system::system_error& e) {
      reconnect(e.what());
    }
  }

  void read() {
    samples.async_read_some(net::buffer(bytes), [self = shared_from_this()](error_code error, std::size_t n) {
      if (error) return self->reconnect("samples: " + error.message());
      try {
        self->reader.feed({self->bytes.data(), n});
        daemon::samples::Record record;
        while (self->reader.next(record)) self->listener.record(record);
      } catch (const daemon::samples::StreamError& e) {
        return self->reconnect(std::string("samples: ") + e.what());
      }
      self->read();
    });
  }

  void reconnect(const std::string& why) {
    if (!why.empty()) listener.log(why);
    error_code ignored;
    samples.close(ignored);
    again.expires_after(kReconnect);
    again.async_wait([self = shared_from_this()](error_code stopped) {
      if (!stopped) self->connect();
    });
  }

  void call(const std::string& method, const std::string& path, std::string body, std::chrono::seconds patience,
            std::function<void(DaemonAnswer)> then, const std::string& on_behalf = {}) {
    const bool stops = method == "POST" && (path == "/v1/abort" || path == "/v1/pause");
    const auto where = stops ? daemon::stop_socket_of(socket).string() : socket;
    const auto made = std::make_shared<Call>(io, patience, std::move(then));
    made->begin(where, method, path, std::move(body), on_behalf);
  }

  /// Status, then what is new: one after the other, so that a slow daemon is asked less often.
  void look() {
    poll.expires_after(kStatusPeriod);
    call("GET", "/v1/status", {}, kPollPatience, [self = shared_from_this()](DaemonAnswer answer) {
      const bool there = answer.status == 200;
      std::string run;
      if (there && answer.body.contains("run")) run = answer.body["run"].value("id", "");
      self->listener.status(answer);
      if (!there) {
        self->last_event = 0;  // another daemon counts from the beginning
        self->have_plan = false;
        return self->rest();
      }
      self->look_at_events(run);
    });
  }

  void look_at_events(const std::string& run) {
    call("GET", "/v1/events?after=" + std::to_string(last_event), {}, kPollPatience,
         [self = shared_from_this(), run](const DaemonAnswer& answer) {
           if (answer.status == 200) {
             const auto last = answer.body.value("last", std::uint64_t{0});
             if (last < self->last_event) {  // restarted meanwhile
               self->last_event = 0;
             } else {
               self->last_event = last;
               if (!answer.body["events"].empty()) self->listener.events(answer);
             }
           }
           if (self->have_plan && run == self->plan_of) return self->rest();
           self->look_at_plan(run);
         });
  }

  void look_at_plan(const std::string& run) {
    call("GET", "/v1/plan", {}, kPollPatience, [self = shared_from_this(), run](const DaemonAnswer& answer) {
      if (answer.status == 200) {
        self->have_plan = true;
        self->plan_of = run;
        self->listener.plan(answer);
      }
      self->rest();
    });
  }

  void rest() {
    poll.async_wait([self = shared_from_this()](error_code stopped) {
      if (!stopped) self->look();
    });
  }

  net::io_context& io;
  const std::string socket;
  const Listener listener;
  Protocol::socket samples;
  net::steady_timer again, poll;
  daemon::samples::Reader reader;
  std::array<char, 65'536> bytes{};
  std::uint64_t last_event = 0;
  bool have_plan = false;
  std::string plan_of;
};

DaemonLink::DaemonLink(net::io_context& io, std::string socket, Listener listener)
    : impl_(std::make_shared<Impl>(io, std::move(socket), std::move(listener))) {}

DaemonLink::~DaemonLink() = default;

void DaemonLink::start() {
  impl_->connect();
  impl_->look();
}

void DaemonLink::call(const std::string& method, const std::string& path, std::string body,
                      std::chrono::seconds patience, std::function<void(DaemonAnswer)> then,
                      const std::string& on_behalf) {
  impl_->call(method, path, std::move(body), patience, std::move(then), on_behalf);
}

}  // namespace isorig::web
