#pragma once
#include <boost/asio/io_context.hpp>
#include <chrono>
#include <functional>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>

#include "daemon/recording/sample_stream.hpp"
#include "webserver/rules/access.hpp"

/// isorigd as this process sees it, over its sockets: the sample stream, and the control API. Nothing here waits; what
/// does not answer is asked again for as long as it takes.
namespace isorig::web {

struct DaemonAnswer {
  int status = 0;  ///< 0: there was none, and `body` says why
  nlohmann::json body;
  std::string text;  ///< the body as it came
  /// Why there was none: "gone", nothing listens on the socket; "refused", it may not be opened; "silent".
  const char* none = "silent";
};

/// The header by which the daemon judges a call by that user's rights, besides those of isorig-web.
[[nodiscard]] std::string on_behalf_of(const Who& who);

class DaemonLink {
 public:
  /// Called by the thread that runs the io_context.
  struct Listener {
    std::function<void(const daemon::samples::Record&)> record;
    std::function<void(const DaemonAnswer&)> status;  ///< five times a second; without an answer, why
    std::function<void(const DaemonAnswer&)> events;  ///< those that are new
    std::function<void(const DaemonAnswer&)> plan;    ///< when another run was opened, or none is open any more
    std::function<void(const std::string&)> log;
  };

  DaemonLink(boost::asio::io_context& io, std::string socket, Listener listener);
  ~DaemonLink();
  DaemonLink(const DaemonLink&) = delete;
  DaemonLink& operator=(const DaemonLink&) = delete;

  void start();
  /// One call. Abort and pause go to the socket that has nothing else to do. `on_behalf`: for which user of the page
  /// (on_behalf_of); empty: for isorig-web itself.
  void call(const std::string& method, const std::string& path, std::string body, std::chrono::seconds patience,
            std::function<void(DaemonAnswer)> then, const std::string& on_behalf = {});

 private:
  struct Impl;
  std::shared_ptr<Impl> impl_;
};

}  // namespace isorig::web
