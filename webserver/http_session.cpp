#include <spdlog/spdlog.h>

#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/http.hpp>
#include <boost/beast/websocket/rfc6455.hpp>
#include <optional>
#include <utility>

#include "base/printable.hpp"
#include "webserver/assets.hpp"
#include "webserver/requests.hpp"
#include "webserver/server_impl.hpp"

namespace isorig::web {
namespace {

namespace beast = boost::beast;
namespace http = beast::http;
using boost::system::error_code;

constexpr std::int64_t kLongestZoom_ns = 3'600'000'000'000;
constexpr std::int64_t kZoomStretches = 4000;

std::string_view view(beast::string_view text) {
  return {text.data(), text.size()};
}
std::string json_text(const std::string& text) {
  return nlohmann::json{{"ok", false}, {"text", text}}.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
}

/// One connection. Owned by the operation that is under way on it.
class HttpSession : public std::enable_shared_from_this<HttpSession> {
 public:
  HttpSession(beast::tcp_stream stream, OpenConnection server)
      : stream_(std::move(stream)), server_(std::move(server)) {}

  void read() {
    parser_.emplace();
    parser_->header_limit(static_cast<std::uint32_t>(server_->limits.header_bytes));
    parser_->body_limit(server_->limits.body_bytes);
    stream_.expires_after(server_->limits.request);
    http::async_read(stream_, buffer_, *parser_,
                     [self = shared_from_this()](error_code error, std::size_t) { self->on_request(error); });
  }

 private:
  void on_request(error_code error) {
    if (error == http::error::header_limit)
      return refuse(http::status::request_header_fields_too_large, "the header is too long");
    if (error == http::error::body_limit)
      return refuse(http::status::payload_too_large, "the body is longer than 1 MiB");
    if (error) return close();
    stream_.expires_never();
    request_ = parser_->release();
    keep_alive_ = request_.keep_alive();
    host_ = std::string(request_[http::field::host]);
    if (!is_loopback_host(host_)) {
      return refuse(http::status::misdirected_request,
                    "this page is at localhost or 127.0.0.1 only; from another machine: ssh -L (docs/web.md)");
    }
    session_ = cookie(view(request_[http::field::cookie]), server_->cookie_name);
    const auto target = std::string(request_.target());
    path_ = target.substr(0, target.find('?'));
    if (path_ == "/live") return live();
    if (path_.starts_with("/api/")) return api(target);
    if (request_.method() != http::verb::get && request_.method() != http::verb::head) {
      return refuse(http::status::method_not_allowed, "the method has to be GET");
    }
    if (path_ == "/enter") return enter(target);
    if (path_ == "/") return answer(http::status::ok, "text/html; charset=utf-8", std::string(kPageHtml));
    if (path_ == "/live.js")
      return answer(http::status::ok, "text/javascript; charset=utf-8", std::string(kPageScript));
    if (path_ == "/live.css") return answer(http::status::ok, "text/css; charset=utf-8", std::string(kPageStyle));
    refuse(http::status::not_found, "there is no such page");
  }

  [[nodiscard]] bool own_origin() const { return is_own_origin(view(request_[http::field::origin]), host_); }

  void live() {
    if (!beast::websocket::is_upgrade(request_)) return refuse(http::status::upgrade_required, "this is a WebSocket");
    if (!own_origin()) return refuse(http::status::forbidden, "this WebSocket is for the server's own page");
    if (!server_->hub.access().who(session_, std::chrono::steady_clock::now())) session_.clear();
    if (server_->hub.viewers(!session_.empty()) >= server_->limits.viewers) {
      return refuse(http::status::service_unavailable, "there are too many pages open; close one");
    }
    serve_live(std::move(stream_), std::move(server_), request_, session_);
  }

  /// The first use of a link that `isorig web` gave.
  void enter(const std::string& target) {
    std::optional<std::string> session;
    std::string why = "This link was used already, or is older than two minutes. `isorig web` makes another one.";
    try {
      session = server_->hub.access().redeem(query_value(target, "token"), std::chrono::steady_clock::now());
    } catch (const Access::TooMany& e) {
      why = e.what();
    }
    if (!session) {
      spdlog::warn("a link was refused: {}", why);
      return refuse(http::status::forbidden, why);
    }
    if (const auto who = server_->hub.access().who(*session, std::chrono::steady_clock::now())) {
      spdlog::info("session of {} (uid {}) begins", base::printable(who->name), who->uid);
    }
    set_cookie_ = server_->cookie_name + "=" + *session + "; Path=/; HttpOnly; SameSite=Strict";
    location_ = "/";
    answer(http::status::see_other, "text/plain; charset=utf-8", "");
  }

