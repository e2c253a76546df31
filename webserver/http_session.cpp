#include <spdlog/spdlog.h>

#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/http.hpp>
#include <boost/beast/websocket/rfc6455.hpp>
#include <chrono>
#include <list>
#include <optional>
#include <utility>

#include "base/printable.hpp"
#include "webserver/assets.hpp"
#include "webserver/rules/requests.hpp"
#include "webserver/server_impl.hpp"

namespace isorig::web {
namespace {

namespace beast = boost::beast;
namespace http = beast::http;
using boost::system::error_code;

constexpr std::int64_t kLongestZoom_ns = 3'600'000'000'000;
constexpr std::int64_t kZoomStretches = 4000;
constexpr const char* kViewOnly = "this page is view only: isorig web gives a link that may control";
/// Of the page that a link leads to. Without scripts its button does the same.
constexpr const char* kEnterScript = "document.forms[0].submit();\n";
constexpr const char* kNoSession =
    "open the link of `isorig web` to see the runs: what is on disk, and what makes the daemon work, is not for "
    "everybody";

std::string_view view(beast::string_view text) {
  return {text.data(), text.size()};
}
std::string json_text(const std::string& text) {
  return nlohmann::json{{"ok", false}, {"text", text}}.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
}

/// What a refusal of the daemon says in words.
std::string said_in(const std::string& refusal) {
  const auto body = nlohmann::json::parse(refusal, nullptr, false);
  const auto text = body.is_object() ? body.find("text") : body.end();
  return body.is_object() && text != body.end() && text->is_string() ? text->get<std::string>() : refusal;
}

/// Before the path of a report on the disk: so its links, which are relative, lead to its neighbours.
constexpr std::string_view kReports = "/page/";

/// Of a report, whose script and style stand in it (web/build.mjs), which draws PNG and SVG from data: and
/// blob:, saves them as files, and has no fonts, popups, frames or connections.
constexpr const char* kReportPolicy =
    "sandbox allow-scripts allow-downloads; default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; "
    "img-src data: blob:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

/// One connection. Owned by the operation that is under way on it.
class HttpSession final : public Waiting, public std::enable_shared_from_this<HttpSession> {
 public:
  HttpSession(TcpStream stream, OpenConnection server) : stream_(std::move(stream)), server_(std::move(server)) {}
  ~HttpSession() override { leave_queue(); }
  HttpSession(const HttpSession&) = delete;
  HttpSession& operator=(const HttpSession&) = delete;

  void read() {
    join_queue();
    reading_ = true;
    parser_.emplace();
    parser_->header_limit(static_cast<std::uint32_t>(server_->limits.header_bytes));
    parser_->body_limit(server_->limits.body_bytes);
    stream_.expires_after(server_->limits.request);
    http::async_read(stream_, buffer_, *parser_,
                     [self = shared_from_this()](error_code error, std::size_t) { self->on_request(error); });
  }

  void give_up() override {
    const auto self = shared_from_this();
    if (!reading_) return close();
    given_up_ = true;
    keep_alive_ = false;
    refuse(http::status::service_unavailable, "there are too many connections; try again");
  }

 private:
  void on_request(error_code error) {
    if (given_up_) return;
    reading_ = false;
    leave_queue();
    unread_ = error == http::error::header_limit || error == http::error::body_limit;
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
    if (path_ == "/enter" && request_.method() == http::verb::post) return enter();
    if (request_.method() != http::verb::get && request_.method() != http::verb::head) {
      return refuse(http::status::method_not_allowed, "the method has to be GET");
    }
    if (path_.starts_with("/report/") || path_.starts_with(kReports)) {
      if (const auto asking = who()) return report(*asking);
      return path_.starts_with(kReports) ? by_way_of_the_page() : refuse(http::status::forbidden, kNoSession);
    }
    if (path_ == "/enter") return offer_to_enter(target);
    if (path_ == "/enter.js") return answer(http::status::ok, "text/javascript; charset=utf-8", kEnterScript);
    if (path_ == "/") return answer(http::status::ok, "text/html; charset=utf-8", std::string(kPageHtml));
    if (path_ == "/live.js")
      return answer(http::status::ok, "text/javascript; charset=utf-8", std::string(kPageScript));
    if (path_ == "/live.css") return answer(http::status::ok, "text/css; charset=utf-8", std::string(kPageStyle));
    refuse(http::status::not_found, "there is no such page");
  }

