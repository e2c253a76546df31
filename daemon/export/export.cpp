#include "daemon/export/export.hpp"

#include <toml++/toml.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <optional>
#include <set>
#include <stdexcept>
#include <thread>

#include "base/lock_file.hpp"
#include "daemon/export/metadata.hpp"
#include "daemon/export/rows.hpp"
#include "daemon/export/scan.hpp"
#include "daemon/export/streams.hpp"
#include "daemon/export/tables.hpp"
#include "protocol/compile.hpp"

namespace isorig::daemon {
namespace {

/// The plan's steps, from the protocol in the header; none where it is not there or of a language that has changed.
std::optional<std::vector<protocol::Step>> plan_of(const isorig_msgs::run_header_t& header) {
  for (const auto& t : header.texts) {
    if (t.name != "protocol.toml") continue;
    try {
      return protocol::compile(base::TomlDocument::parse_text(t.text, t.name)).steps;
    } catch (const base::ConfigError&) {
      return {};
    }
  }
  return {};
}

/// A session on its way into the file.
struct Open {
  const ScannedSession* scanned = nullptr;
  ExportedSession e;
  isorig_msgs::session_t planned{};
  std::array<std::optional<TableSchema>, kStreams> schema;
  std::array<std::optional<Table>, kStreams> block;
  std::array<std::optional<RowOrder>, kStreams> order;
  std::array<std::vector<Row>, kStreams> all;  ///< with remap
  std::unique_ptr<SessionWriter> writer;
  std::size_t taken = 0, due = 0;
  std::int64_t start_ns = 0, last_ns = std::numeric_limits<std::int64_t>::min();
};

/// The second pass.
class Exporter : public RowSource {
 public:
  Exporter(ExportWriter& writer, const ExportOptions& options, const Scan& scan, const Provenance& provenance,
           const std::vector<LiveSession>* live)
      : writer_(writer), options_(options), scan_(scan), from_(provenance), live_(live) {
    set_live(live);
    std::map<std::int32_t, isorig_msgs::session_t> planned;
    for (const auto& [attempt, header] : scan_.headers) {
      for (const auto& s : header.sessions) planned.insert_or_assign(s.session, s);
    }
    for (const auto& [index, attempts] : scan_.sessions) {
      if (const auto* s = scan_.chosen(index)) {
        planned.insert_or_assign(index, planned_of(s->attempt, index));
      } else if (const auto p = find_planned(attempts.back().attempt, index)) {
        planned.try_emplace(index, *p);
      }
    }
    std::vector<isorig_msgs::session_t> all;
    all.reserve(planned.size());
    for (const auto& [index, s] : planned) all.push_back(s);
    names_.emplace(all);
  }

  void header(const isorig_msgs::run_header_t& h) override { attempt_ = h.attempt; }

  /// Everything that was begun; then the sessions in their order.
  std::vector<ExportedSession> finish() {
    while (!open_.empty()) close(open_.begin()->first);
    std::vector<SessionRow> rows;
    std::vector<ExportedSession> all;
    for (auto& [index, done] : done_) {
      rows.push_back(done.second);
      all.push_back(std::move(done.first));
    }
    if (all.empty()) return all;
    writer_.close(describe_run(from_), session_table(rows), texts());
    for (auto& e : all) {
      if (options_.run_id.empty()) break;  // nothing would say whose the other one is
      for (const auto& name : names_->former(planned_of(e.attempt, e.session))) {
        if (writer_.drop(name, options_.run_id, e.session)) e.replaces.push_back(writer_.path_of(name));
      }
    }
    return all;
  }

  [[nodiscard]] std::vector<SkippedSession> skipped() const {
    std::vector<SkippedSession> out;
    for (const auto& [index, attempts] : scan_.sessions) {
      if (index < 0 || scan_.chosen(index) != nullptr) continue;
      SkippedSession s;
      s.session = index;
      for (const auto& a : attempts) {
        s.pressure_rows = std::max(s.pressure_rows, a.stream[static_cast<std::size_t>(Stream::kPressure)].rows);
      }
      if (s.pressure_rows == 0) continue;
      s.name = names_->knows(index) ? names_->of(index) : "session-" + std::to_string(index);
      s.why = s.name + " is left out: it has " + std::to_string(s.pressure_rows) +
              " rows of pressure and none of the frame, without which nothing can be said of the specimen";
      out.push_back(std::move(s));
    }
    return out;
  }

