#pragma once
#include <cstdint>
#include <filesystem>
#include <functional>
#include <limits>
#include <string>
#include <utility>
#include <vector>

#include "daemon/core/streams.hpp"

/// What a recorder is told of its run, and what it says of itself.
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
  std::vector<std::string> step_words;  ///< what each step does, for the story of a trip; may be empty
  std::int32_t first_session = 0;       ///< with which this attempt begins: nothing is recorded into earlier ones
  /// For run.toml alone.
  std::string run_id;
  std::string started_utc;
};

/// The session that a record of `step` belongs to. What is stamped outside the run (the moment before its start, the
/// moment after its end) belongs to the session that is next to it: `present`, the last that was written.
[[nodiscard]] std::int32_t session_of(const RunInfo& info, std::uint32_t step, std::int32_t present);

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

/// Throws std::invalid_argument with the rule that they break.
const RecorderOptions& checked(const RecorderOptions& options);

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

}  // namespace isorig::daemon
