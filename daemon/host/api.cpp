#include "daemon/host/api.hpp"

#include <algorithm>
#include <array>
#include <charconv>
#include <chrono>
#include <nlohmann/json.hpp>
#include <optional>
#include <string_view>

#include "base/printable.hpp"
#include "base/toml_reader.hpp"
#include "daemon/core/live_window.hpp"
#include "daemon/host/api_requests.hpp"
#include "daemon/host/host.hpp"
#include "daemon/host/paths.hpp"

namespace isorig::daemon {
namespace {

using nlohmann::json;

constexpr std::size_t kTasksQueued = 8;
constexpr auto kVerbPatience = std::chrono::seconds(2);
constexpr auto kAnswerPoll = std::chrono::milliseconds(1);

struct Call {
  const char* method;
  const char* path;
};
constexpr std::array kCalls{
    Call{"GET", "/v1/status"},        Call{"GET", "/v1/events"},        Call{"GET", "/v1/readings"},
    Call{"GET", "/v1/calibrations"},  Call{"GET", "/v1/selftest"},      Call{"POST", "/v1/start"},
    Call{"POST", "/v1/pause"},        Call{"POST", "/v1/resume"},       Call{"POST", "/v1/abort"},
    Call{"POST", "/v1/reset"},        Call{"POST", "/v1/confirm-zero"}, Call{"POST", "/v1/seal"},
    Call{"POST", "/v1/calibrations"}, Call{"POST", "/v1/notes"},        Call{"POST", "/v1/go"},
    Call{"POST", "/v1/setup"},        Call{"POST", "/v1/jog"},          Call{"POST", "/v1/accept-rig"},
    Call{"GET", "/v1/plan"}};

struct Verb {
  const char* path;
  Request::Verb verb;
};
constexpr std::array kVerbs{
    Verb{"/v1/pause", Request::Verb::kPause}, Verb{"/v1/resume", Request::Verb::kResume},
    Verb{"/v1/abort", Request::Verb::kAbort}, Verb{"/v1/reset", Request::Verb::kReset},
    Verb{"/v1/seal", Request::Verb::kSeal},   Verb{"/v1/confirm-zero", Request::Verb::kConfirmZero}};

HttpAnswer answer(int status, const json& body) {
  // What a client sent may stand in a text and need not be UTF-8.
  return {status, body.dump(-1, ' ', false, json::error_handler_t::replace)};
}
HttpAnswer refusal(int status, const std::string& text) {
  return answer(status, {{"ok", false}, {"text", text}});
}
HttpAnswer answer(const Host::Result& result) {
  return answer(result.ok ? 200 : 409, {{"ok", result.ok}, {"text", result.text}, {"run", result.run}});
}

/// The whole text, or nothing.
template <typename Number>
std::optional<Number> number_of(const std::string& text) {
  Number value{};
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc() || end != text.data() + text.size()) return std::nullopt;
  return value;
}

/// A verb for the loop that this call is, with what its body says; nothing when it is none. Throws BadRequest.
std::optional<Request> verb_of(const HttpRequest& q) {
  if (q.path == "/v1/setup") return setup_request(q.body);
  if (q.path == "/v1/jog") return jog_request(q.body);
  const auto verb = std::find_if(kVerbs.begin(), kVerbs.end(), [&](const Verb& v) { return q.path == v.path; });
  if (verb == kVerbs.end()) return std::nullopt;
  Request request;
  request.verb = verb->verb;
  return request;
}

/// What a wrong request, protocol or record throws is 400, what disk or catalogue refuse is 409.
template <typename Call>
HttpAnswer answered(Call&& call) {
  try {
    return call();
  } catch (const base::ConfigError& e) {
    return refusal(400, e.what());
  } catch (const BadRequest& e) {
    return refusal(400, e.what());
  } catch (const std::exception& e) {
    return refusal(409, e.what());
  }
}

HttpAnswer events(const Host& host, const HttpRequest& q) {
  std::uint64_t after = 0;
  if (const auto given = q.query.find("after"); given != q.query.end()) {
    const auto number = number_of<std::uint64_t>(given->second);
    if (!number) return refusal(400, "`after` has to be a whole number, 0 or greater");
    after = *number;
  }
  return answer(200, host.events_json(after));
}

HttpAnswer readings(const Host& host, const HttpRequest& q) {
  double window_s = 2.0;
  if (const auto given = q.query.find("window_s"); given != q.query.end())
    window_s = number_of<double>(given->second).value_or(-1.0);
  if (!(window_s >= 0.1 && window_s <= LiveWindow::kLongest_s)) {
    return refusal(400, "`window_s` has to be a number of seconds between 0.1 and 10");
  }
  return answer(200, host.readings_json(window_s));
}

/// An unknown key would be ignored without a word. Of the calls that stop the rig none is refused for it.
std::optional<HttpAnswer> unknown_query(const HttpRequest& q) {
  if (q.method == "POST" && (q.path == "/v1/abort" || q.path == "/v1/pause")) return std::nullopt;
  const std::string known = q.path == "/v1/events" ? "after" : q.path == "/v1/readings" ? "window_s" : "";
  for (const auto& [key, value] : q.query) {
    if (key == known) continue;
    return refusal(400, q.path + " takes " + (known.empty() ? "no query" : "`" + known + "` only") + ", and not `" +
                            base::printable(key) + "`");
  }
  return std::nullopt;
}

HttpAnswer no_such_call(const HttpRequest& q, bool only_stops) {
  std::string known, methods;
  for (const auto& call : kCalls) {
    if (q.path == call.path) methods += (methods.empty() ? "" : " or ") + std::string(call.method);
    known += (known.empty() ? "" : ", ") + std::string(call.method) + " " + call.path;
  }
  const std::string asked = q.method + " " + q.path;
  if (only_stops) {
    return refusal(404, asked +
                            " is not taken on this socket; it has GET /v1/status, POST /v1/abort, POST /v1/pause, and "
                            "the one without .stop has the rest");
  }
  if (!methods.empty()) return refusal(405, asked + ": the method has to be " + methods);
  return refusal(404, asked + " is not a call of this daemon; it has " + known);
}

}  // namespace

