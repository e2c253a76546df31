// isorig-simrig as a program, with the drivers of a real rig at the other end.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <sstream>

#include "drivers/api/clock.hpp"
#include "drivers/clock/real_clock.hpp"
#include "drivers/frame/modbus_frame.hpp"
#include "drivers/pressure/teensy.hpp"
#include "drivers/pressure/tty_stream.hpp"
#include "messages/elvh.hpp"
#include "sim/wire/control_socket.hpp"
#include "sim/wire/wire_rig.hpp"
#include "tree.hpp"

namespace isorig::sim {
namespace {

using testing::HasSubstr;

const std::string kRig = test::source_path("/config/rigs/sim-wire.toml");

/// The program as a child, its output read until it is ready.
class Simrig {
 public:
  explicit Simrig(std::vector<std::string> more, const std::string& ring_samples = "2048") {
    std::string directory = testing::TempDir() + "simrig-XXXXXX";
    if (::mkdtemp(directory.data()) == nullptr) throw std::runtime_error("no temporary directory");
    path = directory;
    // Rings that hold what a machine leaves lying that stands still for a second.
    std::ifstream in(kRig);
    std::string rig((std::istreambuf_iterator<char>(in)), {});
    const auto replace = [&](const std::string& from, const std::string& to) {
      for (auto i = rig.find(from); i != std::string::npos; i = rig.find(from, i + to.size()))
        rig.replace(i, from.size(), to);
    };
    replace("\"../", "\"" + test::source_path("/config/"));
    replace("ring_samples = 256", "ring_samples = " + ring_samples);
    std::ofstream(file("rig.toml")) << rig;
    std::vector<std::string> words{test::program_path("/isorig-simrig"),
                                   "--rig",
                                   file("rig.toml"),
                                   "--port",
                                   "0",
                                   "--duration",
                                   "60",
                                   "--teensy",
                                   file("teensy"),
                                   "--control",
                                   file("control"),
                                   "--truth",
                                   file("truth.csv")};
    words.insert(words.end(), more.begin(), more.end());
    int out[2];
    if (::pipe(out) != 0) throw std::runtime_error("no pipe");
    child_ = ::fork();
    if (child_ == 0) {
      ::dup2(out[1], STDOUT_FILENO);
      ::close(out[0]);
      std::vector<char*> arguments;
      for (auto& word : words) arguments.push_back(word.data());
      arguments.push_back(nullptr);
      ::execv(arguments[0], arguments.data());
      ::_exit(127);
    }
    ::close(out[1]);
    std::FILE* lines = ::fdopen(out[0], "r");
    std::array<char, 256> line{};
    while (std::fgets(line.data(), line.size(), lines) != nullptr) {
      output += line.data();
      unsigned number = 0;
      if (std::sscanf(line.data(), "frame: tcp 127.0.0.1:%u", &number) == 1) port = static_cast<std::uint16_t>(number);
      if (output.find("ready") != std::string::npos) break;
    }
    std::fclose(lines);
  }
  ~Simrig() {
    stop();
    std::filesystem::remove_all(path);
  }
  /// The exit status.
  int stop() {
    if (child_ < 0) return status_;
    ::kill(child_, SIGTERM);
    ::waitpid(child_, &status_, 0);
    child_ = -1;
    return status_;
  }
  void signal(int number) const { ::kill(child_, number); }
  [[nodiscard]] std::string file(const std::string& name) const { return path / name; }
  std::string say(const std::string& line) { return ControlSocket::ask(file("control"), line); }

  std::filesystem::path path;
  std::string output;
  std::uint16_t port = 0;

