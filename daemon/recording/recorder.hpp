#pragma once
#include <atomic>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <isorig_msgs/run_header_t.hpp>
#include <limits>
#include <memory>
#include <mutex>
#include <string>
#include <utility>
#include <vector>

#include "daemon/core/streams.hpp"

namespace isorig::daemon {

/// One repetition at one pressure. A record belongs to the last session whose first step is not after its
/// own.
struct SessionInfo {
  std::uint32_t first_step = 0;
  std::int32_t repetition = 1;
  double pressure_psi = 0.0;
  double pressurized_rest_length_mm = std::numeric_limits<double>::quiet_NaN();
};

/// What every segment says about its run. Nothing in it may differ between two runs of the same config and
/// seed in virtual time, since their segments have to be equal byte by byte: names and dates go to run.toml.
struct RunInfo {
  std::int64_t start_mono_ns = 0;  ///< not after the first record
  std::int64_t epoch_unix_us = 0;  ///< Unix time at mono_ns = 0; in virtual time a fixed number
  bool virtual_time = false;
  std::int64_t seed = 0;
  std::string rig;  ///< identity
  std::string specimen;
  double rest_length_mm = 0.0;  ///< unpressurized
  std::string operator_name;
  std::string plan_summary;
  std::vector<std::pair<std::string, std::string>> texts;     ///< "rig.toml", "protocol.toml", ...: whole files
  std::vector<std::pair<std::string, std::string>> versions;  ///< "isorig", "lcm", firmware, ...
  std::vector<SessionInfo> sessions;                          ///< by first_step; empty: one session
  std::int32_t first_session = 0;  ///< with which this attempt begins: nothing is recorded into earlier ones
  /// For run.toml alone.
  std::string run_id;
  std::string started_utc;
};

struct RecorderOptions {
  std::filesystem::path run_dir;
  double average_interval_s = 0.1;
  double before_s = 1.0;  ///< kept in memory in averaged stretches, see keep_policy.hpp
  double evidence_s = kEvidence_s;
  double max_rate_hz = 2000.0;  ///< of a stream; sizes the memory for before_s
  /// A crash or power cut costs at most sync_interval_s + lag_s + 0.1 s, and in averaged stretches before_s
  /// more. Counted in the run's own time: in virtual time give it minutes.
  double sync_interval_s = 1.0;
  /// How old a record may be when it arrives here and still be put in its place in the order of time.
  double lag_s = 0.25;
  std::uint64_t max_segment_bytes = std::uint64_t{256} << 20U;
  /// Less free space than this is DiskCondition::kLow, and stops a run while the disk still takes everything.
  std::uint64_t min_free_bytes = std::uint64_t{512} << 20U;
  /// A file of this size is kept allocated, and given up when the disk is full all the same: what the run
  /// records until it has stopped goes there.
  std::uint64_t reserve_bytes = std::uint64_t{32} << 20U;
  /// What the queues had dropped before this run.
  std::size_t dropped_before = 0;
  /// Free bytes where run_dir is; statvfs unless a test says otherwise.
  std::function<std::uint64_t(const std::filesystem::path&)> free_bytes;
};

/// Worse ones are larger. From kLow on the supervisor owes a program stop; until kLost nothing is lost.
enum class DiskCondition : std::uint8_t {
  kOk,
  kLow,        ///< less free than min_free_bytes
  kReserve,    ///< the disk was full; the reserve has been given up and is being written to
  kFailing,    ///< the disk takes nothing: everything since is held in memory
  kUnvouched,  ///< a sync failed: what the disk had taken since the one before may be gone. Stays for the run
  kLost,       ///< and the memory is used up
};
[[nodiscard]] const char* describe(DiskCondition condition) noexcept;

struct RecorderStatus {
  DiskCondition disk = DiskCondition::kOk;
  std::string error;  ///< the operating system's words, when there are any
  /// Why the run cannot be called done, whatever its plan says: records dropped, messages lost, a sync that failed, an
  /// end that is not on the disk. Empty when there is nothing.
  std::string fault;
  std::string catalogue_error;  ///< what on_session threw last; it is tried again
  std::uint64_t free_bytes = 0;
  std::uint64_t written_bytes = 0;
  std::uint64_t held_bytes = 0;
  std::uint64_t lost_messages = 0;
  std::uint64_t dropped_records = 0;  ///< by the queues, before they came here
  std::int64_t synced_until_ns = 0;   ///< what is stamped before is on the disk (averaged: less before_s)
  std::uint64_t frame_full = 0, frame_averaged = 0, frame_missing = 0;
  std::uint64_t pressure_full = 0, pressure_averaged = 0, pressure_missing = 0;
  std::int32_t session = -1;
  std::string segment;  ///< file name
};

/// A session began or ended in the recording: for the catalogue.
struct SessionChange {
  bool began = false;     ///< else ended
  bool complete = false;  ///< ended: the plan went on beyond it, or the run finished
  std::int32_t session = 0;
  std::int64_t mono_ns = 0;
  std::string segment;  ///< began: the file it begins in
};

/// Bytes that a plan's recording takes, for the check before a run starts: `full_s` seconds at full rate,
/// `averaged_s` as averages, at 1 kHz per stream.
[[nodiscard]] std::uint64_t estimate_bytes(double full_s, double averaged_s, double average_interval_s) noexcept;

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
  Recorder(RecorderOptions options, RunInfo info);
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

/// The run directory's lock, held for as long as a Recorder writes there, and free after any kind of death of
/// the process: how everybody tells a run that goes on from one that was interrupted.
class RunLock {
 public:
  explicit RunLock(const std::filesystem::path& run_dir);  ///< throws std::runtime_error when it is taken
  ~RunLock();
  RunLock(const RunLock&) = delete;
  RunLock& operator=(const RunLock&) = delete;
  [[nodiscard]] static bool is_held(const std::filesystem::path& run_dir);

 private:
  int fd_ = -1;
};

}  // namespace isorig::daemon
