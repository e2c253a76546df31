#pragma once
#include <gtest/gtest.h>
#include <poll.h>
#include <pty.h>
#include <signal.h>
#include <sys/ioctl.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <string>
#include <utility>
#include <vector>

#include "processes.hpp"

namespace isorig::system_test {

struct TerminalSize {
  unsigned short columns = 80, rows = 24;
};

/// A program at a terminal, and somebody who reads and types there.
class Terminal {
 public:
  explicit Terminal(std::vector<std::string> words, TerminalSize size = {}) {
    const winsize window = window_of(size);
    pid_ = ::forkpty(&fd_, nullptr, nullptr, &window);
    if (pid_ < 0) throw std::runtime_error("forkpty failed");
    if (pid_ == 0) {
      ::prctl(PR_SET_PDEATHSIG, SIGKILL);
      std::vector<char*> arguments;
      for (auto& word : words) arguments.push_back(word.data());
      arguments.push_back(nullptr);
      ::execvp(arguments[0], arguments.data());
      ::_exit(127);
    }
  }
  ~Terminal() {
    if (pid_ > 0) {
      ::kill(pid_, SIGKILL);
      ::waitpid(pid_, nullptr, 0);
    }
    ::close(fd_);
  }
  Terminal(const Terminal&) = delete;
  Terminal& operator=(const Terminal&) = delete;

  /// Reads until `text` stands there; what comes next is looked for behind it.
  [[nodiscard]] bool shows(const std::string& text, double seconds = 120.0) {
    return wait_until(seconds, [&] {
      take();
      const auto at = shown_.find(text, seen_);
      if (at == std::string::npos) return false;
      seen_ = at + text.size();
      return true;
    });
  }
  void type(const std::string& text) {
    ASSERT_EQ(::write(fd_, text.data(), text.size()), static_cast<ssize_t>(text.size()));
  }
  /// The program hears of it by SIGWINCH.
  void resize(TerminalSize size) {
    const winsize window = window_of(size);
    ASSERT_EQ(::ioctl(fd_, TIOCSWINSZ, &window), 0);
  }
  void signal(int number) { ASSERT_EQ(::kill(pid_, number), 0); }
  static constexpr const char* kEnter = "\r";
  static constexpr const char* kCtrlC = "\x03";
  static constexpr const char* kCtrlD = "\x04";

  /// The exit code, or minus the signal that ended it.
  int wait(double seconds = 120.0) {
    int status = 0;
    const bool ended = wait_until(seconds, [&] {
      take();
      return ::waitpid(pid_, &status, WNOHANG) == pid_;
    });
    if (!ended) {
      ADD_FAILURE() << "it did not end:\n" << shown_;
      return -1;
    }
    pid_ = -1;
    take();
    return WIFEXITED(status) ? WEXITSTATUS(status) : -WTERMSIG(status);
  }
  [[nodiscard]] const std::string& shown() const { return shown_; }

 private:
  static winsize window_of(TerminalSize size) {
    winsize window{};
    window.ws_col = size.columns;
    window.ws_row = size.rows;
    return window;
  }
  void take() {
    char bytes[4096];
    pollfd readable{fd_, POLLIN, 0};
    while (::poll(&readable, 1, 0) == 1 && (readable.revents & POLLIN) != 0) {
      const auto size = ::read(fd_, bytes, sizeof bytes);
      if (size <= 0) return;  // EIO: the program has closed it
      shown_.append(bytes, static_cast<std::size_t>(size));
    }
  }

  int fd_ = -1;
  pid_t pid_ = -1;
  std::string shown_;
  std::size_t seen_ = 0;
};

}  // namespace isorig::system_test
