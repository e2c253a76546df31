#include "cli/selftest/selftest_checks.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "base/formatted.hpp"
#include "cli/screen/live_verdicts.hpp"

namespace isorig::cli {
namespace {

using base::formatted;
using nlohmann::json;

// What a healthy rig shows at rest. Noise: the ELVH's is not in its datasheet, 1 count = 0.0023 psi rms is typical of
// its kind; a 1 kN cell has 0.01 N, an encoder less than a micrometre.
constexpr double kPressureNoise_psi[] = {0.007, 0.05};  // warn, fail: 3 and 22 counts
constexpr double kForceNoise_N[] = {0.05, 0.5};
constexpr double kPositionNoise_mm[] = {0.005, 0.05};
constexpr double kZeroPressure_psi[] = {0.3, 0.6};  // the total error band (DS-0376), twice that
constexpr double kZeroForce_N[] = {0.5, 5.0};
constexpr double kAge_s[] = {0.1, 0.5};
constexpr double kRateOff = 0.02;
constexpr double kLateShareUs = 512.0;
constexpr double kLeak_psi_min[] = {0.5, 2.0};
constexpr double kSensorRange_psi = 30.0;

class Sheet {
 public:
  void add(const char* check, Verdict verdict, std::string found, const char* to_do) {
    lines.push_back({check, verdict, std::move(found), verdict == Verdict::kOk ? "" : to_do});
  }
  /// Above the first limit a warning, above the second a failure.
  void below(const char* check, double value, const double (&limits)[2], std::string found, const char* to_do) {
    add(check,
        !(value <= limits[1]) ? Verdict::kFail
        : value > limits[0]   ? Verdict::kWarn
                              : Verdict::kOk,
        std::move(found), to_do);
  }
  std::vector<Line> lines;
};

double number(const json& j, const char* key, double fallback = 0.0) {
  const auto found = j.find(key);
  return found != j.end() && found->is_number() ? found->get<double>() : fallback;
}

/// Of an answer of isorigd. Throws std::runtime_error where there is none: operator[] of a const value would read
/// beyond it.
const json& part(const json& answer, const char* key) {
  const auto found = answer.find(key);
  if (found == answer.end())
    throw std::runtime_error(std::string("isorigd's answer has no `") + key + "`; is isorigd of another version?");
  return *found;
}

void judge_state(Sheet& s, const json& status) {
  const auto state = status.value("state", "");
  const auto fault = status.value("fault", "");
  if (state == "faulted") {
    s.add("state", Verdict::kFail, "faulted: " + fault, "remove the cause, then isorig reset");
  } else if (state == "idle") {
    s.add("state", Verdict::kFail, "idle: " + status.value("not_ready", ""),
          "what is named there keeps the rig from getting ready");
  } else {
    s.add("state", state == "ready" ? Verdict::kOk : Verdict::kWarn, state, "a self-test wants the rig at rest");
  }
}

struct LinkNames {
  const char *link, *identity, *rate, *age, *losses, *clock;
  const char* cable;  // what to look at
};

/// False: nothing comes from there, and what follows from it says nothing.
bool judge_link(Sheet& s, const LinkNames& n, const json& status, const json& self, const json& reading, double age_s) {
  const bool connected = self.value("connected", false);
  s.add(n.link, connected ? Verdict::kOk : Verdict::kFail,
        connected ? "connected" : "not connected: " + self.value("detail", ""), n.cable);
  if (!connected) return false;
  const auto identity = self.value("identity", "");
  s.add(n.identity, identity.empty() ? Verdict::kWarn : Verdict::kOk,
        identity.empty() ? "says nothing of itself" : identity, "compare maker, model and serial number by hand");
  const double rate_hz = number(reading, "rate_hz"), said_hz = number(self, "sample_rate_hz");
  const bool flows = reading.value("samples", 0) > 1 && number(reading, "to_mono_ns") > number(status, "mono_ns") - 2e9;
  if (!flows) {
    s.add(n.rate, Verdict::kFail, "no samples", n.cable);
  } else if (said_hz <= 0.0) {
    s.add(n.rate, rate_hz >= 100.0 ? Verdict::kOk : Verdict::kWarn,
          formatted("%.1f Hz (the device does not say its rate)", rate_hz), "the pressure loop wants 100 Hz or more");
  } else {
    const double off = std::abs(rate_hz / said_hz - 1.0);
    s.add(n.rate, off <= kRateOff ? Verdict::kOk : Verdict::kWarn, formatted("%.1f Hz of %.1f Hz", rate_hz, said_hz),
          "samples are missing or the device's clock is off; look at the losses, the cable, the machine's load");
  }
  s.below(n.age, age_s < 0.0 ? 1e9 : age_s, kAge_s, age_s < 0.0 ? "never read" : formatted("newest %.3f s old", age_s),
          n.cable);
  const double lost = number(self, "lost"), corrupt = number(self, "corrupt"), reconnects = number(self, "reconnects");
  s.add(n.losses, lost + corrupt + reconnects > 0.0 ? Verdict::kWarn : Verdict::kOk,
        formatted("lost %.0f, corrupt %.0f, reconnected %.0f times since start", lost, corrupt, reconnects),
        "a plug, a hub or a loaded machine; it may be old: watch whether it grows");
  const bool ready = self.value("clock_ready", false);
  const double bound_us = number(reading, "bound_us", 1e9);
  s.below(n.clock, ready ? bound_us : 1e9, kLate_us,
          !ready           ? "not mapped yet"
          : bound_us > 1e8 ? "in doubt: the exchanges contradict each other"
                           : formatted("within %.0f us", bound_us),
          "wait half a minute; then look at the link's delays (isorig status)");
  return flows;
}

void judge_frozen(Sheet& s, const char* check, const json& reading, const char* to_do) {
  const auto samples = reading.value("samples", std::size_t{0}), run = reading.value("longest_run", std::size_t{0});
  s.add(check, samples > 100 && run >= samples ? Verdict::kFail : Verdict::kOk,
        formatted("%zu equal values in a row at most, of %zu", run, samples), to_do);
}

void judge_channels(Sheet& s, const Answers& a, bool frame, bool pressure) {
  const auto& limits = part(a.selftest, "limits");
  const auto& force = part(a.readings, "force");
  const auto& position = part(a.readings, "position");
  const auto& air = part(a.readings, "pressure");
  if (frame) {
    s.below("force.noise", number(force, "sd"), kForceNoise_N, formatted("%.4f N rms", number(force, "sd")),
            "shield and earth of the load cell, vibration, a motor nearby");
    judge_frozen(s, "force.frozen", force, "load cell, its plug and amplifier: a live cell moves its last digit");
    const double f = number(force, "calibrated");
    const bool inside = f > number(limits, "force_min_N") && f < number(limits, "force_max_N");
    s.below("force.zero", inside ? std::abs(f) : 1e9, kZeroForce_N, formatted("%+.3f N", f),
            "unload the grips; isorig calibrate force --mode zero --point 0");
    s.below("position.noise", number(position, "sd"), kPositionNoise_mm,
            formatted("%.5f mm rms", number(position, "sd")), "is the crosshead moving? the frame's encoder");
    const double x = number(position, "calibrated"), low = number(limits, "travel_min_mm"),
                 high = number(limits, "travel_max_mm");
    const bool within = x >= low && x <= high;
    s.add("position.travel",
          !within                                             ? Verdict::kFail
          : std::min(x - low, high - x) < 0.05 * (high - low) ? Verdict::kWarn
                                                              : Verdict::kOk,
          formatted("%+.4f mm, allowed %+.3f to %+.3f", x, low, high),
          "set the frame's zero at the specimen's unpressurized rest length");
  }
  if (pressure) {
    s.below("pressure.noise", number(air, "sd"), kPressureNoise_psi, formatted("%.4f psi rms", number(air, "sd")),
            "SPI wires long or beside the valves' wires; supply of the sensor");
    judge_frozen(s, "pressure.frozen", air, "sensor and its SPI wires: a live bridge moves a count within seconds");
    s.below("pressure.zero", std::abs(number(air, "calibrated")), kZeroPressure_psi,
            formatted("%+.4f psi, vented", number(air, "calibrated")),
            "is the dump valve open? then isorig calibrate pressure --mode zero --point 0");
    const double t_C = number(part(a.readings, "temperature"), "raw");
    s.add("pressure.temperature", t_C < 0.0 || t_C > 50.0 ? Verdict::kWarn : Verdict::kOk, formatted("%.1f C", t_C),
          "outside 0..50 C the sensor's error band doubles; -50 C: the firmware reads two bytes only");
  }
}

void judge_limits(Sheet& s, const json& self) {
  const auto& limits = part(self, "limits");
  const double max_psi = number(limits, "pressure_max_psi");
  s.add("limits.pressure", max_psi > kSensorRange_psi ? Verdict::kFail : Verdict::kOk,
        formatted("pressure_max_psi %.1f of the sensor's 30", max_psi),
        "above its range the sensor cannot see the limit broken");
  if (!self.contains("frame_limits")) {
    s.add("limits.frame", Verdict::kSkipped, "this frame cannot be asked for its own limits",
          "read them on its panel: they have to lie outside [limits], and be set");
    return;
  }
  const auto& own = part(self, "frame_limits");
  std::string inside;
  const auto wider = [&](const char* key, bool high) {
    const double frame = number(own, key), rig = number(limits, key);
    if (high ? frame < rig : frame > rig)
      inside += formatted("%s%s %.4g, rig %.4g", inside.empty() ? "" : "; ", key, frame, rig);
  };
  wider("travel_min_mm", false);
  wider("travel_max_mm", true);
  wider("force_min_N", false);
  wider("force_max_N", true);
  wider("speed_max_mm_s", true);
  s.add("limits.frame", inside.empty() ? Verdict::kOk : Verdict::kFail,
        inside.empty() ? "the frame's own lie outside the rig's" : "inside the rig's: " + inside,
        "the frame would stop before the daemon does, and slower work is refused; correct the frame or [limits]");
}

void judge_machine(Sheet& s, const json& self) {
  const auto& rt = part(self, "realtime");
  bool loop_fifo = false;
  for (const auto& t : part(self, "threads")) {
    if (t.value("name", "") == "isorig-loop") loop_fifo = t.value("fifo", false);
  }
  const bool enforced = rt.value("enforced", false);
  s.add(
      "realtime.fifo",
      loop_fifo  ? Verdict::kOk
      : enforced ? Verdict::kFail
                 : Verdict::kWarn,
      loop_fifo ? formatted("SCHED_FIFO, priority %d", rt.value("priority", 0)) : "the loop runs as an ordinary thread",
      "start isorigd as the service, or with LimitRTPRIO; --no-realtime is for a desk");
  const double locked_kB = number(self, "locked_kB", -1.0);
  s.add("realtime.memory",
        locked_kB > 0.0 ? Verdict::kOk
        : enforced      ? Verdict::kFail
                        : Verdict::kWarn,
        formatted("%.0f kB locked", std::max(0.0, locked_kB)), "raise LimitMEMLOCK (ulimit -l unlimited)");

  const auto bins = self.value("lateness", std::vector<double>{});
  double all = 0.0, late = 0.0;
  std::string shape;
  double worst_us = 0.0, edge_us = 1.0;
  for (const double n : bins) {
    all += n;
    if (edge_us > kLateShareUs) late += n;
    if (n > 0.0) worst_us = edge_us;
    edge_us *= 2.0;
  }
  edge_us = 1.0;
  for (const double n : bins) {
    if (n > 0.0 && edge_us >= 64.0)
      shape += formatted("%s<%.0f us %.2g %%", shape.empty() ? "" : ", ", edge_us, 100.0 * n / all);
    edge_us *= 2.0;
  }
  const double share = all > 0.0 ? late / all : 1.0;
  const double limit_us = 1e6 * number(rt, "late_tick_max_s", 0.25);
  s.add("realtime.lateness",
        all == 0.0 || worst_us > 2.0 * limit_us || share > kLateShare[1] ? Verdict::kFail
        : share > kLateShare[0]                                          ? Verdict::kWarn
                                                                         : Verdict::kOk,
        formatted("%.0f wake-ups, worst below %.0f us, %.3g %% later than %.0f us", all, worst_us, 100.0 * share,
                  kLateShareUs) +
            (shape.empty() ? "" : " (" + shape + ")"),
        "load of the machine, priorities, power saving; a PREEMPT_RT kernel ([realtime] cpu, docs/threads.md)");

  const double free_MiB = number(self, "free_MiB", -1.0), keep_MiB = number(self, "min_free_MiB");
  const bool writable = self.value("runs_writable", false);
  s.add("disk",
        !writable || free_MiB < keep_MiB ? Verdict::kFail
        : free_MiB < 4.0 * keep_MiB      ? Verdict::kWarn
                                         : Verdict::kOk,
        self.contains("runs_error") ? self.value("runs_error", "")
        : !writable                 ? self.value("runs", "") + " cannot be written"
                                    : formatted("%.0f MiB free, %.0f are kept", free_MiB, keep_MiB),
        "make room, or give isorigd another --runs");
}

void judge_calibrations(Sheet& s, const json& in_force) {
  for (const auto* channel : {"pressure", "force", "position"}) {
    const auto& c = in_force[channel];
    const auto id = c.value("id", "");
    const std::string check = std::string("calibration.") + channel;
    const std::string to_do = std::string("isorig calibrate ") + channel;
    if (id.empty()) {
      s.add(check.c_str(), Verdict::kWarn, "never calibrated", to_do.c_str());
    } else {
      s.add(check.c_str(), c.value("overdue", false) ? Verdict::kFail : Verdict::kOk,
            id + ", due " + c.value("due", "") + (c.value("overdue", false) ? ": OVERDUE" : ""), to_do.c_str());
    }
  }
}

}  // namespace

const char* name_of(Verdict verdict) noexcept {
  switch (verdict) {
    case Verdict::kOk:
      return "ok";
    case Verdict::kSkipped:
      return "skipped";
    case Verdict::kWarn:
      return "warn";
    case Verdict::kFail:
      return "fail";
  }
  return "";
}

std::vector<Line> judge(const Answers& a) {
  Sheet s;
  judge_state(s, a.status);
  const bool frame = judge_link(s,
                                {"frame.link", "frame.identity", "frame.rate", "frame.age", "frame.losses",
                                 "frame.clock", "the frame's power, its cable, the gateway's address in [frame]"},
                                a.status, part(a.selftest, "frame"), part(a.readings, "position"),
                                number(a.status, "frame_age_s", -1.0));
  const bool pressure = judge_link(
      s,
      {"sensor.link", "sensor.identity", "sensor.rate", "sensor.age", "sensor.losses", "sensor.clock",
       "the Teensy's USB cable, [pressure] port and serial; the sensor's supply and SPI wires"},
      a.status, part(a.selftest, "pressure"), part(a.readings, "pressure"), number(a.status, "pressure_age_s", -1.0));
  judge_channels(s, a, frame, pressure);
  const auto& interlock = part(a.status, "interlock");
  const bool estop = interlock.value("estop_closed", false), guard = interlock.value("guard_closed", false);
  const bool watched = interlock.value("watched", true);
  if (!watched) {
    s.add("interlock", Verdict::kWarn, "not watched: " + interlock.value("not_watched", ""),
          "nobody sees an emergency stop; wire the chain to [interlock] driver = \"gpio\" (docs/gpio.md)");
  }
  if (watched)
    s.add("interlock.estop", estop ? Verdict::kOk : Verdict::kFail, estop ? "closed" : "OPEN, or not read",
          "release the emergency stop; its second contact and wire");
  if (watched)
    s.add("interlock.guard", guard ? Verdict::kOk : Verdict::kFail, guard ? "closed" : "OPEN, or not read",
          "close the guard; its contact and wire");
  judge_limits(s, a.selftest);
  judge_machine(s, a.selftest);
  judge_calibrations(s, part(a.calibrations, "in_force"));
  return s.lines;
}

Line judge_lcm(const json& self, int messages, double seconds) {
  Sheet s;
  if (!part(self, "lcm").value("enabled", false)) {
    s.add("lcm", Verdict::kSkipped, "switched off in the rig's file",
          "[lcm] enabled = true, if somebody wants to listen");
  } else if (messages < 0) {
    s.add("lcm", Verdict::kFail, "no receiver could be set up on " + part(self, "lcm").value("url", ""),
          "a multicast route: ip route add 239.255.76.67/32 dev lo");
  } else {
    s.add("lcm", messages > 0 ? Verdict::kOk : Verdict::kFail,
          formatted("%d messages in %.1f s came back", messages, seconds),
          "multicast route and firewall; is the url the daemon's? (docs/lcm-channels.md)");
  }
  return s.lines.front();
}

std::vector<Line> judge_air(const AirTest& t) {
  Sheet s;
  const double off = std::abs(t.reached_psi - t.wanted_psi);
  s.add("air.fill", off <= 0.2 ? Verdict::kOk : Verdict::kFail,
        formatted("%.3f psi of %.2f", t.reached_psi, t.wanted_psi),
        "supply, fill valve and its driver, dump valve energised?");
  const double leak_psi_min = t.sealed_s > 0.0 ? (t.sealed_from_psi - t.sealed_to_psi) / t.sealed_s * 60.0 : 1e9;
  s.below("air.leak", leak_psi_min, kLeak_psi_min,
          formatted("%.3f psi/min at %.1f psi, all valves shut, %.0f s", leak_psi_min, t.sealed_from_psi, t.sealed_s),
          "soap the fittings; the specimen's seal, dump and vent valves that do not shut");
  s.below("air.vent", std::abs(t.vented_psi), kZeroPressure_psi, formatted("%+.3f psi after venting", t.vented_psi),
          "dump valve (normally open to exhaust), a blocked silencer");
  return s.lines;
}

std::string table_of(const std::vector<Line>& lines) {
  std::string out;
  for (const auto& l : lines) {
    out += formatted("%-8s %-22s ", name_of(l.verdict), l.check.c_str()) + l.found + "\n";
    if (!l.to_do.empty()) out += formatted("%-8s %-22s -> ", "", "") + l.to_do + "\n";
  }
  return out;
}

json to_json(const std::vector<Line>& lines) {
  json all = json::array();
  for (const auto& l : lines) {
    all.push_back({{"check", l.check}, {"verdict", name_of(l.verdict)}, {"found", l.found}, {"to_do", l.to_do}});
  }
  return all;
}

}  // namespace isorig::cli
