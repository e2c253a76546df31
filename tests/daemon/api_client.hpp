#pragma once
#include <gtest/gtest.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <cstring>
#include <nlohmann/json.hpp>
#include <string>

namespace isorig::daemon::test {

struct ApiAnswer {
  int status = 0;
  nlohmann::json body;
  [[nodiscard]] std::string text() const { return body.value("text", ""); }
};

/// One request on a connection of its own, as any program makes it. `line`: "GET /v1/status"; `headers`: each with its
/// end of line. Status 0: no answer.
[[nodiscard]] inline ApiAnswer call_api(const std::string& socket_path, const std::string& line,
                                        const std::string& body = {}, const std::string& headers = {}) {
  const int fd = ::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  std::strcpy(address.sun_path, socket_path.c_str());
  EXPECT_EQ(::connect(fd, reinterpret_cast<const sockaddr*>(&address), sizeof address), 0);
  const std::string all = line + " HTTP/1.1\r\nHost: x\r\nConnection: close\r\n" + headers +
                          "Content-Length: " + std::to_string(body.size()) + "\r\n\r\n" + body;
  EXPECT_EQ(::send(fd, all.data(), all.size(), MSG_NOSIGNAL), static_cast<ssize_t>(all.size()));
  std::string got;
  char buffer[4096];
  for (ssize_t n = 0; (n = ::read(fd, buffer, sizeof buffer)) > 0;) got.append(buffer, static_cast<std::size_t>(n));
  ::close(fd);
  const auto end = got.find("\r\n\r\n");
  if (end == std::string::npos) return {};
  return {std::stoi(got.substr(9, 3)), nlohmann::json::parse(got.substr(end + 4), nullptr, false)};
}

}  // namespace isorig::daemon::test
