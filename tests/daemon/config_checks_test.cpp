#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <memory>
#include <sstream>

#include "daemon/core/pressure_loop.hpp"
#include "daemon/rig/config.hpp"
#include "protocol/compile.hpp"
#include "rig_fixture.hpp"

/// Settings that read well and are dangerous: each is refused with its key, its value, what is allowed and why.
namespace isorig::daemon::test {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;

std::string slurp(const std::string& path) {
  std::ifstream in(path);
  std::stringstream text;
  text << in.rdbuf();
  return text.str();
}

std::string shipped(const std::string& name) {
  auto text = slurp(source("config/rigs/" + name + ".toml"));
  for (auto up = text.find("\"../"); up != std::string::npos; up = text.find("\"../"))
    text.replace(up + 1, 2, source("config"));
  return text;
}

/// `shipped`, as a real rig: another host than this machine, a watched chain.
std::string real(const std::string& name) {
  auto text = shipped(name);
  const auto replace = [&](const std::string& from, const std::string& to) {
    const auto at = text.find(from);
    if (at == std::string::npos) throw std::runtime_error(name + " no longer has " + from);
    text.replace(at, from.size(), to);
  };
  replace("emulated = true", "emulated = false");
  replace("host = \"127.0.0.1\"", "host = \"192.168.7.2\"");
  replace("driver = \"sim\"\n", "driver = \"gpio\"\nchip = \"c\"\nestop = { line = \"ESTOP\" }\n");
  if (name == "sim-wire") replace("frame_age_max_s = 0.5", "frame_age_max_s = 0.4");
  replace("interlock_age_max_s = 1.0", "interlock_age_max_s = 0.5");
  replace("pressure_age_max_s = 0.5", "pressure_age_max_s = 0.2");
  replace("late_tick_max_s = 0.5", "late_tick_max_s = 0.2");
  return text;
}

/// With `key = value` in [table] ("" is the top), in place of what stands there.
std::string with(std::string text, const std::string& table, const std::string& key, const std::string& value) {
  std::size_t begin = 0;
  if (!table.empty()) {
    begin = text.find("\n[" + table + "]\n");
    if (begin == std::string::npos) {
      text += "\n[" + table + "]\n";
      begin = text.find("\n[" + table + "]\n");
    }
    begin += table.size() + 4;
  }
  const auto end = std::min(text.find("\n[", begin), text.size());
  const auto line = ("\n" + text.substr(begin, end - begin)).find("\n" + key + " = ");
  if (line != std::string::npos) text.erase(begin + line, text.find('\n', begin + line) + 1 - begin - line);
  return text.insert(begin, key + " = " + value + "\n");
}

RigConfig load_text(const std::string& text) {
  const auto path = std::filesystem::temp_directory_path() / ("config-checks-" + std::to_string(::getpid()) + ".toml");
  std::ofstream(path) << text;
  const std::unique_ptr<const std::filesystem::path, void (*)(const std::filesystem::path*)> gone(
      &path, [](const std::filesystem::path* p) { std::filesystem::remove(*p); });
  return load_rig(path);
}

std::string faults_of(const std::string& text) {
  try {
    (void)load_text(text);
  } catch (const base::ConfigError& e) {
    return e.what();
  }
  return {};
}

struct Dangerous {
  const char* table;
  const char* key;
  const char* value;
  const char* why;           ///< part of the message
  const char* rig = "wire";  ///< wire: sim-wire.toml as a real rig, 8800, regulator; emulated: as shipped
};

std::string rig_named(const std::string& name) {
  if (name == "wire") return real("sim-wire");
  if (name == "8800") return real("sim-8800");
  if (name == "regulator") return real("sim-8800-regulator");
  return shipped("sim-wire");
}

const Dangerous kDangerous[] = {
    // [limits]: what cannot trip is no limit.
    {"limits", "pressure_max_psi", "29.5", "the sensor's range ends at 30 psi"},
    {"limits", "pressure_max_psi", "30.0", "limit.pressure has to trip before"},
    {"limits", "pressure_max_psi", "100.0", "from 0.1 to 29 psi"},
    {"limits", "pressure_max_psi", "1e6", "limit.pressure has to trip before"},
    {"limits", "pressure_max_psi", "1e-9", "from 0.1"},
    {"limits", "pressure_rate_max_psi_s", "1e6", "no valve"},
    {"limits", "pressure_rate_max_psi_s", "1e-9", "from 0.01"},
    {"limits", "travel_max_mm", "1e6", "rest length"},
    {"limits", "travel_min_mm", "-1e6", "rest length"},
    {"limits", "speed_max_mm_s", "1e4", "faster than any frame"},
    {"limits", "speed_max_mm_s", "1e-6", "from 0.001"},
    {"limits", "speed_min_mm_s", "1e3", "speed_max_mm_s"},
    {"limits", "force_max_N", "1e9", "beyond any load cell"},
    {"limits", "force_max_N", "1e-6", "from 0.01"},
    {"limits", "force_min_N", "-1e9", "beyond any load cell"},
    {"limits", "force_rate_max_N_s", "1e9", "the force limits trip first"},
    {"limits", "force_rate_max_N_s", "1.1e4", "the force limits trip first"},
    {"limits", "force_rate_max_N_s", "1e-9", "from 0.001"},
    {"limits", "segment_interval_min_s", "1e-6", "poll_period_ms"},
    {"limits", "segment_interval_min_s", "1e6", "from 0.005 to 10"},
    {"limits", "force_max_N", "300.0", "the load cell ends at force_full_scale_N", "8800"},
    {"limits", "force_min_N", "-300.0", "the load cell ends at force_full_scale_N", "8800"},
    {"limits", "travel_max_mm", "60.0", "the frame ends at position_full_scale_mm", "8800"},
    {"limits", "travel_min_mm", "-60.0", "the frame ends at position_full_scale_mm", "8800"},
    // [calibration]: a sign turned round.
    {"calibration", "pressure_scale", "-1.0", "fill when it has to vent"},
    {"calibration", "pressure_scale", "0.1", "from 0.5 to 2"},
    {"calibration", "pressure_scale", "100.0", "from 0.5 to 2"},
    {"calibration", "force_scale", "-1.0", "turns tension into compression"},
    {"calibration", "force_scale", "1e-3", "from 0.5 to 2"},
    {"calibration", "position_scale", "-1.0", "turns every motion round"},
    {"calibration", "position_scale", "1e3", "from 0.5 to 2"},
    {"calibration", "pressure_offset_psi", "-10.0", "total error band"},
    {"calibration", "pressure_offset_psi", "10.0", "total error band"},
    {"calibration", "force_offset_N", "-1e6", "leaves no force"},
    {"calibration", "position_offset_mm", "1e9", "travels further"},
    // [pressure_loop]: what makes the guard look away.
    {"pressure_loop", "leak_max_psi_s", "1000.0", "is found by it"},
    {"pressure_loop", "motion_max_psi_per_mm", "1000.0", "may hide behind"},
    {"pressure_loop", "fill_gain_per_s", "19.0", "from 0.001 to 5"},
    {"pressure_loop", "vent_gain_per_s", "19.0", "from 0.001 to 5"},
    {"pressure_loop", "response_min", "0.06", "a guard that looks away"},
    {"pressure_loop", "allowance_psi", "1.5", "sensor with more noise"},
    {"pressure_loop", "dead_zone_psi", "0.0", "winds the integral up"},
    // [supervisor]: what trips when it is too late.
    {"supervisor", "standstill_max_mm", "1000.0", "from 0.005 to 0.5 mm"},
    {"supervisor", "following_error_min_mm", "100.0", "it is none"},
    {"operator", "jog_force_max_N", "1e9", "from 0.01"},
    {"supervisor", "frame_age_max_s", "1e9", "watchdog"},
    {"supervisor", "frame_age_max_s", "0.6", "from 0.01 to 0.5 s"},
    {"supervisor", "frame_age_max_s", "1e-6", "from 0.01"},
    {"supervisor", "frame_age_max_s", "4.0", "from 0.01 to 3 s", "emulated"},
    {"supervisor", "interlock_age_max_s", "4.0", "from 0.02 to 3 s", "emulated"},
    {"supervisor", "pressure_age_max_s", "1e9", "has vented it"},
    {"supervisor", "pressure_age_max_s", "0.25", "from 0.01 to 0.2 s"},
    {"supervisor", "interlock_age_max_s", "1e9", "emergency stop may go unseen"},
    {"supervisor", "late_tick_max_s", "1e9", "sends no heartbeat"},
    {"supervisor", "late_tick_max_s", "0.25", "sends no heartbeat"},
    {"supervisor", "following_error_max_mm", "1e9", "something else than it was told"},
    {"supervisor", "following_error_max_mm", "1e-9", "from 0.01"},
    {"supervisor", "segment_ack_max_s", "1e9", "whether it took the segment"},
    {"supervisor", "frozen_force_max_s", "1e9", "dead load cell"},
    {"supervisor", "force_rate_window_s", "1.0", "0.06"},
    // [frame]
    {"frame", "response_timeout_ms", "10000", "one lost answer"},
    {"frame", "response_timeout_ms", "450", "below frame_age_max_s"},
    {"frame", "connect_timeout_ms", "10000", "nothing else is done"},
    {"frame", "start_confirm_ms", "10000", "did not start"},
    {"frame", "response_timeout_ms", "2000", "one lost answer", "8800"},
    {"frame", "give_up_ms", "600000", "nothing else is asked", "8800"},
    {"frame", "gap_us", "1000000", "too rarely", "8800"},
    {"frame", "reading_age_max_ms", "1000", "not of this moment", "8800"},
    {"frame", "in_position_mm", "50.0", "not reached", "8800"},
    {"frame", "stop_confirm_ms", "10000", "actuator is switched off", "8800"},
    {"frame", "heartbeat_timeout_ms", "10000", "watchdog", "8800"},
    {"frame", "heartbeat_timeout_ms", "60", "a single late heartbeat", "8800"},
    {"frame", "watchdog_feed_ms", "10000", "three times within", "8800"},
    // [services], [pressure]
    {"services", "heartbeat_period_ms", "1000", "a third of the shortest device watchdog"},
    {"services", "heartbeat_period_ms", "100", "a third of the shortest device watchdog"},
    {"services", "heartbeat_period_ms", "200", "a third of the shortest device watchdog", "emulated"},
    {"services", "poll_period_ms", "100", "three times within frame_age_max_s"},
    {"services", "sync_period_ms", "10000", "drifts out of its bound"},
    {"pressure", "command_validity_ms", "20", "valves that fall shut between two"},
    {"pressure", "command_validity_ms", "5000", "dead daemon"},
    {"pressure", "command_validity_ms", "250", "dead daemon"},
    {"pressure", "connect_timeout_s", "60.0", "nothing else is done"},
    // [pressure_loop]
    {"pressure_loop", "supply_psi", "1.0", "below pressure_max_psi"},
    {"pressure_loop", "supply_psi", "1e6", "no supply for these valves"},
    {"pressure_loop", "fill_gain_per_s", "1e-9", "1 bar / V"},
    {"pressure_loop", "vent_gain_per_s", "1e9", "1 bar / V"},
    {"pressure_loop", "proportional_per_s", "1e4", "oscillates"},
    {"pressure_loop", "integral_time_s", "1e-6", "oscillates"},
    {"pressure_loop", "rate_limit_psi_s", "1e6", "fills faster"},
    {"pressure_loop", "feedforward_psi_per_mm", "1e3", "volume of an actuator"},
    {"pressure_loop", "minimum_duty", "0.5", "would hunt"},
    {"pressure_loop", "settled_tolerance_psi", "1e3", "not reached"},
    {"pressure_loop", "unreachable_error_psi", "1e6", "leak would go unseen"},
    {"pressure_loop", "unreachable_after_s", "1e9", "blow into a leak"},
    // [regulator]
    {"regulator", "max_psi", "1e6", "pressure_max_psi", "regulator"},
    {"regulator", "max_psi", "25.0", "pressure_max_psi", "regulator"},
    {"regulator", "age_max_s", "1e9", "last set-point unseen", "regulator"},
    {"regulator", "error_max_psi", "1e9", "error bands", "regulator"},
    {"regulator", "setpoint_tolerance_psi", "100.0", "another one", "regulator"},
    {"regulator", "poll_period_ms", "1000", "three times within age_max_s", "regulator"},
    {"regulator", "response_timeout_ms", "10000", "one lost answer", "regulator"},
    // [recorder], [lcm], [api], [interlock], top
    {"recorder", "sync_interval_s", "60.0", "lost with the power"},
    {"recorder", "min_free_MiB", "1", "a minute and a half"},
    {"recorder", "reserve_MiB", "1e6", "taken out of min_free_MiB"},
    {"recorder", "max_segment_MiB", "1e6", "damaged file"},
    {"lcm", "url", "\"udpm://239.255.76.67:7667?ttl=255\"", "leaves this machine"},
    {"lcm", "url", "\"udpm://239.255.76.67:7667?ttl=1\"", "network = true"},
    {"lcm", "url", "\"udpm://239.255.76.67:7667\"", "says no ttl"},
    {"lcm", "url", "\"udpm://239.255.76.67:7667?ttl=0&ttl=5\"", "its ttl is 5"},
    {"lcm", "url", "\"udpm://239.255.76.67:7667?xttl=0\"", "says no ttl"},
    {"lcm", "url", "\"udpm://239.255.76.67:99999?ttl=0\"", "from 1 to 65535"},
    {"lcm", "url", "\"udpm://239.255.76.67:?ttl=0\"", "from 1 to 65535"},
    {"lcm", "period_ms", "0", "1"},
    {"lcm", "period_ms", "101", "100"},
    {"api", "operate", "\"lab, \"", "has to name Unix groups"},
    {"api", "configure", "\"a group\"", "has to name Unix groups"},
    {"lcm", "url", "\"tcpq://10.0.0.1:7700\"", "can make publishing wait"},
    {"lcm", "url", "\"file:///tmp/x?mode=w\"", "udpm://"},
    {"lcm", "url", "\"\"", "udpm://"},
    {"api", "mode", "\"0777\"", "everybody on this machine"},
    {"api", "mode", "\"0666\"", "everybody on this machine"},
    {"api", "mode", "\"0662\"", "everybody on this machine"},
    {"api", "mode", "\"0000\"", "\"0600\" or \"0660\""},
    {"api", "mode", "\"0770\"", "nobody runs a socket"},
    {"interlock", "closing_ms", "10000", "counts as open"},
    {"", "name", "\"../../etc\"", "names files"},
    {"", "name", "\"\\u202e\"", "names files"},
    {"", "emulated", "true", "this is a real frame"},
};

TEST(ConfigChecks, EveryDangerousValueIsRefusedWithItsReason) {
  static_assert(std::size(kDangerous) >= 75);
  for (const auto& d : kDangerous) {
    SCOPED_TRACE(std::string(d.rig) + " [" + d.table + "] " + d.key + " = " + d.value);
    const auto faults = faults_of(with(rig_named(d.rig), d.table, d.key, d.value));
    EXPECT_THAT(faults, AllOf(HasSubstr("`" + std::string(d.key) + "`"), HasSubstr(d.why)));
    EXPECT_NE(faults.find_first_of("0123456789"), std::string::npos);
  }
}

/// What the reader refused has a fallback that nobody wrote: no second message quotes it, nor what follows from it.
TEST(ConfigChecks, OfAValueThatIsNoneThereIsOneMessage) {
  const auto shipped_rig = real("sim-wire");
  const auto pressure = faults_of(with(shipped_rig, "limits", "pressure_max_psi", "nan"));
  EXPECT_THAT(pressure, HasSubstr("pressure_max_psi"));
  EXPECT_EQ(std::count(pressure.begin(), pressure.end(), '\n'), 0) << pressure;
  auto text = with(shipped_rig, "limits", "speed_max_mm_s", "1");
  text.erase(text.find("speed_max_mm_s = 1\n"), std::string("speed_max_mm_s = 1\n").size());
  const auto speed = faults_of(text);
  EXPECT_THAT(speed, HasSubstr("speed_max_mm_s"));
  EXPECT_THAT(speed, Not(HasSubstr("from 0 to 0")));
  EXPECT_EQ(std::count(speed.begin(), speed.end(), '\n'), 0) << speed;
}

/// As of a real Teensy (`command_validity_ms` above), which has its own key for it.
TEST(ConfigChecks, CommandsAreRepeatedBeforeTheSimulatedTeensyLetsThemEnd) {
  EXPECT_THAT(faults_of(with(shipped("sim"), "sim.pressure", "command_validity_ms", "80")),
              AllOf(HasSubstr("`heartbeat_period_ms` = 50 (by default); it has to be at most 40 ms"),
                    HasSubstr("cannot regulate")));
  EXPECT_EQ(faults_of(with(shipped("sim"), "sim.pressure", "command_validity_ms", "100")), "");
}

/// The default is too slow for a device whose watchdog is quicker.
TEST(ConfigChecks, TheHeartbeatOfARigThatNamesNoneIsHeldToItsWatchdogsToo) {
  auto text = with(shipped("sim"), "sim.frame", "heartbeat_timeout_s", "0.06");
  EXPECT_THAT(faults_of(text), AllOf(HasSubstr("`heartbeat_period_ms` = 50 (by default); it has to be at most 20 ms"),
                                     HasSubstr("shortest device watchdog (0.06 s)")));
  text += text.find("[services]") == std::string::npos ? "\n[services]\nheartbeat_period_ms = 20\n" : "";
  EXPECT_EQ(faults_of(text), "");
}

/// A path that the kernel does not take is found before the daemon begins, also with the .stop of the second socket.
TEST(ConfigChecks, ASocketsPathFitsTheKernel) {
  const auto socket = [](std::size_t length) {
    return with(shipped("sim"), "api", "socket", "\"/" + std::string(length - 1, 's') + "\"");
  };
  EXPECT_EQ(faults_of(socket(102)), "");
  EXPECT_THAT(faults_of(socket(103)), HasSubstr("`socket` has 103 bytes; the path of a socket has 102 at most"));
}

/// What the driver asks on a slow line before a stop is confirmed takes its time. The number that is named is the least
/// that is taken.
TEST(ConfigChecks, ALineThatCannotConfirmAStopInTimeIsRefusedWithTheNumberToWrite) {
  const auto patient = with(real("sim-8800"), "frame", "response_timeout_ms", "600");
  const auto slow = with(with(patient, "frame", "gap_us", "5000"), "frame", "answer_ms", "30");
  auto serial = with(with(patient, "frame", "transport", "\"tty\""), "frame", "tty", "\"/dev/ttyS0\"");
  for (const std::string key : {"host = ", "port = 1503"}) {
    const auto at = serial.find("\n" + key) + 1;
    serial.erase(at, serial.find('\n', at) + 1 - at);
  }
  serial = with(with(serial, "frame", "baud", "9600"), "frame", "gap_us", "5000");
  const auto emulated =
      with(with(shipped("sim-8800"), "frame", "response_timeout_ms", "600"), "sim.controller", "answer_us", "30000");
  for (const auto& text : {slow, serial, emulated}) {
    const auto faults = faults_of(text);
    const std::string begin = "`stop_confirm_max_s` = 0.3 (by default); it has to be at least ";
    ASSERT_THAT(faults, AllOf(HasSubstr(begin), HasSubstr("ms a value"), HasSubstr("frame.stop")));
    const double least_s = std::strtod(faults.c_str() + faults.find(begin) + begin.size(), nullptr);
    EXPECT_GT(least_s, 0.8);
    EXPECT_LT(least_s, 2.0);
    const auto written = [&](double s) { return with(text, "supervisor", "stop_confirm_max_s", std::to_string(s)); };
    EXPECT_EQ(faults_of(written(least_s)), "");
    EXPECT_THAT(faults_of(written(least_s - 0.02)), HasSubstr("`stop_confirm_max_s`"));
  }
  EXPECT_THAT(faults_of(with(slow, "frame", "stop_confirm_ms", "300")),
              AllOf(HasSubstr("`stop_confirm_ms`"), HasSubstr("would switch the actuator off")));
  EXPECT_THAT(
      faults_of(with(slow, "frame", "response_timeout_ms", "400")),
      AllOf(HasSubstr("`response_timeout_ms` = 400; it has to be at least 525 ms"), HasSubstr("never come to an end")));
  EXPECT_THAT(faults_of(with(patient, "frame", "gap_us", "55000")),
              AllOf(HasSubstr("`gap_us`"), HasSubstr("2 s at most")));
  EXPECT_THAT(faults_of(with(slow, "frame", "answer_ms", "70")), HasSubstr("samples are too far apart"));
}

/// Set-point and trim together are no more than the regulator takes, and a protocol that asks for more is refused.
TEST(ConfigChecks, ARegulatorsOwnLimitIsThatOfItsSetPoints) {
  const auto rig = load_text(with(real("sim-8800-regulator"), "regulator", "max_psi", "10.1"));
  const auto faults_of_setpoint = [&](const std::string& psi) {
    try {
      (void)protocol::compile(
          base::TomlDocument::parse_text("format = \"isorig-protocol/1\"\nname = \"p\"\nsteps = [ { do = "
                                         "\"pressurize\", pressure_psi = " +
                                             psi + ", rate_psi_s = 1, settled_for_s = 0.5, timeout_s = 60 } ]\n",
                                         "p.toml"),
          rig.limits);
    } catch (const base::ConfigError& e) {
      return std::string(e.what());
    }
    return std::string();
  };
  EXPECT_EQ(faults_of_setpoint("10.1"), "");
  EXPECT_THAT(faults_of_setpoint("10.2"), HasSubstr("the rig's regulator takes at most 10.1 (regulator.max_psi)"));

  PressureLoop loop(rig.core.pressure_loop);
  loop.set_target(10.1, 5.0, 0);
  double most_psi = 0.0;
  for (int i = 0; i < 60'000; ++i) {  // the ELVH sees a little less, for a minute
    (void)loop.update(std::int64_t{i} * 1'000'000, 10.05, 0.0);
    most_psi = std::max(most_psi, double{loop.command().regulator_psi});
  }
  EXPECT_EQ(most_psi, double{10.1F});
}

TEST(ConfigChecks, WhatIsShippedIsValidAndSoIsAReal) {
  for (const auto* name : {"sim", "sim-wire", "sim-8800", "sim-8800-regulator", "lab"})
    EXPECT_EQ(faults_of(shipped(name)), "") << name;
  for (const auto* name : {"sim-wire", "sim-8800", "sim-8800-regulator"}) EXPECT_EQ(faults_of(real(name)), "") << name;
  EXPECT_EQ(faults_of(with(with(real("sim-wire"), "lcm", "url", "\"udpm://239.255.76.67:7667?ttl=1\""), "lcm",
                           "network", "true")),
            "");
  EXPECT_EQ(faults_of(with(real("sim-wire"), "api", "mode", "\"0600\"")), "");
}

/// docs/commissioning.md begins with this pair: the limits of the one have to let the other pass, with room.
TEST(ConfigChecks, TheRigToCopyLetsTheFirstMotionPass) {
  const auto rig = load_text(shipped("lab"));
  EXPECT_FALSE(rig.emulated);
  EXPECT_TRUE(rig.core.operating.arming_required);
  EXPECT_EQ(rig.core.frame_zero, FrameZero::kConfirm);
  const auto plan = protocol::compile_file(source("config/protocols/first-motion.toml"), rig.limits);
  for (const auto& step : plan.steps) EXPECT_LE(step.pressure_psi, 0.5 * rig.limits.pressure_max_psi);
}

TEST(ConfigChecks, AnUnknownKeyOfTheSimulationIsRefusedWhereItIsRead) {
  EXPECT_THAT(faults_of(with(shipped("sim"), "sim", "sede", "1")), HasSubstr("unknown key `sede`"));
  EXPECT_EQ(faults_of(with(shipped("sim-wire"), "sim", "sede", "1")), "");  // isorig-simrig's business
}

TEST(ConfigChecks, TheSensorEndsWhereItsCalibrationPutsIt) {
  EXPECT_THAT(faults_of(with(real("sim-wire"), "calibration", "pressure_scale", "0.8")),
              HasSubstr("`pressure_max_psi` = 24; it has to be from 0.1 to 23 psi: the sensor's range ends at 24 psi"));
}

/// The firmware vents 200 ms after the last heartbeat: what a rig file leaves out is judged by then.
TEST(ConfigChecks, AgesThatARealRigLeavesOutEndWithTheTeensysWatchdog) {
  const auto without = [](std::string text) {
    const auto from = text.find("\n[supervisor]\n");
    return text.erase(from, text.find("\n[", from + 1) - from);
  };
  const auto of_real = load_text(without(real("sim-wire"))).core.supervisor;
  EXPECT_EQ(of_real.pressure_age_max_s, 0.2);
  EXPECT_EQ(of_real.late_tick_max_s, 0.2);
  EXPECT_EQ(of_real.frame_age_max_s, 0.25);
  const auto of_emulated = load_text(without(shipped("sim-wire"))).core.supervisor;
  EXPECT_EQ(of_emulated.pressure_age_max_s, 0.25);
  EXPECT_EQ(of_emulated.late_tick_max_s, 0.25);
}

TEST(ConfigChecks, AnEmulatedRigMayBePatient) {
  auto text = shipped("sim-wire");
  for (const auto* age : {"frame_age_max_s", "pressure_age_max_s", "interlock_age_max_s", "late_tick_max_s"})
    text = with(text, "supervisor", age, "3.0");
  EXPECT_EQ(faults_of(text), "");
}

TEST(ConfigChecks, ASimulatedChainOnARealRigIsRefused) {
  auto text = with(shipped("sim-wire"), "", "emulated", "false");
  for (const auto* age : {"pressure_age_max_s", "late_tick_max_s"}) text = with(text, "supervisor", age, "0.2");
  EXPECT_THAT(faults_of(text), AllOf(HasSubstr("an emergency stop would count as closed and nobody would look"),
                                     HasSubstr("driver = \"none\"")));
  text = with(text, "interlock", "driver", "\"none\"");
  EXPECT_THAT(faults_of(text), HasSubstr("why nobody watches"));
  EXPECT_THAT(faults_of(with(text, "interlock", "reason", "\"no\"")), HasSubstr("ten letters"));
  text = with(text, "interlock", "reason", "\"the frame's own chain stops everything\"");
  EXPECT_EQ(faults_of(text), "");
  EXPECT_THAT(faults_of(with(shipped("sim"), "interlock", "driver", "\"none\"\nreason = \"none of your business\"")),
              HasSubstr("has its own interlock"));
  EXPECT_THAT(faults_of(with(shipped("sim"), "", "emulated", "true")), HasSubstr("simulated in process"));
}

TEST(ConfigChecks, AMissingOrWrongSpecimenIsNamed) {
  EXPECT_THAT(faults_of(with(shipped("sim-wire"), "", "specimen", "\"nowhere.toml\"")),
              AllOf(HasSubstr("`specimen`: "), HasSubstr("nowhere.toml"), HasSubstr("cannot be opened")));
  EXPECT_THAT(faults_of(with(shipped("sim"), "sim", "specimen", "\"nowhere.toml\"")), HasSubstr("nowhere.toml"));
  const auto specimen = std::filesystem::temp_directory_path() / ("specimen-" + std::to_string(::getpid()) + ".toml");
  std::ofstream(specimen)
      << "name = \"a/../../outside/planted\"\n[geometry]\ninitial_length_mm = 90\nminimum_length_mm = 70\n";
  EXPECT_THAT(faults_of(with(shipped("sim-wire"), "", "specimen", "\"" + specimen.string() + "\"")),
              AllOf(HasSubstr("holds `/`"), HasSubstr("names files")));
  std::filesystem::remove(specimen);
}

}  // namespace
}  // namespace isorig::daemon::test
