// The daemon with a real rig's drivers, over Modbus and a serial line, against isorig-simrig, with LCM's own logger
// listening: what was recorded and published is what the plant did, and faults of the wire end as they should.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sched.h>

#include <array>
#include <cstdlib>
#include <map>
#include <set>

#include "messages/log_reader.hpp"
#include "messages/recording.hpp"
#include "messages/run_log.hpp"
#include "truth.hpp"
#include "wire_rig.hpp"

namespace isorig::system_test {
namespace {

using testing::HasSubstr;

/// A network of this test's own, where nobody else's LCM is heard and multicast stays on `lo`. Where the machine does
/// not give one, the host's is used, on an LCM port of our own.
bool own_network() {
  if (::unshare(CLONE_NEWNET) != 0) return false;
  return std::system("ip link set lo up && ip link set lo multicast on && ip route add 224.0.0.0/4 dev lo") == 0;
}

class Wire : public WireRig {
 protected:
  void SetUp() override {
    own_network_ = own_network();
    lcm_port_ = own_network_ ? 7667 : 20000 + static_cast<int>(::getpid()) % 20000;
    url_ = lcm_url(lcm_port_);
  }

  static std::string lcm_url(int port) {
    return "udpm://239.255.76.67:" + std::to_string(port) + "?ttl=0&recv_buf_size=2097152";
  }

  std::string rig_text() const override {
    return WireRig::rig_text() + "\n[lcm]\nenabled = true\nurl = \"" + url_ + "\"\n";
  }

  /// Runs a protocol to its end and compares what was recorded with what the plant did.
  std::string run_and_compare(const std::string& protocol) {
    const auto id = started_run(daemon_->call({"start", protocol}));
    if (id.empty()) return id;
    const auto watched = daemon_->call({"watch", "--until-done", "--interval-s", "1"}, 150.0);
    const auto status = daemon_->status();
    EXPECT_EQ(watched.code, 0) << watched.text << status.dump(2) << daemon_->log();
    std::printf("  loop: %s\n  frame: %s\n  sensor: %s\n", status["loop"].dump().c_str(),
                status["frame"].dump().c_str(), status["pressure"].dump().c_str());
    EXPECT_EQ(daemon_->process().stop(SIGTERM), 0) << daemon_->log();
    EXPECT_EQ(simrig_->stop(SIGTERM), 0) << simrig_->output();

    const auto truth = Truth::read(dir_ / "truth.csv");
    RunComparison comparison(truth);
    const auto report = messages::read_run(dir_ / "runs" / id, comparison);
    EXPECT_TRUE(report.whole()) << testing::PrintToString(report.complaints());
    comparison.finish();
    comparison.print();
    for (const auto* c : {&comparison.position, &comparison.force, &comparison.pressure_psi}) {
      EXPECT_GT(c->compared, 500U);  // on a quiet machine nearly all; a simulator that waits its turn leaves gaps
      EXPECT_EQ(c->outside, 0U) << "by up to " << c->worst_excess;
    }
    EXPECT_EQ(comparison.mean_position.outside, 0U);
    for (const auto* s : {&comparison.frame_sequence, &comparison.pressure_sequence}) {
      EXPECT_EQ(s->missing, 0U);
      EXPECT_EQ(s->repeated, 0U);
    }
    return id;
  }

  /// Pressurized and ramping slowly, for a fault to hit.
  void be_busy() {
    spit(dir_ / "busy.toml", R"(format = "isorig-protocol/1"
name = "busy"
recording.policy = "round_ramps"
steps = [
  { do = "pressurize", pressure_psi = 5, rate_psi_s = 5, settled_for_s = 0.3, timeout_s = 30 },
  { do = "ramp", to_mm = 2, velocity_mm_s = 0.02 },
]
)");
    started_run(daemon_->call({"start", (dir_ / "busy.toml").string()}));
    ASSERT_TRUE(wait_until(40.0, [&] { return daemon_->status().value("position_mm", 0.0) > 0.02; }))
        << daemon_->status().dump(2);
  }

