#include "cli/run_evidence.hpp"

#include <toml++/toml.h>

#include <algorithm>
#include <cmath>

namespace isorig::cli {
namespace {

template <typename Message>
void bounds(RunEvidence::Stream& stream, const Message& m) {
  for (std::size_t i = 0; i < static_cast<std::size_t>(m.count); ++i)
    stream.worst_bound_us = std::max(stream.worst_bound_us, static_cast<double>(m.bound_ns[i]) * 1e-3);
}

template <typename Message>
std::int64_t middle_ns(const Message& m, std::size_t i) {
  return m.first_mono_ns[i] + (m.last_mono_ns[i] - m.first_mono_ns[i]) / 2;
}

template <typename Message>
void count_averages(RunEvidence::Stream& stream, const Message& m) {
  stream.intervals += static_cast<std::uint64_t>(m.count);
  for (std::size_t i = 0; i < static_cast<std::size_t>(m.count); ++i)
    stream.averaged += static_cast<std::uint64_t>(std::max(0, m.samples[i]));
  bounds(stream, m);
}

}  // namespace

void RunEvidence::span(std::int64_t from_ns, std::int64_t to_ns) {
  if (!begun_) origin_ns = last_ns = from_ns;
  begun_ = true;
  last_ns = std::max(last_ns, to_ns);
}

void RunEvidence::temperature(float value_C) {
  if (!std::isfinite(value_C)) return;
  const double value = double{value_C};
  coldest_C = has_temperature ? std::min(coldest_C, value) : value;
  warmest_C = has_temperature ? std::max(warmest_C, value) : value;
  has_temperature = true;
}

void RunEvidence::session(const isorig_msgs::session_mark_t& m) {
  if (m.kind == isorig_msgs::session_mark_t::END) lost[m.attempt] = m;
  if (m.kind == isorig_msgs::session_mark_t::CONTINUE) return;
  span(m.mono_ns, m.mono_ns);
  marks.push_back(m);
}

void RunEvidence::frame(const isorig_msgs::frame_batch_t& m) {
  if (m.count <= 0) return;
  span(m.mono_ns, m.mono_ns + m.mono_offset_ns.back());
  frames.full += static_cast<std::uint64_t>(m.count);
  bounds(frames, m);
  for (std::size_t i = 0; i < static_cast<std::size_t>(m.count); ++i) {
    const double t = seconds(m.mono_ns + m.mono_offset_ns[i]);
    force_N.add(t, m.force_N[i]);
    position_mm.add(t, m.position_mm[i]);
  }
}

void RunEvidence::frame_average(const isorig_msgs::frame_average_batch_t& m) {
  if (m.count <= 0) return;
  span(m.first_mono_ns.front(), m.last_mono_ns.back());
  count_averages(frames, m);
  for (std::size_t i = 0; i < static_cast<std::size_t>(m.count); ++i) {
    const double t = seconds(middle_ns(m, i)), n = m.samples[i];
    force_N.add(t, m.min_force_N[i], m.max_force_N[i], m.mean_force_N[i], n);
    position_mm.add(t, m.min_position_mm[i], m.max_position_mm[i], m.mean_position_mm[i], n);
  }
}

void RunEvidence::pressure(const isorig_msgs::pressure_batch_t& m) {
  if (m.count <= 0) return;
  span(m.mono_ns, m.mono_ns + m.mono_offset_ns.back());
  pressures.full += static_cast<std::uint64_t>(m.count);
  bounds(pressures, m);
  for (std::size_t i = 0; i < static_cast<std::size_t>(m.count); ++i) {
    if (m.status[i] != 0) {
      ++not_measured;
      continue;
    }
    pressure_psi.add(seconds(m.mono_ns + m.mono_offset_ns[i]), m.pressure_psi[i]);
    temperature(m.temperature_C[i]);
  }
}

void RunEvidence::pressure_average(const isorig_msgs::pressure_average_batch_t& m) {
  if (m.count <= 0) return;
  span(m.first_mono_ns.front(), m.last_mono_ns.back());
  count_averages(pressures, m);
  for (std::size_t i = 0; i < static_cast<std::size_t>(m.count); ++i) {
    not_measured += static_cast<std::uint64_t>(std::max(0, m.samples[i] - m.current[i]));
    if (m.current[i] <= 0) continue;
    pressure_psi.add(seconds(middle_ns(m, i)), m.min_pressure_psi[i], m.max_pressure_psi[i], m.mean_pressure_psi[i],
                     m.current[i]);
    temperature(m.mean_temperature_C[i]);
  }
}

void RunEvidence::control(const isorig_msgs::control_batch_t& m) {
  for (std::size_t i = 0; i < static_cast<std::size_t>(m.count); ++i) {
    const auto& c = m.samples[i];
    span(c.mono_ns, c.mono_ns);
    overruns = std::max(overruns, c.overruns);
    worst_wakeup_ns = std::max(worst_wakeup_ns, c.worst_wakeup_ns);
    worst_run_ns = std::max(worst_run_ns, c.worst_run_ns);
    setpoint_psi.add(seconds(c.mono_ns), double{c.setpoint_psi});
  }
}

void RunEvidence::sync(const isorig_msgs::sync_check_t& m) {
  ++sync_edges;
  if (m.within == 0) ++sync_outside;
  if (std::isfinite(m.error_us)) sync_worst_us = std::max(sync_worst_us, std::abs(m.error_us));
}

bool RunEvidence::simulated() const {
  if (last_header.virtual_time != 0) return true;
  try {
    const auto rig = toml::parse(text("rig.toml"));
    return rig["emulated"].value_or(false) || rig["frame"]["driver"].value_or(std::string()) == "sim";
  } catch (const toml::parse_error&) {
    return false;
  }
}

std::string RunEvidence::text(std::string_view name) const {
  for (const auto& t : last_header.texts)
    if (t.name == name) return t.text;
  return {};
}

}  // namespace isorig::cli
