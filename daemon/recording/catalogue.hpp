#pragma once
#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "daemon/recording/recorder_types.hpp"
#include "protocol/plan.hpp"

struct sqlite3;

namespace isorig::daemon {

/// One repetition at one pressure, as far as it has come.
struct SessionRow {
  std::int32_t session = 0;
  std::int32_t repetition = 0;
  double pressure_psi = 0.0;
  std::string label;
  std::string state;  ///< planned, running, done, interrupted
  std::int32_t attempt = 0;
  std::int64_t first_mono_ns = 0;
  std::int64_t last_mono_ns = 0;
  std::string segment;
};

struct RunRow {
  std::string id;
  std::string specimen;
  std::string rig;
  std::string protocol;
  std::string operator_name;
  std::string started_utc;
  std::string state;  ///< running, done, aborted, failed, refused, interrupted
  std::string fault;  ///< why it ended, unless done
  std::int32_t attempts = 0;
  std::int32_t sessions = 0;
  std::int32_t sessions_done = 0;
  double recorded_s = 0.0;  ///< from the first to the last sample of each session, of the attempt that counts
  std::filesystem::path directory;
};

/// What a further attempt at a run needs.
struct RunInputs {
  std::filesystem::path directory;
  std::string protocol_text;
  std::string protocol_name;
  std::string specimen_text;
  std::string specimen_name;
  std::uint32_t first_open_session = 0;  ///< the first that is not done; the number of sessions when all are
};

/// `runs_root`/catalogue.sqlite: which specimens, runs and repetitions there are, and how far each has come.
/// SQLite with a write-ahead log, so that `isorig runs` reads while a daemon writes. The recordings do not
/// depend on it.
///
/// A run that is noted as running while nobody holds its directory's lock was interrupted: whoever reads is
/// told so, and the next daemon writes it down.
class Catalogue {
 public:
  enum class Access { kReadOnly, kReadWrite };

  /// kReadWrite creates what is missing, settles runs whose writer was killed by what their recordings hold, enters
  /// recordings that are in no catalogue, and removes reserves that killed writers left. kReadOnly: throws when there
  /// is no catalogue; needs no right to write. Throws std::runtime_error with what to do.
  explicit Catalogue(const std::filesystem::path& runs_root, Access access = Access::kReadWrite);
  ~Catalogue();
  Catalogue(const Catalogue&) = delete;
  Catalogue& operator=(const Catalogue&) = delete;

  /// `wanted`, or with a number behind it when there is such a run already.
  [[nodiscard]] std::string new_run_id(const std::string& wanted) const;
  /// A new run, or a further attempt at one that is there. Its recorder holds the lock already. A catalogue whose file
  /// was removed, or replaced, is opened anew before.
  void open_run(const std::string& id, const RunInfo& info, const protocol::Plan& plan,
                const std::string& protocol_name, const std::string& operator_name);
  /// These two wait for nobody who has the catalogue locked, but throw: try again later.
  void on_session(const std::string& id, const SessionChange& change);
  /// `state`: done, aborted, failed, refused, interrupted.
  void close_run(const std::string& id, const std::string& state, const std::string& fault);

  /// Another specimen or operator from now on; empty: as it was.
  void amend(const std::string& id, const std::string& specimen, double rest_length_mm,
             const std::string& operator_name);

  /// Throws std::runtime_error when the run is unknown, still runs, or its inputs are gone.
  [[nodiscard]] RunInputs inputs_of(const std::string& id) const;
  /// Newest first: in the order in which they were entered, whatever date the clock gave them. One that was adopted
  /// from its folder has its place by its date.
  [[nodiscard]] std::vector<RunRow> runs() const;
  /// By its id, or by the beginning of one if only one begins so, or "latest". Nothing when none does.
  [[nodiscard]] std::optional<RunRow> find_run(const std::string& id_or_prefix) const;
  [[nodiscard]] std::vector<SessionRow> sessions_of(const std::string& id) const;

 private:
  [[nodiscard]] RunRow settle_state(RunRow row) const;
  [[nodiscard]] double recorded_by_killed(const RunRow& row) const;
  void open(Access access);
  void open_copy(const std::string& why);
  /// The database, and the copy if one was opened.
  void close() noexcept;
  void renew_if_gone();
  void settle_interrupted();
  void adopt_recordings();

  std::filesystem::path root_;
  std::filesystem::path copy_;  // of a reader that may not write where the catalogue is
  mutable std::mutex mutex_;
  mutable std::map<std::string, double> killed_recorded_s_;  ///< of runs whose writer was killed; guarded by it
  sqlite3* db_ = nullptr;
};

}  // namespace isorig::daemon
