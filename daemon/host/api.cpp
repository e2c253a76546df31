#include "daemon/host/api.hpp"

#include <unistd.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <chrono>
#include <nlohmann/json.hpp>
#include <optional>
#include <string_view>

#include "base/printable.hpp"
#include "base/toml_reader.hpp"
#include "daemon/core/fixed_text.hpp"
#include "daemon/core/live_window.hpp"
#include "daemon/host/api_calls.hpp"
#include "daemon/host/api_requests.hpp"
#include "daemon/host/host.hpp"
#include "daemon/host/not_there.hpp"
#include "daemon/host/paths.hpp"
#include "daemon/host/verb_desk.hpp"

namespace isorig::daemon {
namespace {

using nlohmann::json;

constexpr std::size_t kTasksQueued = 8;
constexpr auto kAnswerPoll = std::chrono::milliseconds(1);

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
HttpAnswer no_such_call(const HttpRequest& q, bool only_stops) {
  const auto why = why_no_such_call(q, only_stops);
  return refusal(why.status, why.text);
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

/// What a wrong request, protocol or record throws is 400, what is not there 404, what disk or catalogue refuse 409.
template <typename Call>
HttpAnswer answered(Call&& call) {
  try {
    return call();
  } catch (const base::ConfigError& e) {
    json places = json::array();
    for (const auto& d : e.diagnostics()) {
      places.push_back(
          {{"file", d.file}, {"line", d.line}, {"column", d.column}, {"message", d.message}, {"text", d.text()}});
    }
    return answer(400, {{"ok", false}, {"text", e.what()}, {"diagnostics", std::move(places)}});
  } catch (const BadRequest& e) {
    return refusal(400, e.what());
  } catch (const NotThere& e) {
    return refusal(404, e.what());
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

}  // namespace

Api::Api(Host& host, const std::filesystem::path& socket_path, unsigned mode, Audit audit, Roles roles,
         AuditLog* audit_log)
    : host_(host),
      gate_(std::move(roles), audit_log, std::move(audit), [&host] { return !host.is_between_runs(); }),
      listener_(socket_path, mode),
      stop_listener_(stop_socket_of(socket_path), mode),
      server_(
          listener_.fd(), {}, [this](const HttpRequest& q, const HttpServer::Reply& r) { handle(server_, q, r); },
          refusal),
      stop_server_(
          stop_listener_.fd(), {},
          [this](const HttpRequest& q, const HttpServer::Reply& r) { handle(stop_server_, q, r); }, refusal) {}

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

void Api::handle(HttpServer& server, const HttpRequest& q, HttpServer::Reply raw_reply) {
  if (const auto wrong = why_not_the_query(q); !wrong.empty()) return raw_reply(refusal(400, wrong));
  const bool stops = &server == &stop_server_;
  if (stops && !is_of_the_stop_socket(q)) return raw_reply(no_such_call(q, true));
  const auto entered = gate_.enter(q, needs_of(q), std::move(raw_reply));
  const auto& reply = entered.reply;
  if (entered.status != 0) return reply(refusal(entered.status, entered.refused));
  if (answer_at_once(server, entered.pass, reply)) return;
  if (q.method == "POST" && q.path == "/v1/control") {
    return reply(answered([&] { return gate_.change_control(*entered.pass); }));
  }
  if (!answer_later(entered.pass, reply)) reply(no_such_call(q, false));
}

/// What waits for a disk or a compiler, by the thread in work(). False: it is not one of these.
bool Api::answer_later(const Pass& pass, const HttpServer::Reply& reply) {
  const auto& q = pass->request;
  const bool get = q.method == "GET", post = q.method == "POST";
  if (post && q.path == "/v1/start") {
    later(pass, reply, [this, pass] {
      return answered([&] {
        bool dry_run = false;
        const auto options = start_options(pass->request.body, &dry_run);
        if (!dry_run) return with_control(pass, [&] { return answer(host_.start(options)); });
        const auto seen = host_.preview(options);
        return answer(seen.value("ok", false) ? 200 : 409, seen);
      });
    });
  } else if (post && q.path == "/v1/notes") {
    later(pass, reply,
          [this, pass] { return answered([&] { return answer(host_.amend(correction(pass->request.body))); }); });
  } else if (post && q.path == "/v1/go") {
    later(pass, reply, [this, pass] {
      return answered([&] { return with_control(pass, [&] { return answer(host_.go(gate_.who(pass->caller))); }); });
    });
  } else if (post && q.path == "/v1/accept-rig") {
    later(pass, reply, [this, pass] {
      return answered([&] {
        const auto& request = pass->request;
        const auto by = accepting_operator(request.body);
        return with_control(pass, [&] { return answer(host_.accept_rig(by, request.peer.uid)); });
      });
    });
  } else if (post && q.path == "/v1/calibrations") {
    later(pass, reply, [this, pass] {
      return answered([&] {
        const auto record = calibration_record(pass->request.body);
        return with_control(pass, [&] { return answer(host_.add_calibration(record)); });
      });
    });
  } else if (get && q.path == "/v1/plan") {
    later(pass, reply, [this] { return answer(200, host_.plan_json()); });  // a plan may have 50,000 steps
  } else if (get && q.path == "/v1/runs") {
    later(pass, reply, [this] { return answered([&] { return answer(200, host_.runs_json()); }); });
  } else if (get && q.path == "/v1/report") {
    const auto run = q.query.find("run");
    if (run == q.query.end()) return reply(refusal(400, "`run` has to name a run: /v1/report?run=ID")), true;
    later(pass, reply,
          [this, id = run->second] { return answered([&] { return answer(200, host_.report_json(id)); }); });
  } else if (post && q.path == "/v1/check") {
    later(pass, reply, [this, pass] {
      return answered([&] {
        const auto asked = check_request(pass->request.body);
        return answer(200, host_.check_json(asked.protocol_text, asked.protocol_name));
      });
    });
  } else if (get && q.path == "/v1/diagnoses") {
    later(pass, reply, [this] { return answered([&] { return answer(200, host_.diagnoses().list()); }); });
  } else if (get && q.path == "/v1/page") {
    const auto path = q.query.find("path");
    if (path == q.query.end())
      return reply(refusal(400, "`path` has to be that of a report: /v1/page?path=PATH")), true;
    later(pass, reply,
          [this, path = path->second] { return answered([&] { return answer(200, host_.diagnoses().page(path)); }); });
  } else if (get && q.path == "/v1/experiment") {
    const auto id = q.query.find("id");
    if (id == q.query.end())
      return reply(refusal(400, "`id` has to name one of GET /v1/diagnoses: /v1/experiment?id=ID")), true;
    later(pass, reply,
          [this, id = id->second] { return answered([&] { return answer(200, host_.diagnoses().experiment(id)); }); });
  } else if (get && q.path == "/v1/selftest") {
    later(pass, reply, [this] { return answer(200, host_.selftest_json()); });
  } else {
    return false;
  }
  return true;
}

/// Judged when it is its turn: who had control when the call came in may have lost it meanwhile.
HttpAnswer Api::with_control(const Pass& pass, const std::function<HttpAnswer()>& call) {
  const auto why = gate_.take_control(*pass);
  return why.empty() ? call() : refusal(409, why);
}

/// What needs no disk, in the thread of the connections. False: it is not one of these.
bool Api::answer_at_once(HttpServer& server, const Pass& pass, const HttpServer::Reply& reply) {
  const auto& q = pass->request;
  if (q.method == "POST" && q.path == "/v1/parted") {  // what pauses the run comes next: no disk may be in its way
    return reply(answered([&] { return answer(host_.parted(parting(q.body))); })), true;
  }
  if (q.method == "POST") {
    std::optional<Request> request;
    try {
      request = verb_of(q);
    } catch (const BadRequest& e) {
      return reply(refusal(400, e.what())), true;
    }
    if (!request) return false;
    copy_text(request->by, gate_.who(pass->caller));
    const auto number = host_.submit(*request);
    if (number == 0) {
      reply(refusal(409, "the loop does not take requests; is it running?"));
    } else {
      await(server, std::make_shared<Wait>(
                        Wait{number, request->verb, reply, std::chrono::steady_clock::now() + kVerbPatience}));
    }
    return true;
  }
  if (q.method != "GET") return false;
  if (q.path == "/v1/status") {
    auto status = host_.status_json();
    status["control"] = gate_.control_json();
    status["pid"] = ::getpid();  // another one: another daemon, which knows nothing of who had control
    return reply(answer(200, status)), true;
  }
  if (q.path == "/v1/events") return reply(events(host_, q)), true;
  if (q.path == "/v1/readings") return reply(readings(host_, q)), true;
  if (q.path == "/v1/calibrations") return reply(answer(200, host_.calibrations_json())), true;
  return false;
}

void Api::await(HttpServer& server, const std::shared_ptr<Wait>& wait) {
  if (const auto result = host_.answer_to(wait->number)) return wait->reply(answer(*result));
  if (std::chrono::steady_clock::now() < wait->deadline) {
    return server.after(kAnswerPoll, [this, &server, wait] { await(server, wait); });
  }
  wait->reply(answer(host_.without_answer(wait->number, wait->verb)));
}

void Api::later(const Pass& pass, const HttpServer::Reply& reply, std::function<HttpAnswer()> task) {
  {
    const std::lock_guard lock(mutex_);
    if (tasks_.size() < kTasksQueued) {
      tasks_.push_back([pass, reply, task = std::move(task)] {
        pass->may_read_long = true;
        HttpAnswer result;
        try {
          result = task();
        } catch (const std::exception& e) {
          result = refusal(500, std::string("isorigd could not answer: ") + e.what());
        }
        reply(std::move(result));
      });
      more_.notify_one();
      return;
    }
  }
  reply(refusal(503, "too many calls wait for their turn already; try again"));
}

}  // namespace isorig::daemon
