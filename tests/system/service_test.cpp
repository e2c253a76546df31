// isorigd under a service manager: this test binds $NOTIFY_SOCKET and listens, as systemd does.
#include <gmock/gmock.h>
#include <sys/ptrace.h>

#include <cstdlib>

#include "../daemon/notify_socket.hpp"
#include "processes.hpp"

namespace isorig::system_test {
namespace {

using daemon::NotifySocket;
using testing::HasSubstr;
using testing::StartsWith;

constexpr const char* kSmoke = "config/protocols/vma-smoke.toml";
constexpr int kWatchdogMs = 2000;

class Service {
 public:
  Service()
      : manager_((dir_ / "notify").string()), daemon_(dir_, patient_rig(dir_), [this] {
          ::setenv("NOTIFY_SOCKET", manager_.name().c_str(), 1);
          ::setenv("WATCHDOG_USEC", std::to_string(kWatchdogMs * 1000).c_str(), 1);
          ::unsetenv("WATCHDOG_PID");
        }) {}

  DaemonProcess& daemon() { return daemon_; }
  NotifySocket& manager() { return manager_; }

  /// The first message that begins so, within the time.
  std::optional<std::string> hear(const std::string& beginning, double seconds) {
    std::optional<std::string> found;
    wait_until(seconds, [&] {
      while (const auto message = manager_.next()) {
        if (message->starts_with(beginning)) {
          found = message;
          return true;
        }
      }
      return false;
    });
    return found;
  }
  void forget() {
    while (manager_.next()) {
    }
  }
  bool fed_for(double seconds) {
    const auto end = std::chrono::steady_clock::now() + std::chrono::duration<double>(seconds);
    while (std::chrono::steady_clock::now() < end) {
      if (!hear("WATCHDOG=1", kWatchdogMs * 1e-3)) return false;
    }
    return true;
  }

 private:
  TempDir dir_;
  NotifySocket manager_;
  DaemonProcess daemon_;
};

pid_t thread_called(pid_t pid, const std::string& name) {
  for (const auto& task : std::filesystem::directory_iterator("/proc/" + std::to_string(pid) + "/task")) {
    if (slurp(task.path() / "comm") == name + "\n") return std::stoi(task.path().filename());
  }
  return -1;
}

/// Holds one thread where it is; every other runs on.
class Stall {
 public:
  explicit Stall(pid_t thread) : thread_(thread) {
    seized_ = ::ptrace(PTRACE_SEIZE, thread_, nullptr, nullptr) == 0;
    error_ = errno;
    if (seized_) {
      ::ptrace(PTRACE_INTERRUPT, thread_, nullptr, nullptr);
      int status = 0;
      ::waitpid(thread_, &status, __WALL);
    }
  }
  ~Stall() {
    if (seized_) ::ptrace(PTRACE_DETACH, thread_, nullptr, nullptr);
  }
  Stall(const Stall&) = delete;
  Stall& operator=(const Stall&) = delete;
  [[nodiscard]] bool holds() const { return seized_; }
  [[nodiscard]] std::string why_not() const { return std::strerror(error_); }

 private:
  pid_t thread_;
  bool seized_ = false;
  int error_ = 0;
};

TEST(ServiceManager, HearsReadyStatusWatchdogAndStopping) {
  Service service;
  const auto ready = service.hear("READY=1", 30.0);
  ASSERT_TRUE(ready) << service.daemon().log();
  EXPECT_THAT(*ready, HasSubstr("\nSTATUS=idle"));
  EXPECT_EQ(service.daemon().call({"status"}).code, 0) << "READY before the API answers";
  ASSERT_TRUE(service.hear("STATUS=ready", 30.0)) << service.daemon().log();
  EXPECT_TRUE(service.fed_for(2.0)) << "a rig that rests is alive";

  ASSERT_EQ(service.daemon().call({"start", source(kSmoke)}).code, 0);
  const auto running = service.hear("STATUS=running: run ", 30.0);
  ASSERT_TRUE(running);
  EXPECT_THAT(*running, testing::ContainsRegex("step [0-9]+ of [0-9]+, [0-9]+ %"));

  ASSERT_EQ(service.daemon().call({"abort"}).code, 0);
  EXPECT_TRUE(service.fed_for(3.0)) << "a rig that stops and vents is alive";

  ::kill(service.daemon().process().pid(), SIGTERM);
  EXPECT_TRUE(service.hear("STOPPING=1\nSTATUS=", 5.0));
  EXPECT_EQ(service.daemon().process().wait(40.0), 0) << service.daemon().log();
}

TEST(ServiceManager, AStalledLoopStarvesTheWatchdogWhileEveryOtherThreadLives) {
  Service service;
  ASSERT_TRUE(service.hear("STATUS=ready", 30.0)) << service.daemon().log();
  ASSERT_EQ(service.daemon().call({"start", source(kSmoke)}).code, 0);
  ASSERT_TRUE(service.hear("STATUS=running", 30.0));
  const pid_t loop = thread_called(service.daemon().process().pid(), "isorig-loop");
  ASSERT_GT(loop, 0);
  {
    Stall stall(loop);
    ASSERT_TRUE(stall.holds()) << "this machine does not let a test trace its own child: " << stall.why_not();
    service.forget();  // one turn may have been under way
    (void)service.hear("WATCHDOG=1", 0.25 * kWatchdogMs * 1e-3);
    EXPECT_FALSE(service.hear("WATCHDOG=1", 1.5 * kWatchdogMs * 1e-3)) << "fed although the loop stands";
    EXPECT_TRUE(service.daemon().process().running());
  }
  EXPECT_TRUE(service.hear("WATCHDOG=1", 5.0)) << "a loop that goes on feeds it again";
  // What the devices did meanwhile: their own time-outs stopped and vented, and the loop finds its run faulted.
  EXPECT_TRUE(service.daemon().reach("faulted")) << service.daemon().log();
  EXPECT_TRUE(service.fed_for(2.0)) << "a faulted rig is alive";
  EXPECT_EQ(service.daemon().process().stop(SIGTERM), 0);
}

}  // namespace
}  // namespace isorig::system_test
