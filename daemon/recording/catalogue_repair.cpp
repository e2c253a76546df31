#include <algorithm>
#include <exception>
#include <filesystem>
#include <string>
#include <vector>

#include "base/formatted.hpp"
#include "daemon/recording/catalogue.hpp"
#include "daemon/recording/recording_summary.hpp"
#include "daemon/recording/run_directory.hpp"
#include "daemon/recording/sqlite.hpp"
#include "messages/run_log.hpp"

/// What a catalogue does about runs whose writer was killed: the recording decides.
namespace isorig::daemon {
namespace {

using sqlite::Statement;
using sqlite::Transaction;

void note_sessions(sqlite3* db, const std::string& id, const RecordingSummary& recording) {
  for (const auto& [index, s] : recording.sessions) {
    Statement(db,
              "UPDATE sessions SET state = ?3, attempt = ?4, first_mono_ns = ?5, last_mono_ns = ?6, segment = ?7"
              " WHERE run = ?1 AND session = ?2 AND state != 'done'")
        .bind(id, index, std::string_view(s.complete ? "done" : "interrupted"), s.begin ? s.begin->attempt : 0,
              s.begin ? s.begin->mono_ns : 0, s.last_mono_ns(), s.segment)
        .run();
  }
  Statement(db, "UPDATE sessions SET state = 'interrupted' WHERE run = ?1 AND state = 'running'").bind(id).run();
}

/// A run's row id is its place among all runs, which are entered as they begin. One that is adopted may be older than
/// those that are here, such as a folder that was copied from another machine: it comes behind the last that began
/// before it, and those behind that one move on.
std::int64_t make_place(sqlite3* db, const std::string& started_utc) {
  Statement last(db, "SELECT coalesce(max(rowid), 0) FROM runs WHERE started_utc <= ?1");
  last.bind(started_utc).step();
  const auto place = last.integer(0) + 1;
  // In two steps, by way of negative numbers: SQLite looks for a number that is taken row by row.
  Statement(db, "UPDATE runs SET rowid = -rowid WHERE rowid >= ?1").bind(place).run();
  Statement(db, "UPDATE runs SET rowid = 1 - rowid WHERE rowid < 0").run();
  return place;
}

/// The protocol's own name, with which the plan's summary begins; its file's name is in no recording.
std::string protocol_of(const isorig_msgs::run_header_t& header) {
  const auto name = header.plan_summary.substr(0, header.plan_summary.find(": "));
  return (name.empty() ? "protocol" : name) + ".toml";
}

}  // namespace

void Catalogue::settle_interrupted() {
  std::vector<std::string> open;
  {
    Statement running(db_, "SELECT id FROM runs WHERE state = 'running'");
    while (running.step()) open.push_back(running.text(0));
  }
  for (const auto& id : open) {
    if (RunLock::is_held(root_ / id)) continue;
    std::string state = "interrupted", fault = kInterruptedFault;
    Transaction all(db_);
    try {
      const auto recording = summarize_recording(root_ / id);
      note_sessions(db_, id, recording);
      state = recording.run_state();
      fault = recording.run_fault();
    } catch (const sqlite::Error&) {
      throw;
    } catch (const std::exception& e) {
      fault += std::string("; ") + e.what();
      Statement(db_, "UPDATE sessions SET state = 'interrupted' WHERE run = ?1 AND state = 'running'").bind(id).run();
    }
    Statement(db_, "UPDATE runs SET state = ?2, fault = ?3 WHERE id = ?1").bind(id, state, fault).run();
    all.commit();
  }
}

void Catalogue::adopt_recordings() {
  std::vector<std::filesystem::directory_entry> entries{std::filesystem::directory_iterator(root_), {}};
  std::sort(entries.begin(), entries.end());  // runs of the same second: by their names
  for (const auto& entry : entries) {
    const auto id = entry.path().filename().string();
    if (entry.is_symlink() || !entry.is_directory()) continue;  // a link leads to what is another folder's
    {
      Statement known(db_, "SELECT 1 FROM runs WHERE id = ?1");
      if (known.bind(id).step()) continue;
    }
    if (messages::list_segments(entry.path()).empty()) continue;
    // Its writer enters it itself, a moment after it took the lock.
    if (RunLock::is_held(entry.path())) continue;
    try {
      const auto recording = summarize_recording(entry.path());
      const auto& h = recording.header;
      const auto state = recording.run_state(), fault = recording.run_fault();
      Transaction all(db_);
      Statement(db_, "INSERT INTO specimens VALUES (?1, ?2) ON CONFLICT DO NOTHING")
          .bind(h.specimen, h.rest_length_mm)
          .run();
      Statement(
          db_,
          "INSERT INTO runs (id, specimen, rig, protocol, plan, operator, started_utc, seed, virtual_time, attempts,"
          " state, fault, rowid) VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7, ?8, ?9, ?10, ?11, ?12, ?13) "
          "ON CONFLICT DO NOTHING")
          .bind(id, h.specimen, h.rig, protocol_of(h), h.plan_summary, recording.operator_name, recording.started_utc,
                h.seed, h.virtual_time != 0 ? 1 : 0, h.attempt, state, std::string_view(fault),
                make_place(db_, recording.started_utc))
          .run();
      for (const auto& s : h.sessions) {
        const std::string label = base::formatted("repetition %d, %g psi", s.repetition, s.pressure_psi);
        Statement(db_,
                  "INSERT INTO sessions (run, session, repetition, pressure_psi, label, state) "
                  "VALUES (?1, ?2, ?3, ?4, ?5, 'planned') ON CONFLICT DO NOTHING")
            .bind(id, s.session, s.repetition, s.pressure_psi, label)
            .run();
      }
      note_sessions(db_, id, recording);
      all.commit();
    } catch (const sqlite::Error&) {
      throw;
    } catch (const std::exception&) {  // no recording, or none that can be read: `isorig show DIR` says why
    }
  }
}

}  // namespace isorig::daemon