 protected:
  void row(Stream stream, std::int32_t session, const Row& row) override {
    auto* o = opened(session);
    if (o == nullptr) return;
    const auto i = static_cast<std::size_t>(stream);
    ++o->taken;
    if (options_.remap) {
      o->all[i].push_back(row);
    } else {
      o->order[i]->add(row);
      if (o->order[i]->due()) drain(*o, stream, false);
    }
    if (o->taken == o->due) close(session);
  }

 private:
  [[nodiscard]] std::vector<std::pair<std::string, std::string>> texts() const {
    std::vector<std::pair<std::string, std::string>> out;
    for (const auto& t : from_.header->texts) out.emplace_back(t.name, t.text);
    return out;
  }

  [[nodiscard]] Provenance provenance_of(std::int32_t attempt) const {
    auto from = from_;
    if (const auto header = scan_.headers.find(attempt); header != scan_.headers.end()) from.header = &header->second;
    return from;
  }

  [[nodiscard]] std::optional<isorig_msgs::session_t> find_planned(std::int32_t attempt, std::int32_t index) const {
    if (index < 0) return {};
    if (live_ != nullptr) {
      // A mark of a recording among the messages of the live channels may name any session.
      if (static_cast<std::size_t>(index) >= live_->size()) return {};
      const auto& live = (*live_)[static_cast<std::size_t>(index)];
      isorig_msgs::session_t s{};
      s.session = index;
      s.repetition = live.repetition;
      s.pressure_psi = live.pressure_psi;
      s.pressurized_rest_length_mm = std::numeric_limits<double>::quiet_NaN();
      return s;
    }
    const auto header = scan_.headers.find(attempt);
    if (header != scan_.headers.end()) {
      for (const auto& s : header->second.sessions) {
        if (s.session == index) return s;
      }
    }
    return {};
  }

  [[nodiscard]] isorig_msgs::session_t planned_of(std::int32_t attempt, std::int32_t index) const {
    if (const auto found = find_planned(attempt, index)) return *found;
    throw std::runtime_error("the recording has samples of session " + std::to_string(index) +
                             ", which its header does not know");
  }

  Open* opened(std::int32_t session) {
    if (const auto found = open_.find(session); found != open_.end()) return &found->second;
    const auto* scanned = scan_.chosen(session);
    if (scanned == nullptr || scanned->attempt != attempt_ || done_.contains(session)) return nullptr;
    auto& o = open_[session];
    o.scanned = scanned;
    o.planned = planned_of(attempt_, session);
    o.e.session = session;
    o.e.attempt = attempt_;
    o.e.repetition = o.planned.repetition;
    o.e.pressure_psi = o.planned.pressure_psi;
    o.e.complete = scanned->complete;
    o.e.not_measured = scanned->not_measured;
    o.e.name = names_->of(session);
    o.start_ns = std::numeric_limits<std::int64_t>::max();
    auto origin = origin_of(*provenance_of(attempt_).header, scan_);
    origin.remapped = options_.remap;
    SessionHead head;
    head.name = o.e.name;
    for (std::size_t i = 0; i < kStreams; ++i) {
      const auto& extent = scanned->stream[i];
      o.due += extent.rows;
      if (i < 2) o.start_ns = std::min(o.start_ns, extent.first_ns);
      o.schema[i] = schema_of(static_cast<Stream>(i), origin);
      o.block[i].emplace(*o.schema[i]);
      o.order[i].emplace(extent.lateness_ns);
      head.schema[i] = *o.schema[i];
      head.rows[i] = extent.rows;
    }
    o.e.frame_rows = head.rows[0];
    o.e.pressure_rows = head.rows[1];
    o.writer = writer_.open(head);
    return &o;
  }

  void put(Open& o, Stream stream, const Row& row) {
    auto& block = *o.block[static_cast<std::size_t>(stream)];
    if (stream != Stream::kSetpoints) o.last_ns = std::max(o.last_ns, row.mono_ns);
    fill(block, stream, row, o.start_ns);
    if (block.rows() < kBlockRows) return;
    o.writer->rows(stream, block);
    block.clear();
  }

