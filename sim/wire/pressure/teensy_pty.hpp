#pragma once
#include <string>

#include "sim/wire/pressure/emulated_teensy.hpp"

namespace isorig::sim {

/// A Teensy on a pseudo-terminal that the real driver opens by path. Like a real port it is in cooked mode with echo
/// until somebody changes that.
class TeensyPty final : public EmulatedTeensy {
 public:
  /// Makes the pty and connects the backend. `link_path` is a symbolic link to the pty, made anew each time the port
  /// comes back. Throws std::system_error.
  TeensyPty(std::string link_path, const Options& options, pressure::Device& backend, std::int64_t now_ns);
  ~TeensyPty() override { pull_out(); }

  [[nodiscard]] int fd() const noexcept override { return master_fd_; }

 private:
  void plug_in() override;
  void pull_out() noexcept override;
  [[nodiscard]] bool is_plugged_in() const noexcept override { return master_fd_ >= 0; }
  bool service_port() noexcept override;
  std::size_t take(std::span<std::uint8_t> out) noexcept override;
  std::size_t give(std::span<const std::uint8_t> bytes) noexcept override;

  /// Another pty for the next host: unlike a real port, a pty keeps the exclusive use (TIOCEXCL) that a killed host
  /// had asked for, and lets only root in again.
  void renew() noexcept;

  std::string link_path_;
  std::string slave_path_;
  int master_fd_ = -1;
  bool was_open_ = false;
};

}  // namespace isorig::sim
