#include <gmock/gmock.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <sstream>

#include "daemon/rig/devices.hpp"
#include "rig_fixture.hpp"

namespace isorig::daemon::test {
namespace {

using ::testing::HasSubstr;
using ::testing::ThrowsMessage;

/// The shipped rig on the wire with another [interlock].
RigConfig with_interlock(const std::string& keys) {
  std::ifstream in(source("config/rigs/sim-wire.toml"));
  std::stringstream text;
  text << in.rdbuf();
  std::string rig = text.str();
  const std::string was = "[interlock]\ndriver = \"sim\"\n";
  const auto at = rig.find(was);
  if (at == std::string::npos) throw std::runtime_error("sim-wire.toml has another [interlock] now");
  rig.replace(at, was.size(), "[interlock]\n" + keys + "\n");
  for (auto up = rig.find("\"../"); up != std::string::npos; up = rig.find("\"../")) {
    rig.replace(up + 1, 2, source("config"));
  }
  const auto path = std::filesystem::temp_directory_path() / ("gpio-config-" + std::to_string(::getpid()) + ".toml");
  std::ofstream(path) << rig;
  struct Remove {
    const std::filesystem::path& path;
    ~Remove() { std::filesystem::remove(path); }
  } remove{path};
  return load_rig(path);
}

TEST(GpioConfig, ReadsEveryLine) {
  const auto rig = with_interlock(R"(driver = "gpio"
chip = "pinctrl-bcm2711"
estop = { line = "GPIO17", active_low = true, bias = "pull-up" }
guard = { line = "27" }
vent_valve = { line = "22", bias = "pull-down" }
sync = { line = "GPIO5", bias = "disabled" }
closing_ms = 80)");
  ASSERT_TRUE(rig.gpio);
  EXPECT_EQ(rig.gpio->chip, "pinctrl-bcm2711");
  EXPECT_TRUE(rig.gpio->estop.active_low);
  EXPECT_EQ(rig.gpio->estop.bias, interlock::Bias::kPullUp);
  EXPECT_EQ(rig.gpio->guard->line, "27");
  EXPECT_EQ(rig.gpio->vent_valve->bias, interlock::Bias::kPullDown);
  EXPECT_EQ(rig.gpio->sync->bias, interlock::Bias::kDisabled);
  EXPECT_EQ(rig.gpio->closing_ns, 80'000'000);
}

TEST(GpioConfig, RefusesAWiringInWhichABrokenWireReadsClosed) {
  // The shipped file up to and with "[interlock]" stays; the keys below begin on the next line.
  std::ifstream shipped(source("config/rigs/sim-wire.toml"));
  int interlock_line = 1;
  for (std::string line; std::getline(shipped, line) && line != "[interlock]";) ++interlock_line;
  const auto at = [&](int below, int column) {
    return "toml:" + std::to_string(interlock_line + below) + ":" + std::to_string(column) + ": ";
  };
  EXPECT_THAT(
      [] {
        with_interlock(R"(driver = "gpio"
chip = "x"
estop = { line = "E", bias = "pull-up" }
vent_valve = { line = "V", active_low = true, bias = "pull-down" })");
      },
      ThrowsMessage<base::ConfigError>(::testing::AllOf(
          HasSubstr(at(3, 30) + "with this `bias` the line is active when its wire is broken"), HasSubstr(at(4, 54)))));
}

TEST(GpioConfig, WantsTheEmergencyStop) {
  EXPECT_THAT([] { with_interlock("driver = \"gpio\"\nchip = \"x\"\nguard = { line = \"G\" }"); },
              ThrowsMessage<base::ConfigError>(HasSubstr("has to be watched")));
}

TEST(GpioConfig, ARigWhoseChipIsNotThereConnectsLater) {
  clock::RealClock clock;
  auto rig = with_interlock("driver = \"gpio\"\nchip = \"no such chip\"\nestop = { line = \"E\" }");
  std::get<frame::ModbusConfig>(rig.frame).host = rig.teensy->port = "gpio-config-test-" + std::to_string(::getpid());
  auto devices = open_devices(rig, clock);
  EXPECT_THAT([&] { devices.interlock->connect(); },
              ThrowsMessage<drivers::DeviceError>(HasSubstr("no GPIO chip is labelled \"no such chip\"")));
}

}  // namespace
}  // namespace isorig::daemon::test
