#pragma once
#include <sys/types.h>

#include <chrono>
#include <string>
#include <string_view>
#include <vector>

/// Commands that the daemon starts beside itself: [notify], the page of a run.
namespace isorig::daemon {

/// Between SIGTERM and SIGKILL.
inline constexpr auto kTermGrace = std::chrono::seconds(1);

/// What a command needs of ours to find itself, and nothing else: no socket of the service manager, no library path.
[[nodiscard]] std::vector<std::string> child_environment();

/// A command's standard error: a file in memory, so that a command that writes much waits for nobody.
class ChildWords {
 public:
  ChildWords();
  ~ChildWords();
  ChildWords(const ChildWords&) = delete;
  ChildWords& operator=(const ChildWords&) = delete;
  [[nodiscard]] int fd() const { return fd_; }
  /// ": " and the first 200 bytes; empty when nothing was said.
  [[nodiscard]] std::string first() const;

 private:
  int fd_;
};

/// posix_spawn's answer: 0 or an errno. `arguments` begins with the program's path. The child has a group of its own,
/// no descriptor of ours, no signal blocked, and says what it has to say to `words_fd`.
[[nodiscard]] int spawn_child(std::vector<std::string> arguments, std::vector<std::string> environment, int words_fd,
                              pid_t& pid);

}  // namespace isorig::daemon
