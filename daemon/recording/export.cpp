#include "daemon/recording/export.hpp"

#include <toml++/toml.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <map>
#include <optional>
#include <sstream>
#include <stdexcept>
#include <tuple>

#include "daemon/recording/export_times.hpp"
#include "daemon/recording/session_marks.hpp"
#include "messages/recording.hpp"

namespace isorig::daemon {
namespace {

/// No row of a recording may follow the one before by less than 1 ns, in seconds as they are rounded.
constexpr std::int64_t kLeastStepNs = 2;

struct Row : TimedRow {
  double first = 0.0;   // position or pressure
  double second = 0.0;  // force
};

struct Session {
  bool complete = false;
  std::vector<Row> frame;
  std::vector<Row> pressure;
  std::size_t not_measured = 0;
  SessionMarks marks;
};

/// A first pass over the log: the exchanges of every attempt, by device.
struct Exchanges : messages::RunVisitor {
  void header(const isorig_msgs::run_header_t& h) override { attempt = h.attempt; }
  void exchanges(const isorig_msgs::exchange_batch_t& m) override {
    for (std::size_t i = 0; i < static_cast<std::size_t>(m.count); ++i) {
      auto& to = of[attempt][m.device[i] == isorig_msgs::exchange_batch_t::FRAME ? 0 : 1];
      to.push_back({m.host_send_ns[i], m.host_recv_ns[i], m.device_rx_us[i], m.device_tx_us[i]});
    }
  }
  std::int32_t attempt = 0;
  std::map<std::int32_t, std::array<std::vector<clock::Exchange>, 2>> of;
};

class Exporter : public messages::RunVisitor {
 public:
  Exporter(const std::filesystem::path& out, const ExportOptions& options, const Exchanges& exchanges,
           const messages::ReadReport& report)
      : out_(out), options_(options), exchanges_(exchanges), state_(report.state()), complaints_(report.complaints()) {}

  void header(const isorig_msgs::run_header_t& h) override {
    if (h.attempt != header_.attempt) write_before(std::numeric_limits<std::int32_t>::max());
    header_ = h;
  }
  void session(const isorig_msgs::session_mark_t& m) override {
    const auto index = m.session.session;
    if (m.kind == isorig_msgs::session_mark_t::BEGIN) {
      // A message of the session before may still come, none of the one before that.
      write_before(index - 1);
      sessions_[index];
    } else if (m.kind == isorig_msgs::session_mark_t::END) {
      auto& s = sessions_[index];
      s.complete = m.complete != 0;
      std::tie(s.marks.frame_missing, s.marks.pressure_missing) = missing_.since_last(m);
    }
  }
  void event(const isorig_msgs::event_t& m) override { sessions_[m.session].marks.events.push_back(m); }
  void frame(const isorig_msgs::frame_batch_t& m) override {
    auto& rows = sessions_[m.session].frame;
    for (std::size_t i = 0; i < static_cast<std::size_t>(m.count); ++i) {
      rows.push_back(sample(m, i, m.position_mm[i], m.force_N[i]));
    }
  }
  void frame_average(const isorig_msgs::frame_average_batch_t& m) override {
    auto& rows = sessions_[m.session].frame;
    for (std::size_t i = 0; i < static_cast<std::size_t>(m.count); ++i) {
      rows.push_back(middle(m, i, m.mean_position_mm[i], m.mean_force_N[i]));
    }
  }
  void pressure(const isorig_msgs::pressure_batch_t& m) override {
    auto& s = sessions_[m.session];
    for (std::size_t i = 0; i < static_cast<std::size_t>(m.count); ++i) {
      if (m.status[i] != 0) {
        ++s.not_measured;
        continue;
      }
      s.pressure.push_back(sample(m, i, m.pressure_psi[i], 0.0));
    }
  }
  void pressure_average(const isorig_msgs::pressure_average_batch_t& m) override {
    auto& s = sessions_[m.session];
    for (std::size_t i = 0; i < static_cast<std::size_t>(m.count); ++i) {
      s.not_measured += static_cast<std::size_t>(std::max(0, m.samples[i] - m.current[i]));
      if (m.current[i] > 0) s.pressure.push_back(middle(m, i, m.mean_pressure_psi[i], 0.0));
    }
  }

  std::vector<ExportedSession> finish() {
    write_before(std::numeric_limits<std::int32_t>::max());
    std::vector<ExportedSession> all;
    for (auto& [index, session] : written_) all.push_back(std::move(session));
    return all;
  }

