// The example loggers beside lcm-logger: what they write is the same, what was missed is said, lcm-logplayer plays it,
// also from one network to another.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sched.h>

#include <algorithm>
#include <fstream>
#include <isorig_msgs/event_t.hpp>
#include <isorig_msgs/frame_batch_t.hpp>
#include <lcm/lcm-cpp.hpp>
#include <sstream>

// The example itself, whose main() stands beside the tests'.
#define main example_logger_main
int example_logger_main(int argc, char** argv);
#include "../../examples/lcm/logger.cpp"
#undef main

#include "messages/log_reader.hpp"
#include "processes.hpp"

namespace isorig::system_test {
namespace {

using testing::HasSubstr;
using testing::Not;

constexpr std::int64_t kMessages = 400;
/// Never sent: what a subscriber misses.
bool left_out(std::int64_t number) {
  return number >= 100 && number < 107;
}

std::string url_of(int port, int ttl) {
  return "udpm://239.255.76.67:" + std::to_string(port) + "?ttl=" + std::to_string(ttl) + "&recv_buf_size=2097152";
}

/// Sent after the two that follow it, as a network that reorders delivers it: late, and not missed.
constexpr std::int64_t kLate = 200;

std::vector<std::int64_t> sent() {
  std::vector<std::int64_t> numbers;
  for (std::int64_t n = 0; n < kMessages; ++n) {
    if (!left_out(n) && n != kLate) numbers.push_back(n);
    if (n == kLate + 2) numbers.push_back(kLate);
  }
  return numbers;
}

/// Frame batches with known numbers, 2 ms apart.
bool publish(const std::string& url) {
  lcm::LCM lcm(url);
  if (!lcm.good()) return false;
  isorig_msgs::frame_batch_t m{};
  m.count = 10;
  m.mono_offset_ns.resize(10);
  m.device_offset_us.resize(10);
  m.sequence_offset.resize(10);
  for (auto* v : {&m.bound_ns, &m.repeatability_ns, &m.raw_position_mm, &m.raw_force_N}) v->resize(10);
  m.position_mm.resize(10, 1.5);
  m.force_N.resize(10, 44.0);
  for (const std::int64_t number : sent()) {
    m.number = number;
    m.mono_ns = m.number * 10'000'000;
    if (lcm.publish("ISORIG_FRAME", &m) != 0) return false;
    std::this_thread::sleep_for(std::chrono::milliseconds(2));
  }
  return true;
}

/// The numbers of the frame messages in a log.
std::vector<std::int64_t> numbers_in(const std::filesystem::path& log) {
  std::vector<std::int64_t> numbers;
  messages::LogReader reader(log);
  while (const auto event = reader.next()) {
    isorig_msgs::frame_batch_t m;
    if (event->channel != "ISORIG_FRAME") continue;
    EXPECT_GE(m.decode(event->data.data(), 0, static_cast<int>(event->data.size())), 0);
    numbers.push_back(m.number);
  }
  return numbers;
}

class LcmExamples : public testing::Test {
 protected:
  void SetUp() override {
    if (::unshare(CLONE_NEWNET) != 0) GTEST_SKIP() << "a network of one's own needs root";
    ASSERT_EQ(std::system("ip link set lo up && ip link set lo multicast on && ip route add 224.0.0.0/4 dev lo"), 0);
  }

  std::vector<std::string> cpp(const std::string& url, const std::string& log) const {
    return {bin("isorig-example-logger"), "--lcm-url", url, (dir_ / log).string()};
  }
  std::vector<std::string> python(const std::string& url, const std::string& log) const {
    return {"env",
            "PYTHONPATH=" ISORIG_LCM_PYTHON,
            "/usr/bin/python3",
            source("examples/lcm/logger.py"),
            "--lcm-url",
            url,
            (dir_ / log).string()};
  }
  static void wait_for(const Process& process) {
    for (int i = 0; i < 200 && process.output().find("listening") == std::string::npos; ++i) {
      std::this_thread::sleep_for(std::chrono::milliseconds(50));
    }
    ASSERT_THAT(process.output(), HasSubstr("listening"));
  }
  static std::vector<std::string> in_network_of(pid_t pid, std::vector<std::string> words) {
    words.insert(words.begin(), {"nsenter", "-t", std::to_string(pid), "-n"});
    return words;
  }

