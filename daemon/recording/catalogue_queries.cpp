#include <algorithm>
#include <filesystem>
#include <stdexcept>
#include <string>
#include <utility>

#include "base/beneath.hpp"
#include "daemon/recording/catalogue.hpp"
#include "daemon/recording/recording_summary.hpp"
#include "daemon/recording/run_directory.hpp"
#include "daemon/recording/sqlite.hpp"

/// What a catalogue is asked.
namespace isorig::daemon {
namespace {

using sqlite::Statement;

constexpr const char* kSelectRuns =
    "SELECT id, specimen, rig, protocol, operator, started_utc, state, fault, attempts,"
    " (SELECT count(*) FROM sessions WHERE run = id),"
    " (SELECT count(*) FROM sessions WHERE run = id AND sessions.state = 'done'),"
    " (SELECT coalesce(sum(max(last_mono_ns - first_mono_ns, 0)), 0) FROM sessions WHERE run = id) FROM runs";

RunRow read_run_row(const Statement& s, const std::filesystem::path& root) {
  RunRow r;
  r.id = s.text(0);
  r.specimen = s.text(1);
  r.rig = s.text(2);
  r.protocol = s.text(3);
  r.operator_name = s.text(4);
  r.started_utc = s.text(5);
  r.state = s.text(6);
  r.fault = s.text(7);
  r.attempts = static_cast<std::int32_t>(s.integer(8));
  r.sessions = static_cast<std::int32_t>(s.integer(9));
  r.sessions_done = static_cast<std::int32_t>(s.integer(10));
  r.recorded_s = static_cast<double>(s.integer(11)) * 1e-9;
  r.directory = root / r.id;
  return r;
}

std::string read_input(const std::filesystem::path& run, const char* name) {
  try {
    return base::read_text_beneath(run, std::filesystem::path("inputs") / name);
  } catch (const base::FileError& e) {
    throw std::runtime_error(std::string(e.what()) + " (the run was started with it)");
  }
}

}  // namespace

/// Nobody has written down how far its last session came. The whole recording is read for it, once: its end does not
/// move any more.
double Catalogue::recorded_by_killed(const RunRow& row) const {
  const auto key = row.id + " " + std::to_string(row.attempts);
  {
    const std::lock_guard hold(mutex_);
    if (const auto known = killed_recorded_s_.find(key); known != killed_recorded_s_.end()) return known->second;
  }
  double recorded_s = 0.0;
  try {
    for (const auto& [index, s] : summarize_recording(row.directory).sessions)
      if (s.begin) recorded_s += 1e-9 * static_cast<double>(s.last_mono_ns() - s.begin->mono_ns);
  } catch (const std::exception&) {  // nothing that can be read: `isorig show` says why
  }
  const std::lock_guard hold(mutex_);
  killed_recorded_s_[key] = recorded_s;
  return recorded_s;
}

RunRow Catalogue::settle_state(RunRow row) const {
  if (row.state == "running" && !RunLock::can_tell(row.directory)) {
    row.state = "unknown";
    row.fault = "its folder is not there, or may not be read: whether it goes on is not known here (isorig status)";
  } else if (row.state == "running" && !RunLock::is_held(row.directory)) {
    row.state = "interrupted";
    row.fault = kInterruptedFault;
    row.recorded_s = std::max(row.recorded_s, recorded_by_killed(row));
  }
  return row;
}

RunInputs Catalogue::inputs_of(const std::string& id) const {
  const auto run = find_run(id);
  if (!run || run->id != id) {
    throw std::runtime_error("there is no run \"" + id + "\" in " + root_.string() + "; `isorig runs` lists them");
  }
  if (run->state == "running") throw std::runtime_error("run " + id + " is still running");
  RunInputs in;
  in.directory = run->directory;
  in.protocol_name = run->protocol;
  in.specimen_name = run->specimen;
  // The recording's own copies have a checksum; a power cut may have emptied the files beside it.
  const auto texts = recorded_texts(run->directory);
  const auto text = [&](const char* name) {
    const auto found = texts.find(name);
    return found != texts.end() ? found->second : read_input(run->directory, name);
  };
  in.protocol_text = text("protocol.toml");
  in.specimen_text = text("specimen.toml");
  const auto sessions = sessions_of(id);
  const auto open = std::find_if(sessions.begin(), sessions.end(), [](const auto& s) { return s.state != "done"; });
  in.first_open_session = static_cast<std::uint32_t>(open - sessions.begin());
  return in;
}

std::vector<RunRow> Catalogue::runs() const {
  std::vector<RunRow> rows;
  {
    const std::lock_guard hold(mutex_);
    Statement all(db_, (std::string(kSelectRuns) + " ORDER BY runs.rowid DESC").c_str());
    while (all.step()) rows.push_back(read_run_row(all, root_));
  }
  for (auto& row : rows) row = settle_state(std::move(row));
  return rows;
}

std::optional<RunRow> Catalogue::find_run(const std::string& id_or_prefix) const {
  if (id_or_prefix.empty()) return std::nullopt;  // the beginning of every name is nobody's
  auto rows = runs();
  // A whole name first: "run-2" begins with "run", and is the newer one.
  for (auto& row : rows) {
    if (row.id == id_or_prefix || id_or_prefix == "latest") return std::move(row);
  }
  std::optional<RunRow> found;
  for (auto& row : rows) {
    if (!row.id.starts_with(id_or_prefix)) continue;
    if (found) {
      throw std::runtime_error("\"" + id_or_prefix + "\" begins the names of several runs, among them " + found->id +
                               " and " + row.id);
    }
    found = std::move(row);
  }
  return found;
}

std::vector<SessionRow> Catalogue::sessions_of(const std::string& id) const {
  const std::lock_guard hold(mutex_);
  const bool is_over = RunLock::can_tell(root_ / id) && !RunLock::is_held(root_ / id);
  std::vector<SessionRow> rows;
  Statement all(db_,
                "SELECT session, repetition, pressure_psi, label, state, attempt, first_mono_ns, last_mono_ns, segment "
                "FROM sessions WHERE run = ?1 ORDER BY session");
  all.bind(id);
  while (all.step()) {
    SessionRow r;
    r.session = static_cast<std::int32_t>(all.integer(0));
    r.repetition = static_cast<std::int32_t>(all.integer(1));
    r.pressure_psi = all.real(2);
    r.label = all.text(3);
    r.state = all.text(4);
    r.attempt = static_cast<std::int32_t>(all.integer(5));
    r.first_mono_ns = all.integer(6);
    r.last_mono_ns = all.integer(7);
    r.segment = all.text(8);
    if (r.state == "running" && is_over) r.state = "interrupted";
    rows.push_back(std::move(r));
  }
  return rows;
}

}  // namespace isorig::daemon
