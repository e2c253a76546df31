#include "daemon/core/realtime.hpp"

#include <malloc.h>
#include <pthread.h>
#include <sched.h>
#include <sys/mman.h>
#include <sys/prctl.h>

#include <cerrno>
#include <cstring>
#include <vector>

#include "base/toml_reader.hpp"

namespace isorig::daemon {
namespace {

constexpr std::size_t kPrefaultHeapBytes = 1024 * 1024;

void touch_stack() noexcept {
  char block[kPrefaultStackBytes];
  for (std::size_t i = 0; i < kPrefaultStackBytes; i += 4096) *static_cast<volatile char*>(&block[i]) = 0;
}

}  // namespace

RealtimeConfig RealtimeConfig::read(const base::TomlTable& table) {
  RealtimeConfig c;
  c.period_ns = table.integer_or("period_us", c.period_ns / 1000, {200, 10'000}) * 1000;
  c.priority = static_cast<int>(table.integer_or("priority", c.priority, {1, 98}));
  c.io_priority = static_cast<int>(table.integer_or("io_priority", c.io_priority, {1, 98}));
  c.cpu = static_cast<int>(table.integer_or("cpu", c.cpu, {-1, 1023}));
  if (c.io_priority >= c.priority) table.error("io_priority", "`io_priority` has to be below `priority`");
  return c;
}

void lock_memory(const RealtimeConfig& config) {
  // Freed memory stays ours and large blocks come from the heap: no page goes back to be faulted in again.
  mallopt(M_TRIM_THRESHOLD, -1);
  mallopt(M_MMAP_MAX, 0);
  // The kernel does not put our pages together into huge ones: it unmaps locked pages meanwhile, and a thread that
  // touches such a page waits (Documentation/admin-guide/mm/transhuge.rst, khugepaged).
  if (prctl(PR_SET_THP_DISABLE, 1, 0, 0, 0) != 0 && config.enforce) {
    throw RealtimeError(std::string("huge pages cannot be turned off for this process (") + std::strerror(errno) +
                        "); start with --no-realtime");
  }
  // What is there now is made resident: programs and libraries, queues, everything that the loop walks over. What comes
  // later is locked page by page as it is touched: a real-time thread touches its stack before it starts, and nobody
  // waits for the stacks and heaps of the other threads.
  if (mlockall(MCL_CURRENT) != 0 || mlockall(MCL_FUTURE | MCL_ONFAULT) != 0) {
    const int error = errno;
    if (config.enforce) {
      throw RealtimeError(std::string("memory cannot be locked (") + std::strerror(error) +
                          "); raise LimitMEMLOCK (ulimit -l unlimited), or start with --no-realtime");
    }
  }
  std::vector<char> heap(kPrefaultHeapBytes);
  for (std::size_t i = 0; i < heap.size(); i += 4096) *const_cast<volatile char*>(&heap[i]) = 0;
}

void enter_realtime(const RealtimeConfig& config, int priority) {
  sched_param param{};
  param.sched_priority = priority;
  // Returns its error; errno is not set.
  if (const int error = pthread_setschedparam(pthread_self(), SCHED_FIFO, &param); error != 0 && config.enforce) {
    throw RealtimeError(std::string("no real-time priority (") + std::strerror(error) +
                        "); grant it with LimitRTPRIO (ulimit -r) or CAP_SYS_NICE, or start with --no-realtime");
  }
  touch_stack();
}

void pin(const RealtimeConfig& config) {
  if (config.cpu < 0) return;
  cpu_set_t set;
  CPU_ZERO(&set);
  CPU_SET(static_cast<unsigned>(config.cpu), &set);
  if (const int error = pthread_setaffinity_np(pthread_self(), sizeof set, &set); error != 0 && config.enforce) {
    throw RealtimeError("the loop cannot be pinned to CPU " + std::to_string(config.cpu) + " (" + std::strerror(error) +
                        "); correct [realtime] cpu");
  }
}

void run_loop(clock::Clock& clock, std::int64_t period_ns, Core& core, const std::atomic<bool>& stop) noexcept {
  std::int64_t deadline_ns = clock.now_ns();
  std::int64_t last_run_ns = 0;
  while (!stop.load(std::memory_order_relaxed)) {
    deadline_ns += period_ns;
    clock.sleep_until_ns(deadline_ns);
    const std::int64_t woke_ns = clock.now_ns();
    core.tick(woke_ns, woke_ns - deadline_ns, last_run_ns);
    const std::int64_t done_ns = clock.now_ns();
    last_run_ns = done_ns - woke_ns;
    if (const std::int64_t missed = (done_ns - deadline_ns) / period_ns; missed > 0) {
      core.note_missed_ticks(static_cast<std::uint64_t>(missed));
      deadline_ns += missed * period_ns;
    }
  }
}

}  // namespace isorig::daemon
