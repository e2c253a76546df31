#include "base/process.hpp"

#include <fcntl.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <chrono>
#include <csignal>
#include <cstring>
#include <stdexcept>
#include <system_error>

namespace isorig::base {

/// A program that runs; it has begun when this is constructed.
class RunningProcess {
 public:
  RunningProcess(const std::vector<std::string>& command, const std::filesystem::path& log,
                 const ProcessOptions& options)
      : among_(options.among) {
    std::vector<char*> words;
    for (const std::string& word : command) words.push_back(const_cast<char*>(word.c_str()));
    words.push_back(nullptr);
    std::array<int, 2> failed{};  // what errno was; closed by a successful exec
    if (::pipe2(failed.data(), O_CLOEXEC) != 0) throw std::system_error(errno, std::generic_category(), "pipe");
    const pid_t parent = ::getpid();
    pid_ = ::fork();
    if (pid_ == 0) {
      become(words, log, options, parent);
      const int error = errno;
      (void)!::write(failed[1], &error, sizeof error);
      ::_exit(127);
    }
    int error = pid_ < 0 ? errno : 0;
    ::close(failed[1]);
    if (pid_ > 0 && ::read(failed[0], &error, sizeof error) > 0) ::waitpid(pid_, nullptr, 0);
    ::close(failed[0]);
    if (error != 0)
      throw std::runtime_error("cannot start " + command[0] + ": " + std::strerror(error) +
                               "; name the program by its path");
    if (among_ == nullptr) return;
    const std::lock_guard lock(among_->mutex_);
    among_->groups_.insert(pid_);
    if (among_->ending_ != 0) ::kill(-pid_, among_->ending_);
  }

  /// Its status and what it used.
  int wait(rusage& usage) {
    // Looked at and not yet taken away: its number is nobody else's while Processes::end() may use it.
    siginfo_t info{};
    while (::waitid(P_PID, static_cast<id_t>(pid_), &info, WEXITED | WNOWAIT) < 0)
      if (errno != EINTR) throw std::system_error(errno, std::generic_category(), "waitid");
    if (among_ != nullptr) {
      const std::lock_guard lock(among_->mutex_);
      among_->groups_.erase(pid_);
    }
    int status = 0;
    while (::wait4(pid_, &status, 0, &usage) < 0)
      if (errno != EINTR) throw std::system_error(errno, std::generic_category(), "wait4");
    return status;
  }

 private:
  /// Between fork and exec, in a program with threads: nothing but system calls. Returns when it cannot.
  static void become(const std::vector<char*>& words, const std::filesystem::path& log, const ProcessOptions& options,
                     pid_t parent) {
    if (options.among != nullptr) {
      ::setpgid(0, 0);
      ::prctl(PR_SET_PDEATHSIG, SIGKILL);
      if (::getppid() != parent) ::_exit(127);
    }
    struct sigaction normal {};
    normal.sa_handler = SIG_DFL;
    for (int number = 1; number < SIGRTMIN; ++number) ::sigaction(number, &normal, nullptr);
    sigset_t none;
    sigemptyset(&none);
    ::sigprocmask(SIG_SETMASK, &none, nullptr);
    const int in = ::open("/dev/null", O_RDONLY);
    const int out = ::open(log.c_str(), O_WRONLY | O_CREAT | O_APPEND, 0644);
    if (in < 0 || out < 0 || ::dup2(in, 0) < 0 || ::dup2(out, 1) < 0 || ::dup2(out, 2) < 0) return;
    if (in > 2) ::close(in);
    if (out > 2) ::close(out);
    if (!options.working_directory.empty() && ::chdir(options.working_directory.c_str()) != 0) return;
    ::execvp(words[0], words.data());
  }

  Processes* among_;
  pid_t pid_ = -1;
};

void Processes::end(int signal) {
  const std::lock_guard lock(mutex_);
  ending_ = signal;
  for (const pid_t group : groups_) ::kill(-group, signal);
}

bool Processes::ending() const {
  const std::lock_guard lock(mutex_);
  return ending_ != 0;
}

ProcessResult run_process(const std::vector<std::string>& command, const std::filesystem::path& log,
                          const ProcessOptions& options) {
  const auto start = std::chrono::steady_clock::now();
  RunningProcess process(command, log, options);
  rusage usage{};
  const int status = process.wait(usage);
  const auto seconds = [](const timeval& t) {
    return static_cast<double>(t.tv_sec) + 1e-6 * static_cast<double>(t.tv_usec);
  };
  ProcessResult result;
  result.wall_s = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  result.cpu_s = seconds(usage.ru_utime) + seconds(usage.ru_stime);
  result.peak_MB = 1e-3 * static_cast<double>(usage.ru_maxrss);
  result.signal = WIFSIGNALED(status) ? WTERMSIG(status) : 0;
  result.exit_code = WIFEXITED(status) ? WEXITSTATUS(status) : 128 + result.signal;
  return result;
}

}  // namespace isorig::base
