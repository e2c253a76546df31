#pragma once
#include <fcntl.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <chrono>
#include <filesystem>
#include <fstream>
#include <functional>
#include <nlohmann/json.hpp>
#include <sstream>
#include <string>
#include <thread>
#include <vector>

#include "tree.hpp"

/// What a test needs to look at the programs from outside: a folder of its own, children that never outlive it, time
/// limits everywhere.
namespace isorig::system_test {

inline std::string bin(const std::string& program) {
  return test::program_path() + "/" + program;
}
inline std::string source(const std::string& path) {
  return test::source_path() + "/" + path;
}

inline std::string slurp(const std::filesystem::path& path) {
  std::ifstream in(path, std::ios::binary);
  std::ostringstream text;
  text << in.rdbuf();
  return text.str();
}

inline void spit(const std::filesystem::path& path, const std::string& text) {
  std::ofstream(path, std::ios::binary) << text;
}

/// Looks every 20 ms; the limit only says when to give up.
inline bool wait_until(double seconds, const std::function<bool()>& condition) {
  const auto deadline = std::chrono::steady_clock::now() + std::chrono::duration<double>(seconds);
  while (!condition()) {
    if (std::chrono::steady_clock::now() > deadline) return false;
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
  }
  return true;
}

class TempDir {
 public:
  TempDir() {
    // Unix sockets have to fit 107 characters: not in the build tree.
    std::string name = (std::filesystem::temp_directory_path() / "isorig-XXXXXX").string();
    if (::mkdtemp(name.data()) == nullptr) throw std::runtime_error("no temporary directory");
    path_ = name;
  }
  ~TempDir() {
    std::error_code ignored;
    std::filesystem::remove_all(path_, ignored);
  }
  TempDir(const TempDir&) = delete;
  TempDir& operator=(const TempDir&) = delete;
  [[nodiscard]] std::filesystem::path operator/(const std::string& name) const { return path_ / name; }
  [[nodiscard]] const std::filesystem::path& path() const { return path_; }

 private:
  std::filesystem::path path_;
};

/// A child with both its outputs in one file. It dies with the test.
class Process {
 public:
  Process(std::vector<std::string> words, std::filesystem::path log, const std::function<void()>& in_child = {})
      : log_(std::move(log)), name_(words.front()) {
    const pid_t parent = ::getpid();
    pid_ = ::fork();
    if (pid_ < 0) throw std::runtime_error("fork failed");
    if (pid_ == 0) {
      ::prctl(PR_SET_PDEATHSIG, SIGKILL);
      if (::getppid() != parent) ::_exit(126);
      const int fd = ::open(log_.c_str(), O_CREAT | O_WRONLY | O_TRUNC | O_APPEND, 0666);
      ::dup2(fd, STDOUT_FILENO);
      ::dup2(fd, STDERR_FILENO);
      if (in_child) in_child();
      std::vector<char*> arguments;
      for (auto& word : words) arguments.push_back(word.data());
      arguments.push_back(nullptr);
      ::execvp(arguments[0], arguments.data());
      ::_exit(127);
    }
  }
  ~Process() {
    if (pid_ > 0) stop(SIGKILL, 10.0);
  }
  Process(const Process&) = delete;
  Process& operator=(const Process&) = delete;

  [[nodiscard]] bool running() {
    if (pid_ > 0 && ::wait4(pid_, &status_, WNOHANG, &usage_) == pid_) pid_ = -1;
    return pid_ > 0;
  }
  /// The exit code, or minus the signal that ended it. A child that does not end in time is a failure and killed.
  int wait(double seconds) {
    if (!wait_until(seconds, [&] { return !running(); })) {
      ADD_FAILURE() << name_ << " did not end within " << seconds << " s:\n" << output();
      ::kill(pid_, SIGKILL);
      ::wait4(pid_, &status_, 0, &usage_);
      pid_ = -1;
    }
    return WIFEXITED(status_) ? WEXITSTATUS(status_) : -WTERMSIG(status_);
  }
  int stop(int signal_number = SIGTERM, double seconds = 40.0) {
    if (running()) ::kill(pid_, signal_number);
    return wait(seconds);
  }
  [[nodiscard]] std::string output() const { return slurp(log_); }
  [[nodiscard]] pid_t pid() const { return pid_; }
  [[nodiscard]] double cpu_s() const {
    const auto s = [](const timeval& t) {
      return static_cast<double>(t.tv_sec) + 1e-6 * static_cast<double>(t.tv_usec);
    };
    return s(usage_.ru_utime) + s(usage_.ru_stime);
  }
  /// The most that was resident of it, of one that has ended.
  [[nodiscard]] double peak_MB() const { return 1e-3 * static_cast<double>(usage_.ru_maxrss); }

