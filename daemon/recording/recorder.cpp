#include "daemon/recording/recorder.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <mutex>
#include <stdexcept>
#include <utility>

#include "base/formatted.hpp"
#include "daemon/core/fixed_text.hpp"
#include "daemon/recording/batches.hpp"
#include "daemon/recording/keep_policy.hpp"
#include "daemon/recording/peeked_queue.hpp"
#include "daemon/recording/segmented_log.hpp"
#include "daemon/recording/staged_messages.hpp"
#include "daemon/recording/trip_evidence.hpp"

namespace isorig::daemon {
namespace {

using messages::Channel;

constexpr std::int64_t kSliceNs = 100'000'000;
// Ten minutes are more than a queue holds; a stamp beyond is nonsense and is taken as it comes.
constexpr int kMostLastSlices = 6'000;
constexpr std::int64_t kDropReportNs = 1'000'000'000;
constexpr std::int64_t kNever = std::numeric_limits<std::int64_t>::max();

std::int64_t to_ns(double s) {
  return static_cast<std::int64_t>(std::llround(s * 1e9));
}

}  // namespace

struct Recorder::Impl {
  /// Where a stream's keep policy puts what it has decided.
  template <typename Full, typename Averages>
  struct Sink {
    explicit Sink(Impl& i) : impl(i) {}
    Impl& impl;
    Full full_batch;
    Averages average_batch;
    std::int32_t session = -1;

    [[nodiscard]] std::int32_t session_of(std::uint32_t step) const { return impl.session_of(step, session); }
    template <typename Record>
    void seen(const Record& r) {
      impl.evidence.take(r);
    }
    template <typename Record>
    void full(const Record& r) {
      append(full_batch, r, session, impl);
    }
    template <typename Average>
    void average(const Average& a) {
      append(average_batch, a, session, impl);
    }
    void flush_batches() {
      flush(average_batch, impl);
      flush(full_batch, impl);
    }
  };
  using FrameSink = Sink<FrameBatch, FrameAverageBatch>;
  using PressureSink = Sink<PressureBatch, PressureAverageBatch>;

  Impl(const RecorderOptions& o, RunInfo i)
      : options(checked(o)),
        info(std::move(i)),
        log(options, info, [this](isorig_msgs::session_mark_t& m) { fill(m); }),
        evidence(options.run_dir, info.step_words, info.virtual_time ? 0 : info.epoch_unix_us),
        frame_sink(*this),
        pressure_sink(*this),
        frame(keep_options(options), frame_sink),
        pressure(keep_options(options), pressure_sink),
        slice_end_ns((info.start_mono_ns / kSliceNs + 1) * kSliceNs),
        next_sync_ns(info.start_mono_ns + to_ns(options.sync_interval_s)),
        synced_until_ns(info.start_mono_ns),
        dropped_before(options.dropped_before) {
    if (!std::is_sorted(info.sessions.begin(), info.sessions.end(),
                        [](const auto& a, const auto& b) { return a.first_step < b.first_step; })) {
      throw std::invalid_argument("recorder: sessions must be in the order of their first steps");
    }
  }

  static KeepOptions keep_options(const RecorderOptions& o) {
    return {to_ns(o.average_interval_s), to_ns(o.before_s), static_cast<std::size_t>(o.before_s * o.max_rate_hz) + 64};
  }

  [[nodiscard]] std::int32_t session_of(std::uint32_t step, std::int32_t present) const {
    return daemon::session_of(info, step, present);
  }

  [[nodiscard]] std::int32_t present_session() const { return std::max(frame_sink.session, pressure_sink.session); }

  void fill(isorig_msgs::session_mark_t& m) const {
    m.frame_full = static_cast<std::int64_t>(frame.counts().full);
    m.frame_averaged = static_cast<std::int64_t>(frame.counts().averaged);
    m.frame_missing = static_cast<std::int64_t>(frame.counts().missing);
    m.pressure_full = static_cast<std::int64_t>(pressure.counts().full);
    m.pressure_averaged = static_cast<std::int64_t>(pressure.counts().averaged);
    m.pressure_missing = static_cast<std::int64_t>(pressure.counts().missing);
    m.dropped_records = static_cast<std::int64_t>(dropped);
  }

  /// The batches' sink.
  template <typename Message>
  void write(Channel channel, std::int32_t session, Message& message) {
    staged.write(channel, session, message);
  }

  void write_event(const EventRecord& r) {
    auto message = to_message(r, session_of(r.step, present_session()));
    write(Channel::kEvent, message.session, message);
  }

  void take_slice(Streams& streams, std::int64_t end) {
    events.until(streams.events, end, [&](const EventRecord& r) {
      if (r.severity >= Severity::kProgramStop) {
        // Before the samples of this slice are looked at: the run-up to the stop goes out in full.
        frame.keep_full_until(r.mono_ns + to_ns(options.evidence_s));
        pressure.keep_full_until(r.mono_ns + to_ns(options.evidence_s));
      }
      write_event(r);
      evidence.take(r);
    });
    frame.take(streams.frame, end);
    pressure.take(streams.pressure, end);
    control.until(streams.control, end, [&](const ControlRecord& r) { take_control(r); });
    exchanges.until(streams.exchanges, end,
                    [&](const ExchangeRecord& r) { append(exchange_batch, r, present_session(), *this); });
    sync_checks.until(streams.sync, end, [&](const SyncRecord& r) {
      auto message = to_message(r, present_session());
      write(Channel::kSync, message.session, message);
    });
  }