  void api(const std::string& target) {
    const bool there = server_->hub.access().who(session_, std::chrono::steady_clock::now()).has_value();
    if (request_.method() == http::verb::get) {
      if (path_ == "/api/zoom") return zoom(target);
      if (path_ != "/api/library") return refuse(http::status::not_found, "there is no such call");
      if (!there)
        return refuse(http::status::forbidden, "this page is view only: isorig web gives a link that may control");
      return answer(http::status::ok, "application/json", server_->hub.library());
    }
    if (request_.method() != http::verb::post) return refuse(http::status::method_not_allowed, "GET or POST");
    if (!own_origin()) return refuse(http::status::forbidden, "this call is for the server's own page");
    if (!view(request_[http::field::content_type]).starts_with("application/json")) {
      return refuse(http::status::unsupported_media_type, "the body has to be application/json");
    }
    if (path_ == "/api/leave") set_cookie_ = server_->cookie_name + "=; Path=/; HttpOnly; SameSite=Strict; Max-Age=0";
    server_->hub.perform(path_.substr(5), session_, request_.body(), [self = shared_from_this()](Hub::Answer a) {
      self->answer(static_cast<http::status>(a.status), "application/json", std::move(a.text));
    });
  }

  void zoom(const std::string& target) {
    const auto from = whole_number(query_value(target, "from")), to = whole_number(query_value(target, "to"));
    const auto stretches = whole_number(query_value(target, "stretches"));
    if (!from || !to || !stretches || *from < 0 || *to <= *from || *to - *from > kLongestZoom_ns || *stretches < 1 ||
        *stretches > kZoomStretches) {
      return refuse(http::status::bad_request, "`from` and `to` in ns, up to an hour; `stretches` up to 4000");
    }
    answer(http::status::ok, "application/octet-stream", server_->hub.zoom(*from, *to, *stretches));
  }

  void refuse(http::status status, const std::string& why) {
    const bool page = path_ == "/enter";
    answer(status, page ? "text/plain; charset=utf-8" : "application/json", page ? why : json_text(why));
  }

  void answer(http::status status, const char* type, std::string body) {
    response_ = {};
    response_.result(status);
    response_.version(11);
    response_.set(http::field::content_type, type);
    response_.set(http::field::cache_control, "no-store");
    response_.set(
        "Content-Security-Policy",
        "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; connect-src 'self' ws://" +
            (is_loopback_host(host_) ? host_ : std::string("localhost")) +
            "; base-uri 'none'; form-action 'none'; frame-ancestors 'none'");
    response_.set("X-Content-Type-Options", "nosniff");
    response_.set("Referrer-Policy", "no-referrer");
    response_.set("Cross-Origin-Opener-Policy", "same-origin");
    response_.set("Cross-Origin-Resource-Policy", "same-origin");
    if (!set_cookie_.empty()) response_.set(http::field::set_cookie, std::exchange(set_cookie_, {}));
    if (!location_.empty()) response_.set(http::field::location, std::exchange(location_, {}));
    response_.keep_alive(keep_alive_);
    const auto length = body.size();
    if (request_.method() != http::verb::head) response_.body() = std::move(body);
    response_.content_length(length);
    stream_.expires_after(server_->limits.request);
    http::async_write(stream_, response_, [self = shared_from_this()](error_code error, std::size_t) {
      if (error || !self->keep_alive_) return self->close();
      self->path_.clear();
      self->read();
    });
  }

  void close() {
    error_code ignored;
    stream_.socket().shutdown(boost::asio::ip::tcp::socket::shutdown_send, ignored);
    stream_.close();
  }

  beast::tcp_stream stream_;
  OpenConnection server_;
  beast::flat_buffer buffer_;
  std::optional<http::request_parser<http::string_body>> parser_;
  Request request_;
  http::response<http::string_body> response_;
  std::string host_, path_, session_, set_cookie_, location_;
  bool keep_alive_ = false;
};

}  // namespace

void serve_http(beast::tcp_stream stream, OpenConnection server) {
  std::make_shared<HttpSession>(std::move(stream), std::move(server))->read();
}

}  // namespace isorig::web
