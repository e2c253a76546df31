#pragma once
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <thread>

namespace isorig::daemon {

/// Looks whether the disk of the runs takes what is written, in a thread of its own: a disk that hangs answers neither
/// with success nor with an error, and whoever waits for it does nothing else.
class StorageWatch {
 public:
  /// Why a run could not be recorded; empty when it could. May hang, may throw. Uses nothing that may go before it
  /// ends: one that hangs outlives the watch.
  using Look = std::function<std::string()>;

  explicit StorageWatch(Look look);
  /// A look that is under way has a second to end, and is left to itself then.
  ~StorageWatch();
  StorageWatch(const StorageWatch&) = delete;
  StorageWatch& operator=(const StorageWatch&) = delete;

  /// In the caller's own thread.
  [[nodiscard]] std::string look_here() const noexcept;
  /// Has a look taken, unless one is under way: of that one the answer is awaited.
  void ask(std::int64_t now_ns);
  /// The answer to what was asked, once.
  [[nodiscard]] std::optional<std::string> take();
  /// Has a look taken, unless one is under way. False where that does not end within a second.
  [[nodiscard]] bool answers(std::int64_t now_ns);
  /// Since when an answer is awaited.
  [[nodiscard]] std::optional<std::int64_t> asked_ns() const;

 private:
  struct Shared;
  const std::shared_ptr<Shared> shared_;
  std::thread thread_;
};

}  // namespace isorig::daemon