  bool own_network_ = false;
  int lcm_port_ = 0;
  std::string url_;
};

/// What an LCM log file holds of our channels, and how many messages its subscriber missed.
struct Heard {
  std::map<std::string, std::uint64_t> messages;
  std::int64_t missed = 0;
  std::uint64_t frame_samples = 0;
};

template <typename Message>
std::int64_t number_of(const messages::LogEvent& event) {
  Message m;
  if (m.decode(event.data.data(), 0, static_cast<int>(event.data.size())) < 0)
    throw std::runtime_error("not decodable");
  return m.number;
}

Heard read_heard(const std::filesystem::path& file) {
  Heard heard;
  std::map<std::string, messages::GapCounter> gaps;
  messages::LogReader reader(file);
  while (const auto event = reader.next()) {
    const std::string channel(event->channel);
    ++heard.messages[channel];
    std::optional<std::int64_t> number;
    if (channel == "ISORIG_FRAME") {
      isorig_msgs::frame_batch_t m;
      if (m.decode(event->data.data(), 0, static_cast<int>(event->data.size())) < 0)
        throw std::runtime_error("frame_batch_t");
      number = m.number;
      heard.frame_samples += static_cast<std::uint64_t>(m.count);
    }
    if (channel == "ISORIG_PRESSURE") number = number_of<isorig_msgs::pressure_batch_t>(*event);
    if (channel == "ISORIG_STATE") number = number_of<isorig_msgs::control_batch_t>(*event);
    if (channel == "ISORIG_EVENT") number = number_of<isorig_msgs::event_t>(*event);
    if (number) heard.missed += gaps[channel].next(*number);
  }
  return heard;
}

TEST_F(Wire, ModbusTcpRecordsAndPublishesWhatThePlantDid) {
  ASSERT_NO_FATAL_FAILURE(start(false));
  Process logger({"lcm-logger", "-q", "-f", "-c", "ISORIG_.*", "--lcm-url=" + url_, (dir_ / "heard.lcm").string()},
                 dir_ / "logger.log");
  std::this_thread::sleep_for(std::chrono::milliseconds(500));
  const auto id = run_and_compare(source("config/protocols/vma-smoke.toml"));
  ASSERT_FALSE(id.empty());

  // What anybody on LCM heard.
  (void)logger.stop(SIGINT, 10.0);
  const auto heard = read_heard(dir_ / "heard.lcm");
  std::uint64_t total = 0;
  for (const auto& [channel, count] : heard.messages) total += count;
  std::printf("  lcm-logger: %llu messages on %zu channels, %lld missed (%s network)\n",
              static_cast<unsigned long long>(total), heard.messages.size(), static_cast<long long>(heard.missed),
              own_network_ ? "own" : "the host's");
  for (const auto* channel : {"ISORIG_FRAME", "ISORIG_PRESSURE", "ISORIG_STATE", "ISORIG_EVENT", "ISORIG_PROGRESS"}) {
    EXPECT_GT(heard.messages.count(channel), 0U) << channel;
  }
  EXPECT_GT(heard.frame_samples, 20'000U);                         // every sample, not the recording's averages
  EXPECT_LT(heard.missed, static_cast<std::int64_t>(total / 20));  // UDP may lose; the number says how much

  // The recording format, and LCM's player on our segments.
  const auto exported =
      isorig(dir_, {"export", id, "--runs", (dir_ / "runs").string(), "--out", (dir_ / "out").string()});
  EXPECT_EQ(exported.code, 0) << exported.text;
  for (const auto* folder : {"rep-1_5-psi", "rep-2_5-psi"}) {
    const auto recording = messages::read_recording(dir_ / "out" / folder);
    EXPECT_THAT(recording.metadata.further_toml, HasSubstr("complete = true"));
    const auto [low, high] =
        std::minmax_element(recording.frame.position_mm.begin(), recording.frame.position_mm.end());
    EXPECT_NEAR(*low, -1.0, 0.1);
    EXPECT_NEAR(*high, 1.0, 0.1);
  }

  // And what the logger heard, like a run: its sessions from the events, every sample in full.
  const auto log = (dir_ / "heard.lcm").string();
  const auto unnamed = isorig(dir_, {"export", log, "--out", (dir_ / "unnamed").string()});
  EXPECT_NE(unnamed.code, 0);
  EXPECT_THAT(unnamed.text, HasSubstr("--rest-length-mm"));
  const auto live = isorig(
      dir_, {"export", log, "--specimen", "as heard", "--rest-length-mm", "94.3", "--out", (dir_ / "live").string()});
  EXPECT_TRUE(live.code == 0 || live.code == 7) << live.text;  // 7: UDP lost some, or the logger its last buffer
  for (const auto* folder : {"rep-1_5-psi", "rep-2_5-psi"}) {
    const auto recorded = messages::read_recording(dir_ / "out" / folder);
    const auto played = messages::read_recording(dir_ / "live" / folder);
    EXPECT_EQ(played.metadata.specimen, "as heard");
    EXPECT_GT(played.frame.size(), recorded.frame.size()) << folder;
    // The recording goes on until the run is closed, the live session ends with its event; LCM's logger forgets a
    // buffer.
    EXPECT_NEAR(played.frame.t_s.back(), recorded.frame.t_s.back(), 4.0) << folder;
    const auto ramps = slurp(dir_ / "live" / folder / "ramps.csv");
    EXPECT_EQ(std::count(ramps.begin(), ramps.end(), '\n'), 5) << ramps;
    EXPECT_THAT(ramps, HasSubstr(",0,1,10,")) << "targets from ISORIG_STATE: to +1 mm at 10 mm/s";
  }

  const auto segments = messages::list_segments(dir_ / "runs" / id);
  ASSERT_FALSE(segments.empty());
  const auto recorded = read_heard(segments.front());
  const auto other = lcm_url(own_network_ ? 7668 : lcm_port_ + 1);
  Process second({"lcm-logger", "-q", "-f", "--lcm-url=" + other, (dir_ / "played.lcm").string()}, dir_ / "second.log");
  std::this_thread::sleep_for(std::chrono::milliseconds(500));
  Process player({"lcm-logplayer", "-s", "4", "--lcm-url=" + other, segments.front().string()}, dir_ / "player.log");
  EXPECT_EQ(player.wait(60.0), 0) << player.output();
  std::this_thread::sleep_for(std::chrono::milliseconds(500));
  (void)second.stop(SIGINT, 10.0);
  const auto played = read_heard(dir_ / "played.lcm");
  for (const auto& [channel, count] : recorded.messages) {
    const auto at = played.messages.find(channel);
    const auto arrived = at == played.messages.end() ? 0 : at->second;
    EXPECT_LE(arrived, count) << channel;
    EXPECT_GE(2 * arrived + 2, count) << channel;  // UDP: a listener that is not scheduled in time loses some
  }
}

TEST_F(Wire, ModbusRtuRecordsWhatThePlantDid) {
  ASSERT_NO_FATAL_FAILURE(start(true));
  spit(dir_ / "short.toml", R"(format = "isorig-protocol/1"
name = "short"
recording.policy = "round_ramps"
recording.before_s = 1.0
recording.after_s = 1.0
steps = [
  { do = "pressurize", pressure_psi = 5, rate_psi_s = 5, settled_for_s = 0.3, timeout_s = 20 },
  { do = "ramp", to_mm = 1, velocity_mm_s = 10 },
  { do = "hold", duration_s = 2 },
  { do = "ramp", to_mm = 0, velocity_mm_s = 0.5, record = "averaged" },
  { do = "hold", duration_s = 3, record = "averaged" },
]
)");
  run_and_compare((dir_ / "short.toml").string());
}

TEST_F(Wire, AFrameThatIsGoneIsASafeStateAndItsReturnIsRecovered) {
  ASSERT_NO_FATAL_FAILURE(start(false));
  ASSERT_NO_FATAL_FAILURE(be_busy());
  EXPECT_EQ(say("fault frame disconnect on"), "ok\n");
  ASSERT_TRUE(daemon_->reach("faulted", 20.0)) << daemon_->status().dump(2);
  EXPECT_THAT(daemon_->status().value("fault", ""), HasSubstr("frame"));
  EXPECT_TRUE(wait_until(30.0, [&] { return daemon_->status().value("pressure_psi", 99.0) < 0.6; }));  // vented
  EXPECT_EQ(daemon_->call({"reset"}).code, 5);  // the cause is still there
  EXPECT_EQ(say("clear"), "ok\n");
  EXPECT_TRUE(wait_until(30.0, [&] { return daemon_->call({"reset"}).code == 0; })) << daemon_->status().dump(2);
  EXPECT_TRUE(daemon_->reach("ready", 20.0)) << daemon_->status().dump(2);
  EXPECT_GT(daemon_->status()["frame"]["reconnects"].get<int>(), 0);
  const auto rows = daemon_->catalogue();
  ASSERT_EQ(rows.size(), 1U);
  EXPECT_EQ(rows[0]["state"], "failed");
}

TEST_F(Wire, ATeensyThatIsGoneIsASafeState) {
  ASSERT_NO_FATAL_FAILURE(start(false));
  ASSERT_NO_FATAL_FAILURE(be_busy());
  EXPECT_EQ(say("fault teensy unplug on"), "ok\n");
  ASSERT_TRUE(daemon_->reach("faulted", 20.0)) << daemon_->status().dump(2);
  EXPECT_THAT(daemon_->status().value("fault", ""), HasSubstr("pressure"));
  EXPECT_EQ(say("clear"), "ok\n");
  EXPECT_TRUE(wait_until(30.0, [&] { return daemon_->call({"reset"}).code == 0; })) << daemon_->status().dump(2);
  EXPECT_TRUE(daemon_->reach("ready", 20.0)) << daemon_->status().dump(2);
}

TEST_F(Wire, DelayAndCorruptBytesAreCountedAndTheRunGoesOn) {
  ASSERT_NO_FATAL_FAILURE(start(false));
  ASSERT_NO_FATAL_FAILURE(be_busy());
  EXPECT_EQ(say("fault frame delay 20"), "ok\n");
  EXPECT_EQ(say("fault teensy corrupt 20"), "ok\n");
  EXPECT_EQ(say("fault frame corrupt 2"), "ok\n");
  EXPECT_TRUE(wait_until(20.0, [&] {
    const auto s = daemon_->status();
    return s["pressure"].value("corrupt", 0) > 0 && s["frame"].value("errors", 0) + s["frame"].value("corrupt", 0) > 0;
  })) << daemon_->status().dump(2);
  EXPECT_EQ(say("clear"), "ok\n");
  std::this_thread::sleep_for(std::chrono::seconds(1));
  EXPECT_EQ(daemon_->state(), "running") << daemon_->status().dump(2);
  const double before_mm = daemon_->status().value("position_mm", 0.0);
  EXPECT_TRUE(wait_until(10.0, [&] { return daemon_->status().value("position_mm", 0.0) > before_mm + 0.01; }));
  const auto status = daemon_->status();
  std::printf("  frame: %s\n  sensor: %s\n", status["frame"].dump().c_str(), status["pressure"].dump().c_str());
}

}  // namespace
}  // namespace isorig::system_test
