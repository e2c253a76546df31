// The live page's port from its socket on: HTTP and WebSocket, before a hub whose daemon is played here.
// First byte, in bits: 1 with the cookie of a session; 2, 4 the origin (own, none, another site, another port); 8
// another host; 16 JSON; 32 a WebSocket; 64 bytes as they are, without any of these. A request: its line (@TOKEN@ is a
// link's), a line of "%%%%", its body. A WebSocket: frames, and what is in them.
#include <arpa/inet.h>
#include <netinet/in.h>
#include <spdlog/spdlog.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <boost/asio/io_context.hpp>
#include <boost/asio/local/stream_protocol.hpp>
#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/http.hpp>
#include <chrono>
#include <memory>
#include <optional>
#include <set>
#include <string>

#include "answers.hpp"
#include "daemon/host/paths.hpp"
#include "target.hpp"
#include "webserver/server.hpp"

namespace isorig::fuzz {
namespace {

/// In a file beside the folders of the library, and in one that a link among the saved protocols leads to.
constexpr const char* kOutside = "what lies outside is shown to nobody";
/// In the answers of the daemon that are for people with a session.
constexpr const char* kInside = "a run's page is for people with a session";

/// As isorigd to isorig-web, on both of its sockets: takes every call, and counts them. In the page's own thread: a
/// call that goes from one thread to another waits for the scheduler, longer than for all else.
class PlayedDaemon {
 public:
  PlayedDaemon(boost::asio::io_context& io, const std::filesystem::path& socket)
      : main_(io, Local::endpoint(socket.string())),
        stops_(io, Local::endpoint(daemon::stop_socket_of(socket).string())) {
    accept(main_);
    accept(stops_);
  }

  [[nodiscard]] unsigned commands() const { return commands_; }
  [[nodiscard]] unsigned looks() const { return looks_; }

 private:
  using Local = boost::asio::local::stream_protocol;
  using Body = boost::beast::http::string_body;

  struct Call {
    explicit Call(Local::socket s) : socket(std::move(s)) {}
    Local::socket socket;
    boost::beast::flat_buffer buffer;
    boost::beast::http::request<Body> request;
    boost::beast::http::response<Body> answer;
  };

  void accept(Local::acceptor& door) {
    door.async_accept([this, &door](boost::system::error_code error, Local::socket socket) {
      if (error) return;
      auto call = std::make_shared<Call>(std::move(socket));
      boost::beast::http::async_read(call->socket, call->buffer, call->request,
                                     [this, call](boost::system::error_code failed, std::size_t) {
                                       if (failed == boost::beast::http::error::header_limit) return refuse(call);
                                       require(!failed, "a call that is no HTTP reaches the daemon");
                                       take(call);
                                     });
      accept(door);
    });
  }

  void take(const std::shared_ptr<Call>& call) {
    ++(call->request.method() == boost::beast::http::verb::post ? commands_ : looks_);
    answer(call, {{"ok", true}, {"text", "done"}, {"page", kInside}, {"term", 1}});
  }

  /// As isorigd does: a path of a report may be longer in the call than it was in the page's request.
  static void refuse(const std::shared_ptr<Call>& call) {
    call->answer.result(boost::beast::http::status::request_header_fields_too_large);
    answer(call, {{"ok", false}, {"text", "the request's header is too long"}});
  }

  static void answer(const std::shared_ptr<Call>& call, const nlohmann::json& body) {
    call->answer.body() = body.dump();
    call->answer.keep_alive(false);
    call->answer.prepare_payload();
    boost::beast::http::async_write(call->socket, call->answer, [call](boost::system::error_code, std::size_t) {});
  }

  unsigned commands_ = 0, looks_ = 0;
  Local::acceptor main_, stops_;
};

struct How {
  explicit How(unsigned byte)
      : cookie((byte & 1U) != 0),
        origin(byte >> 1U & 3U),
        other_host((byte & 8U) != 0),
        json((byte & 16U) != 0),
        live((byte & 32U) != 0),
        as_is((byte & 64U) != 0) {}
  bool cookie;
  unsigned origin;
  bool other_host, json, live, as_is;

