#include "sim/pressure/teensy_pty.hpp"

#include <fcntl.h>
#include <poll.h>
#include <stdlib.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstdio>
#include <filesystem>
#include <system_error>
#include <utility>

namespace isorig::sim {
namespace {

[[noreturn]] void throw_errno(const char* what) {
  throw std::system_error(errno, std::generic_category(), what);
}

}  // namespace

TeensyPty::TeensyPty(std::string link_path, const Options& options, pressure::Device& backend, std::int64_t now_ns)
    : EmulatedTeensy(options, backend, now_ns), link_path_(std::move(link_path)) {
  plug_in();
}

void TeensyPty::plug_in() {
  const int fd = posix_openpt(O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC);
  if (fd < 0) throw_errno("posix_openpt");
  master_fd_ = fd;
  std::array<char, 128> name{};
  if (grantpt(fd) != 0 || unlockpt(fd) != 0 || ptsname_r(fd, name.data(), name.size()) != 0) throw_errno("pty");
  slave_path_ = name.data();
  // A pty reports "other side closed" only after its slave was open once.
  const int slave = ::open(slave_path_.c_str(), O_RDWR | O_NOCTTY | O_CLOEXEC);
  if (slave < 0) throw_errno("pty slave");
  ::close(slave);
  // Replaced in one step: a driver that tries at this moment finds the old or the new one.
  const std::string fresh = link_path_ + ".new";
  ::unlink(fresh.c_str());
  if (symlink(slave_path_.c_str(), fresh.c_str()) != 0 || rename(fresh.c_str(), link_path_.c_str()) != 0) {
    throw_errno(link_path_.c_str());
  }
}

void TeensyPty::pull_out() noexcept {
  if (master_fd_ < 0) return;
  std::error_code error;
  if (std::filesystem::read_symlink(link_path_, error) == slave_path_) ::unlink(link_path_.c_str());
  ::close(master_fd_);
  master_fd_ = -1;
}

bool TeensyPty::service_port() noexcept {
  pollfd port{master_fd_, 0, 0};
  (void)::poll(&port, 1, 0);
  const bool is_open = (port.revents & POLLHUP) == 0;
  if (std::exchange(was_open_, is_open) && !is_open) renew();
  return is_open;
}

void TeensyPty::renew() noexcept {
  const int old = std::exchange(master_fd_, -1);
  try {
    plug_in();
    ::close(old);
  } catch (const std::system_error& error) {  // no more ptys: root can still use the old one
    std::fprintf(stderr, "emulated Teensy: %s\n", error.what());
    if (master_fd_ >= 0) ::close(master_fd_);
    master_fd_ = old;
  }
}

std::size_t TeensyPty::take(std::span<std::uint8_t> out) noexcept {
  const ssize_t size = ::read(master_fd_, out.data(), out.size());
  return size > 0 ? static_cast<std::size_t>(size) : 0;
}

std::size_t TeensyPty::give(std::span<const std::uint8_t> bytes) noexcept {
  const ssize_t size = ::write(master_fd_, bytes.data(), bytes.size());
  return size > 0 ? static_cast<std::size_t>(size) : 0;
}

}  // namespace isorig::sim