  void drain(Open& o, Stream stream, bool all) {
    auto& order = *o.order[static_cast<std::size_t>(stream)];
    order.take(all, [&](const Row& r) { put(o, stream, r); });
  }

  Remapped remap(std::vector<Row>& rows, std::size_t device) const {
    const auto found = scan_.exchanges_of.find(attempt_);
    if (found == scan_.exchanges_of.end()) return {0.0, rows.size(), 0};
    std::vector<TimedRow*> timed;
    timed.reserve(rows.size());
    for (auto& r : rows) timed.push_back(&r);
    return remap_rows(timed, found->second[device]);
  }

  /// All rows of the session are there: in the order of their stamps, mapped, and in that of the new ones.
  void remap(Open& o) {
    const auto ordered = order_rows(o.all[0]) + order_rows(o.all[1]);
    const auto frame = remap(o.all[0], 0), pressure = remap(o.all[1], 1);
    const auto squares = [](const Remapped& r, std::size_t rows) {
      return r.moved_rms_us * r.moved_rms_us * static_cast<double>(rows);
    };
    const auto n = static_cast<double>(o.all[0].size() + o.all[1].size());
    o.e.remap_rms_us = std::sqrt((squares(frame, o.all[0].size()) + squares(pressure, o.all[1].size())) / n);
    o.e.kept_online = frame.kept + pressure.kept;
    o.e.clock_breaks = frame.clock_breaks + pressure.clock_breaks;
    o.e.not_increasing = ordered + order_rows(o.all[0]) + order_rows(o.all[1]);
    (void)order_rows(o.all[2]);
    o.start_ns = o.all[0].front().mono_ns;
    if (!o.all[1].empty()) o.start_ns = std::min(o.start_ns, o.all[1].front().mono_ns);
    for (std::size_t i = 0; i < kStreams; ++i) {
      for (const auto& r : o.all[i]) put(o, static_cast<Stream>(i), r);
      o.all[i] = {};
    }
  }

  void close(std::int32_t session) {
    auto node = open_.extract(session);
    auto& o = node.mapped();
    if (options_.remap) {
      remap(o);
    } else {
      for (std::size_t i = 0; i < kStreams; ++i) drain(o, static_cast<Stream>(i), true);
      o.e.not_increasing = o.order[0]->moved() + o.order[1]->moved();
    }
    for (std::size_t i = 0; i < kStreams; ++i) o.writer->rows(static_cast<Stream>(i), *o.block[i]);
    const auto from = provenance_of(o.e.attempt);
    constexpr double kUnknownLength = std::numeric_limits<double>::quiet_NaN();
    SessionTail tail;
    describe_session(tail, from, o.planned, o.e, o.scanned->marks, o.start_ns);
    SessionRow row{o.e.name,       session,          o.e.attempt,
                   o.e.repetition, o.e.pressure_psi, tail.metadata.pressurized_rest_length_mm.value_or(kUnknownLength),
                   o.e.complete,   o.start_ns,       o.last_ns};
    if (from.header->epoch_unix_us != 0) row.start_unix_us = from.header->epoch_unix_us + o.start_ns / 1000;
    row.frame_rows = o.e.frame_rows;
    row.pressure_rows = o.e.pressure_rows;
    const auto plan = steps_.find(o.e.attempt) != steps_.end()
                          ? steps_.find(o.e.attempt)
                          : steps_.emplace(o.e.attempt, plan_of(*from.header)).first;
    TableInput in{o.scanned, o.start_ns, o.scanned->end_ns != 0 ? o.scanned->end_ns : o.last_ns};
    if (plan->second) in.plan = &*plan->second;
    in.length_mm = tail.metadata.reference_length_mm();
    tail.tables.push_back(session_table({row}));
    for (auto& table : tables_of(in)) tail.tables.push_back(std::move(table));
    o.writer->finish(tail);
    o.e.folder = writer_.path_of(o.e.name);
    done_.emplace(session, std::pair{std::move(o.e), std::move(row)});
  }

