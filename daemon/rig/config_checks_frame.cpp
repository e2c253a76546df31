#include "daemon/rig/config_checks_frame.hpp"

#include <cmath>
#include <variant>

#include "base/overloaded.hpp"
#include "daemon/core/seconds.hpp"
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

constexpr const char* kOneAnswer = "below frame_age_max_s, so that one lost answer is no safe state";

void check_frame(const modbus::ModbusConfig& c, const RigConfig& rig, const Keys& k) {
  k.at_most("response_timeout_ms", c.response_timeout_ms, 0.99e3 * rig.core.supervisor.frame_age_max_s, "ms",
            kOneAnswer);
  k.range("connect_timeout_ms", c.connect_timeout_ms, 1.0, 5'000.0, "ms", "nothing else is done meanwhile");
  k.range("start_confirm_ms", c.start_confirm_ms, 1.0, 2'000.0, "ms",
          "so long a frame that did not start is not noticed");
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

void check_full_scale(const RigConfig& rig, const Keys& limits) {
  std::visit(base::Overloaded{[](const RigConfig::SimulatedFrame&) {}, [](const modbus::ModbusConfig&) {},
                              [&](const frame::Instron8800Config& c) { check_full_scale(c, rig.limits, limits); }},
             rig.frame);
}

void check_frame(const RigConfig& rig, const Keys& k, const Watchdogs& dogs) {
  std::visit(base::Overloaded{[](const RigConfig::SimulatedFrame&) {},
                              [&](const modbus::ModbusConfig& c) { check_frame(c, rig, k); },
                              [&](const frame::Instron8800Config& c) { check_frame(c, rig, k, dogs); }},
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
  const auto sim = root.table_if("sim");
  if (!sim || !(rig.simulated() || rig.emulated)) return dogs;
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
  dogs.frame_s = read(frame_watchdog.table, frame_watchdog.key, frame_watchdog.unless_said_s);
  dogs.pressure_s = read("pressure", "watchdog_s", dogs.pressure_s);
  return dogs;
}

}  // namespace isorig::daemon
