#include "daemon/export/scan.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <tuple>

namespace isorig::daemon {

void Extent::take(std::int64_t mono_ns) noexcept {
  if (rows > 0) lateness_ns = std::max(lateness_ns, newest_ns - mono_ns);
  first_ns = std::min(first_ns, mono_ns);
  newest_ns = std::max(newest_ns, mono_ns);
  ++rows;
}

void ReadingStep::take(double reading) noexcept {
  const double step = std::abs(reading - last_);
  if (step > 0.0) smallest_ = std::min(smallest_, step);  // not NaN, of the first
  last_ = reading;
  largest_ = std::max(largest_, std::abs(reading));
}

double ReadingStep::value() const noexcept {
  if (!std::isfinite(smallest_)) return 0.0;
  constexpr double kFloatDigit = 1.0 / 16'777'216.0;  // a device's readings come in 24 bits
  const double step = std::max(smallest_, kFloatDigit * largest_);
  // The difference of two such readings has its own rounding: two digits are all there is to it.
  const double digit = std::pow(10.0, std::floor(std::log10(step)) - 1.0);
  return std::round(step / digit) * digit;
}

ScannedSession& Scan::at(std::int32_t session) {
  auto& attempts = sessions[session];
  if (attempts.empty() || attempts.back().attempt != attempt_) attempts.emplace_back().attempt = attempt_;
  return attempts.back();
}

void Scan::header(const isorig_msgs::run_header_t& h) {
  attempt_ = h.attempt;
  headers.try_emplace(h.attempt, h);
}

void Scan::session(const isorig_msgs::session_mark_t& m) {
  if (m.kind != isorig_msgs::session_mark_t::END) return;
  auto& s = at(m.session.session);
  s.complete = m.complete != 0;
  s.end_ns = m.mono_ns;
  std::tie(s.marks.frame_missing, s.marks.pressure_missing) = missing_.since_last(m);
}

void Scan::event(const isorig_msgs::event_t& m) {
  if (m.code == "session.start") {
    if (!live_.empty()) live_.back().until_ns = std::min(live_.back().until_ns, m.mono_ns - 1);
    LiveSession s;
    s.from_ns = m.mono_ns;
    // "repetition 3, 15 psi", unless the protocol has labels of its own.
    if (std::sscanf(m.text.c_str(), "repetition %d, %lf psi", &s.repetition, &s.pressure_psi) < 2) s.repetition = 0;
    live_.push_back(s);
  } else if (m.code == "session.end" && !live_.empty()) {
    live_.back().until_ns = m.mono_ns;
    live_.back().ended = true;
  }
  // Of the live channels' log the time decides, and the next session begins in the same nanosecond.
  const bool ends = m.code == "session.end";
  at(session_of(m.session, ends ? m.mono_ns - 1 : m.mono_ns)).marks.events.push_back(m);
}

std::vector<LiveSession> Scan::live_sessions() const {
  if (!live_.empty()) return live_;
  LiveSession all;
  all.from_ns = std::numeric_limits<std::int64_t>::min();
  return {all};
}

void Scan::exchanges(const isorig_msgs::exchange_batch_t& m) {
  for (std::size_t i = 0; i < static_cast<std::size_t>(m.count); ++i) {
    auto& to = exchanges_of[attempt_][m.device[i] == isorig_msgs::exchange_batch_t::FRAME ? 0 : 1];
    to.push_back({m.host_send_ns[i], m.host_recv_ns[i], m.device_rx_us[i], m.device_tx_us[i]});
  }
}

void Scan::row(Stream stream, std::int32_t session, const Row& row) {
  auto& s = at(session);
  s.stream[static_cast<std::size_t>(stream)].take(row.mono_ns);
  if (stream == Stream::kSetpoints) {
    s.targets.try_emplace(row.step, StepTargets{row.value[1], row.value[2], row.value[0]});
  } else if (!row.averaged && stream == Stream::kFrame) {
    position_step.take(row.value[0]);
    force_step.take(row.value[1]);
  } else if (!row.averaged) {
    pressure_step.take(row.value[0]);
  }
}

void Scan::not_measured(std::int32_t session, std::size_t samples) {
  if (samples > 0) at(session).not_measured += samples;
}

void Scan::set_ended(std::int32_t session, const LiveSession& live) {
  const auto found = sessions.find(session);
  if (found == sessions.end() || !live.ended) return;
  found->second.back().complete = true;
  found->second.back().end_ns = live.until_ns;
}

const ScannedSession* Scan::chosen(std::int32_t session) const {
  const auto found = sessions.find(session);
  if (found == sessions.end() || session < 0) return nullptr;
  const ScannedSession* best = nullptr;
  for (const auto& s : found->second) {
    if (s.stream[0].rows == 0) continue;
    if (best == nullptr || s.complete || !best->complete) best = &s;
  }
  return best;
}

}  // namespace isorig::daemon
