#pragma once
#include <chrono>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <string>
#include <utility>

#include "base/printable.hpp"

namespace isorig::cli {

/// The daemon is not there, or the socket is not ours to open; what() says which and what to do.
class NoDaemon : public std::runtime_error {
  using std::runtime_error::runtime_error;
};

/// The daemon is there, and has not answered in time: it is busy, stopped, or hangs.
class NoAnswer : public NoDaemon {
  using NoDaemon::NoDaemon;
};

/// What the daemon answered: HTTP status and JSON body.
struct Answer {
  int status = 0;
  nlohmann::json body;
  [[nodiscard]] bool ok() const { return status == 200; }
  [[nodiscard]] std::string text() const { return base::printable_lines(body.value("text", "")); }
};

/// Talks to isorigd over its Unix sockets (docs/api.md). Abort, pause and status go to the one that has nothing else to
/// do, if it is there.
class Client {
 public:
  static constexpr std::chrono::milliseconds kPatience{30'000};  ///< a start compiles a protocol before it answers
  explicit Client(std::filesystem::path socket, std::chrono::milliseconds patience = kPatience)
      : socket_(std::move(socket)), patience_(patience) {}
  /// The same, for whoever cannot wait so long.
  [[nodiscard]] Client with(std::chrono::milliseconds patience) const { return Client(socket_, patience); }
  /// All throw NoDaemon.
  [[nodiscard]] Answer get(const std::string& path) const;
  /// The body; of a refusal std::runtime_error with its text.
  [[nodiscard]] nlohmann::json get_or_throw(const std::string& path) const;
  [[nodiscard]] Answer post(const std::string& path, const nlohmann::json& body = nlohmann::json::object()) const;

 private:
  [[nodiscard]] Answer ask(const std::string& method, const std::string& path, std::string body) const;
  std::filesystem::path socket_;
  std::chrono::milliseconds patience_;
};

}  // namespace isorig::cli
