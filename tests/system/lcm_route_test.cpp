// The daemon on a machine without a route for multicast, and on one that loses it in mid-run: in a network of this
// test's own, on the ordinary URL.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sched.h>

#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <isorig_msgs/frame_batch_t.hpp>
#include <isorig_msgs/progress_t.hpp>
#include <lcm/lcm-cpp.hpp>
#include <regex>

#include "messages/run_log.hpp"
#include "processes.hpp"

namespace isorig::system_test {
namespace {

using testing::HasSubstr;

constexpr const char* kUrl = "udpm://239.255.76.67:7667?ttl=0";
constexpr const char* kAddRoute = "ip route add 224.0.0.0/4 dev lo";
constexpr const char* kDeleteRoute = "ip route del 224.0.0.0/4 dev lo";

bool shell(const std::string& command) {
  return std::system(command.c_str()) == 0;
}

class LcmRoute : public testing::Test {
 protected:
  void SetUp() override {
    if (::unshare(CLONE_NEWNET) != 0) {
      GTEST_SKIP() << "a machine without a route for multicast is a network namespace, which needs root: "
                   << std::strerror(errno);
    }
    ASSERT_TRUE(shell("ip link set lo up multicast on"));
    rig_ = patient_rig(dir_);
    spit(rig_, replaced(slurp(rig_), "[lcm]\nenabled = false", "[lcm]\nenabled = true"));
  }

  TempDir dir_;
  std::filesystem::path rig_;
};

TEST_F(LcmRoute, ADaemonWithoutOneDoesNotStartAndSaysWhatHelps) {
  std::string said;
  {
    DaemonProcess daemon(dir_, rig_);
    EXPECT_EQ(daemon.process().wait(30.0), 1);
    said = daemon.log();
  }
  EXPECT_THAT(said, HasSubstr("LCM cannot open \"" + std::string(kUrl) + "\""));
  std::smatch command;
  ASSERT_TRUE(std::regex_search(said, command, std::regex("`(ip [^`]*)`"))) << said;
  ASSERT_TRUE(shell(command[1])) << said;
  DaemonProcess daemon(dir_, rig_);
  EXPECT_TRUE(daemon.reach("ready")) << daemon.log();
}

/// A subscriber that counts what it missed.
struct Heard {
  std::int64_t missed = 0, failed_publishes = 0;
  std::size_t messages = 0;
  messages::GapCounter gaps;
  void frame(const lcm::ReceiveBuffer*, const std::string&, const isorig_msgs::frame_batch_t* m) {
    missed += gaps.next(m->number);
    ++messages;
  }
  void progress(const lcm::ReceiveBuffer*, const std::string&, const isorig_msgs::progress_t* m) {
    failed_publishes = m->failed_publishes;
  }
};

struct Nothing : messages::RunVisitor {};

TEST_F(LcmRoute, OneThatGoesInMidRunIsToldAndCostsTheRecordingNothing) {
  ASSERT_TRUE(shell(kAddRoute));
  spit(dir_ / "slow.toml", R"(format = "isorig-protocol/1"
name = "slow"
steps = [
  { do = "pressurize", pressure_psi = 5, rate_psi_s = 5, settled_for_s = 0.3, timeout_s = 30 },
  { do = "ramp", to_mm = 1.5, velocity_mm_s = 0.1 },
]
)");
  lcm::LCM lcm(kUrl);
  ASSERT_TRUE(lcm.good());
  Heard heard;
  lcm.subscribe("ISORIG_FRAME", &Heard::frame, &heard)->setQueueCapacity(0);
  lcm.subscribe("ISORIG_PROGRESS", &Heard::progress, &heard);
  const auto listen = [&] {
    while (lcm.handleTimeout(0) > 0) {
    }
  };
  DaemonProcess daemon(dir_, rig_);
  ASSERT_TRUE(daemon.reach("ready")) << daemon.log();
  const auto id = started_run(daemon.call({"start", (dir_ / "slow.toml").string()}));
  const auto position_mm = [&] { return daemon.status().value("position_mm", 0.0); };
  const auto reach_mm = [&](double at_least) {
    return wait_until(60.0, [&] {
      listen();
      return position_mm() >= at_least;
    });
  };
  ASSERT_TRUE(reach_mm(0.05)) << daemon.log();
  ASSERT_GT(heard.messages, 0U);

  ASSERT_TRUE(shell(kDeleteRoute));
  EXPECT_TRUE(wait_until(20.0, [&] {
    return daemon.log().find("LCM: the network takes no messages (Network is unreachable)") != std::string::npos;
  })) << daemon.log();
  listen();
  const auto heard_before = heard.messages;
  EXPECT_TRUE(reach_mm(position_mm() + 0.1)) << "the loop stands still with the network: " << daemon.status().dump(2);
  EXPECT_EQ(daemon.state(), "running") << daemon.log();
  EXPECT_EQ(heard.messages, heard_before) << "the route was still there: nothing was tried";

  ASSERT_TRUE(shell(kAddRoute));
  std::smatch never;
  EXPECT_TRUE(wait_until(30.0, [&] {
    listen();
    return daemon.log().find("LCM: the network takes messages again") != std::string::npos;
  })) << daemon.log();
  const auto said = daemon.log();
  ASSERT_TRUE(std::regex_search(said, never, std::regex("again; ([0-9]+) were never sent"))) << said;
  const auto watched = daemon.call({"watch", "--until-done", "--interval-s", "1"}, 120.0);
  EXPECT_EQ(watched.code, 0) << watched.text;
  listen();
  EXPECT_GT(heard.messages, heard_before);
  EXPECT_GT(heard.missed, 0) << "the numbers of the messages do not show that some are missing";
  EXPECT_GT(heard.failed_publishes, heard.missed) << "other channels failed as well";
  EXPECT_EQ(std::to_string(heard.failed_publishes), never[1].str());
  EXPECT_EQ(daemon.process().stop(SIGTERM), 0) << daemon.log();

  Nothing nothing;
  const auto report = messages::read_run(dir_ / "runs" / id, nothing);
  EXPECT_TRUE(report.whole()) << testing::PrintToString(report.complaints());
}

}  // namespace
}  // namespace isorig::system_test