  [[nodiscard]] bool own_origin() const { return is_own_origin(view(request_[http::field::origin]), host_); }

  [[nodiscard]] std::optional<Who> who() const {
    return server_->hub.access().who(session_, std::chrono::steady_clock::now());
  }

  void live() {
    if (!beast::websocket::is_upgrade(request_)) return refuse(http::status::upgrade_required, "this is a WebSocket");
    if (!own_origin()) return refuse(http::status::forbidden, "this WebSocket is for the server's own page");
    if (!who()) session_.clear();
    if (server_->hub.viewers(!session_.empty()) >= server_->limits.viewers) {
      return refuse(http::status::service_unavailable, "there are too many pages open; close one");
    }
    serve_live(std::move(stream_), std::move(server_), request_, session_);
  }

  /// The link that `isorig web` gave, opened: a page that enters by itself. To look at the address, as programs do that
  /// fetch what was typed or sent ahead of people, does nothing. Not for another site, which would put a session of its
  /// own in the place of this browser's.
  void offer_to_enter(const std::string& target) {
    if (!is_opened_by_its_user(view(request_["Sec-Fetch-Site"]))) {
      return refuse(http::status::forbidden,
                    "A page of another site led here. Copy the link that `isorig web` printed into the address bar.");
    }
    const auto token = query_value(target, "token");
    if (!is_token(token))
      return refuse(http::status::bad_request, "This is no link of `isorig web`; it makes another one.");
    has_form_ = true;
    answer(http::status::ok, "text/html; charset=utf-8",
           "<!doctype html><html lang=\"en\"><meta charset=\"utf-8\"><title>isorig</title>"
           "<meta name=\"viewport\" content=\"width=device-width\"><link rel=\"stylesheet\" href=\"/live.css\">"
           "<main><form method=\"post\" action=\"/enter\"><input type=\"hidden\" name=\"token\" value=\"" +
               token +
               "\"><button>Open the rig's page</button></form></main><script src=\"/enter.js\"></script></html>");
  }

  /// The first use of a link.
  void enter() {
    if (!own_origin()) return refuse(http::status::forbidden, "this form is for the server's own page");
    std::optional<std::string> session;
    std::string why = "This link was used already, or is older than two minutes. `isorig web` makes another one.";
    try {
      session =
          server_->hub.access().redeem(query_value("?" + request_.body(), "token"), std::chrono::steady_clock::now());
    } catch (const Access::TooMany& e) {
      why = e.what();
    }
    if (!session) {
      spdlog::warn("a link was refused: {}", why);
      return refuse(http::status::forbidden, why);
    }
    if (const auto entering = server_->hub.access().who(*session, std::chrono::steady_clock::now())) {
      spdlog::info("session of {} (uid {}) begins", base::printable(entering->name), entering->uid);
    }
    server_->hub.end_session(session_);  // nobody could use or leave the one whose cookie is replaced here
    set_cookie_ = server_->cookie_name + "=" + *session + "; Path=/; HttpOnly; SameSite=Strict";
    location_ = "/";
    answer(http::status::see_other, "text/plain; charset=utf-8", "");
  }

