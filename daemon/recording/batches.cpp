#include "daemon/recording/batches.hpp"

#include <bit>
#include <cstring>
#include <limits>
#include <string>

namespace isorig::daemon {
namespace {

template <typename T>
bool in_range(std::int64_t value) noexcept {
  return value >= std::numeric_limits<T>::min() && value <= std::numeric_limits<T>::max();
}

template <typename... Vectors>
void resize(std::int16_t n, Vectors&... vectors) {
  (vectors.resize(static_cast<std::size_t>(n)), ...);
}

/// The part that frame and pressure batches share.
template <typename Message, typename Record>
bool sample_fits(const Message& m, const Record& r, std::int32_t session, std::int16_t capacity) noexcept {
  return m.count < capacity && m.session == session && m.step == static_cast<std::int32_t>(r.step) &&
         in_range<std::int32_t>(r.mono_ns - m.mono_ns) && in_range<std::int32_t>(r.device_us - m.device_us) &&
         in_range<std::int16_t>(std::int64_t{r.sequence} - m.sequence);
}

template <typename Message, typename Record>
std::size_t add_sample(Message& m, const Record& r, std::int32_t session) noexcept {
  if (m.count == 0) {
    m.session = session;
    m.step = static_cast<std::int32_t>(r.step);
    m.mono_ns = r.mono_ns;
    m.device_us = r.device_us;
    m.sequence = r.sequence;
  }
  const auto i = static_cast<std::size_t>(m.count++);
  m.mono_offset_ns[i] = static_cast<std::int32_t>(r.mono_ns - m.mono_ns);
  m.device_offset_us[i] = static_cast<std::int32_t>(r.device_us - m.device_us);
  m.sequence_offset[i] = static_cast<std::int16_t>(std::int64_t{r.sequence} - m.sequence);
  m.bound_ns[i] = r.bound_ns;
  m.repeatability_ns[i] = r.repeatability_ns;
  return i;
}

template <typename Message>
std::size_t add_interval(Message& m, const IntervalCore& c, std::int32_t session) noexcept {
  if (m.count == 0) {
    m.session = session;
    m.step = static_cast<std::int32_t>(c.step);
  }
  const auto i = static_cast<std::size_t>(m.count++);
  m.first_mono_ns[i] = c.first_mono_ns;
  m.last_mono_ns[i] = c.last_mono_ns;
  m.first_device_us[i] = c.first_device_us;
  m.last_device_us[i] = c.last_device_us;
  m.first_sequence[i] = c.first_sequence;
  m.last_sequence[i] = c.last_sequence;
  m.samples[i] = c.samples;
  m.bound_ns[i] = c.bound_ns;
  m.repeatability_ns[i] = c.repeatability_ns;
  return i;
}

template <typename Message>
void resize_intervals(Message& m, std::int16_t n) {
  resize(n, m.first_mono_ns, m.last_mono_ns, m.first_device_us, m.last_device_us, m.first_sequence, m.last_sequence,
         m.samples, m.bound_ns, m.repeatability_ns);
  m.count = 0;
}

}  // namespace

FrameBatch::FrameBatch() {
  auto& m = message;
  resize(messages::kFrameBatch, m.mono_offset_ns, m.device_offset_us, m.sequence_offset, m.bound_ns, m.repeatability_ns,
         m.raw_position_mm, m.raw_force_N, m.position_mm, m.force_N);
  m.count = 0;
}
bool FrameBatch::fits(const FrameRecord& r, std::int32_t session) const noexcept {
  return sample_fits(message, r, session, messages::kFrameBatch);
}
void FrameBatch::add(const FrameRecord& r, std::int32_t session) noexcept {
  const auto i = add_sample(message, r, session);
  message.raw_position_mm[i] = r.raw_position_mm;
  message.raw_force_N[i] = r.raw_force_N;
  message.position_mm[i] = r.position_mm;
  message.force_N[i] = r.force_N;
}

PressureBatch::PressureBatch() {
  auto& m = message;
  resize(messages::kPressureBatch, m.mono_offset_ns, m.device_offset_us, m.sequence_offset, m.bound_ns,
         m.repeatability_ns, m.raw_word, m.status, m.temperature_C, m.pressure_psi);
  m.count = 0;
}
bool PressureBatch::fits(const PressureRecord& r, std::int32_t session) const noexcept {
  return sample_fits(message, r, session, messages::kPressureBatch);
}
void PressureBatch::add(const PressureRecord& r, std::int32_t session) noexcept {
  const auto i = add_sample(message, r, session);
  message.raw_word[i] = std::bit_cast<std::int32_t>(r.raw_word);
  message.status[i] = r.status;
  message.temperature_C[i] = r.temperature_C;
  message.pressure_psi[i] = r.pressure_psi;
}

FrameAverageBatch::FrameAverageBatch() {
  auto& m = message;
  resize_intervals(m, messages::kFrameAverageBatch);
  resize(messages::kFrameAverageBatch, m.mean_raw_position_mm, m.mean_raw_force_N, m.mean_position_mm,
         m.min_position_mm, m.max_position_mm, m.mean_force_N, m.min_force_N, m.max_force_N);
}
bool FrameAverageBatch::fits(const FrameAverage& a, std::int32_t session) const noexcept {
  return message.count < messages::kFrameAverageBatch && message.session == session &&
         message.step == static_cast<std::int32_t>(a.core.step);
}
void FrameAverageBatch::add(const FrameAverage& a, std::int32_t session) noexcept {
  auto& m = message;
  const auto i = add_interval(m, a.core, session);
  const double n = a.core.samples;
  m.mean_raw_position_mm[i] = static_cast<float>(a.raw_position_sum / n);
  m.mean_raw_force_N[i] = static_cast<float>(a.raw_force_sum / n);
  m.mean_position_mm[i] = a.position_mm.sum / n;
  m.min_position_mm[i] = a.position_mm.min;
  m.max_position_mm[i] = a.position_mm.max;
  m.mean_force_N[i] = a.force_N.sum / n;
  m.min_force_N[i] = a.force_N.min;
  m.max_force_N[i] = a.force_N.max;
}

PressureAverageBatch::PressureAverageBatch() {
  auto& m = message;
  resize_intervals(m, messages::kPressureAverageBatch);
  resize(messages::kPressureAverageBatch, m.mean_raw_counts, m.current, m.mean_temperature_C, m.mean_pressure_psi,
         m.min_pressure_psi, m.max_pressure_psi);
}
bool PressureAverageBatch::fits(const PressureAverage& a, std::int32_t session) const noexcept {
  return message.count < messages::kPressureAverageBatch && message.session == session &&
         message.step == static_cast<std::int32_t>(a.core.step);
}
void PressureAverageBatch::add(const PressureAverage& a, std::int32_t session) noexcept {
  auto& m = message;
  const auto i = add_interval(m, a.core, session);
  constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
  const bool any = a.current > 0;
  const double n = a.current;
  m.current[i] = a.current;
  m.mean_raw_counts[i] = static_cast<float>(any ? a.raw_counts_sum / n : kNone);
  m.mean_temperature_C[i] = static_cast<float>(any ? a.temperature_sum / n : kNone);
  m.mean_pressure_psi[i] = any ? a.pressure_psi.sum / n : kNone;
  m.min_pressure_psi[i] = any ? a.pressure_psi.min : kNone;
  m.max_pressure_psi[i] = any ? a.pressure_psi.max : kNone;
}

ControlBatch::ControlBatch() {
  resize(messages::kControlBatch, message.samples);
  message.count = 0;
}
bool ControlBatch::fits(const ControlRecord&, std::int32_t session) const noexcept {
  return message.count < messages::kControlBatch && message.session == session;
}
void ControlBatch::add(const ControlRecord& r, std::int32_t session) noexcept {
  message.session = session;
  auto& s = message.samples[static_cast<std::size_t>(message.count++)];
  s.mono_ns = r.mono_ns;
  s.step = static_cast<std::int32_t>(r.step);
  s.state = static_cast<std::int8_t>(r.state);
  s.setpoint_psi = r.setpoint_psi;
  s.pressure_psi = r.pressure_psi;
  s.fill_permille = static_cast<std::int16_t>(r.fill_permille);
  s.vent_permille = static_cast<std::int16_t>(r.vent_permille);
  s.target_mm = r.target_mm;
  s.velocity_mm_s = r.velocity_mm_s;
  s.position_mm = r.position_mm;
  s.force_N = r.force_N;
  s.ticks = static_cast<std::int64_t>(r.ticks);
  s.overruns = static_cast<std::int64_t>(r.overruns);
  s.worst_wakeup_ns =
      static_cast<std::int32_t>(std::min<std::uint32_t>(r.worst_wakeup_ns, std::numeric_limits<std::int32_t>::max()));
  s.worst_run_ns =
      static_cast<std::int32_t>(std::min<std::uint32_t>(r.worst_run_ns, std::numeric_limits<std::int32_t>::max()));
  s.progress = r.progress;
  s.remaining_s = r.remaining_s;
}

ExchangeBatch::ExchangeBatch() {
  auto& m = message;
  resize(messages::kExchangeBatch, m.device, m.host_send_ns, m.host_recv_ns, m.device_rx_us, m.device_tx_us);
  m.count = 0;
}
bool ExchangeBatch::fits(const ExchangeRecord&, std::int32_t session) const noexcept {
  return message.count < messages::kExchangeBatch && message.session == session;
}
void ExchangeBatch::add(const ExchangeRecord& r, std::int32_t session) noexcept {
  auto& m = message;
  m.session = session;
  const auto i = static_cast<std::size_t>(m.count++);
  m.device[i] = static_cast<std::int8_t>(r.device);
  m.host_send_ns[i] = r.exchange.host_send_ns;
  m.host_recv_ns[i] = r.exchange.host_recv_ns;
  m.device_rx_us[i] = r.exchange.device_rx_us;
  m.device_tx_us[i] = r.exchange.device_tx_us;
}

isorig_msgs::sync_check_t to_message(const SyncRecord& r, std::int32_t session) {
  isorig_msgs::sync_check_t m{};
  m.mono_ns = r.mono_ns;
  m.session = session;
  m.edge_ns = r.check.mono_ns;
  m.device_us = r.check.device_us;
  m.error_us = r.check.error_us;
  m.bound_us = r.check.bound_us;
  m.repeatability_us = r.check.repeatability_us;
  m.rising = r.check.rising ? 1 : 0;
  m.within = r.check.within ? 1 : 0;
  m.pairs = static_cast<std::int32_t>(r.counts.pairs);
  m.outside = static_cast<std::int32_t>(r.counts.outside);
  m.unseen = static_cast<std::int32_t>(r.counts.unseen);
  m.unannounced = static_cast<std::int32_t>(r.counts.unannounced);
  m.ambiguous = static_cast<std::int32_t>(r.counts.ambiguous);
  return m;
}

isorig_msgs::event_t to_message(const EventRecord& r, std::int32_t session) {
  isorig_msgs::event_t m{};
  m.mono_ns = r.mono_ns;
  m.session = session;
  m.step = static_cast<std::int32_t>(r.step);
  m.severity = static_cast<std::int8_t>(r.severity);
  m.from_state = static_cast<std::int8_t>(r.from);
  m.to_state = static_cast<std::int8_t>(r.to);
  m.code = std::string(r.code, strnlen(r.code, sizeof r.code));
  m.text = std::string(r.text, strnlen(r.text, sizeof r.text));
  m.value = r.value;
  m.threshold = r.threshold;
  return m;
}

}  // namespace isorig::daemon