 private:
  pid_t child_ = -1;
  int status_ = 0;
};

struct TruthRow {
  std::int64_t mono_ns;
  double position_mm, force_N, pressure_psi;
};

std::vector<TruthRow> read_truth(const std::string& file) {
  std::vector<TruthRow> rows;
  std::ifstream in(file);
  std::string line;
  std::getline(in, line);
  EXPECT_EQ(line, "mono_ns,position_mm,force_N,pressure_psi");
  while (std::getline(in, line)) {
    TruthRow row{};
    long long ns = 0;
    if (std::sscanf(line.c_str(), "%lld,%lf,%lf,%lf", &ns, &row.position_mm, &row.force_N, &row.pressure_psi) == 4) {
      row.mono_ns = ns;
      rows.push_back(row);
    }
  }
  return rows;
}

double position_at(const std::vector<TruthRow>& rows, double mono_ns) {
  const auto after = std::lower_bound(rows.begin(), rows.end(), mono_ns, [](const TruthRow& row, double at) {
    return static_cast<double>(row.mono_ns) < at;
  });
  if (after == rows.begin() || after == rows.end()) return std::nan("");
  const auto before = after - 1;
  const double fraction =
      (mono_ns - static_cast<double>(before->mono_ns)) / static_cast<double>(after->mono_ns - before->mono_ns);
  return before->position_mm + fraction * (after->position_mm - before->position_mm);
}

/// The map's ring is longer than the simulated frame's own: what that overwrote must not come a second time.
TEST(Simrig, AnEmulatorThatWasHeldUpServesNoSampleTwice) {
  Simrig simrig({}, "256");
  ASSERT_NE(simrig.port, 0) << simrig.output;
  clock::RealClock clock;
  auto config = std::get<WireRigConfig::Modbus>(read_wire_rig(kRig).frame).line;
  config.port = simrig.port;
  config.response_timeout_ms = 2000;
  frame::ModbusFrame frame(config, clock);
  (void)frame.connect();
  std::vector<frame::Sample> samples, part(4096);
  std::uint64_t lost = 0;
  std::int64_t longest_ns = 0, last_ns = clock.now_ns();
  const auto poll_for = [&](std::int64_t ns) {
    for (const std::int64_t until_ns = clock.now_ns() + ns; clock.now_ns() < until_ns;) {
      const auto poll = frame.poll(part);
      longest_ns = std::max(longest_ns, clock.now_ns() - last_ns);
      last_ns = clock.now_ns();
      samples.insert(samples.end(), part.begin(), part.begin() + static_cast<std::ptrdiff_t>(poll.samples));
      lost += poll.lost;
      clock.sleep_until_ns(clock.now_ns() + 10'000'000);
    }
  };
  poll_for(1'200'000'000);  // a turn of the map's ring: each of its slots was written once
  simrig.signal(SIGSTOP);
  clock.sleep_until_ns(clock.now_ns() + 400'000'000);
  simrig.signal(SIGCONT);
  poll_for(400'000'000);
  ASSERT_GT(samples.size(), 1'000U);
  EXPECT_EQ(samples.back().sequence - samples.front().sequence + 1, samples.size() + lost);
  for (std::size_t i = 1; i < samples.size(); ++i) {
    const auto samples_on = static_cast<double>(samples[i].sequence - samples[i - 1].sequence);
    const auto us_on = static_cast<double>(samples[i].device_us - samples[i - 1].device_us);
    ASSERT_NEAR(us_on, 1000.0 * samples_on, 100.0) << samples[i].sequence;
  }
  if (longest_ns < 900'000'000) {
    EXPECT_EQ(lost, 0U);  // else the machine stood still for longer than the ring lasts
  }
}

TEST(Simrig, WhatTheDriversReadIsWhatThePlantDid) {
  Simrig simrig({});
  ASSERT_NE(simrig.port, 0) << simrig.output;
  clock::RealClock clock;
  auto config = std::get<WireRigConfig::Modbus>(read_wire_rig(kRig).frame).line;
  config.port = simrig.port;
  config.response_timeout_ms = 2000;  // a loaded machine is not what is tested here
  frame::ModbusFrame frame(config, clock);
  EXPECT_EQ(frame.connect().serial, "SIM-FRAME-1");

  pressure::Teensy::Options options;
  options.serial = "1234560";
  pressure::Teensy teensy(
      options, std::make_unique<pressure::TtyStream>(pressure::TtyStream::Options{.path = simrig.file("teensy")}),
      clock);
  EXPECT_EQ(teensy.connect().serial, "1234560");

  frame.heartbeat(1);
  frame.start_segment({5, 1.0F, 10.0F});
  std::vector<frame::Sample> samples, part(4096);
  std::vector<pressure::Sample> words(4096);
  std::array<clock::Exchange, 16> exchanges;
  clock::Exchange best{0, 1'000'000'000, 0.0, 0.0};
  std::size_t pressure_samples = 0;
  std::uint32_t lost = 0;
  frame::State state;
  const std::int64_t start_ns = clock.now_ns();
  for (std::uint16_t i = 2; clock.now_ns() - start_ns < 600'000'000 || pressure_samples <= 300; ++i) {
    ASSERT_LT(clock.now_ns() - start_ns, 30'000'000'000);
    frame.heartbeat(i);
    teensy.heartbeat();
    const auto poll = frame.poll(part);
    samples.insert(samples.end(), part.begin(), part.begin() + static_cast<std::ptrdiff_t>(poll.samples));
    lost += poll.lost;
    state = poll.state;
    if (poll.has_exchange &&
        poll.exchange.host_recv_ns - poll.exchange.host_send_ns < best.host_recv_ns - best.host_send_ns) {
      best = poll.exchange;
    }
    const auto air = teensy.poll(words, exchanges, 5'000'000);
    for (std::size_t k = 0; k < air.samples; ++k) {
      const auto word = messages::unpack_elvh(words[k].raw_word);
      EXPECT_NEAR(messages::elvh_pressure_psi(word.pressure_raw), 0.0, 0.05);
    }
    pressure_samples += air.samples;
    clock.sleep_until_ns(clock.now_ns() + 5'000'000);
  }
  EXPECT_EQ(state.motion, frame::Motion::kReached);
  EXPECT_EQ(state.segment_id, 5);
  EXPECT_EQ(lost, 0U);
  EXPECT_GT(pressure_samples, 300U);
  ASSERT_GT(samples.size(), 400U);
  EXPECT_EQ(samples.back().sequence - samples.front().sequence + 1, samples.size());

  EXPECT_EQ(simrig.stop(), 0);
  const auto truth = read_truth(simrig.file("truth.csv"));
  ASSERT_GT(truth.size(), 100U);
  // One exchange maps 0.6 s well enough: 12 ppm of skew are 7 us, 10 mm/s make 0.1 um of it.
  const double middle_ns = 0.5 * (static_cast<double>(best.host_send_ns) + static_cast<double>(best.host_recv_ns));
  const double uncertain_mm = 10.0 * 0.5e-9 * static_cast<double>(best.host_recv_ns - best.host_send_ns);
  std::size_t compared = 0;
  double largest_mm = 0.0;
  for (const auto& sample : samples) {
    const double at_ns = middle_ns + 1000.0 * (static_cast<double>(sample.device_us) - best.device_tx_us);
    const double true_mm = position_at(truth, at_ns);
    if (std::isnan(true_mm)) continue;
    largest_mm = std::max(largest_mm, std::abs(static_cast<double>(sample.position_mm) - true_mm));
    ++compared;
  }
  EXPECT_GT(compared, 400U);
  // Noise of 0.2 um rms and steps of 0.1 um; within a step of the truth the ramp is not quite straight.
  EXPECT_LT(largest_mm, 0.01 + uncertain_mm);
  EXPECT_NEAR(static_cast<double>(samples.back().position_mm), 1.0, 0.01);
}

TEST(Simrig, FaultsAreSwitchedWhileItRuns) {
  Simrig simrig({"--fault", "frame refuse on"});
  ASSERT_NE(simrig.port, 0) << simrig.output;
  clock::RealClock clock;
  auto config = std::get<WireRigConfig::Modbus>(read_wire_rig(kRig).frame).line;
  config.port = simrig.port;
  config.response_timeout_ms = 2000;
  frame::ModbusFrame frame(config, clock);
  frame.connect();
  frame.heartbeat(1);
  EXPECT_THROW(frame.start_segment({1, 0.5F, 5.0F}), drivers::DeviceError);
  EXPECT_EQ(simrig.say("clear"), "ok\n");
  frame.heartbeat(2);
  EXPECT_NO_THROW(frame.start_segment({2, 0.5F, 5.0F}));

  std::vector<frame::Sample> part(4096);
  EXPECT_EQ(simrig.say("fault frame freeze on"), "ok\n");
  frame.poll(part);  // what came before
  clock.sleep_until_ns(clock.now_ns() + 30'000'000);
  EXPECT_EQ(frame.poll(part).samples, 0U);
  EXPECT_THAT(simrig.say("list"), HasSubstr("frame freeze on"));
  EXPECT_EQ(simrig.say("fault frame freeze off"), "ok\n");
  clock.sleep_until_ns(clock.now_ns() + 30'000'000);
  EXPECT_GT(frame.poll(part).samples, 20U);

  EXPECT_EQ(simrig.say("fault rig estop on"), "ok\n");
  const auto end_ns = clock.now_ns() + 20'000'000'000;
  while ((frame.poll(part).state.fault_bits & frame::kInterlockOpen) == 0) ASSERT_LT(clock.now_ns(), end_ns);

  EXPECT_THAT(simrig.say("fault frame freeze maybe"), HasSubstr("on or off"));
  EXPECT_THAT(simrig.say("fault frame delay -1"), HasSubstr("0 to 60000 ms"));
  EXPECT_THAT(simrig.say("fault frame dealy 1"), HasSubstr("frame delay"));
  EXPECT_THAT(simrig.say("help"), HasSubstr("error: say"));
}

TEST(Simrig, TheHeartbeatStopsTheFrameByItself) {
  Simrig simrig({});
  clock::RealClock clock;
  auto config = std::get<WireRigConfig::Modbus>(read_wire_rig(kRig).frame).line;
  config.port = simrig.port;
  config.response_timeout_ms = 2000;
  frame::ModbusFrame frame(config, clock);
  frame.connect();
  frame.heartbeat(1);
  frame.start_segment({1, 2.0F, 0.5F});  // 4 s
  std::vector<frame::Sample> part(4096);
  frame::State state;
  const std::int64_t start_ns = clock.now_ns();
  do {
    clock.sleep_until_ns(clock.now_ns() + 20'000'000);
    state = frame.poll(part).state;
  } while (state.motion == frame::Motion::kMoving && clock.now_ns() - start_ns < 3'000'000'000);
  EXPECT_EQ(state.motion, frame::Motion::kStopped);
  EXPECT_NE(state.fault_bits & frame::kHeartbeatLost, 0);
}

TEST(Simrig, ARigFileForAnotherDriverIsRefusedWithItsPlace) {
  std::array<char, 512> line{};
  std::FILE* out = ::popen(
      (test::program_path("/isorig-simrig --rig ") + test::source_path("/config/rigs/sim.toml 2>&1")).c_str(), "r");
  std::string text;
  while (std::fgets(line.data(), line.size(), out) != nullptr) text += line.data();
  EXPECT_EQ(WEXITSTATUS(::pclose(out)), 3);
  EXPECT_THAT(text, ::testing::ContainsRegex("sim\\.toml:[0-9]+:[0-9]+: "));
  EXPECT_THAT(text, HasSubstr("\"modbus\""));
}

}  // namespace
}  // namespace isorig::sim
