#pragma once
#include <sys/socket.h>
#include <sys/un.h>

#include <atomic>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

/// What a service manager is told, in sd_notify(3)'s protocol: one datagram of `KEY=value` lines to $NOTIFY_SOCKET.
/// The protocol is stable and ten lines long; a library for it would be one more thing that runs beside the loop.
namespace isorig::daemon {

class ServiceNotifier {
 public:
  /// Reads NOTIFY_SOCKET, WATCHDOG_USEC and WATCHDOG_PID and takes them out of the environment: what this process
  /// starts must not speak for it. Without a manager every call below does nothing.
  static ServiceNotifier from_environment();

  /// `socket`: a path, or an abstract name that begins with '@'; empty for none. Throws std::runtime_error when it
  /// names something that cannot be a Unix socket.
  explicit ServiceNotifier(std::string_view socket, std::int64_t watchdog_ns = 0);
  ~ServiceNotifier();
  ServiceNotifier(ServiceNotifier&& other) noexcept;
  ServiceNotifier& operator=(ServiceNotifier&&) = delete;

  /// One datagram, without waiting. False when the manager did not take it; errno says why.
  bool send(std::string_view assignments) noexcept;
  /// READY=1 with a first STATUS.
  void ready(std::string_view status);
  /// STATUS, only when it is another than the last.
  void status(std::string_view text);
  void stopping(std::string_view status);

  /// How often the manager wants to hear WATCHDOG=1, 0 when it does not.
  [[nodiscard]] std::int64_t watchdog_ns() const noexcept { return watchdog_ns_; }
  [[nodiscard]] bool connected() const noexcept { return fd_ >= 0; }

 private:
  sockaddr_un address_{};
  socklen_t address_length_ = 0;
  int fd_ = -1;
  std::int64_t watchdog_ns_ = 0;
  std::string last_status_;
};

/// Passes the real-time loop's progress on to the manager's watchdog, and nothing else: `turn()` sends only when the
/// loop's beat has changed since the last turn. A stalled loop starves the watchdog however alive the rest of the
/// process is; a rig that rests, or is faulted, ticks on and feeds it (docs/service.md).
class WatchdogFeeder {
 public:
  WatchdogFeeder(ServiceNotifier& notifier, const std::atomic<std::uint32_t>& loop_beat) noexcept
      : notifier_(notifier), loop_beat_(loop_beat) {}

  /// A quarter of the limit: three turns may be late or lost before the manager acts.
  [[nodiscard]] std::int64_t period_ns() const noexcept { return notifier_.watchdog_ns() / 4; }
  /// True when the watchdog was fed.
  bool turn() noexcept;

 private:
  ServiceNotifier& notifier_;
  const std::atomic<std::uint32_t>& loop_beat_;
  std::optional<std::uint32_t> last_beat_;
};

}  // namespace isorig::daemon