  TempDir dir_;
};

TEST(LcmExampleInCpp, CountsByTheCasesThatGapCounterCountsBy) {
  std::ifstream file(source("tests/messages/gap_cases.txt"));
  int cases = 0;
  for (std::string line; std::getline(file, line);) {
    if (line.starts_with('#')) continue;
    std::istringstream numbers(line.substr(0, line.find('='))), changes(line.substr(line.find('=') + 1));
    Count count;
    std::vector<std::int64_t> counted, expected;
    for (std::int64_t number = 0; numbers >> number;) counted.push_back(count.next(number));
    for (std::int64_t change = 0; changes >> change;) expected.push_back(change);
    EXPECT_EQ(counted, expected) << line;
    ++cases;
  }
  EXPECT_GT(cases, 15);
}

TEST_F(LcmExamples, LogWhatLcmLoggerLogsAndSayWhatWasMissed) {
  const auto url = url_of(7667, 0);
  Process tool({"lcm-logger", "-q", "-f", "--flush-interval=10", "--lcm-url=" + url, (dir_ / "tool.lcm").string()},
               dir_ / "tool.log");
  Process in_cpp(cpp(url, "cpp.lcm"), dir_ / "cpp.log");
  Process in_python(python(url, "python.lcm"), dir_ / "python.log");
  wait_for(in_cpp);
  wait_for(in_python);
  std::this_thread::sleep_for(std::chrono::milliseconds(300));  // lcm-logger does not say when it listens
  ASSERT_TRUE(publish(url));
  std::this_thread::sleep_for(std::chrono::milliseconds(300));
  EXPECT_EQ(in_cpp.stop(SIGINT), 0) << in_cpp.output();
  EXPECT_EQ(in_python.stop(SIGINT), 0) << in_python.output();
  (void)tool.stop(SIGINT);

  const std::string summary = "ISORIG_FRAME: " + std::to_string(kMessages - 7) + " messages, 7 missed";
  for (const auto* process : {&in_cpp, &in_python}) {
    EXPECT_THAT(process->output(), HasSubstr("ISORIG_FRAME: missed 7\n"));
    EXPECT_THAT(process->output(), HasSubstr(summary));
    EXPECT_THAT(process->output(), HasSubstr(std::to_string(10 * (kMessages - 7)) + " frame samples"));
  }
  EXPECT_EQ(numbers_in(dir_ / "cpp.lcm"), sent());
  EXPECT_EQ(numbers_in(dir_ / "python.lcm"), sent());
  // Debian 12's logger forgets its last buffer when it is ended: what it has is the beginning of the same.
  const auto logged = numbers_in(dir_ / "tool.lcm");
  EXPECT_GT(logged.size(), 100U);
  EXPECT_TRUE(std::equal(logged.begin(), logged.end(), sent().begin()));

  // And played again, each hears the other's.
  const auto again = url_of(7669, 0);
  Process second_cpp(cpp(again, "played-cpp.lcm"), dir_ / "second-cpp.log");
  Process second_python(python(again, "played-python.lcm"), dir_ / "second-python.log");
  wait_for(second_cpp);
  wait_for(second_python);
  Process player({"lcm-logplayer", "--lcm-url=" + again, (dir_ / "python.lcm").string()}, dir_ / "player.log");
  EXPECT_EQ(player.wait(30.0), 0) << player.output();
  std::this_thread::sleep_for(std::chrono::milliseconds(300));
  EXPECT_EQ(second_cpp.stop(SIGINT), 0) << second_cpp.output();
  EXPECT_EQ(second_python.stop(SIGINT), 0) << second_python.output();
  EXPECT_EQ(numbers_in(dir_ / "played-cpp.lcm"), sent());
  EXPECT_EQ(numbers_in(dir_ / "played-python.lcm"), sent());
}

TEST_F(LcmExamples, HearARigInAnotherNetwork) {
  // A second network, held by a process that waits; a cable between the two.
  Process other({"unshare", "-n", "sleep", "60"}, dir_ / "other.log");
  std::this_thread::sleep_for(std::chrono::milliseconds(300));
  const auto pid = std::to_string(other.pid());
  const auto there = "nsenter -t " + pid + " -n ip ";
  const auto cable =
      "ip link add rig type veth peer name desk netns " + pid +
      " && ip addr add 10.77.0.1/24 dev rig && ip link set rig up && ip route change 224.0.0.0/4 dev rig && " + there +
      "link set lo up && " + there + "addr add 10.77.0.2/24 dev desk && " + there + "link set desk up && " + there +
      "route add 224.0.0.0/4 dev desk";
  if (std::system(cable.c_str()) != 0) GTEST_SKIP() << "this kernel has no veth: " << cable;
  const auto url = url_of(7667, 1);
  Process in_cpp(in_network_of(other.pid(), cpp(url, "cpp.lcm")), dir_ / "cpp.log");
  Process in_python(in_network_of(other.pid(), python(url, "python.lcm")), dir_ / "python.log");
  wait_for(in_cpp);
  wait_for(in_python);
  ASSERT_TRUE(publish(url));
  // ttl=0 stays here: a desk hears nothing of it.
  ASSERT_TRUE(publish(url_of(7667, 0)));
  std::this_thread::sleep_for(std::chrono::milliseconds(300));
  EXPECT_EQ(in_cpp.stop(SIGINT), 0) << in_cpp.output();
  EXPECT_EQ(in_python.stop(SIGINT), 0) << in_python.output();
  EXPECT_EQ(numbers_in(dir_ / "cpp.lcm"), sent());
  EXPECT_EQ(numbers_in(dir_ / "python.lcm"), sent());
  EXPECT_THAT(in_cpp.output(), HasSubstr("7 missed"));

  // lcm-logplayer at the rig, a logger at the desk.
  Process hears(in_network_of(other.pid(), cpp(url, "played.lcm")), dir_ / "hears.log");
  wait_for(hears);
  Process player({"lcm-logplayer", "--lcm-url=" + url, (dir_ / "cpp.lcm").string()}, dir_ / "player.log");
  EXPECT_EQ(player.wait(30.0), 0) << player.output();
  std::this_thread::sleep_for(std::chrono::milliseconds(300));
  EXPECT_EQ(hears.stop(SIGINT), 0) << hears.output();
  EXPECT_EQ(numbers_in(dir_ / "played.lcm"), sent());
  (void)other.stop(SIGTERM);
}

}  // namespace
}  // namespace isorig::system_test
