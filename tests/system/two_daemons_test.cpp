// Two isorigd that are started in the same moment, on one simulated rig and on one rig with drivers: one lives, the
// other says why it does not, and what the first has is left alone.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <array>
#include <memory>

#include "processes.hpp"

namespace isorig::system_test {
namespace {

using testing::HasSubstr;

constexpr int kPairs = 10;

class TwoDaemons : public testing::Test {
 protected:
  /// `number`: 0 or 1. Of one name both have the same, of two each has its own.
  std::unique_ptr<Process> daemon(int number, const std::filesystem::path& rig, bool own_places,
                                  const Gate& gate) const {
    const auto own = own_places ? std::to_string(number) : "";
    return std::make_unique<Process>(
        std::vector<std::string>{bin("isorigd"), "--no-realtime", "--no-report", "--rig", rig.string(), "--runs",
                                 (dir_ / ("runs" + own)).string(), "--socket", socket(own)},
        dir_ / ("isorigd-" + std::to_string(number) + ".log"), [&gate] { gate.wait(); });
  }
  std::string socket(const std::string& own) const { return (dir_ / ("isorigd" + own + ".sock")).string(); }
  std::string state(const std::string& socket) const {
    const auto s = isorig(dir_, {"status", "--json", "--socket", socket}).json();
    return s.is_object() ? s.value("state", "") : "";
  }
  /// The number of the one that lives. The other has ended with exit code 1.
  int start_both(const std::filesystem::path& rig, bool own_places) {
    Gate gate;
    for (int i = 0; i < 2; ++i) pair_[static_cast<std::size_t>(i)] = daemon(i, rig, own_places, gate);
    gate.open();
    EXPECT_TRUE(wait_until(60.0, [&] { return !pair_[0]->running() || !pair_[1]->running(); }))
        << "both live:\n"
        << pair_[0]->output() << pair_[1]->output();
    const int living = pair_[0]->running() ? 0 : 1;
    EXPECT_EQ(loser(living).wait(1.0), 1) << loser(living).output();
    EXPECT_TRUE(winner(living).running()) << "none lives:\n" << pair_[0]->output() << pair_[1]->output();
    return living;
  }
  Process& winner(int living) { return *pair_[static_cast<std::size_t>(living)]; }
  Process& loser(int living) { return *pair_[static_cast<std::size_t>(1 - living)]; }

  TempDir dir_;
  std::array<std::unique_ptr<Process>, 2> pair_;
};

/// After every second pair the living one is killed: the next two find its dead socket files and its catalogue.
TEST_F(TwoDaemons, OfOneSocketAndOneRunsFolderOneLives) {
  const auto rig = patient_rig(dir_);
  std::size_t runs = 0;
  for (int pair = 0; pair < kPairs; ++pair) {
    const int living = start_both(rig, false);
    ASSERT_FALSE(HasFailure()) << "pair " << pair;
    EXPECT_THAT(loser(living).output(), HasSubstr("another daemon answers on " + socket("")));
    ASSERT_TRUE(wait_until(60.0, [&] { return state(socket("")) == "ready"; })) << winner(living).output();
    // Both sockets are those of the living one.
    const std::vector<std::string> there{"--socket", socket("")};
    const auto words = [&](std::vector<std::string> all) {
      all.insert(all.end(), there.begin(), there.end());
      return isorig(dir_, all);
    };
    const auto started = words({"start", source("config/protocols/vma-smoke.toml")});
    EXPECT_NE(started_run(started), "");
    EXPECT_EQ(words({"abort"}).code, 0);
    ++runs;
    ASSERT_TRUE(wait_until(60.0, [&] { return state(socket("")) == "ready"; })) << winner(living).output();
    const auto rows = isorig(dir_, {"runs", "--json", "--runs", (dir_ / "runs").string()}).json();
    EXPECT_EQ(rows.size(), runs);
    if (pair % 2 == 0) {
      EXPECT_EQ(winner(living).stop(SIGKILL), -SIGKILL);
      EXPECT_TRUE(std::filesystem::exists(socket("")));
    } else {
      EXPECT_EQ(winner(living).stop(SIGTERM), 0) << winner(living).output();
      EXPECT_FALSE(std::filesystem::exists(socket("")));
    }
  }
}

/// A TCP port of this machine that is ours, and that nobody listens on.
class SilentPort {
 public:
  SilentPort() : fd_(::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0)) {
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    socklen_t size = sizeof address;
    EXPECT_EQ(::bind(fd_, reinterpret_cast<const sockaddr*>(&address), size), 0);
    EXPECT_EQ(::getsockname(fd_, reinterpret_cast<sockaddr*>(&address), &size), 0);
    number_ = ntohs(address.sin_port);
  }
  ~SilentPort() { ::close(fd_); }
  SilentPort(const SilentPort&) = delete;
  SilentPort& operator=(const SilentPort&) = delete;
  [[nodiscard]] int number() const { return number_; }

 private:
  int fd_, number_ = 0;
};

/// Sockets and runs of their own: the devices are what they share. Nobody answers on these, and nobody has to.
TEST_F(TwoDaemons, OfOneRigWithDriversOneLives) {
  auto text = slurp(source("config/rigs/sim-wire.toml"));
  text = replaced(text, "\"../", "\"" + source("config/"));
  text = replaced(text, "port = \"/tmp/isorig-sim-teensy\"", "port = \"" + (dir_ / "teensy").string() + "\"");
  const SilentPort port;
  text = replaced(text, "port = 1502", "port = " + std::to_string(port.number()));
  const auto rig = dir_ / "rig.toml";
  spit(rig, text);
  for (int pair = 0; pair < kPairs; ++pair) {
    const int living = start_both(rig, true);
    ASSERT_FALSE(HasFailure()) << "pair " << pair;
    EXPECT_THAT(loser(living).output(), HasSubstr("another isorigd on this machine drives the frame at tcp"));
    EXPECT_THAT(loser(living).output(), HasSubstr("process " + std::to_string(winner(living).pid())));
    ASSERT_TRUE(wait_until(60.0, [&] { return state(socket(std::to_string(living))) == "idle"; }))
        << winner(living).output();
    EXPECT_EQ(state(socket(std::to_string(1 - living))), "") << "a dead file at the most";
    (void)winner(living).stop(pair % 2 == 0 ? SIGKILL : SIGTERM);
  }
}

}  // namespace
}  // namespace isorig::system_test
