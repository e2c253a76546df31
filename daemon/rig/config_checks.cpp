#include "daemon/rig/config_checks.hpp"

#include <sys/un.h>

#include <algorithm>
#include <cmath>
#include <sstream>
#include <string>
#include <string_view>
#include <vector>

#include "base/formatted.hpp"
#include "base/number_text.hpp"
#include "daemon/core/seconds.hpp"
#include "daemon/core/valve_flow.hpp"
#include "daemon/rig/config.hpp"
#include "daemon/rig/config_checks_frame.hpp"
#include "messages/elvh.hpp"

namespace isorig::daemon {
namespace {

using base::number_text;
using base::TomlTable;

constexpr double kLeakMostShare = 0.15;  // of the full fill rate

void check_travel_and_force(const RigConfig& rig, const Keys& k) {
  const auto& l = rig.limits;
  k.range("travel_min_mm", l.travel_min_mm, -2000.0, 0.0, "mm",
          "the position is counted from the specimen's rest length, and no frame of this kind travels further");
  k.range("travel_max_mm", l.travel_max_mm, 0.0, 2000.0, "mm",
          "the position is counted from the specimen's rest length, and no frame of this kind travels further");
  if (k.has("travel_min_mm") && k.has("travel_max_mm")) {
    k.at_least("travel_max_mm", l.travel_max_mm, l.travel_min_mm + 0.01, "mm",
               "above travel_min_mm, or nothing may move");
  }
  k.range("speed_max_mm_s", l.speed_max_mm_s, 0.001, 500.0, "mm/s", "faster than any frame that this drives");
  k.range("speed_min_mm_s", l.speed_min_mm_s, 0.0, l.speed_max_mm_s, "mm/s", "below speed_max_mm_s");
  k.range("force_min_N", l.force_min_N, -1e5, 0.0, "N",
          "tension is positive and a slack specimen cannot push; beyond any load cell of such a frame the limit cannot "
          "trip");
  k.range("force_max_N", l.force_max_N, 0.01, 1e5, "N", "beyond any load cell of such a frame the limit cannot trip");
  if (k.has("force_rate_max_N_s")) {
    const double window_s = rig.core.supervisor.force_rate_window_s;
    k.range("force_rate_max_N_s", l.force_rate_max_N_s, 1e-3, (l.force_max_N - l.force_min_N) / window_s, "N/s",
            "above that the force limits trip first, within force_rate_window_s = " + number_text(window_s) + " s");
  }
  k.range("segment_interval_min_s", l.segment_interval_min_s, std::max(0.002, seconds(rig.services.poll_period_ns)),
          10.0, "s", "a segment takes at least one turn of poll_period_ms");
}

// Three times the sensor's total error band of 0.3 psi, and noise: below that a reading at the end of its range does
// not exceed the limit for certain.
constexpr double kHeadRoom_psi = 1.0;

/// What the sensor reads at the end of its range.
double top_pressure_psi(const Calibration& c) {
  return c.pressure_scale * messages::kElvhSpanPsi + c.pressure_offset_psi;
}

void check_pressure_limits(const RigConfig& rig, const Keys& k) {
  const double top_psi = top_pressure_psi(rig.core.calibration);
  k.range("pressure_max_psi", rig.limits.pressure_max_psi, 0.1, top_psi - kHeadRoom_psi, "psi",
          "the sensor's range ends at " + number_text(top_psi) +
              " psi as [calibration] has it, and limit.pressure has to trip before");
  k.range("pressure_rate_max_psi_s", rig.limits.pressure_rate_max_psi_s, 0.01, 200.0, "psi/s",
          "no valve of this kind fills faster, so the limit would be none");
}

struct CalibrationRange {
  const char* key;
  double value, low, high;
  const char* unit;
  std::string why;
};

std::vector<CalibrationRange> calibration_ranges(const RigConfig& rig) {
  const auto& c = rig.core.calibration;
  const auto scale = [](const char* key, double value, const char* negative) {
    const std::string why = std::string("a channel that is off by more is wired, mapped or read wrong; ") + negative;
    return CalibrationRange{key, value, 0.5, 2.0, "", why};
  };
  const double force_N = rig.limits.force_max_N - rig.limits.force_min_N;
  return {
      scale("position_scale", c.position_scale,
            "a negative scale turns every motion round: correct the sign in the frame's register map"),
      scale("force_scale", c.force_scale,
            "a negative scale turns tension into compression, and force_max_N no longer protects: correct the sign in "
            "the frame"),
      scale("pressure_scale", c.pressure_scale, "a negative scale makes the loop fill when it has to vent"),
      {"position_offset_mm", c.position_offset_mm, -2000.0, 2000.0, "mm", "no frame of this kind travels further"},
      {"force_offset_N", c.force_offset_N, -force_N, force_N, "N",
       "a larger one leaves no force within force_min_N to force_max_N"},
      {"pressure_offset_psi", c.pressure_offset_psi, -2.0, 2.0, "psi",
       "the sensor's total error band is 0.3 psi; one that is off by more is broken"},
  };
}

void check_calibration(const RigConfig& rig, const Keys& k) {
  for (const auto& r : calibration_ranges(rig)) k.range(r.key, r.value, r.low, r.high, r.unit, r.why);
}

void check_supervisor(const RigConfig& rig, const Keys& k, const Watchdogs& dogs) {
  const auto& s = rig.core.supervisor;
  const std::string frame_dog =
      "after that the frame's own watchdog has stopped it, and what the daemon does comes too late";
  const std::string valve_dog =
      "after that the pressure device's own watchdog has vented it, and what the daemon does comes too late";
  // Of an emulated rig at least this: nobody can be hurt, and its processor is not its own.
  const double patience_s = rig.simulated() || rig.emulated ? 3.0 : 0.0;
  k.range("frame_age_max_s", s.frame_age_max_s, 0.01, std::max(patience_s, dogs.frame_s), "s", frame_dog);
  k.range("pressure_age_max_s", s.pressure_age_max_s, 0.01, std::max(patience_s, dogs.pressure_s), "s", valve_dog);
  k.range("interlock_age_max_s", s.interlock_age_max_s, 0.02, std::max(patience_s, 1.0), "s",
          "so long an emergency stop may go unseen");
  k.range("late_tick_max_s", s.late_tick_max_s, 0.005, std::max(patience_s, std::min(dogs.frame_s, dogs.pressure_s)),
          "s", "a loop that is later sends no heartbeat, and the devices stop by themselves");
  k.range("following_error_max_mm", s.following_error_max_mm, 0.01, 5.0, "mm",
          "a crosshead that is further from its segment does something else than it was told");
  k.range("following_error_min_mm", s.following_error_min_mm, 0.01, s.following_error_max_mm, "mm",
          "the narrower of the two stages: wider than following_error_max_mm it is none");
  k.range("standstill_max_mm", s.standstill_max_mm, 0.005, 0.5, "mm",
          "a stopped crosshead that is further from its place moves");
  k.range("segment_ack_max_s", s.segment_ack_max_s, 0.02, std::max(patience_s, 1.5), "s",
          "so long a frame may stand, or go on, without anybody knowing whether it took the segment");
  k.range("frozen_force_max_s", s.frozen_force_max_s, 0.05, 5.0, "s",
          "so long a dead load cell may go unseen while the crosshead moves");
  if (!rig.simulated() && !rig.emulated) {
    const double travel_mm = rig.limits.travel_max_mm - rig.limits.travel_min_mm;
    const double unseen_mm = rig.limits.speed_max_mm_s * s.frame_age_max_s;
    if (k.has("frame_age_max_s") && unseen_mm > travel_mm) {
      k.at_most("frame_age_max_s", s.frame_age_max_s, travel_mm / rig.limits.speed_max_mm_s, "s",
                "at speed_max_mm_s the crosshead runs through its whole travel without being seen");
    }
  }
}

void check_services(const RigConfig& rig, const Keys& k, const Watchdogs& dogs) {
  const auto& c = rig.services;
  const double shortest_s = std::min(dogs.frame_s, dogs.pressure_s);
  const std::string third = "a third of the shortest device watchdog (" + number_text(shortest_s) +
                            " s), so that one late heartbeat does not stop the rig";
  const double heartbeat_ms = 1e3 * seconds(c.heartbeat_period_ns);
  k.range("heartbeat_period_ms", heartbeat_ms, 5.0, 1e3 * shortest_s / 3.0, "ms", third);
  if (!k.has("heartbeat_period_ms"))
    k.at_most("heartbeat_period_ms", heartbeat_ms, 1e3 * shortest_s / 3.0, "ms", third);
  if (rig.simulated() && rig.sim)
    k.at_most("heartbeat_period_ms", heartbeat_ms, 0.5 * rig.sim->pressure.command_validity_ms, "ms",
              "half of [sim.pressure] command_validity_ms: commands are repeated every heartbeat_period_ms, and valves "
              "that fall shut between two cannot regulate");
  k.range("poll_period_ms", 1e3 * seconds(c.poll_period_ns), 1.0,
          1e3 * std::min(0.05, rig.core.supervisor.frame_age_max_s / 3.0), "ms",
          "limits are judged on what was polled, three times within frame_age_max_s");
  k.range("sync_period_ms", 1e3 * seconds(c.sync_period_ns), 50.0, 5'000.0, "ms",
          "a device's clock drifts out of its bound meanwhile");
}

void check_teensy(const RigConfig& rig, const Keys& k, const Watchdogs& dogs) {
  if (!rig.teensy) return;
  const double refresh_ms = 1e3 * seconds(rig.services.heartbeat_period_ns);
  const double validity_ms = rig.teensy->options.command_validity_ms;
  k.at_least("command_validity_ms", validity_ms, 2.0 * refresh_ms, "ms",
             "commands are repeated every heartbeat_period_ms, and valves that fall shut between two cannot regulate");
  k.range("command_validity_ms", validity_ms, 20.0, 1e3 * dogs.pressure_s, "ms",
          "the last command of a dead daemon stays in force so long");
  k.range("connect_timeout_s", seconds(rig.teensy->options.connect_timeout_ns), 0.1, 10.0, "s",
          "nothing else is done meanwhile");
}

void check_loop(const RigConfig& rig, const Keys& k) {
  const auto& c = rig.core.pressure_loop;
  k.range("supply_psi", c.supply_psi, rig.limits.pressure_max_psi, 150.0, "psi",
          "below pressure_max_psi it could not be reached; above, it is no supply for these valves, and the loop "
          "reckons its duties with it");
  // A 1.5 mm valve fills 50 mL at 300 psi/s, which is 5 1/s; what is faster in the file makes the guard blind.
  k.range("fill_gain_per_s", c.fill_gain_per_s, 1e-3, 5.0, "1/s", "C * 1 bar / V of such a rig; see docs/config.md");
  k.range("vent_gain_per_s", c.vent_gain_per_s, 1e-3, 5.0, "1/s", "C * 1 bar / V of such a rig; see docs/config.md");
  const double full_psi_s = c.fill_gain_per_s * (c.supply_psi + kAtmospherePsi);
  k.range(
      "leak_max_psi_s", c.leak_bound_psi_s(), 1e-4, kLeakMostShare * full_psi_s, "psi/s",
      "three twentieths of what the full fill valve gives: a leak that large is a fault, and a reading that lies in a "
      "hold is found by it");
  k.range("motion_max_psi_per_mm", c.motion_bound_psi_mm(), 1e-3, 1.5, "psi/mm",
          "a millimetre of so short an actuator changes its volume by a twentieth; what the crosshead may explain, a "
          "reading "
          "that lies may hide behind");
  k.range("response_min", c.response_min, 0.1, 1.0, "",
          "a chamber ten times as large as the gains say needs other gains, not a guard that looks away");
  k.range("allowance_psi", c.allowance_psi, 0.02, 1.0, "psi", "a sensor with more noise is broken");
  k.range("dead_zone_psi", c.dead_zone_psi, 0.002, 0.1, "psi",
          "below a count of the sensor an error that never changes winds the integral up");
  k.range("proportional_per_s", c.proportional_per_s, 0.1, 40.0, "1/s",
          "with 10 ms of dead time the loop oscillates above");
  k.range("integral_time_s", c.integral_time_s, 0.05, 60.0, "s",
          "shorter, the loop oscillates; longer, an offset stays");
  k.range("rate_limit_psi_s", c.rate_limit_psi_s, 0.01, 200.0, "psi/s", "no valve of this kind fills faster");
  k.range("feedforward_psi_per_mm", c.feedforward_psi_per_mm, -5.0, 5.0, "psi/mm",
          "a millimetre changes the volume of an actuator by a few per cent");
  k.range("minimum_duty", c.minimum_duty, 0.0, 0.3, "", "smaller commands are shut, and the loop would hunt");
  k.range("settled_tolerance_psi", c.settled_tolerance_psi, 0.01, 2.0, "psi",
          "a set-point that far off is not reached");
  k.range("unreachable_error_psi", c.unreachable_error_psi, 0.05, 5.0, "psi", "so far off a leak would go unseen");
  k.range("unreachable_after_s", c.unreachable_after_s, 0.1, 30.0, "s", "so long the fill valve may blow into a leak");
}

void check_operator(const RigConfig& rig, const Keys& k) {
  const double force_N = rig.limits.force_max_N - rig.limits.force_min_N;
  k.range("jog_force_max_N", rig.core.operating.jog_force_max_N, 0.01, 0.5 * force_N, "N",
          "half of the range between the force limits: a person stands at the grips in set-up");
}

void check_regulator(const RigConfig& rig, const Keys& k) {
  if (!rig.regulator) return;
  const auto& s = rig.core.supervisor;
  k.range("max_psi", rig.regulator->max_psi, 0.1, rig.limits.pressure_max_psi, "psi",
          "no set-point may lie above [limits] pressure_max_psi");
  k.range("age_max_s", s.regulator_age_max_s, 0.02, 2.0, "s",
          "so long a regulator that is gone keeps its last set-point unseen");
  k.range("error_max_psi", s.regulator_error_max_psi, 0.05, 3.0, "psi",
          "the two sensors' error bands together are below one");
  k.range("setpoint_tolerance_psi", rig.regulator->setpoint_tolerance_psi, 1e-4, 0.5, "psi",
          "a set-point that far off is another one");
  k.at_most("poll_period_ms", 1e3 * seconds(rig.regulator_period_ns), 1e3 * s.regulator_age_max_s / 3.0, "ms",
            "three times within age_max_s");
  k.at_most("response_timeout_ms", rig.regulator->line.response_timeout_ms, 0.99e3 * s.regulator_age_max_s, "ms",
            "below age_max_s, so that one lost answer is no safe state");
}

void check_recorder(const RigConfig& rig, const Keys& k) {
  const auto& r = rig.recording;
  k.range("sync_interval_s", r.sync_interval_s, 0.1, 10.0, "s", "what is younger is lost with the power");
  k.range("min_free_MiB", static_cast<double>(r.min_free_bytes) / kMiB, 8.0, 1e6, "MiB",
          "a minute and a half at full rate, to stop in");
  k.range("reserve_MiB", static_cast<double>(r.reserve_bytes) / kMiB, 1.0,
          std::max(1.0, static_cast<double>(r.min_free_bytes) / kMiB), "MiB", "it is taken out of min_free_MiB");
  k.range("max_segment_MiB", static_cast<double>(r.max_segment_bytes) / kMiB, 1.0, 4096.0, "MiB",
          "a damaged file costs that much");
}

/// LCM is for this machine; what leaves it is everybody's on that network.
void check_lcm(const RigConfig& rig, const TomlTable& root) {
  const auto table = root.table_if("lcm");
  if (!table) return;
  const bool network = table->boolean_or("network", false);
  if (!rig.lcm.enabled) return;
  const auto& url = rig.lcm.url;
  const auto wrong = [&](const std::string& why) { table->error("url", "`url` = \"" + url + "\"; " + why); };
  if (!url.starts_with("udpm://")) {
    wrong(
        "it has to be \"udpm://GROUP:PORT?ttl=0\": a tcpq server or a file can make publishing wait, and memq reaches "
        "nobody");
    return;
  }
  const auto to = url.substr(9, url.find('?') == std::string::npos ? std::string::npos : url.find('?') - 9);
  const auto colon = to.rfind(':');
  const auto port = colon == std::string::npos ? std::string() : to.substr(colon + 1);
  const bool digits = !port.empty() && port.size() <= 5 && port.find_first_not_of("0123456789") == std::string::npos;
  if (colon != std::string::npos && (!digits || std::stoi(port) < 1 || std::stoi(port) > 65535)) {
    wrong("its port \"" + port + "\" has to be a number from 1 to 65535");
    return;
  }
  std::string ttl;  // where it stands twice the one that is not 0: which of them LCM takes is its own business
  const auto mark = url.find('?');
  std::istringstream options(mark == std::string::npos ? "" : url.substr(mark + 1));
  for (std::string option; std::getline(options, option, '&');) {
    if (option.starts_with("ttl=") && (ttl.empty() || ttl == "0")) ttl = option.substr(4);
  }
  if (ttl != "0" && !network) {
    wrong((ttl.empty() ? std::string("it says no ttl") : "its ttl is " + ttl) +
          ", so every sample leaves this machine unencrypted; end it with ?ttl=0, or, if other machines have to "
          "listen, add network = true");
  }
}

void check_api(const RigConfig& rig, const TomlTable& root) {
  const auto table = root.table_if("api");
  if (!table) return;
  // With ".stop" behind it, and a final zero, it has to fit the kernel's sockaddr_un.
  constexpr std::size_t kLongestSocket = sizeof(sockaddr_un::sun_path) - 1 - std::string_view(".stop").size();
  if (rig.api.socket.native().size() > kLongestSocket)
    table->error("socket", "`socket` has " + std::to_string(rig.api.socket.native().size()) +
                               " bytes; the path of a socket has " + std::to_string(kLongestSocket) + " at most");
  if (!table->has("mode")) return;
  const std::string mode = base::formatted("%04o", rig.api.mode);
  if ((rig.api.mode & 0007U) != 0) {
    table->error("mode", "`mode` = \"" + mode +
                             "\"; it has to end in 0, such as \"0660\": who may open the socket may move the rig, and "
                             "others are everybody on this machine");
  } else if ((rig.api.mode & 0600U) != 0600U || (rig.api.mode & 0111U) != 0) {
    table->error(
        "mode",
        "`mode` = \"" + mode +
            "\"; it has to be \"0600\" or \"0660\": a client needs reading and writing, and nobody runs a socket");
  }
}

void check_interlock(const RigConfig& rig, const Keys& k) {
  if (rig.gpio)
    k.range("closing_ms", 1e3 * seconds(rig.gpio->closing_ns), 0.0, 2'000.0, "ms",
            "so long a closed chain still counts as open");
}

}  // namespace

std::string why_no_calibration(const RigConfig& rig) {
  for (const auto& r : calibration_ranges(rig)) {
    if (r.value >= r.low && r.value <= r.high) continue;
    const auto unit = r.unit[0] == '\0' ? std::string() : std::string(" ") + r.unit;
    return std::string(r.key) + " = " + number_text(r.value) + unit + "; it has to be from " + number_text(r.low) +
           " to " + number_text(r.high) + unit + ": " + r.why;
  }
  const double top_psi = top_pressure_psi(rig.core.calibration);
  if (rig.limits.pressure_max_psi <= top_psi - kHeadRoom_psi) return {};
  return "the sensor's range ends at " + number_text(top_psi) +
         " psi by it, and [limits] pressure_max_psi = " + number_text(rig.limits.pressure_max_psi) + " has to lie " +
         number_text(kHeadRoom_psi) + " psi below, or limit.pressure cannot trip";
}

void check_rig(const RigConfig& rig, const TomlTable& root) {
  const auto dogs = watchdogs_of(rig, root);
  check_travel_and_force(rig, {root, "limits"});
  check_full_scale(rig, {root, "limits"});
  check_pressure_limits(rig, {root, "limits"});
  check_calibration(rig, {root, "calibration"});
  check_supervisor(rig, {root, "supervisor"}, dogs);
  check_frame(rig, {root, "frame"}, {root, "supervisor"}, dogs);
  check_services(rig, {root, "services"}, dogs);
  check_teensy(rig, {root, "pressure"}, dogs);
  check_loop(rig, {root, "pressure_loop"});
  check_operator(rig, {root, "operator"});
  check_regulator(rig, {root, "regulator"});
  check_recorder(rig, {root, "recorder"});
  check_interlock(rig, {root, "interlock"});
  check_lcm(rig, root);
  check_api(rig, root);
}

}  // namespace isorig::daemon
