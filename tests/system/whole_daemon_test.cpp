// Every thread of isorigd at once, the real-time loop among them, on the wire: what build-tsan plays under the thread
// sanitizer. Programs and test are of one build; `isorig` is not needed, so that this build need not compile it.
#include <gmock/gmock.h>
#include <sched.h>

#include <atomic>
#include <cstdlib>
#include <thread>
#include <vector>

#include "../daemon/api_client.hpp"
#include "../daemon/sample_subscription.hpp"
#include "messages/run_log.hpp"
#include "wire_rig.hpp"

namespace isorig::system_test {
namespace {

using daemon::test::ApiAnswer;
using daemon::test::call_api;
using testing::HasSubstr;
using testing::Not;

class WholeDaemon : public WireRig {
 protected:
  void SetUp() override {
    // With LCM's thread as well, where a network of our own is allowed: nobody else's route or messages matter there.
    lcm_ = ::unshare(CLONE_NEWNET) == 0 &&
           std::system("ip link set lo up multicast on && ip route add 224.0.0.0/4 dev lo") == 0;
    // The log's thread holds its logger by a shared_ptr while it works for it. Debian's libspdlog counts that down in
    // code that the sanitizer does not see, so that the last owner's destructor seems to race with it.
    spit(dir_ / "suppressions", "race:spdlog::logger::~logger\n");
    ::setenv("TSAN_OPTIONS", ("suppressions=" + (dir_ / "suppressions").string()).c_str(), 1);
  }
  std::string rig_text() const override {
    return WireRig::rig_text() + "\n[lcm]\nenabled = " + (lcm_ ? "true" : "false") + "\n";
  }
  void start_daemon() override {
    daemon_.emplace(dir_, dir_ / "rig.toml");
    ASSERT_TRUE(wait_until(30.0, [&] { return std::filesystem::exists(daemon_->socket()); })) << daemon_->log();
    ASSERT_TRUE(reach("ready")) << daemon_->log();
  }

  [[nodiscard]] ApiAnswer get(const std::string& path) const { return call_api(daemon_->socket(), "GET " + path); }
  [[nodiscard]] ApiAnswer post(const std::string& path, const std::string& body = {}) const {
    return call_api(daemon_->socket(), "POST " + path, body);
  }
  [[nodiscard]] ApiAnswer stop(const std::string& path) const {
    return call_api(daemon_->socket() + ".stop", "POST " + path);
  }
  [[nodiscard]] nlohmann::json status() const { return get("/v1/status").body; }
  [[nodiscard]] bool reach(const std::string& state) const {
    return wait_until(120.0, [&] { return status().value("state", "") == state; });
  }

  bool lcm_ = false;
};

TEST_F(WholeDaemon, RunsOnTheWireAmongClientsAndEndsInOrder) {
  ASSERT_NO_FATAL_FAILURE(start(false));
  std::atomic<bool> done{false};
  std::atomic<int> answered{0};
  std::vector<std::thread> clients;
  for (const auto* path : {"/v1/status", "/v1/events?after=0", "/v1/plan", "/v1/runs", "/v1/readings?window_s=0.2",
                           "/v1/selftest", "/v1/calibrations"}) {
    clients.emplace_back([&, path] {
      while (!done) {
        if (get(path).status == 200) ++answered;
        std::this_thread::sleep_for(std::chrono::milliseconds(50));
      }
    });
  }
  std::size_t samples = 0;
  clients.emplace_back([&] {
    daemon::testing::Subscription subscriber(daemon_->socket() + ".samples");
    while (!done && subscriber.next()) ++samples;
  });
  const std::string protocol = R"(format = "isorig-protocol/1"
name = "short"
steps = [
  { do = "pressurize", pressure_psi = 5, rate_psi_s = 5, settled_for_s = 0.3, timeout_s = 60 },
  { do = "mark", label = "pressurized" },
  { do = "ramp", to_mm = 1, velocity_mm_s = 0.5 },
  { do = "ramp", to_mm = 0, velocity_mm_s = 0.5, record = "averaged" },
]
)";
  const auto started = post("/v1/start", nlohmann::json{{"protocol", protocol}, {"operator", "Ada"}}.dump());
  EXPECT_EQ(started.status, 200) << started.body.dump();
  if (started.status != 200) {
    done = true;
    for (auto& c : clients) c.join();
    return;
  }
  const auto id = started.body.value("run", "");
  EXPECT_TRUE(wait_until(120.0, [&] { return status().value("position_mm", 0.0) > 0.3; })) << daemon_->log();
  EXPECT_EQ(stop("/v1/pause").status, 200);
  EXPECT_TRUE(reach("paused")) << status().dump(2);
  EXPECT_TRUE(wait_until(60.0, [&] { return post("/v1/resume").status == 200; }));  // once it is seen to stand
  EXPECT_TRUE(wait_until(120.0, [&] { return status().contains("last_run"); })) << status().dump(2);
  EXPECT_EQ(status()["last_run"].value("outcome", ""), "done") << daemon_->log();
  done = true;
  for (auto& c : clients) c.join();
  EXPECT_GT(samples, 100U);
  EXPECT_GT(answered, 50);

  // A report of a sanitizer makes a program's exit code its own.
  EXPECT_EQ(daemon_->process().stop(SIGTERM, 60.0), 0) << daemon_->log();
  EXPECT_EQ(simrig_->stop(SIGTERM, 60.0), 0) << simrig_->output();
  EXPECT_THAT(daemon_->log(), Not(HasSubstr("Sanitizer")));
  EXPECT_THAT(simrig_->output(), Not(HasSubstr("Sanitizer")));

  struct Nothing : messages::RunVisitor {
  } nothing;
  const auto report = messages::read_run(dir_ / "runs" / id, nothing);
  EXPECT_TRUE(report.whole()) << testing::PrintToString(report.complaints());
}

}  // namespace
}  // namespace isorig::system_test
