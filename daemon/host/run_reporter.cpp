#include "daemon/host/run_reporter.hpp"

#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <chrono>
#include <csignal>
#include <cstring>

#include "base/printable.hpp"
#include "base/report_pages.hpp"
#include "daemon/host/child_process.hpp"

namespace isorig::daemon {
namespace {

using steady_clock = std::chrono::steady_clock;

constexpr auto kPageLook = std::chrono::milliseconds(50);
constexpr auto kLongest = std::chrono::minutes(30);  // a page of a day's run takes seconds

}  // namespace

std::filesystem::path RunReporter::beside_this_program() {
  std::error_code error;
  const auto self = std::filesystem::read_symlink("/proc/self/exe", error);
  if (error) return {};
  const auto program = self.parent_path() / "isorig";
  return ::access(program.c_str(), X_OK) == 0 ? program : std::filesystem::path();
}

void RunReporter::on_closed(const std::filesystem::path& run) {
  if (!enabled()) return;
  {
    const std::lock_guard lock(mutex_);
    runs_.push_back(run);
  }
  more_.notify_one();
}

void RunReporter::catch_up(const std::filesystem::path& runs_root) {
  if (!enabled()) return;
  std::filesystem::path newest;  // names of runs begin with their date
  std::error_code error;
  for (const auto& entry : std::filesystem::directory_iterator(runs_root, error)) {
    std::error_code ignored;
    if (!entry.is_symlink(ignored) && entry.path().filename() > newest.filename() &&
        std::filesystem::exists(entry.path() / "run.toml", ignored))
      newest = entry.path();
  }
  if (!newest.empty() && !std::filesystem::exists(newest / base::kRunPage, error)) on_closed(newest);
}

void RunReporter::stop() {
  {
    const std::lock_guard lock(mutex_);
    stopping_ = true;
  }
  more_.notify_all();
}

void RunReporter::run() {
  for (;;) {
    std::filesystem::path next;
    {
      std::unique_lock lock(mutex_);
      more_.wait(lock, [this] { return stopping_ || !runs_.empty(); });
      if (stopping_) return;
      next = std::move(runs_.front());
      runs_.pop_front();
    }
    write(next);
  }
}

void RunReporter::write(const std::filesystem::path& run) {
  const auto note = [&](const std::string& why) {
    if (log_)
      log_("the page of run " + base::printable(run.filename().string()) + " was not written: " + why +
           "; `isorig report` writes it");
  };
  const ChildWords words;
  pid_t pid = 0;
  if (const int error = spawn_child({program_.string(), "report", run.string(), "--background"}, child_environment(),
                                    words.fd(), pid);
      error != 0) {
    note(program_.string() + " cannot be started: " + std::strerror(error));
    return;
  }
  const auto deadline = steady_clock::now() + kLongest;
  int status = 0;
  bool ended = false;
  {
    std::unique_lock lock(mutex_);
    while (!stopping_ && steady_clock::now() < deadline) {
      const pid_t got = ::waitpid(pid, &status, WNOHANG);
      if (got == pid || (got < 0 && errno != EINTR)) {
        ended = true;
        break;
      }
      more_.wait_for(lock, kPageLook);
    }
  }
  if (ended) {
    if (WIFSIGNALED(status)) return note("it was killed by signal " + std::to_string(WTERMSIG(status)) + words.first());
    if (WEXITSTATUS(status) != 0)
      note("it failed with exit code " + std::to_string(WEXITSTATUS(status)) + words.first());
    return;
  }
  if (::waitpid(pid, &status, WNOHANG) == pid) return;  // between the last look and the wish to end
  ::kill(-pid, SIGTERM);
  const auto killed = steady_clock::now() + kTermGrace;
  while (::waitpid(pid, &status, WNOHANG) == 0) {
    if (steady_clock::now() > killed) {
      ::kill(-pid, SIGKILL);
      ::waitpid(pid, &status, 0);
      break;
    }
    ::usleep(10'000);
  }
  note("the daemon ended, or it took too long");
}

}  // namespace isorig::daemon
