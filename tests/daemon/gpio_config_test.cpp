#include <gmock/gmock.h>

#include <fstream>

#include "daemon/rig/devices.hpp"
#include "drivers/clock/real_clock.hpp"
#include "edited_rig.hpp"
#include "rig_fixture.hpp"

namespace isorig::daemon::test {
namespace {

using ::testing::HasSubstr;
using ::testing::ThrowsMessage;

/// The shipped rig on the wire with another [interlock].
RigConfig with_interlock(const std::string& keys) {
  return wire_rig_with("[interlock]\ndriver = \"sim\"\n", "[interlock]\n" + keys + "\n");
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
  std::get<modbus::ModbusConfig>(rig.frame).host = rig.teensy->port = "gpio-config-test-" + std::to_string(::getpid());
  auto devices = open_devices(rig, clock);
  EXPECT_THAT([&] { devices.interlock->connect(); },
              ThrowsMessage<drivers::DeviceError>(HasSubstr("no GPIO chip is labelled \"no such chip\"")));
}

}  // namespace
}  // namespace isorig::daemon::test
