#pragma once
#include <condition_variable>
#include <deque>
#include <filesystem>
#include <functional>
#include <mutex>
#include <string>

namespace isorig::daemon {

/// Has the page of each run written when it is over, by `isorig report` in a process of its own and with low
/// priority: the daemon itself analyses nothing. One at a time; a thread that does nothing else waits for it.
class RunReporter {
 public:
  /// What went wrong, a line each.
  using Log = std::function<void(const std::string&)>;

  /// `program`: isorig; empty: no pages are written.
  RunReporter(std::filesystem::path program, Log log) : program_(std::move(program)), log_(std::move(log)) {}

  /// The isorig that lies beside this program; empty, where it is not installed.
  [[nodiscard]] static std::filesystem::path beside_this_program();

  [[nodiscard]] bool enabled() const noexcept { return !program_.empty(); }
  /// Any thread; queues, waits for nothing. The run has its end on the disk and in the catalogue.
  void on_closed(const std::filesystem::path& run);
  /// The newest run, if it has no page: it ended together with the daemon before this one.
  void catch_up(const std::filesystem::path& runs_root);

  /// The thread: writes until stop(), which ends a page that is being made; catch_up() makes it later.
  void run();
  void stop();

 private:
  void write(const std::filesystem::path& run);

  const std::filesystem::path program_;
  const Log log_;
  std::mutex mutex_;
  std::condition_variable more_;
  std::deque<std::filesystem::path> runs_;  // guarded by mutex_
  bool stopping_ = false;                   // guarded by mutex_
};

}  // namespace isorig::daemon
