#include "daemon/export/rows.hpp"

#include <algorithm>
#include <cmath>

namespace isorig::daemon {
namespace {

constexpr std::int64_t kLeastStepNs = 2;
constexpr double kNothing = std::numeric_limits<double>::quiet_NaN();

template <typename Message>
Row sample(const Message& m, std::size_t i) {
  Row r;
  r.mono_ns = m.mono_ns + m.mono_offset_ns[i];
  r.bound_ns = static_cast<double>(m.bound_ns[i]);
  r.repeatability_ns = static_cast<double>(m.repeatability_ns[i]);
  r.device_us = static_cast<double>(m.device_us + m.device_offset_us[i]);
  r.sequence = static_cast<double>(m.sequence + m.sequence_offset[i]);
  r.step = m.step;
  return r;
}

/// An interval, at the middle of its time.
template <typename Message>
Row middle(const Message& m, std::size_t i) {
  Row r;
  r.mono_ns = m.first_mono_ns[i] + (m.last_mono_ns[i] - m.first_mono_ns[i]) / 2;
  r.bound_ns = static_cast<double>(m.bound_ns[i]);
  r.repeatability_ns = static_cast<double>(m.repeatability_ns[i]);
  r.device_span_us = static_cast<double>(m.last_device_us[i] - m.first_device_us[i]);
  r.device_us = static_cast<double>(m.first_device_us[i]) + 0.5 * r.device_span_us;
  r.sequence_span = std::remainder(static_cast<double>(m.last_sequence[i] - m.first_sequence[i]), 4'294'967'296.0);
  r.sequence = static_cast<double>(m.first_sequence[i]) + 0.5 * r.sequence_span;
  r.step = m.step;
  r.samples = m.samples[i];
  r.averaged = true;
  return r;
}

}  // namespace

std::int32_t RowSource::session_of(std::int32_t said, std::int64_t mono_ns) const noexcept {
  if (live_ == nullptr) return said;
  const auto after = std::upper_bound(live_->begin(), live_->end(), mono_ns,
                                      [](std::int64_t ns, const LiveSession& s) { return ns < s.from_ns; });
  if (after == live_->begin() || mono_ns > (after - 1)->until_ns) return -1;
  return static_cast<std::int32_t>(after - 1 - live_->begin());
}

void RowSource::frame(const isorig_msgs::frame_batch_t& m) {
  for (std::size_t i = 0; i < static_cast<std::size_t>(m.count); ++i) {
    auto r = sample(m, i);
    r.value = {m.position_mm[i], m.force_N[i], kNothing, kNothing, kNothing, kNothing};
    row(Stream::kFrame, session_of(m.session, r.mono_ns), r);
  }
}

void RowSource::frame_average(const isorig_msgs::frame_average_batch_t& m) {
  for (std::size_t i = 0; i < static_cast<std::size_t>(m.count); ++i) {
    auto r = middle(m, i);
    r.value = {m.mean_position_mm[i], m.mean_force_N[i], m.min_position_mm[i],
               m.max_position_mm[i],  m.min_force_N[i],  m.max_force_N[i]};
    row(Stream::kFrame, session_of(m.session, r.mono_ns), r);
  }
}

void RowSource::pressure(const isorig_msgs::pressure_batch_t& m) {
  for (std::size_t i = 0; i < static_cast<std::size_t>(m.count); ++i) {
    auto r = sample(m, i);
    const auto session = session_of(m.session, r.mono_ns);
    if (m.status[i] != 0) {
      not_measured(session, 1);
      continue;
    }
    r.value = {m.pressure_psi[i], kNothing, kNothing, static_cast<double>(m.temperature_C[i])};
    row(Stream::kPressure, session, r);
  }
}

void RowSource::pressure_average(const isorig_msgs::pressure_average_batch_t& m) {
  for (std::size_t i = 0; i < static_cast<std::size_t>(m.count); ++i) {
    auto r = middle(m, i);
    const auto session = session_of(m.session, r.mono_ns);
    not_measured(session, static_cast<std::size_t>(std::max(0, m.samples[i] - m.current[i])));
    if (m.current[i] <= 0) continue;
    r.samples = m.current[i];
    r.value = {m.mean_pressure_psi[i], m.min_pressure_psi[i], m.max_pressure_psi[i],
               static_cast<double>(m.mean_temperature_C[i])};
    row(Stream::kPressure, session, r);
  }
}

void RowSource::control(const isorig_msgs::control_batch_t& m) {
  for (std::size_t i = 0; i < static_cast<std::size_t>(m.count); ++i) {
    const auto& c = m.samples[i];
    Row r;
    r.mono_ns = c.mono_ns;
    r.step = c.step;
    r.value = {static_cast<double>(c.setpoint_psi),  static_cast<double>(c.target_mm),
               static_cast<double>(c.velocity_mm_s), static_cast<double>(c.fill_permille),
               static_cast<double>(c.vent_permille), static_cast<double>(c.state)};
    row(Stream::kSetpoints, session_of(m.session, r.mono_ns), r);
  }
}

void RowOrder::add(const Row& row) {
  newest_ns_ = std::max(newest_ns_, row.mono_ns);
  waiting_.push_back(row);
}

void RowOrder::take(bool all, const std::function<void(const Row&)>& to) {
  const auto earlier = [](const Row& a, const Row& b) { return a.mono_ns < b.mono_ns; };
  if (!std::is_sorted(waiting_.begin(), waiting_.end(), earlier)) {
    std::stable_sort(waiting_.begin(), waiting_.end(), earlier);
  }
  // A row that is still to come may be lateness_ns behind the newest; one of that very time has to follow those of it.
  const auto end = all ? waiting_.end()
                       : std::lower_bound(waiting_.begin(), waiting_.end(), newest_ns_ - lateness_ns_,
                                          [](const Row& r, std::int64_t ns) { return r.mono_ns < ns; });
  for (auto r = waiting_.begin(); r != end; ++r) {
    if (last_ns_ != std::numeric_limits<std::int64_t>::min() && r->mono_ns < last_ns_ + kLeastStepNs) {
      r->bound_ns += static_cast<double>(last_ns_ + kLeastStepNs - r->mono_ns);
      r->mono_ns = last_ns_ + kLeastStepNs;
      ++moved_;
    }
    last_ns_ = r->mono_ns;
    to(*r);
  }
  waiting_.erase(waiting_.begin(), end);
  due_ = std::max(kBlockRows, 2 * waiting_.size());
}

std::size_t order_rows(std::vector<Row>& rows) {
  RowOrder order(0);
  for (const auto& r : rows) order.add(r);
  rows.clear();
  order.take(true, [&](const Row& r) { rows.push_back(r); });
  return order.moved();
}

}  // namespace isorig::daemon
