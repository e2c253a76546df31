#pragma once
#include <array>
#include <atomic>
#include <bit>
#include <cstdint>
#include <cstring>

#include "daemon/core/links.hpp"
#include "daemon/core/records.hpp"

namespace isorig::daemon {

/// How a run ended; kNone while it goes on.
/// kNotStarted: its countdown was not completed.
enum class Outcome : std::uint8_t { kNone, kDone, kAborted, kFailed, kNotStarted };

/// Wake-ups by how late they came: below 1, 2, 4, ... 2^18 us, and later.
inline constexpr std::size_t kLatenessBins = 20;
[[nodiscard]] constexpr std::size_t lateness_bin(std::int64_t late_ns) noexcept {
  const auto us = static_cast<std::uint64_t>(late_ns < 0 ? 0 : late_ns) / 1000;
  const auto width = static_cast<std::size_t>(std::bit_width(us));
  return width < kLatenessBins ? width : kLatenessBins - 1;
}

/// A fault since the last reset, in the order in which they came.
struct FaultNote {
  std::int64_t mono_ns = 0;
  Severity severity = Severity::kInfo;
  char code[32] = {};
  char text[400] = {};  ///< what, the numbers, what the device's driver says
};
inline constexpr std::size_t kFaultsKept = 16;

/// What `isorig status` and `watch` show: the loop's newest view of everything.
struct Status {
  ControlRecord control;
  std::uint32_t session = 0;
  std::uint32_t sessions = 0;
  std::uint32_t steps = 0;
  std::int32_t repetition = 0;
  bool healthy = false;
  std::uint64_t runs_started = 0;
  bool run_loaded = false;  ///< a run is open: it can still go on
  Outcome outcome = Outcome::kNone;
  bool stopped = false;         ///< no run is open, the crosshead stands (or was given 2 s to), the actuator is vented
  bool vented_fault = false;    ///< the fault's reaction was the safe state
  bool zero_confirmed = false;  ///< the frame's zero, since the frame was started
  float operator_left_s = -1.0F;  ///< armed: for the second act; countdown: to the motion; setup: until it is left
  LinkHealth frame;
  LinkHealth pressure;
  LinkHealth interlock;
  clock::SyncCounts sync;        ///< the mapping of the Teensy's clock, measured by the sync line
  clock::SyncCheck sync_check;   ///< the last
  LinkHealth regulator;          ///< where one sets the pressure
  double frame_age_s = -1.0;     ///< of the newest sample; negative before the first
  double pressure_age_s = -1.0;  ///< of the newest valid reading
  bool estop_closed = false;
  bool guard_closed = false;
  std::uint64_t records_dropped = 0;  ///< by a full queue to the recorder: the run says so and fails
  std::uint64_t publish_dropped = 0;
  std::uint32_t worst_wakeup_ns = 0;  ///< since start
  std::uint32_t worst_run_ns = 0;
  std::array<std::uint64_t, kLatenessBins> lateness{};  ///< since start
  std::uint64_t invalid_pressure = 0;                   ///< sensor words that were no current reading, since start
  char not_ready[96] = {};                              ///< what is missing for ready, in words
  char fault[448] = {};                                 ///< the latched cause: the first
  std::uint32_t fault_count = 0;                        ///< of `faults`; what came when it was full is not there
  std::array<FaultNote, kFaultsKept> faults{};
};

/// One writer that never waits, many readers that retry: a sequence lock over words that are themselves atomic, so
/// that a torn read is detected and is no data race (Boehm, "Can seqlocks get along with programming language
/// memory models?", MSPC 2012).
template <typename T>
class SeqLock {
  static_assert(std::is_trivially_copyable_v<T>);
  static constexpr std::size_t kWords = (sizeof(T) + 7) / 8;

 public:
  void store(const T& value) noexcept {
    std::array<std::uint64_t, kWords> words{};
    std::memcpy(words.data(), &value, sizeof(T));
    const auto s = sequence_.load(std::memory_order_relaxed);
    sequence_.store(s + 1, std::memory_order_relaxed);
    std::atomic_thread_fence(std::memory_order_release);
    for (std::size_t i = 0; i < kWords; ++i) words_[i].store(words[i], std::memory_order_relaxed);
    sequence_.store(s + 2, std::memory_order_release);
  }

  [[nodiscard]] T load() const noexcept {
    std::array<std::uint64_t, kWords> words{};
    for (;;) {
      const auto before = sequence_.load(std::memory_order_acquire);
      for (std::size_t i = 0; i < kWords; ++i) words[i] = words_[i].load(std::memory_order_relaxed);
      std::atomic_thread_fence(std::memory_order_acquire);
      if ((before & 1U) == 0 && sequence_.load(std::memory_order_relaxed) == before) break;
    }
    T value;
    std::memcpy(static_cast<void*>(&value), words.data(), sizeof(T));
    return value;
  }

 private:
  std::atomic<std::uint64_t> sequence_{0};
  std::array<std::atomic<std::uint64_t>, kWords> words_{};
};

}  // namespace isorig::daemon