  /// In slow parts the controller's samples are thinned to the averages' rate; their worst figures are kept.
  void take_control(ControlRecord r) {
    evidence.take(r);
    worst_wakeup_ns = std::max(worst_wakeup_ns, r.worst_wakeup_ns);
    worst_run_ns = std::max(worst_run_ns, r.worst_run_ns);
    if (!frame.in_full() && r.mono_ns < next_control_ns && r.state == last_state && r.step == last_step) return;
    next_control_ns = r.mono_ns + to_ns(options.average_interval_s);
    last_state = r.state;
    last_step = r.step;
    r.worst_wakeup_ns = std::exchange(worst_wakeup_ns, 0U);
    r.worst_run_ns = std::exchange(worst_run_ns, 0U);
    append(control_batch, r, session_of(r.step, present_session()), *this);
  }

  /// At once when it begins, then once a second: it must not push every other event out.
  void report_dropped(const Streams& streams, std::int64_t at_ns, bool last = false) {
    const auto now_dropped = streams.dropped() - dropped_before;
    if (now_dropped == dropped) return;
    log.note_loss();
    if (!last && at_ns < next_drop_report_ns) return;
    next_drop_report_ns = at_ns + kDropReportNs;
    EventRecord r;
    r.mono_ns = at_ns;
    r.step = last_step;
    r.severity = Severity::kProgramStop;
    r.value = static_cast<double>(now_dropped - dropped);
    copy_text(r.code, "recorder.dropped");
    copy_text(
        r.text,
        base::formatted("%zu records lost before the recorder, which was not scheduled in time or waited for its disk",
                        now_dropped - dropped));
    dropped = now_dropped;
    write_event(r);
  }

  void flush_batches() {
    frame_sink.flush_batches();
    pressure_sink.flush_batches();
    flush(control_batch, *this);
    flush(exchange_batch, *this);
  }

  void write_staged() {
    if (staged.goes_beyond(log.session())) flush_batches();  // nothing of the old session comes after its end
    staged.append_to(log);
    log.roll_if_large();
  }

  void run_slices(Streams& streams, std::int64_t due_ns) {
    for (; due_ns >= slice_end_ns; slice_end_ns += kSliceNs) {
      take_slice(streams, slice_end_ns);
      report_dropped(streams, slice_end_ns);
      // Decided by the slices' own time, so that two runs cut their batches at the same places.
      const bool sync = slice_end_ns >= next_sync_ns;
      if (sync) flush_batches();
      write_staged();
      if (!sync) continue;
      next_sync_ns = slice_end_ns + to_ns(options.sync_interval_s);
      log.sync();
      if (log.synced()) synced_until_ns = slice_end_ns;
      report_fault();
    }
  }

  void report_fault() {
    if (log.fault().empty() || std::exchange(fault_reported, true)) return;
    EventRecord r;
    r.mono_ns = slice_end_ns;
    r.step = last_step;
    r.severity = Severity::kProgramStop;
    copy_text(r.code, "recorder.disk");
    copy_text(r.text, log.fault());
    write_event(r);
  }

  [[nodiscard]] bool has_room_for_evidence() const { return log.condition() < DiskCondition::kReserve; }

  /// After the slices and their sync: the recording comes first, and a turn must not wait long for the disk.
  void advance_evidence() {
    const std::int64_t taken_until_ns = slice_end_ns - kSliceNs;
    evidence.advance(taken_until_ns, has_room_for_evidence());
    report_evidence(taken_until_ns);
  }

  /// At the end, with the recording on the disk but for its end marks. Nothing may follow those, so that what is to be
  /// said of the evidence comes before them.
  void finish_evidence() {
    if (!evidence.is_owed()) return;
    log.sync();
    evidence.finish(has_room_for_evidence());
    report_evidence(slice_end_ns);
    write_staged();
  }

  /// The recording has it all the same: a warning.
  void report_evidence(std::int64_t at_ns) {
    if (evidence.error() == evidence_said) return;
    evidence_said = evidence.error();
    if (evidence_said.empty()) return;
    EventRecord r;
    r.mono_ns = at_ns;
    r.step = last_step;
    r.severity = Severity::kWarning;
    copy_text(r.code, "recorder.evidence");
    copy_text(r.text, evidence_said);
    write_event(r);
  }

  /// What the run cannot be called done for.
  [[nodiscard]] std::string fault(const RecorderStatus& s) const {
    if (!trouble.empty()) return "the recorder failed: " + trouble;
    if (!log.fault().empty()) return log.fault();
    if (s.lost_messages > 0) return std::to_string(s.lost_messages) + " messages were lost: the disk takes nothing";
    if (s.dropped_records > 0) {
      return std::to_string(s.dropped_records) +
             " records were dropped before the recorder, which was not scheduled in time or waited for its disk";
    }
    if (finished && !log.synced()) {
      return "the end of the recording is not on the disk: " +
             (s.error.empty() ? std::string("it was not synced") : s.error);
    }
    return {};
  }

