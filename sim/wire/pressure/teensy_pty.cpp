#include "sim/wire/pressure/teensy_pty.hpp"

#include <poll.h>
#include <unistd.h>

#include <cstdio>
#include <exception>
#include <filesystem>
#include <system_error>
#include <utility>

#include "sim/wire/wire_ends.hpp"

namespace isorig::sim {
TeensyPty::TeensyPty(std::string link_path, const Options& options, pressure::Device& backend, std::int64_t now_ns)
    : EmulatedTeensy(options, backend, now_ns), link_path_(std::move(link_path)) {
  plug_in();
}

void TeensyPty::plug_in() {
  auto pty = open_pseudo_terminal(false);  // as a tty comes up: cooked
  // A pty reports "other side closed" only after its slave was open once.
  pty.slave.reset();
  link_to(pty.path, link_path_);
  master_fd_ = pty.master.release();
  slave_path_ = pty.path;
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
  } catch (const std::exception& error) {  // no more ptys: root can still use the old one
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