  void api(const std::string& target) {
    if (request_.method() == http::verb::get) {
      if (path_ == "/api/zoom") return zoom(target);
      const auto what = path_.substr(5);
      if (what == "runs" || what == "calibrations" || what == "diagnoses" || what == "selftest") {
        const auto asking = who();
        if (!asking) return refuse(http::status::forbidden, kNoSession);
        return server_->hub.look_up(what, *asking, [self = shared_from_this()](Hub::Answer a) {
          self->answer(static_cast<http::status>(a.status), "application/json", std::move(a.text));
        });
      }
      if (what == "protocol" || what == "experiment") {
        const auto asking = who();
        return asking ? text_of_a_protocol(what, *asking, target) : refuse(http::status::forbidden, kNoSession);
      }
      if (what != "library") return refuse(http::status::not_found, "there is no such call");
      if (!who()) return refuse(http::status::forbidden, kViewOnly);
      return server_->hub.library([self = shared_from_this()](Hub::Answer a) {
        self->answer(static_cast<http::status>(a.status), "application/json", std::move(a.text));
      });
    }
    if (request_.method() != http::verb::post) return refuse(http::status::method_not_allowed, "GET or POST");
    if (!own_origin()) return refuse(http::status::forbidden, "this call is for the server's own page");
    if (!view(request_[http::field::content_type]).starts_with("application/json")) {
      return refuse(http::status::unsupported_media_type, "the body has to be application/json");
    }
    if (path_ == "/api/leave") set_cookie_ = server_->cookie_name + "=; Path=/; HttpOnly; SameSite=Strict; Max-Age=0";
    server_->hub.perform(path_.substr(5), session_, request_.body(), [self = shared_from_this()](Hub::Answer a) {
      self->place_ = std::move(a.place);
      if (a.status == 503) self->retry_after_ = true;
      self->answer(static_cast<http::status>(a.status), "application/json", std::move(a.text));
    });
  }

  /// One of the library, or what a diagnosis proposes.
  void text_of_a_protocol(const std::string& what, const Who& asking, const std::string& target) {
    if (what == "experiment") {
      return server_->hub.experiment(query_value(target, "id"), asking, [self = shared_from_this()](Hub::Answer a) {
        self->place_ = std::move(a.place);
        if (a.status == 503) self->retry_after_ = true;
        self->answer(static_cast<http::status>(a.status), "application/json", std::move(a.text));
      });
    }
    server_->hub.protocol(query_value(target, "from"), query_value(target, "name"),
                          [self = shared_from_this()](Hub::Answer a) {
                            self->answer(static_cast<http::status>(a.status), "application/json", std::move(a.text));
                          });
  }

  /// A report: it is given an origin of its own, without this page's cookie and calls.
  void report(const Who& asking) {
    const auto send = [self = shared_from_this()](Hub::Answer a) {
      const bool there = a.status == 200;
      self->place_ = std::move(a.place);
      if (a.status == 503) self->retry_after_ = true;
      if (there) self->policy_ = kReportPolicy;
      if (!there && self->path_.starts_with(kReports))
        return self->refuse(static_cast<http::status>(a.status), said_in(a.text));
      self->answer(static_cast<http::status>(a.status), there ? "text/html; charset=utf-8" : "application/json",
                   std::move(a.text));
    };
    if (path_.starts_with(kReports)) return server_->hub.page(path_.substr(kReports.size() - 1), asking, send);
    server_->hub.report(path_.substr(path_.find('/', 1) + 1), asking, send);
  }

  /// A link in a report, in a chat, on another site: a browser sends no SameSite=Strict cookie with it. The page, which
  /// needs none, opens the report again as of its own site, whose cookie is sent (web/src/live/report_link.ts). Who has
  /// no session is told there. What is no navigation could read the answer, and gets none.
  void by_way_of_the_page() {
    const auto mode = view(request_["Sec-Fetch-Mode"]);
    if (!mode.empty() && mode != "navigate") return refuse(http::status::forbidden, kNoSession);
    if (!is_path_of_a_report(path_.substr(kReports.size() - 1)))
      return refuse(http::status::bad_request, "this is no path of a report");
    location_ = "/#" + path_;
    answer(http::status::see_other, "text/plain; charset=utf-8", "");
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
    const bool page = path_ == "/enter" || path_.starts_with(kReports);  // people read it
    answer(status, page ? "text/plain; charset=utf-8" : "application/json", page ? why : json_text(why));
  }

