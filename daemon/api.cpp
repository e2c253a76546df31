#include "daemon/api.hpp"

#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

#include <algorithm>
#include <cstring>
#include <nlohmann/json.hpp>

#include "base/toml_reader.hpp"
#include "daemon/host.hpp"

// Last: it brings <resolv.h>, whose macro _res breaks Eigen.
#include <httplib.h>

namespace isorig::daemon {
namespace {

using nlohmann::json;

sockaddr_un address_of(const std::filesystem::path& path) {
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  const std::string text = path.string();
  if (text.size() >= sizeof address.sun_path) {
    throw std::runtime_error("the API socket's path is longer than " + std::to_string(sizeof address.sun_path - 1) +
                             " characters: " + text + "; choose a shorter one in [api] socket");
  }
  std::memcpy(address.sun_path, text.c_str(), text.size() + 1);
  return address;
}

bool somebody_answers(const sockaddr_un& address) {
  const int fd = ::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
  const bool answers = fd >= 0 && ::connect(fd, reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0;
  if (fd >= 0) ::close(fd);
  return answers;
}

void answer(httplib::Response& response, int status, const json& body) {
  response.status = status;
  // What a client sent may stand in a text and need not be UTF-8.
  response.set_content(body.dump(-1, ' ', false, json::error_handler_t::replace), "application/json");
}

void answer(httplib::Response& response, const Host::Result& result) {
  answer(response, result.ok ? 200 : 409, {{"ok", result.ok}, {"text", result.text}, {"run", result.run}});
}

/// A name goes to terminals, logs and file names.
bool plain(const std::string& text) {
  return std::none_of(text.begin(), text.end(), [](unsigned char c) { return c < 0x20 || c == 0x7f; });
}

constexpr std::size_t kLongestRequest = 4 * 1024 * 1024;

/// What cpp-httplib refuses by itself gets the form of every other answer.
void explain_refusal(const httplib::Request& request, httplib::Response& response) {
  if (!response.body.empty()) return;
  std::string text;
  switch (response.status) {
    case 404:
      text = request.method + " " + request.path +
             " is not a call of this daemon; GET /v1/status, /v1/events, /v1/readings, /v1/calibrations, /v1/selftest; POST "
             "/v1/start, /v1/pause, /v1/resume, /v1/abort, /v1/reset, /v1/seal, /v1/calibrations";
      break;
    case 413:
      text = "the request is longer than 4 MiB, or longer than 8 KiB and not declared as JSON; send it with "
             "Content-Type: application/json";
      break;
    default:
      text = request.method + " " + request.path + " could not be read or answered (HTTP " +
             std::to_string(response.status) + "); docs/api.md has the calls";
  }
  answer(response, response.status, {{"ok", false}, {"text", text}});
}

}  // namespace

/// cpp-httplib 0.11 knows no Unix sockets: this one is given a socket that already listens.
class Api::Server : public httplib::Server {
 public:
  explicit Server(int listening_fd) { svr_sock_ = listening_fd; }
};

Api::Api(Host& host, const std::filesystem::path& socket_path, unsigned mode) : path_(socket_path) {
  const auto address = address_of(socket_path);
  if (socket_path.has_parent_path()) std::filesystem::create_directories(socket_path.parent_path());
  if (std::filesystem::exists(socket_path)) {
    if (somebody_answers(address)) {
      throw std::runtime_error("another daemon answers on " + socket_path.string() +
                               "; stop it, or give this one another socket ([api] socket or --socket)");
    }
    std::filesystem::remove(socket_path);
  }
  const int fd = ::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
  // The mode has to hold from the first moment the socket exists, not from a chmod later.
  const mode_t old_mask = ::umask(static_cast<mode_t>(0777 & ~mode));
  const bool bound = fd >= 0 && ::bind(fd, reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0;
  const int error = errno;
  ::umask(old_mask);
  if (!bound || ::listen(fd, 16) != 0) {
    const int why = bound ? errno : error;
    if (fd >= 0) ::close(fd);
    throw std::runtime_error("the API socket " + socket_path.string() + " cannot be made: " + std::strerror(why) +
                             "; check the directory and its permissions ([api] socket)");
  }

  server_ = std::make_unique<Server>(fd);
  auto& s = *server_;
  s.new_task_queue = [] { return new httplib::ThreadPool(4); };
  s.set_payload_max_length(kLongestRequest);
  s.set_error_handler(explain_refusal);
  s.set_exception_handler([](const httplib::Request&, httplib::Response& r, std::exception_ptr e) {
    try {
      std::rethrow_exception(std::move(e));
    } catch (const std::exception& thrown) {
      answer(r, 500, {{"ok", false}, {"text", std::string("isorigd could not answer: ") + thrown.what()}});
    } catch (...) {
      answer(r, 500, {{"ok", false}, {"text", "isorigd could not answer"}});
    }
  });
  s.Get("/v1/status", [&host](const httplib::Request&, httplib::Response& r) { answer(r, 200, host.status_json()); });
  s.Get("/v1/events", [&host](const httplib::Request& q, httplib::Response& r) {
    std::uint64_t after = 0;
    if (q.has_param("after")) {
      try {
        after = std::stoull(q.get_param_value("after"));
      } catch (const std::exception&) {
        answer(r, 400, {{"ok", false}, {"text", "`after` has to be a whole number"}});
        return;
      }
    }
    answer(r, 200, host.events_json(after));
  });
  s.Get("/v1/readings", [&host](const httplib::Request& q, httplib::Response& r) {
    double window_s = 2.0;
    if (q.has_param("window_s")) {
      try {
        window_s = std::stod(q.get_param_value("window_s"));
      } catch (const std::exception&) {
        window_s = -1.0;
      }
    }
    if (!(window_s >= 0.1 && window_s <= LiveWindow::kLongest_s)) {
      answer(r, 400, {{"ok", false}, {"text", "`window_s` has to be a number of seconds between 0.1 and 10"}});
      return;
    }
    answer(r, 200, host.readings_json(window_s));
  });
  s.Get("/v1/selftest", [&host](const httplib::Request&, httplib::Response& r) { answer(r, 200, host.selftest_json()); });
  s.Get("/v1/calibrations",
        [&host](const httplib::Request&, httplib::Response& r) { answer(r, 200, host.calibrations_json()); });
  s.Post("/v1/calibrations", [&host](const httplib::Request& q, httplib::Response& r) {
    try {
      const json body = json::parse(q.body);
      answer(r, host.add_calibration(body.at("record").get<std::string>()));
    } catch (const base::ConfigError& e) {
      answer(r, 400, {{"ok", false}, {"text", e.what()}});
    } catch (const json::exception& e) {
      answer(r, 400, {{"ok", false}, {"text", std::string("the request is not what /v1/calibrations takes: ") + e.what()}});
    } catch (const std::exception& e) {
      answer(r, 409, {{"ok", false}, {"text", e.what()}});
    }
  });
  s.Post("/v1/start", [&host](const httplib::Request& q, httplib::Response& r) {
    try {
      const json body = json::parse(q.body);
      StartOptions options;
      if (!body.is_object()) {
        answer(r, 400, {{"ok", false}, {"text", "the request is not what /v1/start takes: it has to be a JSON object"}});
        return;
      }
      options.resume_run = body.value("resume_run", "");
      // A run that goes on has its protocol with it.
      options.protocol_text = options.resume_run.empty() ? body.at("protocol").get<std::string>() : "";
      options.protocol_name = body.value("protocol_name", "protocol.toml");
      options.specimen_text = body.value("specimen", "");
      options.specimen_name = body.value("specimen_name", "");
      options.operator_name = body.value("operator", "");
      for (const auto& [key, text] : {std::pair{"protocol_name", options.protocol_name}, {"specimen_name", options.specimen_name},
                                      {"operator", options.operator_name}}) {
        if (plain(text)) continue;
        answer(r, 400, {{"ok", false}, {"text", std::string("`") + key + "` holds a control character; one line of plain text is needed"}});
        return;
      }
      answer(r, host.start(options));
    } catch (const base::ConfigError& e) {
      answer(r, 400, {{"ok", false}, {"text", e.what()}});
    } catch (const json::exception& e) {
      answer(r, 400, {{"ok", false}, {"text", std::string("the request is not what /v1/start takes: ") + e.what()}});
    } catch (const std::exception& e) {
      answer(r, 409, {{"ok", false}, {"text", e.what()}});
    }
  });
  const auto verb = [&](const char* path, Request::Verb v) {
    s.Post(path, [&host, v](const httplib::Request&, httplib::Response& r) { answer(r, host.verb(v)); });
  };
  verb("/v1/pause", Request::Verb::kPause);
  verb("/v1/resume", Request::Verb::kResume);
  verb("/v1/abort", Request::Verb::kAbort);
  verb("/v1/reset", Request::Verb::kReset);
  verb("/v1/seal", Request::Verb::kSeal);
}

Api::~Api() {
  stop();
  std::error_code ignored;
  std::filesystem::remove(path_, ignored);
}

void Api::serve() { server_->listen_after_bind(); }
void Api::stop() { server_->stop(); }

}  // namespace isorig::daemon
