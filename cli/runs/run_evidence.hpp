#pragma once
#include <cstdint>

#include "daemon/recording/run_tally.hpp"
#include "identify/report/long_signal.hpp"

namespace isorig::cli {

/// What a run's page is drawn from: the tally, and the signals over the whole run. Times are seconds from the first
/// message that has one; a session's begin mark and the loop's first state come before the first sample.
struct RunEvidence : daemon::RunTally {
  void session(const isorig_msgs::session_mark_t& m) override;
  void frame(const isorig_msgs::frame_batch_t& m) override;
  void pressure(const isorig_msgs::pressure_batch_t& m) override;
  void frame_average(const isorig_msgs::frame_average_batch_t& m) override;
  void pressure_average(const isorig_msgs::pressure_average_batch_t& m) override;
  void control(const isorig_msgs::control_batch_t& m) override;
  void sync(const isorig_msgs::sync_check_t& m) override;

  /// Of a rig time (RunTally).
  [[nodiscard]] double seconds(std::int64_t rig_ns) const noexcept {
    return static_cast<double>(rig_ns - origin_ns) * 1e-9;
  }
  [[nodiscard]] double duration_s() const noexcept { return seconds(last_ns); }
  /// No sample is of a real specimen: in virtual time, with a driver "sim", or with devices that are emulated.
  [[nodiscard]] bool simulated() const;

  std::int64_t origin_ns = 0, last_ns = 0;
  std::uint64_t not_measured = 0;  ///< pressure samples with a stale or faulty word
  std::uint64_t sync_edges = 0, sync_outside = 0;
  double sync_worst_us = 0.0;
  double coldest_C = 0.0, warmest_C = 0.0;
  bool has_temperature = false;
  identify::report::LongSignal force_N{0.01}, position_mm{0.01}, pressure_psi{0.01}, setpoint_psi{0.01};

 private:
  void span(std::int64_t from_ns, std::int64_t to_ns);
  void temperature(float value_C);
  bool begun_ = false;
};

}  // namespace isorig::cli
