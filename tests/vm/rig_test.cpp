// A whole rig on a real kernel: the installed packages, the daemon under systemd with its own drivers, a frame over
// Modbus, an emulated Teensy on USB, the emergency stop, guard, vent valve and sync line on the kernel's GPIO. One run
// to its end, then what nobody hopes for, each while the crosshead moves: what counts is what the plant did, as the
// plant itself wrote it down.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <time.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <memory>
#include <optional>

#include "messages/run_log.hpp"
#include "tests/system/processes.hpp"
#include "tests/system/terminal.hpp"
#include "tests/vm/gpio_sim.hpp"

namespace isorig::system_test {
namespace {

using nlohmann::literals::operator""_json_pointer;
using testing::HasSubstr;

constexpr std::size_t kEstop = 0, kGuard = 1, kVent = 2, kSync = 3;

// The processor is emulated and shared: limits that are generous in time, and exact in what has to happen.
constexpr double kPatience_s = 120.0;
constexpr double kVented_psi = 0.5;
constexpr double kEdge_us = 200.0;

std::int64_t mono_ns() {
  timespec now{};
  clock_gettime(CLOCK_MONOTONIC, &now);
  return std::int64_t{now.tv_sec} * 1'000'000'000 + now.tv_nsec;
}

struct PlantState {
  std::int64_t mono_ns = 0;
  double position_mm = 0.0, force_N = 0.0, pressure_psi = 0.0;
};

std::vector<PlantState> read_truth(const std::filesystem::path& csv) {
  std::vector<PlantState> states;
  std::ifstream in(csv);
  std::string line;
  std::getline(in, line);
  while (std::getline(in, line)) {
    PlantState s;
    long long ns = 0;
    if (std::sscanf(line.c_str(), "%lld,%lf,%lf,%lf", &ns, &s.position_mm, &s.force_N, &s.pressure_psi) == 4) {
      s.mono_ns = ns;
      states.push_back(s);
    }
  }
  return states;
}

/// The plant as it is now: the end of what it writes down.
std::optional<PlantState> newest_truth(const std::filesystem::path& csv) {
  std::ifstream in(csv, std::ios::ate);
  constexpr std::streamoff kTail = 400;
  in.seekg(std::max<std::streamoff>(0, in.tellg() - kTail));
  std::optional<PlantState> newest;
  std::string line;
  std::getline(in, line);
  while (std::getline(in, line)) {
    if (in.eof()) break;  // a line that is still being written
    PlantState s;
    long long ns = 0;
    if (std::sscanf(line.c_str(), "%lld,%lf,%lf,%lf", &ns, &s.position_mm, &s.force_N, &s.pressure_psi) == 4) {
      s.mono_ns = ns;
      newest = s;
    }
  }
  return newest;
}

/// The daemon's status without a program to ask for it: starting one is a second's work here.
nlohmann::json ask_status(const std::string& socket) {
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  std::snprintf(address.sun_path, sizeof address.sun_path, "%s", socket.c_str());
  const int fd = ::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
  std::string text;
  const std::string request = "GET /v1/status HTTP/1.1\r\nHost: rig\r\nConnection: close\r\n\r\n";
  if (::connect(fd, reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0 &&
      ::write(fd, request.data(), request.size()) == static_cast<ssize_t>(request.size())) {
    std::array<char, 4096> buffer;
    for (ssize_t size = 0; (size = ::read(fd, buffer.data(), buffer.size())) > 0;) {
      text.append(buffer.data(), static_cast<std::size_t>(size));
    }
  }
  ::close(fd);
  const auto body = text.find("\r\n\r\n");
  const auto json = nlohmann::json::parse(body == std::string::npos ? "{}" : text.substr(body + 4), nullptr, false);
  return json.is_object() ? json : nlohmann::json::object();
}

/// Looks four times a second.
bool comes_true(const std::function<bool()>& condition) {
  for (int i = 0; i < static_cast<int>(4 * kPatience_s); ++i) {
    if (condition()) return true;
    std::this_thread::sleep_for(std::chrono::milliseconds(250));
  }
  return false;
}

void say_done(const std::string& what) {
  std::printf("[%7.1f s] %s\n", 1e-9 * static_cast<double>(mono_ns()), what.c_str());
  std::fflush(stdout);
}

/// What the sync line said, as recorded.
struct SyncSeen : messages::RunVisitor {
  void sync(const isorig_msgs::sync_check_t& m) override {
    ++checks;
    within += m.within;
    worst_us = std::max(worst_us, std::abs(m.error_us));
    bound_us = std::max(bound_us, m.bound_us);
  }
  int checks = 0, within = 0;
  double worst_us = 0.0, bound_us = 0.0;
};

/// The installed packages under systemd.
class Daemon {
 public:
  explicit Daemon(const TempDir& dir) : dir_(dir) {}

  static constexpr const char* kRig = "/etc/isorig/rig.toml";
  static constexpr const char* kShared = "/usr/share/isorig/";
  static constexpr const char* kRuns = "/var/lib/isorig/runs";
  static constexpr const char* kSocket = "/run/isorig/isorigd.sock";

  void start() { EXPECT_EQ(systemctl({"start", "isorigd"}).code, 0); }
  /// Systemd starts it again by itself.
  void kill() { EXPECT_EQ(systemctl({"kill", "--signal=KILL", "isorigd"}).code, 0); }
  [[nodiscard]] std::string property(const std::string& name) const {
    return systemctl({"show", "-P", name, "isorigd"}).text;
  }
  void stop() {
    EXPECT_EQ(systemctl({"stop", "isorigd"}).code, 0);
    EXPECT_EQ(property("Result"), "success\n");
  }
  [[nodiscard]] std::string log() const {
    return run(dir_, {"journalctl", "--no-pager", "-o", "short-monotonic", "-u", "isorigd"}).text;
  }
  Answer call(std::vector<std::string> words) const {
    words.insert(words.begin(), "isorig");
    words.insert(words.end(), {"--socket", kSocket});
    return run(dir_, std::move(words));
  }
  [[nodiscard]] std::string catalogue() const { return run(dir_, {"isorig", "runs", "--json", "--runs", kRuns}).text; }

 private:
  Answer systemctl(std::vector<std::string> words) const {
    words.insert(words.begin(), "systemctl");
    return run(dir_, std::move(words));
  }
  const TempDir& dir_;
};

class RigOnKernel : public testing::Test {
 protected:
  void SetUp() override {
    plug_in_gpio();
    spit(Daemon::kRig, rig_text());
    simrig_.emplace(
        std::vector<std::string>{"isorig-simrig", "--rig", Daemon::kRig, "--truth", (dir_ / "truth.csv").string(),
                                 "--control", (dir_ / "control").string(), "--gpio-sync", (dir_ / "sync").string(),
                                 "--gpio-vent", (dir_ / "vent").string()},
        dir_ / "simrig.log");
    ASSERT_TRUE(
        comes_true([&] { return !simrig_->running() || simrig_->output().find("ready;") != std::string::npos; }) &&
        simrig_->running())
        << simrig_->output();
    start_daemon();
  }

  void plug_in_gpio() {
    chip_ = std::make_unique<test::GpioSim>("rig", "isorig-rig",
                                            std::vector<std::string>{"ESTOP", "GUARD", "VENT", "SYNC"});
    chip_->drive(kEstop, true);
    chip_->drive(kGuard, true);
    // The chip's number may be another one each time: the plant is told of it.
    for (const auto& [name, file] :
         {std::pair{"vent", chip_->file(kVent, "value")}, {"sync", chip_->file(kSync, "pull")}}) {
      std::filesystem::remove(dir_ / name);
      std::filesystem::create_symlink(file, dir_ / name);
    }
  }

  /// The shipped rig on the wire, with its interlock on GPIO and limits for a machine that is slow and shared.
  std::string rig_text() const {
    auto text = slurp(Daemon::kShared + std::string("rigs/sim-wire.toml"));
    text = replaced(text, "\"../", std::string("\"") + Daemon::kShared);
    text = replaced(text, "[interlock]\ndriver = \"sim\"", R"([interlock]
driver = "gpio"
chip = "isorig-rig"
estop = { line = "ESTOP" }
guard = { line = "GUARD" }
vent_valve = { line = "VENT" }
sync = { line = "SYNC" })");
    text = replaced(text, "transport = \"tty\"\nport = \"/tmp/isorig-sim-teensy\"", "transport = \"usb\"");
    text = replaced(text, "response_timeout_ms = 100", "response_timeout_ms = 1000\nstart_confirm_ms = 2000");
    for (const auto* age :
         {"frame_age_max_s = 0.5", "pressure_age_max_s = 0.5", "interlock_age_max_s = 1.0", "late_tick_max_s = 0.5"}) {
      text = replaced(text, age, std::string(age).substr(0, std::string(age).find('=')) + "= 2.0");
    }
    text = replaced(text, "late_tick_max_s = 2.0", "late_tick_max_s = 2.0\nsegment_ack_max_s = 2.0");
    text = replaced(text, "heartbeat_timeout_s = 0.5", "heartbeat_timeout_s = 2.0");
    text = replaced(text, "watchdog_s = 0.5", "watchdog_s = 2.0");
    // A third of the work: what is looked at here needs no kilohertz.
    text = replaced(text, "[sim.pressure]\n", "[sim.pressure]\nsample_rate_hz = 300\n");
    text = replaced(text, "[sim.frame]\n", "[sim.frame]\nsample_rate_hz = 300\n");
    return replaced(text, "ring_samples = 256", "ring_samples = 2048") +
           "\n[realtime]\nperiod_us = 4000\n[services]\npoll_period_ms = 20\n[lcm]\nenabled = false\n";
  }

  void start_daemon() {
    daemon_.start();
    ASSERT_TRUE(reach("ready")) << daemon_.log() << status().dump(2);
  }

  nlohmann::json status() const { return ask_status(Daemon::kSocket); }
  bool reach(const std::string& state) {
    return comes_true([&] { return status().value("state", "") == state; });
  }

  std::string say(const std::string& line) const {
    return run(dir_, {"isorig-simrig", "send", (dir_ / "control").string(), line}).text;
  }

  /// Pressurized and ramping slowly, for something to happen.
  std::string be_busy() {
    spit(dir_ / "busy.toml", R"(format = "isorig-protocol/1"
name = "busy"
recording.policy = "round_ramps"
steps = [
  { do = "pressurize", pressure_psi = 5, rate_psi_s = 5, settled_for_s = 0.3, timeout_s = 60 },
  { do = "ramp", to_mm = 2, velocity_mm_s = 0.02 },
]
)");
    const auto id = started_run(daemon_.call({"start", (dir_ / "busy.toml").string()}));
    const double from_mm = status().value("position_mm", 0.0);
    EXPECT_TRUE(comes_true([&] { return status().value("position_mm", 0.0) > from_mm + 0.03; }))
        << status().dump(2) << daemon_.log();
    say_done("moving");
    EXPECT_TRUE(chip_->value(kVent)) << "the dump valve is not held while a run goes on";
    return id;
  }

  /// Looks at the plant until it is vented; the daemon may be dead.
  void wait_for_a_safe_rig(const std::string& what, std::int64_t since_ns) {
    EXPECT_TRUE(!chip_ || comes_true([&] { return !chip_->value(kVent); })) << what << ": the vent line is held";
    EXPECT_TRUE(comes_true([&] {
      const auto now = newest_truth(dir_ / "truth.csv");
      return now && now->mono_ns > since_ns && now->pressure_psi < kVented_psi;
    })) << what
        << ": the rig is not vented";
    std::this_thread::sleep_for(std::chrono::seconds(5));  // a frame that still moves shows it in this
    moments_.push_back({what, since_ns, mono_ns()});
    say_done(what + ": the rig is safe");
  }

  void expect_fault(const std::string& what, const std::string& code, std::int64_t since_ns) {
    ASSERT_TRUE(reach("faulted")) << what << ": " << daemon_.log() << status().dump(2);
    EXPECT_THAT(status().value("fault", ""), HasSubstr(code)) << what;
    wait_for_a_safe_rig(what, since_ns);
  }

  void back_to_ready(const std::string& what) {
    EXPECT_TRUE(comes_true([&] { return daemon_.call({"reset"}).code == 0; })) << what << status().dump(2);
    EXPECT_TRUE(reach("ready")) << what << status().dump(2);
  }

  void judge_plant() {
    simrig_->stop();
    const auto truth = read_truth(dir_ / "truth.csv");
    for (const auto& moment : moments_) {
      const auto at = [&](std::int64_t ns) {
        return std::lower_bound(truth.begin(), truth.end(), ns,
                                [](const PlantState& s, std::int64_t t) { return s.mono_ns < t; });
      };
      const auto first = at(moment.from_ns), last = at(moment.until_ns) - 1;
      ASSERT_LT(first, last) << moment.what;
      auto moving = last;
      while (moving > first && std::abs(moving->position_mm - last->position_mm) < 0.002) --moving;
      const auto vented = std::find_if(first, last, [](const PlantState& s) { return s.pressure_psi < kVented_psi; });
      const double travelled_mm = std::abs(last->position_mm - first->position_mm);
      const auto seconds = [&](const auto& state) {
        return 1e-9 * static_cast<double>(state->mono_ns - moment.from_ns);
      };
      std::printf("  %-28s frame at rest after %.2f s and %.3f mm, vented from %.2f psi after %.2f s\n",
                  moment.what.c_str(), seconds(moving), travelled_mm, first->pressure_psi, seconds(vented));
      EXPECT_GT(first->pressure_psi, 3.0) << moment.what << ": nothing was at stake";
      EXPECT_LT(vented, last) << moment.what;
      EXPECT_GT(seconds(last) - seconds(moving), 1.0) << moment.what << ": the frame still moves";
      EXPECT_LT(travelled_mm, 0.3) << moment.what;
      EXPECT_LT(last->pressure_psi, kVented_psi) << moment.what;
    }
  }

  struct Moment {
    std::string what;
    std::int64_t from_ns = 0, until_ns = 0;
  };

  TempDir dir_;
  std::unique_ptr<test::GpioSim> chip_;
  std::optional<Process> simrig_;
  Daemon daemon_{dir_};
  std::vector<Moment> moments_;
};

TEST_F(RigOnKernel, RunsAProtocolAndMeetsEveryMishapSafely) {
  // The self-test, with somebody at the contacts.
  {
    Terminal terminal({"isorig", "selftest", "--window-s", "1", "--socket", Daemon::kSocket});
    const auto answer = [&](const std::string& question, std::size_t line, bool closed) {
      EXPECT_TRUE(terminal.shows(question)) << terminal.shown();
      chip_->drive(line, closed);
      terminal.type(Terminal::kEnter);
    };
    answer("Press the emergency stop, then press Enter", kEstop, false);
    answer("Release it, then press Enter", kEstop, true);
    answer("Open the guard, then press Enter", kGuard, false);
    answer("Close it, then press Enter", kGuard, true);
    (void)terminal.wait();
    EXPECT_TRUE(terminal.shows("interlock.estop.walk") && terminal.shows("seen open and closed")) << terminal.shown();
    EXPECT_TRUE(terminal.shows("interlock.guard.walk") && terminal.shows("seen open and closed")) << terminal.shown();
    std::printf("%s", terminal.shown().c_str());
    EXPECT_TRUE(reach("ready")) << status().dump(2);
    say_done("the self-test");
  }

  // A run to its end.
  spit(dir_ / "short.toml", R"(format = "isorig-protocol/1"
name = "short"
recording.policy = "round_ramps"
steps = [
  { do = "pressurize", pressure_psi = 5, rate_psi_s = 5, settled_for_s = 0.3, timeout_s = 60 },
  { do = "ramp", to_mm = 1, velocity_mm_s = 10 },
  { do = "hold", duration_s = 2 },
  { do = "ramp", to_mm = 0, velocity_mm_s = 1 },
]
)");
  const auto id = started_run(daemon_.call({"start", (dir_ / "short.toml").string()}));
  EXPECT_TRUE(comes_true([&] { return status().value("/last_run/outcome"_json_pointer, "") == "done"; }))
      << status().dump(2) << daemon_.log();
  say_done("a run to its end");
  EXPECT_TRUE(reach("ready"));
  EXPECT_FALSE(chip_->value(kVent)) << "after a run the rig stays vented";
  SyncSeen recorded;
  EXPECT_TRUE(messages::read_run(std::filesystem::path(Daemon::kRuns) / id, recorded).whole());
  EXPECT_GT(recorded.checks, 5);
  // The emulated edge is made by a system call, somewhere in which it lies.
  EXPECT_LT(recorded.worst_us, recorded.bound_us + kEdge_us) << "the clock mapping is beyond its bound";
  std::printf("  sync line: %d edges recorded, clock off by at most %.0f us, bound up to %.0f us\n", recorded.checks,
              recorded.worst_us, recorded.bound_us);

  // The Teensy's plug is pulled.
  be_busy();
  std::int64_t at_ns = mono_ns();
  EXPECT_EQ(say("fault teensy unplug on"), "ok\n");
  expect_fault("Teensy pulled out", "stale.pressure", at_ns);
  EXPECT_NE(daemon_.call({"reset"}).code, 0) << "reset while the cause is there";
  EXPECT_EQ(say("fault teensy unplug off"), "ok\n");
  back_to_ready("Teensy plugged in");

  // The emergency stop opens.
  be_busy();
  at_ns = mono_ns();
  chip_->drive(kEstop, false);
  expect_fault("emergency stop", "interlock.estop", at_ns);
  EXPECT_NE(daemon_.call({"reset"}).code, 0) << "reset while the cause is there";
  chip_->drive(kEstop, true);
  back_to_ready("emergency stop released");

  // The GPIO chip's plug is pulled: no emergency stop is seen any more, and nobody holds the dump valve.
  be_busy();
  at_ns = mono_ns();
  const auto number = chip_->chip();
  chip_->unplug();
  chip_.reset();
  expect_fault("GPIO chip pulled out", "interlock", at_ns);
  EXPECT_NE(daemon_.call({"reset"}).code, 0) << "reset while the cause is there";
  plug_in_gpio();
  EXPECT_NE(chip_->chip(), number) << "found again by its label, not by its number";
  back_to_ready("GPIO chip plugged in");

  // The daemon is killed.
  const auto cut = be_busy();
  at_ns = mono_ns();
  daemon_.kill();
  wait_for_a_safe_rig("daemon killed", at_ns);
  EXPECT_TRUE(reach("ready")) << daemon_.log() << status().dump(2);
  EXPECT_EQ(daemon_.property("NRestarts"), "1\n");
  const auto runs = daemon_.catalogue();
  EXPECT_THAT(runs, HasSubstr(cut));
  EXPECT_THAT(runs, HasSubstr("interrupted"));

  EXPECT_TRUE(comes_true([&] { return status()["sync_line"].value("pairs", 0) > 2; }));
  const auto line = status()["sync_line"];
  std::printf("  sync line now: %s\n", line.dump().c_str());
  EXPECT_EQ(line.value("ambiguous", -1) + line.value("wrong_polarity", -1), 0);
  daemon_.stop();
  judge_plant();
}

}  // namespace
}  // namespace isorig::system_test
