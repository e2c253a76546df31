#pragma once
#include <algorithm>
#include <cstdint>
#include <limits>
#include <map>

#include "messages/run_log.hpp"

/// How a recording ends: what crosshead and actuator did at the last.
namespace isorig::system_test {

class LastState : public messages::RunVisitor {
 public:
  void frame(const isorig_msgs::frame_batch_t& m) override {
    for (std::size_t i = 0; i < static_cast<std::size_t>(m.count); ++i)
      position_.add(m.mono_ns + m.mono_offset_ns[i], m.position_mm[i], m.position_mm[i]);
  }
  void frame_average(const isorig_msgs::frame_average_batch_t& m) override {
    for (std::size_t i = 0; i < static_cast<std::size_t>(m.count); ++i)
      position_.add(m.last_mono_ns[i], m.min_position_mm[i], m.max_position_mm[i]);
  }
  void pressure(const isorig_msgs::pressure_batch_t& m) override {
    for (std::size_t i = 0; i < static_cast<std::size_t>(m.count); ++i)
      pressure_.add(m.mono_ns + m.mono_offset_ns[i], m.pressure_psi[i], m.pressure_psi[i]);
  }
  void pressure_average(const isorig_msgs::pressure_average_batch_t& m) override {
    for (std::size_t i = 0; i < static_cast<std::size_t>(m.count); ++i)
      pressure_.add(m.last_mono_ns[i], m.min_pressure_psi[i], m.max_pressure_psi[i]);
  }

  [[nodiscard]] double peak_psi() const { return pressure_.within(1e9).high; }
  [[nodiscard]] double last_psi() const { return pressure_.within(0.0).low; }
  [[nodiscard]] double last_mm() const { return position_.within(0.0).low; }
  /// What the crosshead went through in the last `last_s`.
  [[nodiscard]] double travel_mm(double last_s) const {
    const auto range = position_.within(last_s);
    return range.high - range.low;
  }

 private:
  struct Range {
    double low = std::numeric_limits<double>::infinity(), high = -std::numeric_limits<double>::infinity();
  };
  struct Channel {
    std::map<std::int64_t, Range> rows;  ///< by their end
    void add(std::int64_t at_ns, double low, double high) { rows[at_ns] = {low, high}; }
    [[nodiscard]] Range within(double last_s) const {
      Range all;
      if (rows.empty()) return all;
      const auto from = static_cast<double>(rows.rbegin()->first) - 1e9 * last_s;
      for (auto row = rows.rbegin(); row != rows.rend() && static_cast<double>(row->first) >= from; ++row) {
        all.low = std::min(all.low, row->second.low);
        all.high = std::max(all.high, row->second.high);
      }
      return all;
    }
  };
  Channel position_, pressure_;
};

}  // namespace isorig::system_test
