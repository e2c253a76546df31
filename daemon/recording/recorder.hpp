#pragma once
#include <atomic>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>

#include "daemon/core/streams.hpp"
#include "daemon/recording/recorder_types.hpp"

namespace isorig::daemon {

/// Writes a run as LCM event log segments, `run_dir`/segment-0001.lcm and so on. One thread calls drain() and
/// finish(); disk() is wait-free for everybody, status() may be called from any thread that can wait.
///
/// Time is cut into slices of 0.1 s. A slice is written when now - lag_s has passed its end, its messages in
/// order of time; so the bytes written depend on the records alone and not on how often drain() is called.
class Recorder {
 public:
  /// Creates run_dir if needed, takes its lock, opens the next segment. In a directory that has segments, it
  /// is a further attempt at the same run (resume). Throws std::runtime_error with what to do: the directory
  /// is locked by a live daemon, or cannot be written, or has less than min_free_bytes.
  Recorder(const RecorderOptions& options, RunInfo info);
  ~Recorder();
  Recorder(const Recorder&) = delete;
  Recorder& operator=(const Recorder&) = delete;

  /// Takes what is queued and writes what is due. Every record stamped before now - lag_s has been pushed.
  /// Does not throw: a disk or a catalogue that takes nothing is a condition (disk(), status()), and is tried again.
  void drain(Streams& streams, std::int64_t now_ns) noexcept;
  /// The rest, the end of the session and of the recording, sync. `complete`: the plan was carried out to its end.
  /// Nothing is recorded afterwards. False: not everything is on the disk or in the catalogue yet; settle() tries
  /// again.
  bool finish(Streams& streams, bool complete) noexcept;
  bool settle() noexcept;

  /// May throw: it is called again with the next drain() or settle().
  void on_session(std::function<void(const SessionChange&)> callback);

  /// `now_ns` of the last drain() that came back: what the real-time loop judges, since a recorder that waits for its
  /// disk cannot say so. Wait-free.
  [[nodiscard]] std::int64_t last_turn_ns() const noexcept { return last_turn_ns_.load(std::memory_order_relaxed); }
  [[nodiscard]] DiskCondition disk() const noexcept { return disk_.load(std::memory_order_relaxed); }
  [[nodiscard]] RecorderStatus status() const;
  [[nodiscard]] std::int32_t attempt() const noexcept;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
  std::atomic<DiskCondition> disk_{DiskCondition::kOk};
  std::atomic<std::int64_t> last_turn_ns_{0};
};

}  // namespace isorig::daemon
