#pragma once
#include <poll.h>
#include <sys/socket.h>

#include <array>
#include <charconv>
#include <chrono>
#include <functional>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <string_view>
#include <thread>

#include "target.hpp"

/// A client of an HTTP server that is fuzzed.
namespace isorig::fuzz {

/// One server for many inputs, since its start takes longer than an input: made anew before every `interval`-th one
/// where it is used up.
template <class Served, class UsedUp>
Served& server_for_next_input(unsigned interval, const UsedUp& used_up) {
  (void)scratch();  // outlives what works in it
  static auto served = std::make_unique<Served>();
  static unsigned inputs = 0;
  if (++inputs % interval == 0 && used_up(*served)) {
    served.reset();
    served = std::make_unique<Served>();
  }
  return *served;
}

/// Sends, says that nothing more comes, and reads to the end; `meanwhile` is called while nothing is there. A server
/// that neither answers nor closes within 15 s is a finding: its own limits are 10 s.
inline std::string talk(int fd, std::string_view request, const std::function<void()>& meanwhile) {
  using Clock = std::chrono::steady_clock;
  const auto until = Clock::now() + std::chrono::seconds(15);
  std::string got;
  static std::array<char, 65536> bytes;
  bool said_all = false;
  for (;;) {
    if (!said_all && request.empty()) {
      ::shutdown(fd, SHUT_WR);
      said_all = true;
    }
    pollfd of{fd, static_cast<short>(POLLIN | (said_all ? 0 : POLLOUT)), 0};
    if (::poll(&of, 1, 0) > 0) {
      if ((of.revents & (POLLIN | POLLHUP | POLLERR)) != 0) {
        const auto size = ::recv(fd, bytes.data(), bytes.size(), MSG_DONTWAIT);
        if (size == 0 || (size < 0 && errno != EAGAIN && errno != EINTR)) return got;
        if (size > 0) got.append(bytes.data(), static_cast<std::size_t>(size));
      }
      if ((of.revents & POLLOUT) != 0) {
        const auto size = ::send(fd, request.data(), request.size(), MSG_NOSIGNAL | MSG_DONTWAIT);
        if (size > 0) {
          request.remove_prefix(static_cast<std::size_t>(size));
        } else if (errno != EAGAIN && errno != EINTR) {
          request = {};  // it has heard enough; what it says is read
        }
      }
      continue;
    }
    meanwhile();
    std::this_thread::yield();  // to the threads that answer
    require(Clock::now() < until, "a connection is neither answered nor closed");
  }
}

/// Every answer of a server that refuses has to say why.
inline void check_answers(std::string_view got) {
  while (got.starts_with("HTTP/1.1 ") || got.starts_with("HTTP/1.0 ")) {
    const auto end = got.find("\r\n\r\n");
    if (end == std::string_view::npos) return;  // cut, since this side had closed
    const std::string header(got.substr(0, end));
    got.remove_prefix(end + 4);
    int status = 0;
    std::from_chars(header.data() + 9, header.data() + 12, status);
    if (status < 200) continue;
    const auto at = header.find("Content-Length: ");
    require(at != std::string::npos, "an answer without its length");
    std::size_t length = 0;
    std::from_chars(header.data() + at + 16, header.data() + header.size(), length);
    const auto body = got.substr(0, length);
    got.remove_prefix(body.size());
    if (status < 400 || body.size() < length) continue;  // a HEAD has none
    if (header.find("application/json") == std::string::npos) {
      refused(body);
      continue;
    }
    const auto said = nlohmann::json::parse(body, nullptr, false);
    require(said.is_object() && said.contains("text") && said["text"].is_string(), "a refusal that is no JSON");
    refused(said["text"].get_ref<const std::string&>());
  }
}

}  // namespace isorig::fuzz
