#include "daemon/recording/run_tally.hpp"

#include <algorithm>
#include <tuple>

#include "daemon/recording/session_marks.hpp"

namespace isorig::daemon {
namespace {

template <typename Message>
void take_bounds(RunTally::Stream& stream, const Message& m) {
  for (std::size_t i = 0; i < static_cast<std::size_t>(m.count); ++i)
    stream.worst_bound_us = std::max(stream.worst_bound_us, static_cast<double>(m.bound_ns[i]) * 1e-3);
}

}  // namespace

const char* RunTally::Repetition::state_text() const noexcept {
  if (!ended) return "cut off or running";
  return complete ? "complete" : "stopped, or not whole";
}

void RunTally::header(const isorig_msgs::run_header_t& h) {
  if (!has_header_) first_epoch_unix_us = h.epoch_unix_us;
  if (has_header_ && h.attempt != last_header.attempt) {
    begins_attempt_ = true;
    has_overruns_ = false;
    overruns_of_attempts_ = overruns;
  }
  has_header_ = true;
  last_header = h;
}

std::int64_t RunTally::rig_ns(std::int64_t mono_ns) {
  if (begins_attempt_) shift_ns_ = latest_ns_ - mono_ns;
  begins_attempt_ = false;
  latest_ns_ = std::max(latest_ns_, mono_ns + shift_ns_);
  return mono_ns + shift_ns_;
}

void RunTally::event(const isorig_msgs::event_t& m) {
  events.push_back(m);
  events.back().mono_ns = rig_ns(m.mono_ns);
  event_shift_ns.push_back(shift_ns_);
  constexpr double kMost_s = 1e9;  // of what a recording may claim
  if (m.code == "loop.late" && m.value > 0.0 && m.value < kMost_s)
    worst_wakeup_ns = std::max(worst_wakeup_ns, static_cast<std::int64_t>(1e9 * m.value));
}

void RunTally::samples_span(std::int64_t from_ns, std::int64_t to_ns) {
  from_ns = rig_ns(from_ns);
  to_ns = rig_ns(to_ns);
  first_sample_ns = has_samples_ ? std::min(first_sample_ns, from_ns) : from_ns;
  last_sample_ns = has_samples_ ? std::max(last_sample_ns, to_ns) : to_ns;
  has_samples_ = true;
}

template <typename Message>
void RunTally::count_full(Stream& stream, const Message& m) {
  if (m.count <= 0) return;
  samples_span(m.mono_ns, m.mono_ns + m.mono_offset_ns.back());
  stream.full += static_cast<std::uint64_t>(m.count);
  take_bounds(stream, m);
}

template <typename Message>
void RunTally::count_averages(Stream& stream, const Message& m) {
  if (m.count <= 0) return;
  samples_span(m.first_mono_ns.front(), m.last_mono_ns.back());
  stream.intervals += static_cast<std::uint64_t>(m.count);
  for (std::size_t i = 0; i < static_cast<std::size_t>(m.count); ++i)
    stream.averaged += static_cast<std::uint64_t>(std::max(0, m.samples[i]));
  take_bounds(stream, m);
}

void RunTally::session(const isorig_msgs::session_mark_t& m) {
  if (m.kind == isorig_msgs::session_mark_t::END) lost[m.attempt] = m;
  if (m.kind == isorig_msgs::session_mark_t::CONTINUE) return;
  marks.push_back(m);
  marks.back().mono_ns = rig_ns(m.mono_ns);
  mark_shift_ns.push_back(shift_ns_);
}

void RunTally::frame(const isorig_msgs::frame_batch_t& m) {
  count_full(frames, m);
}

void RunTally::pressure(const isorig_msgs::pressure_batch_t& m) {
  count_full(pressures, m);
}

void RunTally::frame_average(const isorig_msgs::frame_average_batch_t& m) {
  count_averages(frames, m);
}

void RunTally::pressure_average(const isorig_msgs::pressure_average_batch_t& m) {
  count_averages(pressures, m);
}

void RunTally::control(const isorig_msgs::control_batch_t& m) {
  for (std::size_t i = 0; i < static_cast<std::size_t>(m.count); ++i) {
    if (!has_overruns_) overruns_before_ = m.samples[i].overruns;
    has_overruns_ = true;
    overruns = std::max(overruns, overruns_of_attempts_ + m.samples[i].overruns - overruns_before_);
    worst_wakeup_ns = std::max(worst_wakeup_ns, std::int64_t{m.samples[i].worst_wakeup_ns});
    worst_run_ns = std::max(worst_run_ns, m.samples[i].worst_run_ns);
  }
}

void RunTally::exchanges(const isorig_msgs::exchange_batch_t& m) {
  exchange_count += static_cast<std::uint64_t>(std::max<std::int64_t>(0, m.count));
}

std::string RunTally::text(std::string_view name) const {
  for (const auto& t : last_header.texts)
    if (t.name == name) return t.text;
  return {};
}

RunTally::Losses RunTally::losses() const {
  Losses sum;
  for (const auto& [attempt, m] : lost) {
    sum.frame += std::max<std::int64_t>(0, m.frame_missing);
    sum.pressure += std::max<std::int64_t>(0, m.pressure_missing);
    sum.dropped += std::max<std::int64_t>(0, m.dropped_records);
  }
  return sum;
}

std::vector<RunTally::Repetition> RunTally::repetitions() const {
  MissingCounts missing;
  std::vector<Repetition> out;
  for (std::size_t i = 0; i < marks.size(); ++i) {
    if (marks[i].kind != isorig_msgs::session_mark_t::BEGIN) continue;
    Repetition& r = out.emplace_back();
    r.begin = marks[i];
    // A repetition that was cut off is followed by the begin mark of the next attempt, or by nothing.
    if (i + 1 == marks.size() || marks[i + 1].kind != isorig_msgs::session_mark_t::END) continue;
    const auto& end = marks[i + 1];
    r.ended = true;
    r.end_ns = end.mono_ns;
    r.complete = end.complete != 0;
    std::tie(r.frame_missing, r.pressure_missing) = missing.since_last(end);
  }
  return out;
}

}  // namespace isorig::daemon