  [[nodiscard]] bool own() const { return origin == 0 && !other_host; }
};

class Served {
 public:
  Served() : folder_(scratch() / "web") {
    spdlog::set_level(spdlog::level::off);
    std::filesystem::remove_all(folder_);
    for (const char* name : {"protocols", "specimens", "models"}) std::filesystem::create_directories(folder_ / name);
    put(folder_ / "outside.toml", kOutside);
    put(folder_ / "protocols/p.toml", "format = \"isorig-protocol/1\"\n");
    put(folder_ / "specimens/s.toml", "format = \"isorig-specimen/1\"\n");
    put_saved();
    played_ = std::make_unique<PlayedDaemon>(io_, folder_ / "s");
    web::HubSettings settings;
    settings.socket = (folder_ / "s").string();
    settings.protocols = folder_ / "protocols";
    settings.saved_protocols = folder_ / "saved";
    settings.specimens = folder_ / "specimens";
    settings.models = folder_ / "models";
    hub_ = std::make_unique<web::Hub>(io_, settings);
    server_ = std::make_unique<web::Server>(io_, *hub_, 0, web::ServerLimits{});
    server_->start();
    before_ = entries();
    // What is refused below has a counterpart that is not.
    constexpr std::string_view kAbort = "POST /api/abort\n%%%%\n{}";
    Input abort(reinterpret_cast<const std::uint8_t*>(kAbort.data()), kAbort.size());
    exchange(How(1U | 16U), abort);
    require(played_->commands() == 1, "a command of the own page does not reach the daemon");
  }

  /// Sessions, links and saved protocols are bounded, and used up.
  void refresh() {
    hub_->access().expire(std::chrono::steady_clock::now() + std::chrono::hours(24));
    (void)hub_->access().control_is(std::nullopt);
    put_saved();
  }

  void exchange(const How& how, Input& in) {
    const auto commands = played_->commands(), looks = played_->looks();
    const int fd = connected();
    std::string got;
    bool has_heads = false;  // of several answers one to HEAD has no body: the next is in its place
    if (how.as_is) {
      const auto bytes = text(in.rest());
      has_heads = bytes.find("HEAD") != std::string_view::npos;
      got = talk(fd, bytes, [this] { turn(); });
    } else if (how.live) {
      got = look_on(fd, how, in);
    } else {
      const std::string line(text(in.part())), body(text(in.rest()));
      got = talk(fd, request(how, line, body), [this] { turn(); });
    }
    ::close(fd);
    turn();
    if (!has_heads) check_answers(got);
    const bool has_session = how.cookie && !how.as_is;
    require(got.find(kOutside) == std::string::npos, "a file outside of the folders was shown");
    require(got.find(kInside) == std::string::npos || has_session, "a page was shown to somebody without a session");
    require(played_->looks() == looks || (has_session && !how.other_host), "the daemon was asked without a session");
    // Also of its own page it takes JSON only: a form of another site can send none.
    require(played_->commands() == commands || (has_session && how.own() && how.json),
            "a command reached the daemon without a session, or from another site");
    require(entries() == before_, "a file was made outside of the folder for saved protocols");
  }

 private:
  /// The link alone; a protocol may be on its way into the folder.
  void put_saved() const {
    const auto saved = folder_ / "saved";
    std::error_code ignored;
    std::filesystem::create_directories(saved, ignored);
    for (const auto& entry : std::filesystem::directory_iterator(saved, ignored))
      std::filesystem::remove_all(entry.path(), ignored);
    std::filesystem::create_symlink("../outside.toml", saved / "link.toml", ignored);
  }

  [[nodiscard]] std::set<std::string> entries() const {
    std::set<std::string> names;
    for (const char* under : {"", "protocols", "specimens", "models"})
      for (const auto& entry : std::filesystem::directory_iterator(folder_ / under))
        names.insert(entry.path().string());
    return names;
  }

  void turn() {
    io_.restart();
    io_.poll();
  }

