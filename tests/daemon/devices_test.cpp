#include <gmock/gmock.h>
#include <unistd.h>

#include "daemon/devices.hpp"
#include "rig_fixture.hpp"

namespace isorig::daemon::test {
namespace {

using ::testing::HasSubstr;
using ::testing::ThrowsMessage;

/// A rig on the wire that only this process knows. Nothing connects to it.
RigConfig own_rig() {
  auto rig = load_rig(source("config/rigs/sim-wire.toml"));
  rig.modbus->host = "device-claim-test-" + std::to_string(::getpid());
  rig.teensy->port = "/tmp/device-claim-test-" + std::to_string(::getpid());
  return rig;
}

TEST(Devices, ARigHasOneDaemon) {
  clock::RealClock clock;
  const auto rig = own_rig();
  {
    const auto first = open_devices(rig, clock);
    EXPECT_THAT([&] { (void)open_devices(rig, clock); },
                ThrowsMessage<std::runtime_error>(HasSubstr("another isorigd on this machine drives the frame at tcp")));
    auto other_frame = rig;
    other_frame.modbus->port = 1;
    EXPECT_THAT([&] { (void)open_devices(other_frame, clock); },
                ThrowsMessage<std::runtime_error>(HasSubstr("drives the pressure device at /tmp/device-claim-test-")));
  }
  EXPECT_NO_THROW((void)open_devices(rig, clock));
}

TEST(Devices, PathsOfAnyLengthAreClaimed) {
  clock::RealClock clock;
  auto rig = own_rig();
  rig.teensy->port = "/dev/serial/by-id/" + std::string(300, 'x') + rig.teensy->port;
  const auto first = open_devices(rig, clock);
  EXPECT_THROW((void)open_devices(rig, clock), std::runtime_error);
}

}  // namespace
}  // namespace isorig::daemon::test