 private:
  std::filesystem::path log_;
  std::string name_;
  pid_t pid_ = -1;
  int status_ = 0;
  rusage usage_{};
};

/// Programs that were started wait here, until all are let go at once.
class Gate {
 public:
  Gate() { EXPECT_EQ(::pipe2(ends_.data(), O_CLOEXEC), 0); }
  ~Gate() {
    open();
    ::close(ends_[0]);
  }
  Gate(const Gate&) = delete;
  Gate& operator=(const Gate&) = delete;
  /// In the child: until nobody holds the writing end any more.
  void wait() const {
    ::close(ends_[1]);
    char byte = 0;
    (void)!::read(ends_[0], &byte, 1);
  }
  void open() {
    if (ends_[1] >= 0) ::close(ends_[1]);
    ends_[1] = -1;
  }

 private:
  std::array<int, 2> ends_{-1, -1};
};

struct Answer {
  int code = 0;
  std::string text;  ///< both outputs
  [[nodiscard]] nlohmann::json json() const { return nlohmann::json::parse(text, nullptr, false); }
};

/// Runs a program to its end.
inline Answer run(const TempDir& dir, std::vector<std::string> words, double seconds = 60.0) {
  static int number = 0;
  const auto log = dir / ("answer-" + std::to_string(++number) + ".txt");
  Process process(std::move(words), log);
  const int code = process.wait(seconds);
  return {code, process.output()};
}

inline Answer isorig(const TempDir& dir, std::vector<std::string> words, double seconds = 60.0) {
  words.insert(words.begin(), bin("isorig"));
  return run(dir, std::move(words), seconds);
}

inline std::string replaced(std::string text, const std::string& from, const std::string& to) {
  const auto at = text.find(from);
  if (at == std::string::npos) throw std::runtime_error("the rig file no longer has \"" + from + "\"");
  for (auto i = at; i != std::string::npos; i = text.find(from, i + to.size())) text.replace(i, from.size(), to);
  return text;
}

/// The shipped virtual rig for a machine that may stand still for some tenths of a second: what is tested here is not
/// how punctual the host is. `more` is appended.
inline std::filesystem::path patient_rig(const TempDir& dir, const std::string& more = "") {
  auto text = slurp(source("config/rigs/sim.toml"));
  text = replaced(text, "\"../", "\"" + source("config/"));
  text = replaced(text, "frame_age_max_s = 0.25\npressure_age_max_s = 0.25",
                  "frame_age_max_s = 2.0\npressure_age_max_s = 2.0\ninterlock_age_max_s = 2.0\nlate_tick_max_s = 2.0\n"
                  "segment_ack_max_s = 2.0");
  text = replaced(text, "heartbeat_timeout_s = 0.5", "heartbeat_timeout_s = 2.0");
  text = replaced(text, "watchdog_s = 0.5", "watchdog_s = 2.0");
  text = replaced(text, "ring_samples = 256", "ring_samples = 2048");
  text = replaced(text, "[sim.pressure]\n", "[sim.pressure]\nring_samples = 2048\n");
  const auto path = dir / "rig.toml";
  spit(path, text + "\n" + more);
  return path;
}

/// isorigd with its socket and runs in `dir`.
class DaemonProcess {
 public:
  DaemonProcess(const TempDir& dir, const std::filesystem::path& rig, const std::function<void()>& in_child = {})
      : dir_(dir),
        socket_((dir / "isorigd.sock").string()),
        runs_((dir / "runs").string()),
        process_({bin("isorigd"), "--no-realtime", "--rig", rig.string(), "--runs", runs_, "--socket", socket_},
                 dir / "isorigd.log", in_child) {}

  [[nodiscard]] nlohmann::json status() const { return isorig(dir_, {"status", "--json", "--socket", socket_}).json(); }
  [[nodiscard]] std::string state() const {
    const auto s = status();
    return s.is_object() ? s.value("state", "") : "";
  }
  bool reach(const std::string& state_name, double seconds = 60.0) {
    return wait_until(seconds, [&] { return state() == state_name; });
  }
  Answer call(std::vector<std::string> words, double seconds = 60.0) const {
    words.insert(words.end(), {"--socket", socket_});
    return isorig(dir_, std::move(words), seconds);
  }
  [[nodiscard]] nlohmann::json catalogue() const { return isorig(dir_, {"runs", "--json", "--runs", runs_}).json(); }
  [[nodiscard]] const std::string& runs() const { return runs_; }
  [[nodiscard]] const std::string& socket() const { return socket_; }
  Process& process() { return process_; }
  [[nodiscard]] std::string log() const { return process_.output(); }

 private:
  const TempDir& dir_;
  std::string socket_, runs_;
  Process process_;
};

/// "run X started" -> X
inline std::string started_run(const Answer& answer) {
  const auto from = answer.text.find("run ");
  const auto to = answer.text.find(" started");
  if (answer.code != 0 || from == std::string::npos || to == std::string::npos) {
    ADD_FAILURE() << "not started (" << answer.code << "): " << answer.text;
    return "";
  }
  return answer.text.substr(from + 4, to - from - 4);
}

}  // namespace isorig::system_test