  [[nodiscard]] int connected() const {
    const int fd = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_port = htons(server_->port());
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    require(::connect(fd, reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0, "nobody listens");
    return fd;
  }

  [[nodiscard]] std::string token() {
    const web::Who who{"A. Lovelace", 1000, 1000, {}, {}};
    try {
      return hub_->access().mint(who, std::chrono::steady_clock::now());
    } catch (const web::Access::TooMany&) {
      return "none";
    }
  }

  [[nodiscard]] std::string session() {
    const auto now = std::chrono::steady_clock::now();
    if (!hub_->access().who(session_, now)) session_ = hub_->access().redeem(token(), now).value_or("none");
    return session_;
  }

  /// What a browser puts before every request, by the choices of the input.
  [[nodiscard]] std::string headers(const How& how) {
    const auto port = ":" + std::to_string(server_->port());
    const std::string host = (how.other_host ? "lab.example" : "localhost") + port;
    std::string all = "Host: " + host + "\r\n";
    if (how.origin != 1)
      all += "Origin: http://" +
             (how.origin == 0   ? host
              : how.origin == 2 ? std::string("evil.example")
                                : std::string("localhost:1")) +
             "\r\n";
    if (how.cookie) all += "Cookie: a=b; isorig-" + port.substr(1) + "=" + session() + "\r\n";
    return all;
  }

  [[nodiscard]] std::string request(const How& how, std::string line, const std::string& body) {
    // A line that makes headers of its own would make other choices than the first byte.
    std::replace_if(
        line.begin(), line.end(), [](unsigned char c) { return c == '\r' || c == '\n'; }, ' ');
    if (const auto at = line.find("@TOKEN@"); at != std::string::npos) line.replace(at, 7, token());
    return line + " HTTP/1.1\r\n" + headers(how) + "Content-Type: " + (how.json ? "application/json" : "text/plain") +
           "\r\nConnection: close\r\nContent-Length: " + std::to_string(body.size()) + "\r\n\r\n" + body;
  }

  /// A page that looks on, and says what no page says.
  [[nodiscard]] std::string look_on(int fd, const How& how, Input& in) {
    const auto ask = "GET /live HTTP/1.1\r\n" + headers(how) +
                     "Connection: Upgrade\r\nUpgrade: websocket\r\nSec-WebSocket-Version: 13\r\n"
                     "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n";
    require(::send(fd, ask.data(), ask.size(), MSG_NOSIGNAL) == static_cast<ssize_t>(ask.size()), "not sent");
    std::string head;
    for (int i = 0; i < 100'000 && head.find("\r\n\r\n") == std::string::npos; ++i) {
      turn();
      char bytes[4096];
      const auto n = ::recv(fd, bytes, sizeof bytes, MSG_DONTWAIT);
      if (n == 0) break;
      if (n > 0) head.append(bytes, static_cast<std::size_t>(n));
    }
    require(head.starts_with("HTTP/1.1 "), "a WebSocket that is asked for is not answered");
    const bool taken = head.starts_with("HTTP/1.1 101 ");
    require(taken == how.own(), "a WebSocket has to be for the server's own page, and for it alone");
    std::string frames;
    while (!in.empty()) {
      const auto first = in.byte();
      if (first == 0xff) {  // as they are
        frames += text(in.rest());
        break;
      }
      const auto payload = text(in.take(in.byte() % 126U));
      frames += static_cast<char>(first);
      frames += static_cast<char>(0x80U | payload.size());  // masked, as a browser has to
      frames += std::string("\0\0\0\0", 4);
      frames += payload;
    }
    return head + talk(fd, frames, [this] { turn(); });
  }

  std::filesystem::path folder_;
  boost::asio::io_context io_{1};
  std::unique_ptr<PlayedDaemon> played_;
  std::unique_ptr<web::Hub> hub_;
  std::unique_ptr<web::Server> server_;
  std::set<std::string> before_;
  std::string session_;
};

}  // namespace
}  // namespace isorig::fuzz

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace isorig::fuzz;
  // Anew seldom: the room for the history of a hub's samples is 60 MB.
  Served& served = server_for_next_input<Served>(20'000, [](const Served&) { return true; });
  static unsigned inputs = 0;
  if (++inputs % 50 == 0) served.refresh();
  Input in(data, size);
  const How how(in.byte());
  served.exchange(how, in);
  return 0;
}
