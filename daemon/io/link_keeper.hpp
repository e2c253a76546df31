#pragma once
#include <cstdint>
#include <exception>
#include <initializer_list>
#include <string>

#include "base/spsc_queue.hpp"
#include "daemon/core/links.hpp"
#include "drivers/api/backoff.hpp"
#include "drivers/api/error.hpp"

namespace isorig::daemon {

/// What all services have in common. A service is the device side of a link: it owns one device and is run by one
/// thread in real time (`run_once` at its period) or inline by the virtual runner, the same code in both. Everything
/// that blocks or throws stays in it. Here: a turn whose exceptions end nowhere else, the connection with its back-off
/// and failures, and the health that is reported.
///
/// Policy after a reconnect: nothing is sent again by itself; the loop has seen the stream go stale, has brought the
/// rig to its safe state and waits for a reset.
class LinkKeeper {
 protected:
  /// Five missing or spoilt answers in a row lose a connection; see note_failure().
  static constexpr int kFailuresToLose = 5;

  /// `failures_to_lose` 0: any error loses it, even a refusal.
  explicit LinkKeeper(base::SpscQueue<LinkHealth>& reports, const drivers::Backoff::Options& retry = {},
                      int failures_to_lose = kFailuresToLose)
      : reports_(reports), backoff_(retry), failures_to_lose_(failures_to_lose) {}
  virtual ~LinkKeeper() = default;
  LinkKeeper(const LinkKeeper&) = delete;
  LinkKeeper& operator=(const LinkKeeper&) = delete;

  /// Runs one turn of the service; what it throws is noted as a failure of the link. Reports the health.
  template <typename Turn>
  void keep(std::int64_t now_ns, Turn turn) noexcept;
  /// Notes a failure; drops the connection if that has to be started afresh.
  void fail(std::int64_t now_ns, const drivers::DeviceError& error) noexcept;
  /// Closes what there is of a connection and forgets what belonged to it.
  virtual void drop(std::int64_t now_ns) noexcept = 0;

  void connect_now() noexcept { backoff_.reset(); }  ///< instead of when the back-off says
  [[nodiscard]] bool may_connect(std::int64_t now_ns) const noexcept { return backoff_.is_due(now_ns); }
  void note_connected(const std::string& identity) noexcept;
  void note_answer() noexcept { failures_in_a_row_ = 0; }
  /// At most every 100 ms, unless forced.
  void report_health(std::int64_t now_ns, bool force) noexcept;
  /// "a, b" of the parts that are not empty.
  [[nodiscard]] static std::string words(std::initializer_list<std::string> parts);

  LinkHealth health_;

 private:
  /// True when the connection has to be started afresh.
  bool note_failure(std::int64_t now_ns, const drivers::DeviceError& error) noexcept;
  /// What else a report says, just before it goes out.
  virtual void complete(LinkHealth& /*health*/) const noexcept {}

  base::SpscQueue<LinkHealth>& reports_;
  drivers::Backoff backoff_;
  int failures_to_lose_;
  int failures_in_a_row_ = 0;
  bool was_connected_ = false;
  std::int64_t next_health_ns_ = 0;
};

/// Whether the loop still ticks, by the number that it counts up (`loop_beat`).
class LoopWatch {
 public:
  [[nodiscard]] bool alive(std::uint32_t beat, std::int64_t now_ns) noexcept {
    if (beat != last_) {
      last_ = beat;
      last_ns_ = now_ns;
    }
    return now_ns - last_ns_ < kDeadNs;
  }

 private:
  /// A loop that has not ticked for this long holds neither a set-point nor the dump valve any more.
  static constexpr std::int64_t kDeadNs = 500'000'000;

  std::uint32_t last_ = 0;
  std::int64_t last_ns_ = 0;
};

template <typename Turn>
void LinkKeeper::keep(std::int64_t now_ns, Turn turn) noexcept {
  try {
    turn();
  } catch (const drivers::DeviceError& error) {
    fail(now_ns, error);
  } catch (const std::exception& error) {
    fail(now_ns, drivers::DeviceError(drivers::Fault::kDisconnected, error.what()));
  }
  report_health(now_ns, false);
}

}  // namespace isorig::daemon
