#pragma once
#include <pthread.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <exception>
#include <future>
#include <thread>
#include <vector>

#include "daemon/core/realtime.hpp"
#include "drivers/api/clock.hpp"

/// How the daemon's threads start, take turns and complain (docs/threads.md).
namespace isorig::daemon {

/// What a thread's turn threw, now and then: a turn comes back every few milliseconds.
class Complaint {
 public:
  explicit Complaint(const char* name) : name_(name) {}
  void note(const char* what) noexcept;

 private:
  const char* name_;
  std::chrono::steady_clock::time_point next_{};
};

/// A stack is resident as far as it was touched (lock_memory()), and counts against LimitMEMLOCK whole: the usual 8 MiB
/// each would be 100 MiB of that limit. A real-time thread needs what enter_realtime() touches and a few frames; the
/// others read TOML, which recurses for each of its 256 levels of nesting at most, and write pages. A sanitizer's
/// frames are several times as large.
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
inline constexpr std::size_t kStackFactor = 8;
#else
inline constexpr std::size_t kStackFactor = 1;
#endif
inline constexpr std::size_t kRealtimeStackBytes = kStackFactor * 512 * 1024;
inline constexpr std::size_t kStackBytes = kStackFactor * 1024 * 1024;
static_assert(kRealtimeStackBytes >= 2 * kPrefaultStackBytes);

/// Stacks of the threads that are made after this, in the whole process (those of libraries as well).
void set_stack_bytes(std::size_t bytes);

/// Starts a thread that runs `body` after it has its priority; what it could not get is thrown here.
template <typename Body>
void spawn(std::vector<std::thread>& into, const char* name, int priority, const RealtimeConfig& realtime, Body body) {
  std::promise<void> ready;
  auto outcome = ready.get_future();
  set_stack_bytes(priority > 0 ? kRealtimeStackBytes : kStackBytes);
  into.emplace_back([&realtime, name, priority, &ready, body]() mutable {
    pthread_setname_np(pthread_self(), name);
    try {
      if (priority > 0) enter_realtime(realtime, priority);
      if (priority == realtime.priority) pin(realtime);
    } catch (...) {
      ready.set_exception(std::current_exception());
      return;
    }
    ready.set_value();
    try {
      body();
    } catch (const std::exception& e) {
      Complaint(name).note(e.what());
    }
  });
  set_stack_bytes(kStackBytes);
  outcome.get();
}

/// A turn that throws is tried again: what it was there for is missing meanwhile, and the supervisor judges that.
template <typename Turn>
void every(clock::Clock& clock, const char* name, std::int64_t period_ns, const std::atomic<bool>& stop, Turn turn) {
  Complaint complaint(name);
  std::int64_t deadline_ns = clock.now_ns();
  while (!stop.load(std::memory_order_relaxed)) {
    deadline_ns = std::max(deadline_ns + period_ns, clock.now_ns());
    clock.sleep_until_ns(deadline_ns);
    try {
      turn();
    } catch (const std::exception& e) {
      complaint.note(e.what());
    }
  }
}

}  // namespace isorig::daemon
