#pragma once
#include <atomic>
#include <chrono>
#include <cstddef>
#include <memory>

namespace isorig::daemon {

/// Log lines go to standard output through a queue and a thread of their own: a terminal that stands still (Ctrl-S) or
/// a full pipe holds up nobody who has something to say. When nobody takes the lines, the oldest are given up and
/// counted. One a process; make it after the signals are blocked.
class Logging {
 public:
  Logging();
  ~Logging();
  Logging(const Logging&) = delete;
  Logging& operator=(const Logging&) = delete;

  /// Lines given up so far.
  [[nodiscard]] static std::size_t lost();
  /// Waits until all lines are out. False when they do not go: the process then has to leave without its log's thread.
  [[nodiscard]] bool drain(std::chrono::milliseconds patience);

 private:
  std::shared_ptr<std::atomic<bool>> flushed_;
};

}  // namespace isorig::daemon
