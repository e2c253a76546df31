#pragma once
#include <condition_variable>
#include <cstdint>
#include <functional>
#include <mutex>
#include <optional>
#include <string>
#include <thread>

namespace isorig::daemon {

/// Looks whether the disk of the runs takes what is written, in a thread of its own: a disk that hangs answers neither
/// with success nor with an error, and whoever waits for it does nothing else.
class StorageWatch {
 public:
  /// Why a run could not be recorded; empty when it could. May hang, may throw.
  using Look = std::function<std::string()>;

  explicit StorageWatch(Look look);
  /// Waits for a look that is under way.
  ~StorageWatch();
  StorageWatch(const StorageWatch&) = delete;
  StorageWatch& operator=(const StorageWatch&) = delete;

  /// In the caller's own thread.
  [[nodiscard]] std::string look_here() const noexcept;
  /// Has a look taken, unless one is under way: of that one the answer is awaited.
  void ask(std::int64_t now_ns);
  /// The answer to what was asked, once.
  [[nodiscard]] std::optional<std::string> take();
  /// Since when an answer is awaited.
  [[nodiscard]] std::optional<std::int64_t> asked_ns() const;

 private:
  void run();

  const Look look_;
  mutable std::mutex mutex_;  // guards all below but the thread
  std::condition_variable wake_;
  bool stop_ = false;
  std::optional<std::int64_t> asked_ns_;
  std::optional<std::string> answer_;
  std::thread thread_;
};

}  // namespace isorig::daemon
