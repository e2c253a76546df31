// What the service manager hears: sd_notify's datagrams, and a watchdog that only the loop's progress feeds.
#include "daemon/host/service_notifier.hpp"

#include <gtest/gtest.h>

#include <atomic>
#include <cstdlib>
#include <filesystem>

#include "notify_socket.hpp"

namespace isorig::daemon {
namespace {

class Notifier : public testing::Test {
 protected:
  Notifier() {
    std::string name = (std::filesystem::temp_directory_path() / "isorig-notify-XXXXXX").string();
    directory = ::mkdtemp(name.data());
  }
  ~Notifier() override { std::filesystem::remove_all(directory); }

  std::filesystem::path directory;
};

TEST_F(Notifier, OneDatagramPerMessageAtAPath) {
  NotifySocket manager((directory / "notify").string());
  ServiceNotifier notifier(manager.name());
  EXPECT_TRUE(notifier.connected());
  notifier.ready("idle: no frame");
  EXPECT_EQ(manager.next(), "READY=1\nSTATUS=idle: no frame");
  notifier.stopping("venting");
  EXPECT_EQ(manager.next(), "STOPPING=1\nSTATUS=venting");
  EXPECT_EQ(manager.next(), std::nullopt);
}

TEST_F(Notifier, AnAbstractName) {
  NotifySocket manager("@isorig-notify-test-" + std::to_string(::getpid()));
  ServiceNotifier notifier(manager.name());
  EXPECT_TRUE(notifier.send("WATCHDOG=1"));
  EXPECT_EQ(manager.next(), "WATCHDOG=1");
}

TEST_F(Notifier, AStatusIsSentOnceAndIsOneLine) {
  NotifySocket manager((directory / "notify").string());
  ServiceNotifier notifier(manager.name());
  notifier.ready("ready");
  (void)manager.next();
  notifier.status("ready");
  EXPECT_EQ(manager.next(), std::nullopt);
  notifier.status("faulted: frame said\nREADY=0");
  EXPECT_EQ(manager.next(), "STATUS=faulted: frame said READY=0");
}

TEST_F(Notifier, WithoutAManagerNothingHappens) {
  ServiceNotifier nobody("");
  EXPECT_FALSE(nobody.connected());
  nobody.ready("ready");
  EXPECT_FALSE(nobody.send("WATCHDOG=1"));

  ServiceNotifier gone((directory / "nobody-bound-this").string());
  EXPECT_TRUE(gone.connected());
  EXPECT_FALSE(gone.send("WATCHDOG=1"));
}

TEST_F(Notifier, ANameThatIsNoSocketIsRefused) {
  for (const std::string& name :
       {std::string("notify"), std::string("@"), std::string("/"), "/" + std::string(108, 'a')}) {
    EXPECT_THROW(ServiceNotifier notifier(name), std::runtime_error) << name;
  }
  EXPECT_NO_THROW(ServiceNotifier notifier("@" + std::string(106, 'a')));
}

TEST_F(Notifier, TheEnvironmentIsReadAndEmptied) {
  NotifySocket manager((directory / "notify").string());
  ::setenv("NOTIFY_SOCKET", manager.name().c_str(), 1);
  ::setenv("WATCHDOG_USEC", "2000000", 1);
  ::setenv("WATCHDOG_PID", std::to_string(::getpid()).c_str(), 1);
  const auto ours = ServiceNotifier::from_environment();
  EXPECT_TRUE(ours.connected());
  EXPECT_EQ(ours.watchdog_ns(), 2'000'000'000);
  for (const char* name : {"NOTIFY_SOCKET", "WATCHDOG_USEC", "WATCHDOG_PID"})
    EXPECT_EQ(std::getenv(name), nullptr) << name;

  ::setenv("NOTIFY_SOCKET", manager.name().c_str(), 1);
  ::setenv("WATCHDOG_USEC", "2000000", 1);
  ::setenv("WATCHDOG_PID", std::to_string(::getppid()).c_str(), 1);
  EXPECT_EQ(ServiceNotifier::from_environment().watchdog_ns(), 0) << "the watchdog of another process";

  ::setenv("NOTIFY_SOCKET", manager.name().c_str(), 1);
  ::setenv("WATCHDOG_USEC", "2 s", 1);
  EXPECT_EQ(ServiceNotifier::from_environment().watchdog_ns(), 0) << "no number";
}

TEST_F(Notifier, OnlyProgressOfTheLoopFeedsTheWatchdog) {
  NotifySocket manager((directory / "notify").string());
  ServiceNotifier notifier(manager.name(), 2'000'000'000);
  std::atomic<std::uint32_t> beat{41};
  WatchdogFeeder feeder(notifier, beat);
  EXPECT_EQ(feeder.period_ns(), 500'000'000);
  EXPECT_FALSE(feeder.turn()) << "one look is no progress";
  beat = 42;
  EXPECT_TRUE(feeder.turn());
  EXPECT_EQ(manager.next(), "WATCHDOG=1");
  for (int stalled = 0; stalled < 10; ++stalled) EXPECT_FALSE(feeder.turn());
  EXPECT_EQ(manager.next(), std::nullopt);
  beat = 0;  // the counter may wrap
  EXPECT_TRUE(feeder.turn());
  EXPECT_EQ(manager.next(), "WATCHDOG=1");
}

TEST_F(Notifier, AManagerThatDoesNotReadNeverMakesItWait) {
  NotifySocket manager((directory / "notify").string());
  ServiceNotifier notifier(manager.name(), 2'000'000'000);
  std::atomic<std::uint32_t> beat{0};
  WatchdogFeeder feeder(notifier, beat);
  (void)feeder.turn();
  int taken = 0;
  for (;; ++taken) {
    ++beat;
    if (!feeder.turn()) break;
    ASSERT_LT(taken, 1'000'000);
  }
  EXPECT_GT(taken, 0);
  (void)manager.next();
  ++beat;
  EXPECT_TRUE(feeder.turn()) << "fed again as soon as there is room";
}

}  // namespace
}  // namespace isorig::daemon
