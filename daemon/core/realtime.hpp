#pragma once
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <stdexcept>
#include <string>

#include "daemon/core/core.hpp"
#include "drivers/api/clock.hpp"

namespace isorig::base {
class TomlTable;
}

namespace isorig::daemon {

struct RealtimeConfig {
  std::int64_t period_ns = 1'000'000;
  int priority = 80;     ///< SCHED_FIFO; above the kernel's threaded interrupts (50)
  int io_priority = 60;  ///< SCHED_FIFO of the device threads
  int cpu = -1;          ///< pins the loop; -1 leaves it to the scheduler
  bool enforce = true;   ///< false (--no-realtime): what is refused is done without; the log says what was got

  /// Reads [realtime].
  static RealtimeConfig read(const base::TomlTable& table);
};

/// The machine will not give what real time needs; what() says what and how to grant it.
class RealtimeError : public std::runtime_error {
  using std::runtime_error::runtime_error;
};

/// Locks all memory: what is there is made resident, and what comes stays resident once it was touched. Stack and heap
/// are touched, so that no page fault is left for the loop. Process-wide; call before the threads start. Throws
/// RealtimeError if `enforce` and it is refused.
void lock_memory(const RealtimeConfig& config);

/// Of its stack a real-time thread touches so much before it starts.
inline constexpr std::size_t kPrefaultStackBytes = 256 * 1024;

/// Gives the calling thread SCHED_FIFO at `priority`. Throws RealtimeError if `enforce` and it is refused.
void enter_realtime(const RealtimeConfig& config, int priority);

/// Pins the calling thread, if configured.
void pin(const RealtimeConfig& config);

/// The loop: absolute deadlines, one tick each; returns when `stop` is set. A wake-up that comes more than a period
/// late skips the ticks it missed (they are counted): a burst of catch-up ticks would only be late again.
void run_loop(clock::Clock& clock, std::int64_t period_ns, Core& core, const std::atomic<bool>& stop) noexcept;

}  // namespace isorig::daemon