Api::Api(Host& host, const std::filesystem::path& socket_path, unsigned mode, Audit audit)
    : host_(host),
      audit_(std::move(audit)),
      listener_(socket_path, mode),
      stop_listener_(stop_socket_of(socket_path), mode),
      server_(
          listener_.fd(), {}, [this](HttpRequest q, HttpServer::Reply r) { handle(server_, q, r); }, refusal),
      stop_server_(
          stop_listener_.fd(), {}, [this](HttpRequest q, HttpServer::Reply r) { handle(stop_server_, q, r); },
          refusal) {}

Api::~Api() {
  stop();
  tasks_.clear();  // they hold connections of the servers, which go next
}

void Api::serve() {
  server_.run();
}
void Api::serve_stops() {
  stop_server_.run();
}

void Api::work() {
  for (;;) {
    std::function<void()> task;
    {
      std::unique_lock lock(mutex_);
      more_.wait(lock, [this] { return stopping_ || !tasks_.empty(); });
      if (stopping_) return;
      task = std::move(tasks_.front());
      tasks_.pop_front();
    }
    task();
  }
}

void Api::stop() {
  {
    const std::lock_guard lock(mutex_);
    stopping_ = true;
  }
  more_.notify_all();
  server_.stop();
  stop_server_.stop();
}

