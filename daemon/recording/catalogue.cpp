#include "daemon/recording/catalogue.hpp"

#include <chrono>
#include <stdexcept>
#include <thread>
#include <utility>

#include "daemon/recording/run_directory.hpp"
#include "daemon/recording/sqlite.hpp"

namespace isorig::daemon {
namespace {

using sqlite::execute;
using sqlite::Statement;
using sqlite::Transaction;

constexpr std::int64_t kSchemaVersion = 1;
constexpr int kPatienceMs = 5000;
constexpr const char* kFileName = "catalogue.sqlite";
constexpr const char* kSchema = R"(
CREATE TABLE specimens (
  name TEXT PRIMARY KEY,
  rest_length_mm REAL NOT NULL);
CREATE TABLE runs (
  id TEXT PRIMARY KEY,
  specimen TEXT NOT NULL REFERENCES specimens(name),
  rig TEXT NOT NULL,
  protocol TEXT NOT NULL,
  plan TEXT NOT NULL,
  operator TEXT NOT NULL,
  started_utc TEXT NOT NULL,
  seed INTEGER NOT NULL,
  virtual_time INTEGER NOT NULL,
  attempts INTEGER NOT NULL,
  state TEXT NOT NULL,
  fault TEXT NOT NULL);
CREATE TABLE sessions (
  run TEXT NOT NULL REFERENCES runs(id),
  session INTEGER NOT NULL,
  repetition INTEGER NOT NULL,
  pressure_psi REAL NOT NULL,
  label TEXT NOT NULL,
  state TEXT NOT NULL,
  attempt INTEGER NOT NULL DEFAULT 0,
  first_mono_ns INTEGER NOT NULL DEFAULT 0,
  last_mono_ns INTEGER NOT NULL DEFAULT 0,
  segment TEXT NOT NULL DEFAULT '',
  PRIMARY KEY (run, session));
)";

std::int64_t schema_version(sqlite3* db) {
  Statement version(db, "PRAGMA user_version");
  version.step();
  return version.integer(0);
}

/// Of connections that make a new file's log at once SQLite turns all but one away without asking its time-out, since
/// two that hold a read lock would wait for each other.
void use_write_ahead_log(sqlite3* db) {
  const auto deadline = std::chrono::steady_clock::now() + std::chrono::milliseconds(kPatienceMs);
  while (true) {
    try {
      return execute(db, "PRAGMA journal_mode = WAL");
    } catch (const sqlite::Error& e) {
      if (e.code != SQLITE_BUSY || std::chrono::steady_clock::now() > deadline) throw;
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  }
}

/// The recorder's thread does not wait for a catalogue that somebody else has locked: it comes again.
class NoPatience {
 public:
  explicit NoPatience(sqlite3* db) : db_(db) { sqlite3_busy_timeout(db_, 20); }
  ~NoPatience() { sqlite3_busy_timeout(db_, kPatienceMs); }
  NoPatience(const NoPatience&) = delete;
  NoPatience& operator=(const NoPatience&) = delete;

 private:
  sqlite3* db_;
};

}  // namespace

Catalogue::Catalogue(const std::filesystem::path& runs_root, Access access) : root_(runs_root) {
  const auto file = root_ / kFileName;
  if (access == Access::kReadWrite) {
    std::filesystem::create_directories(root_);
  } else if (!std::filesystem::exists(file)) {
    throw std::runtime_error("no runs in " + root_.string() + " (no catalogue.sqlite); name their place with --runs");
  }
  try {
    open(access);
    if (access == Access::kReadOnly) return;
    settle_interrupted();
    adopt_recordings();
    for (const auto& entry : std::filesystem::directory_iterator(root_)) {
      if (!entry.is_symlink()) remove_stale_reserve(entry.path());  // what lies elsewhere is somebody else's
    }
  } catch (...) {
    close();
    throw;
  }
}

void Catalogue::close() noexcept {
  sqlite3_close(std::exchange(db_, nullptr));
  std::error_code none;
  if (!copy_.empty()) std::filesystem::remove_all(copy_, none);
}

void Catalogue::open(Access access) {
  const auto file = root_ / kFileName;
  // Reading too: a write-ahead log is read through its shared memory file, which readers may have to create.
  const int flags = SQLITE_OPEN_READWRITE | (access == Access::kReadWrite ? SQLITE_OPEN_CREATE : 0);
  int opened = sqlite3_open_v2(file.c_str(), &db_, flags, nullptr);
  if (opened != SQLITE_OK && access == Access::kReadOnly) {
    sqlite3_close(db_);
    opened = sqlite3_open_v2(file.c_str(), &db_, SQLITE_OPEN_READONLY, nullptr);
  }
  if (opened != SQLITE_OK) sqlite::fail(db_, "cannot open " + file.string());
  sqlite3_busy_timeout(db_, kPatienceMs);
  std::int64_t found = 0;
  try {
    found = schema_version(db_);
  } catch (const sqlite::Error& e) {
    const bool not_allowed = e.code == SQLITE_READONLY || e.code == SQLITE_CANTOPEN || e.code == SQLITE_PERM;
    if (access != Access::kReadOnly || !not_allowed) throw;
    open_copy(e.what());
    found = schema_version(db_);
  }
  if (found > kSchemaVersion) {
    throw std::runtime_error(file.string() + " was written by a newer isorig (schema " + std::to_string(found) +
                             ", this one knows " + std::to_string(kSchemaVersion) + "); update this one");
  }
  if (access == Access::kReadOnly) {
    if (found > 0) return;
    throw std::runtime_error(file.string() +
                             " is empty, or another program's; move it aside: the next isorigd, or isorig run, makes "
                             "it anew from the recordings beside it");
  }
  use_write_ahead_log(db_);
  execute(db_, "PRAGMA synchronous = FULL");
  execute(db_, "PRAGMA foreign_keys = ON");
  Transaction all(db_);
  if (schema_version(db_) == 0) {  // asked again: somebody else may have been first
    execute(db_, kSchema);
    execute(db_, "PRAGMA user_version = 1");
  }
  all.commit();
}

/// Somebody removed the runs' folder, or put another in its place: what is written into the open file nobody will read.
void Catalogue::renew_if_gone() {
  int moved = 0;
  if (sqlite3_file_control(db_, "main", SQLITE_FCNTL_HAS_MOVED, &moved) == SQLITE_OK && moved == 0) return;
  sqlite3_close(std::exchange(db_, nullptr));
  std::filesystem::create_directories(root_);
  open(Access::kReadWrite);
  settle_interrupted();
  adopt_recordings();
}

/// A reader that may not write cannot make the shared memory file, without which SQLite does not read a write-ahead
/// log. Nobody has the catalogue open then, or the file would be there: a copy is as good.
void Catalogue::open_copy(const std::string& why) {
  sqlite3_close(std::exchange(db_, nullptr));
  auto pattern = (std::filesystem::temp_directory_path() / "isorig-catalogue-XXXXXX").string();
  if (::mkdtemp(pattern.data()) == nullptr) throw std::runtime_error(why);
  copy_ = pattern;
  try {
    std::filesystem::copy_file(root_ / kFileName, copy_ / kFileName);
    const auto log = std::string(kFileName) + "-wal";
    if (std::filesystem::exists(root_ / log)) std::filesystem::copy_file(root_ / log, copy_ / log);
  } catch (const std::filesystem::filesystem_error& e) {
    std::error_code none;
    std::filesystem::remove_all(copy_, none);
    throw std::runtime_error("you may not read " + e.path1().string() + "; ask for the right to, or to join its group");
  }
  for (const auto& file : std::filesystem::directory_iterator(copy_)) {
    std::filesystem::permissions(file, std::filesystem::perms::owner_read | std::filesystem::perms::owner_write);
  }
  if (sqlite3_open_v2((copy_ / kFileName).c_str(), &db_, SQLITE_OPEN_READWRITE, nullptr) != SQLITE_OK) {
    sqlite::fail(db_, "cannot open a copy of " + (root_ / kFileName).string());
  }
}

Catalogue::~Catalogue() {
  close();
}

std::string Catalogue::new_run_id(const std::string& wanted) const {
  const std::lock_guard hold(mutex_);
  for (int n = 1;; ++n) {
    auto id = n == 1 ? wanted : wanted + "-" + std::to_string(n);
    Statement known(db_, "SELECT 1 FROM runs WHERE id = ?1");
    // The directory may be there without an entry: a catalogue that was deleted, a start that failed.
    if (!known.bind(id).step() && !std::filesystem::exists(root_ / id)) return id;
  }
}

void Catalogue::open_run(const std::string& id, const RunInfo& info, const protocol::Plan& plan,
                         const std::string& protocol_name, const std::string& operator_name) {
  const std::lock_guard hold(mutex_);
  renew_if_gone();
  Transaction all(db_);
  Statement(db_,
            "INSERT INTO specimens VALUES (?1, ?2) ON CONFLICT DO UPDATE SET rest_length_mm = "
            "excluded.rest_length_mm")
      .bind(info.specimen, info.rest_length_mm)
      .run();
  Statement(db_,
            "INSERT INTO runs VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7, ?8, ?9, 1, 'running', '') "
            "ON CONFLICT DO UPDATE SET attempts = attempts + 1, state = 'running', fault = ''")
      .bind(id, info.specimen, info.rig, protocol_name, info.plan_summary, operator_name, info.started_utc, info.seed,
            info.virtual_time ? 1 : 0)
      .run();
  for (std::size_t i = 0; i < plan.sessions.size(); ++i) {
    const auto& s = plan.sessions[i];
    Statement(db_,
              "INSERT INTO sessions (run, session, repetition, pressure_psi, label, state) "
              "VALUES (?1, ?2, ?3, ?4, ?5, 'planned') ON CONFLICT DO NOTHING")
        .bind(id, i, s.repetition, s.pressure_psi, s.label)
        .run();
  }
  all.commit();
}

void Catalogue::on_session(const std::string& id, const SessionChange& change) {
  const std::lock_guard hold(mutex_);
  const NoPatience now(db_);
  if (change.began) {
    Statement(db_,
              "UPDATE sessions SET state = 'running', attempt = (SELECT attempts FROM runs WHERE id = ?1),"
              " first_mono_ns = ?3, last_mono_ns = ?3, segment = ?4 WHERE run = ?1 AND session = ?2")
        .bind(id, change.session, change.mono_ns, change.segment)
        .run();
  } else {
    Statement(db_, "UPDATE sessions SET state = ?3, last_mono_ns = ?4 WHERE run = ?1 AND session = ?2")
        .bind(id, change.session, std::string_view(change.complete ? "done" : "interrupted"), change.mono_ns)
        .run();
  }
}

void Catalogue::close_run(const std::string& id, const std::string& state, const std::string& fault) {
  const std::lock_guard hold(mutex_);
  const NoPatience now(db_);
  Transaction all(db_);
  Statement(db_, "UPDATE sessions SET state = 'interrupted' WHERE run = ?1 AND state = 'running'").bind(id).run();
  Statement(db_, "UPDATE runs SET state = ?2, fault = ?3 WHERE id = ?1").bind(id, state, fault).run();
  all.commit();
}

void Catalogue::amend(const std::string& id, const std::string& specimen, double rest_length_mm,
                      const std::string& operator_name) {
  const std::lock_guard hold(mutex_);
  Transaction all(db_);
  if (!specimen.empty()) {
    Statement(db_, "INSERT INTO specimens VALUES (?1, ?2) ON CONFLICT DO NOTHING").bind(specimen, rest_length_mm).run();
    Statement(db_, "UPDATE runs SET specimen = ?2 WHERE id = ?1").bind(id, specimen).run();
  }
  if (!operator_name.empty()) {
    Statement(db_, "UPDATE runs SET operator = ?2 WHERE id = ?1").bind(id, operator_name).run();
  }
  all.commit();
}

}  // namespace isorig::daemon