  void answer(http::status status, const char* type, std::string body) {
    response_ = {};
    response_.result(status);
    response_.version(11);
    response_.set(http::field::content_type, type);
    response_.set(http::field::cache_control, "no-store");
    const std::string own =
        "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; connect-src 'self' ws://" +
        (is_loopback_host(host_) ? host_ : std::string("localhost")) + "; base-uri 'none'; form-action " +
        (has_form_ ? "'self'" : "'none'") + "; frame-ancestors 'none'";
    // A sandboxed page has no origin to be isolated with: browsers refuse it beside another opener policy than none.
    response_.set("Cross-Origin-Opener-Policy", policy_.empty() ? "same-origin" : "unsafe-none");
    response_.set("Content-Security-Policy", policy_.empty() ? own : std::exchange(policy_, {}));
    response_.set("X-Content-Type-Options", "nosniff");
    // Without a referrer a browser does not say either of which origin a form is.
    response_.set("Referrer-Policy", std::exchange(has_form_, false) ? "strict-origin" : "no-referrer");
    response_.set("Cross-Origin-Resource-Policy", "same-origin");
    if (!set_cookie_.empty()) response_.set(http::field::set_cookie, std::exchange(set_cookie_, {}));
    if (std::exchange(retry_after_, false)) response_.set(http::field::retry_after, "1");
    if (!location_.empty()) response_.set(http::field::location, std::exchange(location_, {}));
    response_.keep_alive(keep_alive_);
    const auto length = body.size();
    if (request_.method() != http::verb::head) response_.body() = std::move(body);
    response_.content_length(length);
    serializer_.emplace(response_);
    reading_ = false;
    join_queue();
    write();
  }

  /// Piece by piece, each with a deadline of its own: a page of 24 MiB may come over a slow link, as long as it comes.
  void write() {
    stream_.expires_after(server_->limits.stalled);
    http::async_write_some(stream_, *serializer_, [self = shared_from_this()](error_code error, std::size_t) {
      if (!error && !self->serializer_->is_done()) return self->write();
      self->serializer_.reset();
      self->response_ = {};  // a run's page is large
      self->place_.reset();
      if (!error && self->unread_) return self->outlast();
      if (error || !self->keep_alive_) return self->close();
      self->path_.clear();
      self->read();
    });
  }

  /// Of a request that was too long the rest is taken and thrown away, for a while. To close on it would reset the
  /// connection, and the answer that says why would be lost on the way or never be read (RFC 9112, 9.6).
  void outlast() {
    error_code ignored;
    stream_.socket().shutdown(boost::asio::ip::tcp::socket::shutdown_send, ignored);
    buffer_.clear();
    stream_.expires_after(kOutlasting);
    join_queue();
    throw_away(0);
  }
  void throw_away(std::size_t so_far) {
    stream_.async_read_some(buffer_.prepare(kPiece),
                            [self = shared_from_this(), so_far](error_code error, std::size_t n) {
                              if (error || so_far + n > kMostThrownAway) return self->close();
                              self->throw_away(so_far + n);
                            });
  }

  void close() {
    given_up_ = true;
    leave_queue();
    error_code ignored;
    stream_.socket().shutdown(boost::asio::ip::tcp::socket::shutdown_send, ignored);
    stream_.close();
  }

  void join_queue() {
    leave_queue();
    place_in_queue_ = server_->waiting.insert(server_->waiting.end(), this);
  }
  void leave_queue() {
    if (place_in_queue_) server_->waiting.erase(*place_in_queue_);
    place_in_queue_.reset();
  }

  TcpStream stream_;
  OpenConnection server_;
  beast::flat_buffer buffer_;
  std::optional<http::request_parser<http::string_body>> parser_;
  Request request_;
  http::response<http::string_body> response_;
  std::optional<http::response_serializer<http::string_body>> serializer_;  // of it, while it is written
  std::string host_, path_, session_, set_cookie_, location_;
  std::string policy_;                 // of this answer, in place of the page's own
  std::shared_ptr<const void> place_;  // of this answer (Hub::report)
  static constexpr auto kOutlasting = std::chrono::seconds(5);
  static constexpr std::size_t kPiece = std::size_t{64} << 10U, kMostThrownAway = std::size_t{16} << 20U;

  std::optional<std::list<Waiting*>::iterator> place_in_queue_;
  bool reading_ = false;   // a request, nothing of which is answered yet
  bool given_up_ = false;  // the answer that is being written is the last
  bool unread_ = false;    // its request is longer than is taken
  bool retry_after_ = false;
  bool has_form_ = false;  // this answer has one, and it is for this server
  bool keep_alive_ = false;
};

}  // namespace

void serve_http(TcpStream stream, OpenConnection server) {
  std::make_shared<HttpSession>(std::move(stream), std::move(server))->read();
}

}  // namespace isorig::web