void Api::handle(HttpServer& server, const HttpRequest& q, const HttpServer::Reply& reply) {
  if (const auto wrong = unknown_query(q)) return reply(*wrong);
  if (answer_at_once(server, q, reply)) return;
  const bool get = q.method == "GET", post = q.method == "POST";
  if (&server == &stop_server_) return reply(no_such_call(q, true));
  if (post && q.path == "/v1/start") {
    later(q, reply, [this, body = q.body] {
      return answered([&] {
        bool dry_run = false;
        const auto options = start_options(body, &dry_run);
        if (!dry_run) return answer(host_.start(options));
        const auto seen = host_.preview(options);
        return answer(seen.value("ok", false) ? 200 : 409, seen);
      });
    });
  } else if (post && q.path == "/v1/notes") {
    later(q, reply, [this, body = q.body] { return answered([&] { return answer(host_.amend(correction(body))); }); });
  } else if (post && q.path == "/v1/go") {
    later(q, reply, [this] { return answered([&] { return answer(host_.go()); }); });
  } else if (post && q.path == "/v1/accept-rig") {
    later(q, reply,
          [this, q] { return answered([&] { return answer(host_.accept_rig(accepting_operator(q.body), q.uid)); }); });
  } else if (post && q.path == "/v1/calibrations") {
    later(q, reply, [this, body = q.body] {
      return answered([&] { return answer(host_.add_calibration(calibration_record(body))); });
    });
  } else if (get && q.path == "/v1/plan") {
    later(q, reply, [this] { return answer(200, host_.plan_json()); });  // a plan may have 50,000 steps
  } else if (get && q.path == "/v1/selftest") {
    later(q, reply, [this] { return answer(200, host_.selftest_json()); });
  } else {
    reply(no_such_call(q, false));
  }
}

/// What needs no disk, in the thread of the connections. False: it is not one of these.
bool Api::answer_at_once(HttpServer& server, const HttpRequest& q, const HttpServer::Reply& reply) {
  const bool stops = &server == &stop_server_;
  if (q.method == "POST") {
    std::optional<Request> request;
    try {
      request = verb_of(q);
    } catch (const BadRequest& e) {
      return reply(refusal(400, e.what())), true;
    }
    if (!request) return false;
    if (stops && request->verb != Request::Verb::kAbort && request->verb != Request::Verb::kPause) return false;
    const auto number = host_.submit(*request);
    if (number == 0) {
      reply(refusal(409, "the loop does not take requests; is it running?"));
    } else {
      await(server, std::make_shared<Wait>(Wait{number, q, reply, std::chrono::steady_clock::now() + kVerbPatience}));
    }
    return true;
  }
  if (q.method != "GET") return false;
  if (q.path == "/v1/status") return reply(answer(200, host_.status_json())), true;
  if (stops) return false;
  if (q.path == "/v1/events") return reply(events(host_, q)), true;
  if (q.path == "/v1/readings") return reply(readings(host_, q)), true;
  if (q.path == "/v1/calibrations") return reply(answer(200, host_.calibrations_json())), true;
  return false;
}

void Api::await(HttpServer& server, const std::shared_ptr<Wait>& wait) {
  if (const auto result = host_.answer_to(wait->number)) {
    const auto taken = answer(*result);
    note(wait->request, taken);
    return wait->reply(taken);
  }
  if (std::chrono::steady_clock::now() < wait->deadline) {
    return server.after(kAnswerPoll, [this, &server, wait] { await(server, wait); });
  }
  const auto none = refusal(409, "the real-time loop did not answer within 2 s; see isorig status");
  note(wait->request, none);
  wait->reply(none);
}

void Api::later(const HttpRequest& q, const HttpServer::Reply& reply, std::function<HttpAnswer()> task) {
  {
    const std::lock_guard lock(mutex_);
    if (tasks_.size() < kTasksQueued) {
      tasks_.push_back([this, q, reply, task = std::move(task)] {
        HttpAnswer result;
        try {
          result = task();
        } catch (const std::exception& e) {
          result = refusal(500, std::string("isorigd could not answer: ") + e.what());
        }
        if (q.method == "POST") note(q, result);
        reply(std::move(result));
      });
      more_.notify_one();
      return;
    }
  }
  reply(refusal(503, "too many calls wait for their turn already; try again"));
}

void Api::note(const HttpRequest& q, const HttpAnswer& result) const {
  if (!audit_) return;
  const auto body = json::parse(result.json, nullptr, false);
  const auto text = body.is_object() ? body.value("text", std::string()) : std::string();
  audit_(q.path.substr(std::min<std::size_t>(4, q.path.size())) + " by uid " + std::to_string(q.uid) + " (process " +
         std::to_string(q.pid) + "): " + text.substr(0, text.find('\n')));
}

}  // namespace isorig::daemon
