#pragma once
#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <filesystem>
#include <functional>
#include <map>
#include <mutex>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "daemon/host/peer.hpp"

namespace isorig::daemon {

/// One command: who, what, and what came of it.
struct AuditEntry {
  std::int64_t unix_ms = 0;
  Peer peer;                     ///< who sent it, as the kernel says
  std::optional<Peer> for_whom;  ///< for whom, as the sender says: isorig-web speaks for the users of its page
  std::string for_name;
  std::string verb;
  std::string arguments;  ///< in short
  int status = 0;         ///< HTTP: 200 it was done, 403 no right, 409 refused, 400 wrong
  std::string outcome;    ///< the answer's first line
};

/// Every command that the daemon was given, a line of JSON each, in RUNS/audit/commands.jsonl: appended to and never
/// rewritten, over restarts. A file that is full gets a number, and the oldest of those goes when there are too many.
/// Written and synced by the thread in run(): add() waits for no disk, since abort does not.
class AuditLog {
 public:
  struct Limits {
    std::size_t file_bytes = std::size_t{4} << 20U;  ///< some 10,000 commands
    std::size_t files = 16;                          ///< with a number, besides the one that is written
    std::size_t queued = 4096;                       ///< more are counted, and the next line says how many are missing
    std::chrono::milliseconds repeats{1000};         ///< in which equal ones become one line
  };
  /// `trouble` hears, once for each cause, that lines cannot be written; they are tried again.
  AuditLog(const std::filesystem::path& runs_root, std::function<void(const std::string&)> trouble);
  AuditLog(const std::filesystem::path& runs_root, std::function<void(const std::string&)> trouble,
           const Limits& limits);
  ~AuditLog();
  AuditLog(const AuditLog&) = delete;
  AuditLog& operator=(const AuditLog&) = delete;

  /// False: it is one more of the command before. Refusals and stops that are equal but for their arguments and follow
  /// each other within a second are one line, with the newest of them and their `count`: whoever repeats himself does
  /// not drive everybody else's commands out of the files.
  bool add(AuditEntry entry);
  /// Writes until stop().
  void run();
  void stop();
  /// What is queued is on the disk when it returns, if the disk takes it. When nobody is in run().
  void finish();

 private:
  struct Queued {
    AuditEntry entry;
    std::uint64_t lost_before = 0;
    std::uint64_t count = 1;
  };
  bool write(const std::deque<Queued>& batch);
  bool write_lines(const std::deque<Queued>& batch);
  [[nodiscard]] std::string name_of(uid_t uid);
  void put(const AuditEntry& entry, std::uint64_t count);
  void put_repeats();
  bool open_file();
  bool rotate();
  void close_file();
  bool failed(const std::string& what, const std::string& why);
  bool failed(const std::string& what, int error);

  const std::filesystem::path folder_;
  const std::function<void(const std::string&)> trouble_;
  const Limits limits_;
  int folder_fd_ = -1, fd_ = -1;  // of the thread that writes, as the next four
  std::uint64_t bytes_ = 0, number_ = 0;
  std::string told_;
  std::map<uid_t, std::string> names_;
  std::mutex mutex_;
  std::condition_variable more_;
  std::deque<Queued> queue_;  // guarded by mutex_, as all below
  std::uint64_t lost_ = 0;
  std::optional<AuditEntry> last_;
  std::uint64_t repeats_ = 0;  ///< of the last one, that are in no line yet
  std::chrono::steady_clock::time_point last_put_;
  bool stopping_ = false;
};

[[nodiscard]] std::filesystem::path audit_folder_of(const std::filesystem::path& runs_root);

/// The newest `most` lines, oldest first. Lines that a power cut left in halves are not among them. Throws
/// std::runtime_error when there is no such log, or the caller may not read it. `on_progress` is told which part of the
/// files is read, 0 to 1.
[[nodiscard]] std::vector<nlohmann::json> read_audit(const std::filesystem::path& runs_root, std::size_t most,
                                                     const std::function<void(double)>& on_progress = {});

}  // namespace isorig::daemon