  [[nodiscard]] DiskCondition condition() const {
    return trouble.empty() ? log.condition() : std::max(log.condition(), DiskCondition::kFailing);
  }

  [[nodiscard]] bool has_more(const Streams& streams) const {
    return frame.has_more(streams.frame) || pressure.has_more(streams.pressure) || control.has_more(streams.control) ||
           events.has_more(streams.events) || exchanges.has_more(streams.exchanges) ||
           sync_checks.has_more(streams.sync);
  }

  void publish_status() {
    RecorderStatus s;
    log.describe(s);
    s.dropped_records = dropped;
    s.disk = condition();
    s.fault = fault(s);
    s.synced_until_ns = synced_until_ns;
    s.frame_full = frame.counts().full;
    s.frame_averaged = frame.counts().averaged;
    s.frame_missing = frame.counts().missing;
    s.pressure_full = pressure.counts().full;
    s.pressure_averaged = pressure.counts().averaged;
    s.pressure_missing = pressure.counts().missing;
    const std::lock_guard hold(status_mutex);
    status = std::move(s);
  }

  const RecorderOptions options;
  const RunInfo info;
  SegmentedLog log;
  TripEvidence evidence;
  std::string evidence_said;
  FrameSink frame_sink;
  PressureSink pressure_sink;
  KeepPolicy<FrameRecord, FrameAverage, FrameSink> frame;
  KeepPolicy<PressureRecord, PressureAverage, PressureSink> pressure;
  PeekedQueue<ControlRecord> control;
  PeekedQueue<EventRecord> events;
  PeekedQueue<ExchangeRecord> exchanges;
  PeekedQueue<SyncRecord> sync_checks;
  ControlBatch control_batch;
  ExchangeBatch exchange_batch;
  StagedMessages staged;

  std::int64_t slice_end_ns;
  std::int64_t next_sync_ns;
  std::int64_t synced_until_ns;
  std::int64_t next_control_ns = std::numeric_limits<std::int64_t>::min();
  RunState last_state = RunState::kIdle;
  std::uint32_t last_step = 0;
  std::uint32_t worst_wakeup_ns = 0;
  std::uint32_t worst_run_ns = 0;
  std::size_t dropped_before;
  std::size_t dropped = 0;
  std::int64_t next_drop_report_ns = std::numeric_limits<std::int64_t>::min();
  bool fault_reported = false;
  std::string trouble;  // an exception that nothing else explains
  bool finished = false;
  bool settled = false;

  mutable std::mutex status_mutex;
  RecorderStatus status;
};

Recorder::Recorder(const RecorderOptions& options, RunInfo info)
    : impl_(std::make_unique<Impl>(options, std::move(info))) {
  impl_->publish_status();
  disk_ = impl_->log.condition();
}

Recorder::~Recorder() = default;

void Recorder::drain(Streams& streams, std::int64_t now_ns) noexcept {
  auto& m = *impl_;
  if (m.finished) return;
  try {
    m.run_slices(streams, now_ns - to_ns(m.options.lag_s));
    m.advance_evidence();
    m.log.tell_sessions();
  } catch (const std::exception& e) {
    m.trouble = e.what();
  }
  disk_.store(m.condition(), std::memory_order_relaxed);
  m.publish_status();
  last_turn_ns_.store(now_ns, std::memory_order_relaxed);
}

bool Recorder::finish(Streams& streams, bool complete) noexcept {
  auto& m = *impl_;
  if (std::exchange(m.finished, true)) return settle();
  try {
    for (int i = 0; i < kMostLastSlices && m.has_more(streams); ++i) m.run_slices(streams, m.slice_end_ns);
    m.take_slice(streams, kNever);
    m.report_dropped(streams, m.slice_end_ns, true);
    m.frame.finish();
    m.pressure.finish();
    m.flush_batches();
    m.write_staged();
    m.finish_evidence();
    m.log.end_session(complete);
    m.log.end_attempt(complete, m.dropped);
  } catch (const std::exception& e) {
    m.trouble = e.what();
  }
  return settle();
}

bool Recorder::settle() noexcept {
  auto& m = *impl_;
  try {
    if (!m.settled || !m.log.synced()) m.log.sync();
    m.log.tell_sessions();
  } catch (const std::exception& e) {
    m.trouble = e.what();
  }
  m.settled = m.log.synced();
  if (m.settled) m.synced_until_ns = m.slice_end_ns;
  disk_.store(m.condition(), std::memory_order_relaxed);
  m.publish_status();
  return m.settled && m.log.told();
}

void Recorder::on_session(std::function<void(const SessionChange&)> callback) {
  impl_->log.on_session = std::move(callback);
}

RecorderStatus Recorder::status() const {
  const std::lock_guard hold(impl_->status_mutex);
  return impl_->status;
}

std::int32_t Recorder::attempt() const noexcept {
  return impl_->log.attempt();
}

}  // namespace isorig::daemon