 private:
  template <typename Message>
  static Row middle(const Message& m, std::size_t i, double first, double second) {
    Row r;
    r.mono_ns = m.first_mono_ns[i] + (m.last_mono_ns[i] - m.first_mono_ns[i]) / 2;
    r.bound_ns = static_cast<double>(m.bound_ns[i]);
    r.device_span_us = static_cast<double>(m.last_device_us[i] - m.first_device_us[i]);
    r.device_us = static_cast<double>(m.first_device_us[i]) + 0.5 * r.device_span_us;
    r.sequence_span = std::remainder(static_cast<double>(m.last_sequence[i] - m.first_sequence[i]), 4'294'967'296.0);
    r.sequence = static_cast<double>(m.first_sequence[i]) + 0.5 * r.sequence_span;
    r.first = first;
    r.second = second;
    return r;
  }

  template <typename Message>
  static Row sample(const Message& m, std::size_t i, double first, double second) {
    Row r;
    r.mono_ns = m.mono_ns + m.mono_offset_ns[i];
    r.bound_ns = static_cast<double>(m.bound_ns[i]);
    r.device_us = static_cast<double>(m.device_us + m.device_offset_us[i]);
    r.sequence = static_cast<double>(m.sequence + m.sequence_offset[i]);
    r.first = first;
    r.second = second;
    return r;
  }

  void write_before(std::int32_t index) {
    while (!sessions_.empty() && sessions_.begin()->first < index) {
      auto node = sessions_.extract(sessions_.begin());
      write(node.key(), node.mapped());
    }
  }

  [[nodiscard]] isorig_msgs::session_t session_of(std::int32_t index) const {
    for (const auto& s : header_.sessions) {
      if (s.session == index) return s;
    }
    throw std::runtime_error("the recording has samples of session " + std::to_string(index) +
                             ", which its header does not know");
  }

  Remapped remap(std::vector<Row>& rows, std::size_t device) {
    const auto found = exchanges_.of.find(header_.attempt);
    std::vector<TimedRow*> timed;
    timed.reserve(rows.size());
    for (auto& r : rows) timed.push_back(&r);
    if (found == exchanges_.of.end()) return {0.0, rows.size(), 0};
    return remap_rows(timed, found->second[device]);
  }

  /// By time, each row later than the one before: no row is left out for its time.
  static std::size_t sort(std::vector<Row>& rows) {
    std::stable_sort(rows.begin(), rows.end(), [](const Row& a, const Row& b) { return a.mono_ns < b.mono_ns; });
    std::size_t moved = 0;
    for (std::size_t i = 1; i < rows.size(); ++i) {
      if (rows[i].mono_ns >= rows[i - 1].mono_ns + kLeastStepNs) continue;
      rows[i].mono_ns = rows[i - 1].mono_ns + kLeastStepNs;
      ++moved;
    }
    return moved;
  }

  void write(std::int32_t index, Session& s) {
    if (s.frame.empty() || index < 0) return;  // nothing, or the way to the first session
    const auto earlier = written_.find(index);
    if (earlier != written_.end() && earlier->second.complete && !s.complete) return;

    ExportedSession e;
    e.session = index;
    e.attempt = header_.attempt;
    const auto planned = session_of(index);
    e.repetition = planned.repetition;
    e.pressure_psi = planned.pressure_psi;
    e.complete = s.complete;
    e.not_measured = s.not_measured;
    // Messages of one stream may be written out of order (a run-up behind an average): by time again.
    e.not_increasing = sort(s.frame) + sort(s.pressure);
    if (options_.remap) {
      const auto n = static_cast<double>(s.frame.size() + s.pressure.size());
      const auto frame = remap(s.frame, 0), pressure = remap(s.pressure, 1);
      const auto squares = [](const Remapped& r, std::size_t rows) {
        return r.moved_rms_us * r.moved_rms_us * static_cast<double>(rows);
      };
      e.remap_rms_us = std::sqrt((squares(frame, s.frame.size()) + squares(pressure, s.pressure.size())) / n);
      e.kept_online = frame.kept + pressure.kept;
      e.clock_breaks = frame.clock_breaks + pressure.clock_breaks;
      e.not_increasing += sort(s.frame) + sort(s.pressure);
    }

    std::int64_t start_ns = s.frame.front().mono_ns;
    if (!s.pressure.empty()) start_ns = std::min(start_ns, s.pressure.front().mono_ns);
    const auto seconds = [&](const Row& r) { return static_cast<double>(r.mono_ns - start_ns) * 1e-9; };
    messages::Recording recording;
    for (const auto& r : s.frame) {
      recording.frame.t_s.push_back(seconds(r));
      recording.frame.position_mm.push_back(r.first);
      recording.frame.force_N.push_back(r.second);
    }
    if (!s.pressure.empty()) {
      auto& p = recording.pressure.emplace();
      for (const auto& r : s.pressure) {
        p.t_s.push_back(seconds(r));
        p.pressure_psi.push_back(r.first);
      }
    }
    e.frame_rows = s.frame.size();
    e.pressure_rows = s.pressure.size();
    recording.metadata = metadata(planned, e, s.marks, start_ns);
    char name[64];
    std::snprintf(name, sizeof name, "rep-%d_%g-psi", e.repetition, e.pressure_psi);
    e.folder = out_ / name;
    // Two sessions of a plan may have the same repetition and pressure.
    for (const auto& [other, session] : written_) {
      if (other != index && session.folder == e.folder) e.folder += "_session-" + std::to_string(index);
    }
    messages::write_recording(e.folder, recording);
    written_[index] = std::move(e);
  }

  messages::RecordingMetadata metadata(const isorig_msgs::session_t& planned, const ExportedSession& e,
                                       const SessionMarks& marks, std::int64_t start_ns) const {
    messages::RecordingMetadata m;
    m.units_stated = true;
    m.specimen = header_.specimen;
    m.rest_length_mm = header_.rest_length_mm;
    if (std::isfinite(planned.pressurized_rest_length_mm)) {
      m.pressurized_rest_length_mm = planned.pressurized_rest_length_mm;
    }
    m.nominal_pressure_psi = planned.pressure_psi;
    toml::table versions;
    for (const auto& v : header_.versions) versions.insert_or_assign(v.name, v.text);
    toml::table further{{"run", options_.run_id},
                        {"rig", header_.rig},
                        {"session", e.session},
                        {"repetition", e.repetition},
                        {"attempt", e.attempt},
                        {"complete", e.complete},
                        {"start_mono_ns", start_ns},
                        {"start_unix_us", header_.epoch_unix_us + start_ns / 1000},
                        {"virtual_time", header_.virtual_time != 0},
                        {"seed", header_.seed},
                        {"plan", header_.plan_summary},
                        {"time_mapping", options_.remap ? "offline" : "online"},
                        {"average_interval_s", header_.average_interval_s},
                        {"versions", versions},
                        {"recording_state", messages::to_text(state_)}};
    toml::array complaints;
    for (const auto& line : complaints_) complaints.push_back(line);
    if (!complaints.empty()) further.insert_or_assign("recording_complaints", complaints);
    if (options_.remap) further.insert_or_assign("rows_with_online_time", static_cast<std::int64_t>(e.kept_online));
    if (!options_.outcome.empty()) further.insert_or_assign("outcome", options_.outcome);
    if (!options_.operator_name.empty()) further.insert_or_assign("operator", options_.operator_name);
    for (const auto& t : header_.texts) {
      if (t.name == "operator") further.insert_or_assign("operator", t.text);
    }
    for (const auto& t : header_.texts) {
      // What corrected these values; the raw ones are in the run.
      if (t.name == "calibration.toml") further.insert_or_assign("calibration", toml::parse(t.text));
    }
    marks.write(further, start_ns);
    std::ostringstream text;
    text << further << '\n';
    m.further_toml = text.str();
    return m;
  }

  std::filesystem::path out_;
  ExportOptions options_;
  const Exchanges& exchanges_;
  const messages::RecordingState state_;
  const std::vector<std::string> complaints_;
  isorig_msgs::run_header_t header_{};
  MissingCounts missing_;
  std::map<std::int32_t, Session> sessions_;
  std::map<std::int32_t, ExportedSession> written_;
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

}  // namespace

ExportReport export_run(const std::filesystem::path& run_dir, const std::filesystem::path& out,
                        const ExportOptions& options) {
  refuse_recordings_of_others(out, options.run_id);
  // First what state it is in, which each exported folder says.
  Exchanges exchanges;
  ExportReport report;
  report.read = messages::read_run(run_dir, exchanges);
  report.read.set_against(options.outcome, options.still_written);
  Exporter exporter(out, options, exchanges, report.read);
  (void)messages::read_run(run_dir, exporter);
  report.sessions = exporter.finish();
  return report;
}

}  // namespace isorig::daemon
