#pragma once
// The firmware on QEMU's Cortex-M4 as a child process: its link is a pseudo-terminal, which the real driver
// opens by path; the test line (firmware/mps2/main.cpp) is a socket.
#include <gtest/gtest.h>
#include <poll.h>
#include <signal.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <cstdlib>
#include <string>
#include <thread>
#include <vector>

namespace isorig::firmware {

class QemuMachine {
 public:
  QemuMachine() {
    std::string folder = testing::TempDir() + "isorig_qemu_XXXXXX";
    if (mkdtemp(folder.data()) == nullptr) std::abort();
    folder_ = folder;
    int output[2];
    if (pipe(output) != 0) std::abort();
    pid_ = fork();
    if (pid_ == 0) {
      dup2(output[1], STDOUT_FILENO);
      close(output[0]);
      const std::string test_line = "socket,id=test,server=on,wait=off,path=" + test_line_path();
      execlp("qemu-system-arm", "qemu-system-arm", "-M", "mps2-an386", "-display", "none", "-monitor", "none",
             "-semihosting-config", "enable=on,target=native", "-chardev", "pty,id=link", "-chardev", test_line.c_str(),
             "-serial", "chardev:link", "-serial", "chardev:test", "-kernel", ISORIG_QEMU_IMAGE, nullptr);
      _exit(127);
    }
    close(output[1]);
    // "char device redirected to /dev/pts/3 (label link)"
    const std::string said = read_line(output[0]);
    close(output[0]);
    const std::size_t from = said.find("/dev/");
    if (from != std::string::npos) link_ = said.substr(from, said.find(' ', from) - from);
    connect_test_line();
  }
  ~QemuMachine() {
    if (pid_ > 0) {
      kill(pid_, SIGKILL);
      waitpid(pid_, nullptr, 0);
    }
    if (test_line_ >= 0) close(test_line_);
    unlink(test_line_path().c_str());
    rmdir(folder_.c_str());
  }
  QemuMachine(const QemuMachine&) = delete;
  QemuMachine& operator=(const QemuMachine&) = delete;

  [[nodiscard]] const std::string& link() const { return link_; }
  [[nodiscard]] bool is_up() const { return !link_.empty() && test_line_ >= 0; }

  void tell(char command) { ASSERT_EQ(write(test_line_, &command, 1), 1); }
  /// What the test line has said since the last call.
  std::vector<std::string> heard() {
    char bytes[4096];
    for (;;) {
      const ssize_t size = recv(test_line_, bytes, sizeof bytes, MSG_DONTWAIT);
      if (size <= 0) break;
      unfinished_.append(bytes, static_cast<std::size_t>(size));
    }
    std::vector<std::string> lines;
    for (std::size_t end = 0; (end = unfinished_.find('\n')) != std::string::npos;) {
      lines.push_back(unfinished_.substr(0, end));
      unfinished_.erase(0, end + 1);
    }
    return lines;
  }
  /// The exit code; -1 if it still runs after `limit_s`, -2 if it was killed.
  int wait_for_exit(int limit_s) {
    for (int i = 0; i < limit_s * 100; ++i) {
      int status = 0;
      if (waitpid(pid_, &status, WNOHANG) == pid_) {
        pid_ = -1;
        return WIFEXITED(status) ? WEXITSTATUS(status) : -2;
      }
      std::this_thread::sleep_for(std::chrono::milliseconds(10));
    }
    return -1;
  }
  /// As if its machine got no time at all.
  void freeze() { kill(pid_, SIGSTOP); }
  void thaw() { kill(pid_, SIGCONT); }

 private:
  [[nodiscard]] std::string test_line_path() const { return folder_ + "/test-line"; }

  static std::string read_line(int fd) {
    std::string line;
    char one = 0;
    pollfd waiting{fd, POLLIN, 0};
    while (::poll(&waiting, 1, 20'000) > 0 && read(fd, &one, 1) == 1 && one != '\n') line += one;
    return line;
  }
  void connect_test_line() {
    sockaddr_un address{};
    address.sun_family = AF_UNIX;
    test_line_path().copy(address.sun_path, sizeof address.sun_path - 1);
    for (int i = 0; i < 500; ++i) {
      const int fd = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
      if (connect(fd, reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0) {
        test_line_ = fd;
        return;
      }
      close(fd);
      std::this_thread::sleep_for(std::chrono::milliseconds(10));
    }
  }

  std::string folder_;
  std::string link_;
  std::string unfinished_;
  pid_t pid_ = -1;
  int test_line_ = -1;
};

}  // namespace isorig::firmware
