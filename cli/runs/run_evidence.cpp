#include "cli/runs/run_evidence.hpp"

#include <toml++/toml.h>

#include <algorithm>
#include <cmath>

namespace isorig::cli {
namespace {

template <typename Message>
std::int64_t middle_ns(const Message& m, std::size_t i) {
  return m.first_mono_ns[i] + (m.last_mono_ns[i] - m.first_mono_ns[i]) / 2;
}

}  // namespace

void RunEvidence::span(std::int64_t from_ns, std::int64_t to_ns) {
  from_ns = rig_ns(from_ns);
  to_ns = rig_ns(to_ns);
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
  daemon::RunTally::session(m);
  if (m.kind != isorig_msgs::session_mark_t::CONTINUE) span(m.mono_ns, m.mono_ns);
}

void RunEvidence::frame(const isorig_msgs::frame_batch_t& m) {
  daemon::RunTally::frame(m);
  if (m.count <= 0) return;
  span(m.mono_ns, m.mono_ns + m.mono_offset_ns.back());
  for (std::size_t i = 0; i < static_cast<std::size_t>(m.count); ++i) {
    const double t = seconds(rig_ns(m.mono_ns + m.mono_offset_ns[i]));
    force_N.add(t, m.force_N[i]);
    position_mm.add(t, m.position_mm[i]);
  }
}

void RunEvidence::frame_average(const isorig_msgs::frame_average_batch_t& m) {
  daemon::RunTally::frame_average(m);
  if (m.count <= 0) return;
  span(m.first_mono_ns.front(), m.last_mono_ns.back());
  for (std::size_t i = 0; i < static_cast<std::size_t>(m.count); ++i) {
    const double t = seconds(rig_ns(middle_ns(m, i))), n = m.samples[i];
    force_N.add(t, m.min_force_N[i], m.max_force_N[i], m.mean_force_N[i], n);
    position_mm.add(t, m.min_position_mm[i], m.max_position_mm[i], m.mean_position_mm[i], n);
  }
}

void RunEvidence::pressure(const isorig_msgs::pressure_batch_t& m) {
  daemon::RunTally::pressure(m);
  if (m.count <= 0) return;
  span(m.mono_ns, m.mono_ns + m.mono_offset_ns.back());
  for (std::size_t i = 0; i < static_cast<std::size_t>(m.count); ++i) {
    if (m.status[i] != 0) {
      ++not_measured;
      continue;
    }
    pressure_psi.add(seconds(rig_ns(m.mono_ns + m.mono_offset_ns[i])), m.pressure_psi[i]);
    temperature(m.temperature_C[i]);
  }
}

void RunEvidence::pressure_average(const isorig_msgs::pressure_average_batch_t& m) {
  daemon::RunTally::pressure_average(m);
  if (m.count <= 0) return;
  span(m.first_mono_ns.front(), m.last_mono_ns.back());
  for (std::size_t i = 0; i < static_cast<std::size_t>(m.count); ++i) {
    not_measured += static_cast<std::uint64_t>(std::max(0, m.samples[i] - m.current[i]));
    if (m.current[i] <= 0) continue;
    pressure_psi.add(seconds(rig_ns(middle_ns(m, i))), m.min_pressure_psi[i], m.max_pressure_psi[i],
                     m.mean_pressure_psi[i], m.current[i]);
    temperature(m.mean_temperature_C[i]);
  }
}

void RunEvidence::control(const isorig_msgs::control_batch_t& m) {
  daemon::RunTally::control(m);
  for (std::size_t i = 0; i < static_cast<std::size_t>(m.count); ++i) {
    const auto& c = m.samples[i];
    span(c.mono_ns, c.mono_ns);
    setpoint_psi.add(seconds(rig_ns(c.mono_ns)), double{c.setpoint_psi});
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

}  // namespace isorig::cli