  ExportWriter& writer_;
  const ExportOptions& options_;
  const Scan& scan_;
  const Provenance& from_;
  const std::vector<LiveSession>* live_;
  std::int32_t attempt_ = 0;
  std::optional<SessionNames> names_;
  std::map<std::int32_t, std::optional<std::vector<protocol::Step>>> steps_;
  std::map<std::int32_t, Open> open_;
  std::map<std::int32_t, std::pair<ExportedSession, SessionRow>> done_;
};

/// The run that a recording folder says it is of; empty when it does not say, as in one that was made by hand.
std::string run_of(const std::filesystem::path& recording) {
  try {
    return toml::parse_file((recording / "recording.toml").string())["run"].value_or(std::string());
  } catch (const toml::parse_error&) {
    return {};
  }
}

/// Folders of two runs have the same names: those of the other run would be replaced, or stay among this one's and
/// be analysed with them.
void refuse_recordings_of_others(const std::filesystem::path& out, const std::string& run_id) {
  std::error_code none;
  for (const auto& entry : std::filesystem::directory_iterator(out, none)) {
    if (!std::filesystem::exists(entry.path() / "recording.toml", none)) continue;
    const auto run = run_of(entry.path());
    if (run == run_id) continue;
    throw std::runtime_error(out.string() + " already holds " + entry.path().filename().string() + ", " +
                             (run.empty() ? std::string("which is of no run") : "of run " + run) +
                             "; export into a folder of this run's own");
  }
}

/// A session that is being written to a MAT file has a file open for each of its 37 columns: eight are 296 of the 1024
/// that a process may have open unless it is told otherwise.
constexpr unsigned kMostMatThreads = 8;

std::unique_ptr<ExportWriter> make_writer(const std::filesystem::path& out, const ExportOptions& options) {
  // Names of sessions are those of every run: the run's own keeps two runs in one folder apart.
  const std::string run = options.run_id.empty() ? "run" : options.run_id;
  switch (options.format) {
    case ExportFormat::kHdf5:
      return make_background_writer(make_hdf5_writer(out, run), 1);
    case ExportFormat::kMat:
      return make_background_writer(make_mat_writer(out / run),
                                    std::clamp(std::thread::hardware_concurrency(), 1U, kMostMatThreads));
    case ExportFormat::kCsv:
      break;
  }
  return make_background_writer(make_csv_writer(out, options.lean), 1);
}

}  // namespace

ExportReport export_run(const std::filesystem::path& run_dir, const std::filesystem::path& out,
                        const ExportOptions& options) {
  // Before the folder is looked at: another export may just have finished its recordings there.
  const base::FolderLock alone(out);
  // The names of the other formats have the run in them.
  if (options.format == ExportFormat::kCsv) refuse_recordings_of_others(out, options.run_id);
  // The log is read twice, one of the live channels three times.
  const auto part = [&](double from, double to) -> std::function<void(double)> {
    if (!options.on_progress) return {};
    return [&options, from, to](double fraction) { options.on_progress(from + (to - from) * fraction); };
  };
  auto scan = std::make_unique<Scan>();
  ExportReport report;
  report.read = messages::read_run(run_dir, *scan, part(0.0, 0.5));
  report.read.set_against(options.outcome, options.still_written);
  std::vector<LiveSession> live;
  const bool of_live_channels = scan->headers.empty();
  if (of_live_channels) {
    if (options.format == ExportFormat::kCsv && options.specimen.empty()) {
      throw std::runtime_error(run_dir.string() +
                               ": a log of the live channels does not say what it is of, and a recording has to: give "
                               "--specimen, and --rest-length-mm for strains, or another --format");
    }
    live = scan->live_sessions();
    scan = std::make_unique<Scan>(live);
    (void)messages::read_run(run_dir, *scan, part(0.5, 0.75));
    for (std::size_t i = 0; i < live.size(); ++i) scan->set_ended(static_cast<std::int32_t>(i), live[i]);
  }
  // The last attempt's says how the run was gone on with.
  isorig_msgs::run_header_t header{};
  if (!of_live_channels) header = scan->headers.rbegin()->second;
  if (header.specimen.empty()) header.specimen = options.specimen;
  if (of_live_channels) header.rest_length_mm = options.rest_length_mm;
  const Provenance provenance{&options, &header, report.read.state(), report.read.complaints()};
  const auto writer = make_writer(out, options);
  Exporter exporter(*writer, options, *scan, provenance, of_live_channels ? &live : nullptr);
  (void)messages::read_run(run_dir, exporter, part(of_live_channels ? 0.75 : 0.5, 1.0));
  report.sessions = exporter.finish();
  report.skipped = exporter.skipped();
  return report;
}

}  // namespace isorig::daemon
