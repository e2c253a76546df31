#pragma once
#include <cstdint>
#include <filesystem>
#include <isorig_msgs/run_header_t.hpp>
#include <string>

#include "daemon/recording/recorder_types.hpp"

/// What a run's directory holds beside its segments: run.toml, inputs/, the lock and the reserve.
namespace isorig::daemon {

[[nodiscard]] std::uint64_t free_bytes(const std::filesystem::path& path);

/// Why nothing could be recorded in this folder now, in words: a few bytes are written and synced, in a file that is
/// gone afterwards. Empty: they could be. A folder that is not there is made, as a start makes it.
[[nodiscard]] std::string why_not_writable(const std::filesystem::path& directory);

/// The entry itself (a new file's name) survives a power cut only after this.
void sync_directory(const std::filesystem::path& directory);

[[nodiscard]] isorig_msgs::run_header_t make_header(const RunInfo& info, const RecorderOptions& options,
                                                    std::int32_t attempt);

/// run.toml (identity, dates, versions) and inputs/NAME, each text whole, for people and for resume.
void write_inputs(const std::filesystem::path& run_dir, const RunInfo& info);

inline constexpr const char* kReserveName = ".reserve";
/// What a writer that was killed left allocated. Nothing happens in a run that is being written.
void remove_stale_reserve(const std::filesystem::path& run_dir) noexcept;

/// An allocated file that is given up when the disk is full.
class Reserve {
 public:
  Reserve(std::filesystem::path file, std::uint64_t bytes);
  ~Reserve();
  Reserve(const Reserve&) = delete;
  Reserve& operator=(const Reserve&) = delete;
  /// False when the disk has no room for it, or the file system cannot preallocate.
  bool allocate();
  /// True when it was there.
  bool release() noexcept;
  [[nodiscard]] bool held() const noexcept { return held_; }

 private:
  std::filesystem::path file_;
  std::uint64_t bytes_;
  bool held_ = false;
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
  /// Whether is_held() says anything: false where the directory is not there, or its lock may not be looked at.
  [[nodiscard]] static bool can_tell(const std::filesystem::path& run_dir);

 private:
  int fd_ = -1;
};

}  // namespace isorig::daemon
