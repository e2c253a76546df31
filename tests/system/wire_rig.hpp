#pragma once
#include <gtest/gtest.h>

#include <optional>

#include "processes.hpp"

namespace isorig::system_test {

/// isorigd with a real rig's drivers against isorig-simrig: Modbus TCP or RTU, and the Teensy's pseudo-terminal.
class WireRig : public testing::Test {
 protected:
  /// The shipped wire rig, with time limits for a machine that stands still now and then.
  virtual std::string rig_text() const {
    auto text = slurp(source("config/rigs/sim-wire.toml"));
    text = replaced(text, "\"../", "\"" + source("config/"));
    text = replaced(text, "port = \"/tmp/isorig-sim-teensy\"", "port = \"" + (dir_ / "teensy").string() + "\"");
    text = replaced(text, "response_timeout_ms = 100", "response_timeout_ms = 500\nstart_confirm_ms = 2000");
    for (const auto* age :
         {"frame_age_max_s = 0.5", "pressure_age_max_s = 0.5", "interlock_age_max_s = 1.0", "late_tick_max_s = 0.5"}) {
      text = replaced(text, age, std::string(age).substr(0, std::string(age).find('=')) + "= 2.0");
    }
    text = replaced(text, "late_tick_max_s = 2.0", "late_tick_max_s = 2.0\nsegment_ack_max_s = 2.0");
    text = replaced(text, "heartbeat_timeout_s = 0.5", "heartbeat_timeout_s = 2.0");
    text = replaced(text, "watchdog_s = 0.5", "watchdog_s = 2.0");
    return replaced(text, "ring_samples = 256", "ring_samples = 2048");
  }

  /// In the child, before it becomes the daemon.
  virtual void in_daemon() const {}

  void start(bool rtu) {
    auto text = rig_text();
    if (rtu) {
      text = replaced(text, "transport = \"tcp\"\nhost = \"127.0.0.1\"\nport = 1502",
                      "transport = \"rtu\"\nbaud = 115200\ntty = \"" + (dir_ / "frame").string() + "\"");
    }
    const auto rig = dir_ / "rig.toml";
    spit(rig, text);
    std::vector<std::string> words{
        bin("isorig-simrig"),       "--rig", rig.string(), "--truth", (dir_ / "truth.csv").string(), "--control",
        (dir_ / "control").string()};
    if (!rtu) words.insert(words.end(), {"--port", "0"});
    simrig_.emplace(words, dir_ / "simrig.log");
    ASSERT_TRUE(wait_until(20.0, [&] { return simrig_->output().find("ready") != std::string::npos; }))
        << simrig_->output();
    if (!rtu) {
      const auto said = simrig_->output();
      const std::string before = "frame: tcp 127.0.0.1:";
      const auto at = said.find(before);
      ASSERT_NE(at, std::string::npos) << said;
      const auto end = said.find('\n', at);
      text = replaced(text, "port = 1502", "port = " + said.substr(at + before.size(), end - at - before.size()));
      spit(rig, text);
    }
    start_daemon();
  }

  /// Also once more, after the first was killed.
  virtual void start_daemon() {
    daemon_.emplace(dir_, dir_ / "rig.toml", [this] { in_daemon(); });
    ASSERT_TRUE(daemon_->reach("ready")) << daemon_->log() << daemon_->status().dump(2);
  }

  std::string say(const std::string& line) const {
    return run(dir_, {bin("isorig-simrig"), "send", (dir_ / "control").string(), line}).text;
  }

  TempDir dir_;
  std::optional<Process> simrig_;
  std::optional<DaemonProcess> daemon_;
};

}  // namespace isorig::system_test
