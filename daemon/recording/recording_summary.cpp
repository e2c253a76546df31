#include "daemon/recording/recording_summary.hpp"

#include <toml++/toml.h>

#include <exception>

#include "messages/run_log.hpp"

namespace isorig::daemon {
namespace {

struct Reader : messages::RunVisitor {
  explicit Reader(RecordingSummary& s) : to(s) {}
  void segment(const std::filesystem::path& path) override { file = path.filename().string(); }
  void header(const isorig_msgs::run_header_t& h) override {
    if (h.attempt != to.header.attempt) to.outcome.clear();
    to.header = h;
  }
  /// Core::end_run's. A countdown that was not completed takes nothing back from a run that was there before.
  void event(const isorig_msgs::event_t& e) override {
    const std::string_view code = e.code;
    if (code == "run.done" || code == "run.aborted" || code == "run.failed") {
      to.outcome = code.substr(4);
    } else if (code == "run.not_started") {
      to.outcome = to.header.attempt > 1 ? "interrupted" : "not started";
    } else {
      if (e.severity >= isorig_msgs::event_t::PROGRAM_STOP) fault = e.code + ": " + e.text;
      return;
    }
    to.outcome_text = to.outcome == "failed" && !fault.empty() ? fault : e.text;
  }
  void session(const isorig_msgs::session_mark_t& m) override {
    auto& s = to.sessions[m.session.session];
    if (m.kind == isorig_msgs::session_mark_t::BEGIN) {
      s.begin = m;
      s.end.reset();
      s.newest_mono_ns = 0;
      s.segment = file;
    } else if (m.kind == isorig_msgs::session_mark_t::END) {
      s.end = m;
      s.complete = s.complete || m.complete != 0;
    }
  }
  void frame(const isorig_msgs::frame_batch_t& m) override {
    if (m.count > 0) measured(m.session, m.mono_ns + m.mono_offset_ns.back());
  }
  void frame_average(const isorig_msgs::frame_average_batch_t& m) override {
    if (m.count > 0) measured(m.session, m.last_mono_ns.back());
  }
  void measured(std::int32_t session, std::int64_t mono_ns) {
    if (session < 0) return;
    auto& newest_ns = to.sessions[session].newest_mono_ns;
    newest_ns = std::max(newest_ns, mono_ns);
  }
  RecordingSummary& to;
  std::string file;
  std::string fault;  // the last that stopped the rig
};

}  // namespace

std::string RecordingSummary::run_state() const {
  if (report.state() == messages::RecordingState::kWhole && report.ended) return "done";
  return outcome.empty() || outcome == "done" ? "interrupted" : outcome;
}

std::string RecordingSummary::run_fault() const {
  const auto state = run_state();
  if (state == "done") return {};
  return state == "interrupted" ? kInterruptedFault : outcome_text;
}

RecordingSummary summarize_recording(const std::filesystem::path& run_dir) {
  RecordingSummary s;
  Reader reader(s);
  s.report = messages::read_run(run_dir, reader);
  if (!s.report.has_header) throw std::runtime_error(run_dir.string() + ": no header of a recording can be read");
  for (const auto& t : s.header.texts) {
    if (t.name == "operator") s.operator_name = t.text;
  }
  try {
    const auto run = toml::parse_file((run_dir / "run.toml").string());
    s.started_utc = run["started_utc"].value_or(std::string());
    if (s.operator_name.empty()) s.operator_name = run["operator"].value_or(std::string());
  } catch (const std::exception&) {  // for people; the recording does without
  }
  return s;
}

std::map<std::string, std::string> recorded_texts(const std::filesystem::path& run_dir) {
  std::map<std::string, std::string> texts;
  auto checksums = messages::Checksums::kAsFound;
  bool first = true;
  for (const auto& segment : messages::list_segments(run_dir)) {
    try {
      if (std::exchange(first, false)) checksums = messages::checksums_of_first(segment);
      // Of every one: a newer program may have gone on with the run.
      const auto header = messages::read_header(segment, checksums);
      checksums = messages::checksums_behind(segment, checksums);
      if (!header || !texts.empty()) continue;
      for (const auto& t : header->texts) texts[t.name] = t.text;
    } catch (const messages::UnknownLogVersion&) {
      throw;
    } catch (const std::exception&) {  // the next segment has the same
    }
  }
  return texts;
}

}  // namespace isorig::daemon
