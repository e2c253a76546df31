#include "daemon/host/api_calls.hpp"

#include <algorithm>
#include <array>

#include "base/printable.hpp"

namespace isorig::daemon {
namespace {

constexpr Needs kNothing{std::nullopt, false, true};  // to stop
constexpr Needs kLook{Role::kSee, false, false};
constexpr Needs kNote{Role::kOperate, false, true};
constexpr Needs kOperate{Role::kOperate, true, true};
constexpr Needs kConfigure{Role::kConfigure, true, true};

struct Call {
  const char* method;
  const char* path;
  Needs needs;
};
constexpr std::array kCalls{Call{"GET", "/v1/status", kLook},
                            Call{"GET", "/v1/events", kLook},
                            Call{"GET", "/v1/readings", kLook},
                            Call{"GET", "/v1/calibrations", kLook},
                            Call{"GET", "/v1/selftest", kLook},
                            Call{"POST", "/v1/start", kNote},  // control: unless it is a dry run
                            Call{"POST", "/v1/pause", kNothing},
                            Call{"POST", "/v1/resume", kOperate},
                            Call{"POST", "/v1/abort", kNothing},
                            Call{"POST", "/v1/reset", kOperate},
                            Call{"POST", "/v1/confirm-zero", kOperate},
                            Call{"POST", "/v1/seal", kOperate},
                            Call{"POST", "/v1/calibrations", kConfigure},
                            Call{"POST", "/v1/notes", kNote},
                            Call{"POST", "/v1/parted", kNote},
                            Call{"POST", "/v1/go", kOperate},
                            Call{"POST", "/v1/setup", kOperate},
                            Call{"POST", "/v1/jog", kOperate},
                            Call{"POST", "/v1/accept-rig", kConfigure},
                            Call{"GET", "/v1/plan", kLook},
                            Call{"GET", "/v1/runs", kLook},
                            Call{"GET", "/v1/report", kLook},
                            Call{"POST", "/v1/check", kLook},
                            Call{"GET", "/v1/diagnoses", kLook},
                            Call{"GET", "/v1/page", kLook},
                            Call{"GET", "/v1/experiment", kLook},
                            Call{"POST", "/v1/control", kNote}};

}  // namespace

/// Of a call that there is not: refused all the same, and nobody learns more by it than what calls there are.
Needs needs_of(const HttpRequest& q) {
  const auto* call = std::find_if(kCalls.begin(), kCalls.end(),
                                  [&](const Call& c) { return q.path == c.path && q.method == c.method; });
  if (call == kCalls.end()) return kLook;
  auto needs = call->needs;
  if (q.path == "/v1/control" && q.body.find("\"keep\"") != std::string::npos) needs.command = false;  // every 5 s
  return needs;
}

bool is_stop(const HttpRequest& q) {
  return q.method == "POST" && (q.path == "/v1/abort" || q.path == "/v1/pause");
}

bool is_of_the_stop_socket(const HttpRequest& q) {
  return is_stop(q) || (q.method == "GET" && q.path == "/v1/status");
}

std::string why_not_the_query(const HttpRequest& q) {
  if (is_stop(q)) return {};
  if (q.twice) return "`" + base::printable(*q.twice) + "` stands in the query twice";
  const std::string known = q.path == "/v1/events"       ? "after"
                            : q.path == "/v1/readings"   ? "window_s"
                            : q.path == "/v1/report"     ? "run"
                            : q.path == "/v1/page"       ? "path"
                            : q.path == "/v1/experiment" ? "id"
                                                         : "";
  for (const auto& [key, value] : q.query) {
    if (key == known) continue;
    return q.path + " takes " + (known.empty() ? "no query" : "`" + known + "` only") + ", and not `" +
           base::printable(key) + "`";
  }
  return {};
}

NoSuchCall why_no_such_call(const HttpRequest& q, bool only_stops) {
  std::string known, methods;
  for (const auto& call : kCalls) {
    if (q.path == call.path) methods += (methods.empty() ? "" : " or ") + std::string(call.method);
    known += (known.empty() ? "" : ", ") + std::string(call.method) + " " + call.path;
  }
  const std::string asked = q.method + " " + q.path;
  if (only_stops) {
    return {404, asked +
                     " is not taken on this socket; it has GET /v1/status, POST /v1/abort, POST /v1/pause, and "
                     "the one without .stop has the rest"};
  }
  if (!methods.empty()) return {405, asked + ": the method has to be " + methods};
  return {404, asked + " is not a call of this daemon; it has " + known};
}

}  // namespace isorig::daemon
