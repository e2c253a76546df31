#include "daemon/rig/config_checks_frame.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <variant>

#include "base/overloaded.hpp"
#include "daemon/core/seconds.hpp"
#include "daemon/core/standstill.hpp"
#include "daemon/core/supervisor.hpp"
#include "daemon/rig/config.hpp"

/// What of a rig's file depends on the kind of its frame.
namespace isorig::daemon {
namespace {

void check_full_scale(const frame::Instron8800Config& c, const protocol::Limits& l, const Keys& k) {
  if (c.force_full_scale_N > 0.0) {
    k.at_most("force_max_N", l.force_max_N, c.force_full_scale_N, "N",
              "the load cell ends at force_full_scale_N, so the limit could not trip");
    k.at_least("force_min_N", l.force_min_N, -c.force_full_scale_N, "N",
               "the load cell ends at force_full_scale_N, so the limit could not trip");
  }
  if (c.position_full_scale_mm > 0.0) {
    k.at_most("travel_max_mm", l.travel_max_mm, c.position_full_scale_mm, "mm",
              "the frame ends at position_full_scale_mm");
    k.at_least("travel_min_mm", l.travel_min_mm, -c.position_full_scale_mm, "mm",
               "the frame ends at position_full_scale_mm");
  }
}

using base::number_text;

constexpr const char* kOneAnswer = "below frame_age_max_s, so that one lost answer is no safe state";

void check_frame(const modbus::ModbusConfig& c, const RigConfig& rig, const Keys& k) {
  k.at_most("response_timeout_ms", c.response_timeout_ms, 0.99e3 * rig.core.supervisor.frame_age_max_s, "ms",
            kOneAnswer);
  k.range("connect_timeout_ms", c.connect_timeout_ms, 1.0, 5'000.0, "ms", "nothing else is done meanwhile");
  k.range("start_confirm_ms", c.start_confirm_ms, 1.0, 2'000.0, "ms",
          "so long a frame that did not start is not noticed");
}

void check_stop(const frame::Instron8800Config& c, const RigConfig& rig, const Keys& k, const Keys& supervisor,
                double answers_in_s) {
  const double answer_s = std::max(1e-3 * c.answer_ms, answers_in_s);
  const auto line = frame::times_of(c, answer_s);
  const std::string where =
      "on this line, at " + number_text(1e3 * line.value_s, 3) + " ms a value (gap_us = " + std::to_string(c.gap_us) +
      (c.tcp ? "" : ", baud = " + std::to_string(c.baud)) + ", answer_ms = " + number_text(1e3 * answer_s, 3) + "), ";
  const double confirmed_s = stop_confirmed_s(line);
  if (!(confirmed_s <= kLongestStopConfirm_s)) {
    k.wrong("gap_us",
            where +
                (std::isfinite(confirmed_s)
                     ? "a stop is seen to stand after " + number_text(confirmed_s, 3) +
                           " s, and stop_confirm_max_s is " + number_text(kLongestStopConfirm_s) + " s at most"
                     : "samples are too far apart to say whether the crosshead stands") +
                ": a shorter gap, or a faster line");
    return;
  }
  k.at_least(
      "response_timeout_ms", c.response_timeout_ms, std::ceil(1e3 * line.confirms_s), "ms",
      where + "the driver's questions after a stop begin afresh when it is over, and would never come to an end");
  supervisor.at_least("stop_confirm_max_s", rig.core.supervisor.stop_confirm_max_s, std::ceil(1e2 * confirmed_s) / 1e2,
                      "s", where + "a stop is seen to stand only then, and would be the fault frame.stop before");
  k.at_least("stop_confirm_ms", c.stop_confirm_ms, std::ceil(1e3 * line.confirms_s), "ms",
             where + "the driver sees a stop only then, and would switch the actuator off before");
}

void check_frame(const frame::Instron8800Config& c, const RigConfig& rig, const Keys& k, const Watchdogs& dogs) {
  k.at_most("response_timeout_ms", c.response_timeout_ms, 0.99e3 * rig.core.supervisor.frame_age_max_s, "ms",
            kOneAnswer);
  k.range("give_up_ms", c.give_up_ms, 100.0, 60'000.0, "ms", "nothing else is asked meanwhile");
  k.range("gap_us", c.gap_us, 0.0, 100'000.0, "us", "the controller would be polled too rarely for frame_age_max_s");
  k.range("reading_age_max_ms", c.reading_age_max_ms, 0.0, 100.0, "ms", "older readings are not of this moment");
  k.range("in_position_mm", c.in_position_mm, 1e-4, 1.0, "mm", "a target that far off is not reached");
  k.range("start_confirm_ms", c.start_confirm_ms, 1.0, 2'000.0, "ms",
          "so long a frame that did not start is not noticed");
  k.range("stop_confirm_ms", c.stop_confirm_ms, 10.0, 3'000.0, "ms",
          "so long a crosshead that did not stop goes on before the actuator is switched off");
  k.range("heartbeat_timeout_ms", c.heartbeat_timeout_ms, 50.0, 1e3 * dogs.frame_s, "ms",
          "the controller's watchdog acts then");
  k.at_least("heartbeat_timeout_ms", c.heartbeat_timeout_ms, 3e3 * seconds(rig.services.heartbeat_period_ns), "ms",
             "three times [services] heartbeat_period_ms, or a single late heartbeat stops the crosshead");
  k.range("watchdog_feed_ms", c.watchdog_feed_ms, 50.0, 1e3 * dogs.frame_s / 3.0, "ms",
          "three times within the controller's watchdog, so that one late turn does not let it act");
}

}  // namespace

double stop_confirmed_s(const frame::Instron8800Times& line) noexcept {
  constexpr double kLoop_s = 0.005;  // from the last sample to the loop's next look at the frame's report
  if (!line.gives_samples) return std::numeric_limits<double>::infinity();
  return line.confirms_after_request_s + line.first_sample_s + Standstill::tells_after_s(line.round_s) + kLoop_s;
}

void check_full_scale(const RigConfig& rig, const Keys& limits) {
  std::visit(base::Overloaded{[](const RigConfig::SimulatedFrame&) {}, [](const modbus::ModbusConfig&) {},
                              [&](const frame::Instron8800Config& c) { check_full_scale(c, rig.limits, limits); }},
             rig.frame);
}

void check_frame(const RigConfig& rig, const Keys& k, const Keys& supervisor, const Watchdogs& dogs) {
  std::visit(base::Overloaded{[](const RigConfig::SimulatedFrame&) {},
                              [&](const modbus::ModbusConfig& c) { check_frame(c, rig, k); },
                              [&](const frame::Instron8800Config& c) {
                                check_frame(c, rig, k, dogs);
                                check_stop(c, rig, k, supervisor, dogs.frame_answer_s);
                              }},
             rig.frame);
}

Watchdogs watchdogs_of(const RigConfig& rig, const base::TomlTable& root) {
  Watchdogs dogs;
  struct Source {
    const char* table;
    const char* key;
    double unless_said_s;
  };
  // In [sim], of the emulator that plays such a frame.
  const auto frame_watchdog = std::visit(base::Overloaded{[&](const RigConfig::SimulatedFrame&) {
                                                            return Source{"frame", "heartbeat_timeout_s", dogs.frame_s};
                                                          },
                                                          [&](const modbus::ModbusConfig&) {
                                                            return Source{"frame", "heartbeat_timeout_s", dogs.frame_s};
                                                          },
                                                          [&](const frame::Instron8800Config&) {
                                                            dogs.frame_s = 1.0;
                                                            return Source{"controller", "watchdog_s", 3.0};
                                                          }},
                                         rig.frame);
  if (!rig.simulated() && !rig.emulated) {
    dogs.pressure_s = kTeensyWatchdog_s;
    return dogs;
  }
  const auto sim = root.table_if("sim");
  if (!sim) return dogs;
  // Of an emulator on the wire the rest is that program's own; of a simulated rig all has been read.
  if (!rig.simulated()) sim->ignore_rest();
  // The readers of [sim] judge these numbers; whatever is wrong with them is said there.
  const auto read = [&](const char* table, const char* key, double fallback) {
    const auto t = sim->table_if(table);
    if (!t || !t->has(key) || (t->type_of(key) != "float" && t->type_of(key) != "integer")) return fallback;
    if (!rig.simulated()) t->ignore_rest();
    const double value = t->number_or(key, fallback);
    return std::isfinite(value) && value > 0.0 ? value : fallback;
  };
  if (std::holds_alternative<frame::Instron8800Config>(rig.frame))
    dogs.frame_answer_s = 1e-6 * read("controller", "answer_us", 0.0);
  dogs.frame_s = read(frame_watchdog.table, frame_watchdog.key, frame_watchdog.unless_said_s);
  dogs.pressure_s = read("pressure", "watchdog_s", dogs.pressure_s);
  return dogs;
}

}  // namespace isorig::daemon
