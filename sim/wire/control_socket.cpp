#include "sim/wire/control_socket.hpp"

#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

#include <array>
#include <cerrno>

#include "sim/wire/wire_ends.hpp"

namespace isorig::sim {
namespace {

sockaddr_un address_of(const std::string& path) {
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  if (path.empty() || path.size() >= sizeof address.sun_path) {
    errno = ENAMETOOLONG;
    throw_errno("control socket " + path);
  }
  path.copy(address.sun_path, path.size());
  return address;
}

}  // namespace

ControlSocket::ControlSocket(std::string path, Answer answer) : path_(std::move(path)), answer_(std::move(answer)) {
  const auto address = address_of(path_);
  fd_ = ::socket(AF_UNIX, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
  if (fd_ < 0) throw_errno("control socket");
  ::unlink(path_.c_str());
  const mode_t before = ::umask(0177);
  const int bound = ::bind(fd_, reinterpret_cast<const sockaddr*>(&address), sizeof address);
  ::umask(before);
  if (bound != 0 || ::listen(fd_, 4) != 0) {
    const int error = errno;
    ::close(fd_);
    errno = error;
    throw_errno("control socket " + path_);
  }
}

ControlSocket::~ControlSocket() {
  for (const auto& client : clients_) ::close(client.fd);
  ::close(fd_);
  ::unlink(path_.c_str());
}

void ControlSocket::service() {
  for (int fd; (fd = ::accept4(fd_, nullptr, nullptr, SOCK_NONBLOCK | SOCK_CLOEXEC)) >= 0;) {
    clients_.push_back({fd, {}});
  }
  std::erase_if(clients_, [this](Client& client) {
    if (serve(client)) return false;
    ::close(client.fd);
    return true;
  });
}

bool ControlSocket::serve(Client& client) {
  std::array<char, 512> buffer{};
  const auto size = ::recv(client.fd, buffer.data(), buffer.size(), 0);
  if (size == 0) return false;
  if (size < 0) return errno == EAGAIN || errno == EINTR;
  client.received.append(buffer.data(), static_cast<std::size_t>(size));
  if (client.received.size() > 4096) return false;  // no line of ours is that long
  for (std::size_t end; (end = client.received.find('\n')) != std::string::npos;) {
    const auto answer = answer_(std::string_view(client.received).substr(0, end));
    client.received.erase(0, end + 1);
    if (::send(client.fd, answer.data(), answer.size(), MSG_NOSIGNAL) != static_cast<ssize_t>(answer.size())) {
      return false;
    }
  }
  return true;
}

std::string ControlSocket::ask(const std::string& path, const std::string& line) {
  const auto address = address_of(path);
  const int fd = ::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
  if (fd < 0) throw_errno("socket");
  std::string answer;
  const std::string text = line + "\n";
  const bool sent = ::connect(fd, reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0 &&
                    ::send(fd, text.data(), text.size(), MSG_NOSIGNAL) == static_cast<ssize_t>(text.size());
  const int error = errno;
  if (sent) {
    ::shutdown(fd, SHUT_WR);
    std::array<char, 4096> buffer{};
    for (ssize_t size; (size = ::recv(fd, buffer.data(), buffer.size(), 0)) > 0;) {
      answer.append(buffer.data(), static_cast<std::size_t>(size));
    }
  }
  ::close(fd);
  if (!sent) {
    errno = error;
    throw_errno("cannot reach the emulated rig at " + path);
  }
  return answer;
}

}  // namespace isorig::sim
