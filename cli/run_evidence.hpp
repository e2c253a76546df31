#pragma once
#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "identify/report/long_signal.hpp"
#include "messages/run_log.hpp"

namespace isorig::cli {

/// What a recording says about its run, in one pass, for the run's page. Times are seconds from the first message that
/// has one.
struct RunEvidence : messages::RunVisitor {
  struct Stream {
    std::uint64_t full = 0;
    std::uint64_t averaged = 0;
    std::uint64_t intervals = 0;
    double worst_bound_us = 0.0;
  };

  void header(const isorig_msgs::run_header_t& h) override { last_header = h; }
  void session(const isorig_msgs::session_mark_t& m) override;
  void frame(const isorig_msgs::frame_batch_t& m) override;
  void pressure(const isorig_msgs::pressure_batch_t& m) override;
  void frame_average(const isorig_msgs::frame_average_batch_t& m) override;
  void pressure_average(const isorig_msgs::pressure_average_batch_t& m) override;
  void control(const isorig_msgs::control_batch_t& m) override;
  void event(const isorig_msgs::event_t& m) override { events.push_back(m); }
  void exchanges(const isorig_msgs::exchange_batch_t& m) override {
    exchange_count += static_cast<std::uint64_t>(m.count);
  }
  void sync(const isorig_msgs::sync_check_t& m) override;

  [[nodiscard]] double seconds(std::int64_t mono_ns) const noexcept {
    return static_cast<double>(mono_ns - origin_ns) * 1e-9;
  }
  [[nodiscard]] double duration_s() const noexcept { return seconds(last_ns); }
  /// No sample is of a real specimen: in virtual time, with a driver "sim", or with devices that are emulated.
  [[nodiscard]] bool simulated() const;
  /// An input file as it was recorded; empty when there is none of that name.
  [[nodiscard]] std::string text(std::string_view name) const;

  isorig_msgs::run_header_t last_header{};
  std::vector<isorig_msgs::session_mark_t> marks;  ///< begins and ends
  std::vector<isorig_msgs::event_t> events;
  std::map<std::int32_t, isorig_msgs::session_mark_t> lost;  ///< counts up to the last end of each attempt
  std::int64_t origin_ns = 0, last_ns = 0;
  Stream frames, pressures;
  std::uint64_t not_measured = 0;  ///< pressure samples with a stale or faulty word
  std::uint64_t exchange_count = 0;
  std::int64_t overruns = 0;
  std::int32_t worst_wakeup_ns = 0, worst_run_ns = 0;
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
