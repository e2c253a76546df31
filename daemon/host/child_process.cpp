#include "daemon/host/child_process.hpp"

#include <fcntl.h>
#include <spawn.h>
#include <sys/mman.h>
#include <unistd.h>

#include <array>
#include <csignal>
#include <cstdlib>

#include "base/printable.hpp"

namespace isorig::daemon {
namespace {

constexpr std::size_t kWordsKept = 200;

}  // namespace

std::vector<std::string> child_environment() {
  std::vector<std::string> out;
  for (const char* name : {"PATH", "HOME", "USER", "LOGNAME", "LANG", "LC_ALL", "TZ", "TMPDIR"}) {
    if (const char* value = std::getenv(name); value != nullptr) out.push_back(std::string(name) + "=" + value);
  }
  return out;
}

ChildWords::ChildWords() : fd_(::memfd_create("isorig-child", MFD_CLOEXEC)) {}

ChildWords::~ChildWords() {
  if (fd_ >= 0) ::close(fd_);
}

std::string ChildWords::first() const {
  std::array<char, kWordsKept> bytes{};
  const auto got = fd_ < 0 ? 0 : ::pread(fd_, bytes.data(), bytes.size(), 0);
  return got <= 0 ? std::string() : ": " + base::printable({bytes.data(), static_cast<std::size_t>(got)});
}

int spawn_child(std::vector<std::string> arguments, std::vector<std::string> environment, int words_fd, pid_t& pid) {
  posix_spawn_file_actions_t actions;
  posix_spawnattr_t attributes;
  posix_spawn_file_actions_init(&actions);
  posix_spawnattr_init(&attributes);
  posix_spawn_file_actions_addopen(&actions, STDIN_FILENO, "/dev/null", O_RDONLY, 0);
  posix_spawn_file_actions_addopen(&actions, STDOUT_FILENO, "/dev/null", O_WRONLY, 0);
  if (words_fd >= 0) {
    posix_spawn_file_actions_adddup2(&actions, words_fd, STDERR_FILENO);
  } else {
    posix_spawn_file_actions_addopen(&actions, STDERR_FILENO, "/dev/null", O_WRONLY, 0);
  }
  posix_spawn_file_actions_addclosefrom_np(&actions, STDERR_FILENO + 1);
  sigset_t none, all;
  sigemptyset(&none);
  sigfillset(&all);
  posix_spawnattr_setsigmask(&attributes, &none);
  posix_spawnattr_setsigdefault(&attributes, &all);
  posix_spawnattr_setpgroup(&attributes, 0);
  posix_spawnattr_setflags(&attributes, POSIX_SPAWN_SETPGROUP | POSIX_SPAWN_SETSIGMASK | POSIX_SPAWN_SETSIGDEF);
  std::vector<char*> words, variables;
  for (auto& a : arguments) words.push_back(a.data());
  for (auto& v : environment) variables.push_back(v.data());
  words.push_back(nullptr);
  variables.push_back(nullptr);
  const int error = ::posix_spawn(&pid, words.front(), &actions, &attributes, words.data(), variables.data());
  posix_spawnattr_destroy(&attributes);
  posix_spawn_file_actions_destroy(&actions);
  return error;
}

}  // namespace isorig::daemon
