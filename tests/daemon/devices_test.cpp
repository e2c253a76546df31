#include "daemon/rig/devices.hpp"

#include <gmock/gmock.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <cstddef>
#include <cstring>
#include <thread>

#include "drivers/clock/real_clock.hpp"
#include "edited_rig.hpp"
#include "rig_fixture.hpp"

namespace isorig::daemon::test {
namespace {

using ::testing::HasSubstr;
using ::testing::ThrowsMessage;

/// A rig on the wire that only this process knows. Nothing connects to it.
RigConfig own_rig() {
  auto rig = load_rig(source("config/rigs/sim-wire.toml"));
  std::get<modbus::ModbusConfig>(rig.frame).host = "device-claim-test-" + std::to_string(::getpid());
  rig.teensy->port = "/tmp/device-claim-test-" + std::to_string(::getpid());
  return rig;
}

TEST(Devices, ARigHasOneDaemon) {
  clock::RealClock clock;
  const auto rig = own_rig();
  {
    const auto first = open_devices(rig, clock);
    EXPECT_THAT(
        [&] { (void)open_devices(rig, clock); },
        ThrowsMessage<std::runtime_error>(HasSubstr("another isorigd on this machine drives the frame at tcp")));
    auto other_frame = rig;
    std::get<modbus::ModbusConfig>(other_frame.frame).port = 1;
    EXPECT_THAT([&] { (void)open_devices(other_frame, clock); },
                ThrowsMessage<std::runtime_error>(HasSubstr("drives the pressure device at /tmp/device-claim-test-")));
  }
  EXPECT_NO_THROW((void)open_devices(rig, clock));
}

/// Any user can take an abstract name: the message says whose process it is.
TEST(Devices, WhoHoldsADeviceIsNamed) {
  const std::string device = "frame at claim-holder-" + std::to_string(::getpid());
  int ready[2], leave[2];
  ASSERT_EQ(::pipe(ready), 0);
  ASSERT_EQ(::pipe(leave), 0);
  const pid_t child = ::fork();
  if (child == 0) {
    ::close(leave[1]);
    if (::geteuid() == 0 && ::setuid(65534) != 0) ::_exit(1);
    const DeviceClaim claim(device);
    char byte = 0;
    if (::write(ready[1], "x", 1) != 1) ::_exit(1);
    (void)!::read(leave[0], &byte, 1);
    ::_exit(0);
  }
  char byte = 0;
  ASSERT_EQ(::read(ready[0], &byte, 1), 1);
  EXPECT_THAT([&] { const DeviceClaim again(device); },
              ThrowsMessage<std::runtime_error>(HasSubstr("process " + std::to_string(child))));
  if (::geteuid() == 0) {
    EXPECT_THAT([&] { const DeviceClaim again(device); },
                ThrowsMessage<std::runtime_error>(HasSubstr("neither you nor root")));
  }
  ::close(leave[1]);
  ::waitpid(child, nullptr, 0);
  for (const int fd : {ready[0], ready[1], leave[0]}) ::close(fd);
  EXPECT_NO_THROW(DeviceClaim{device});
}

/// Another that has bound the name and has not come to listen: of two that start at once.
TEST(Devices, WhoIsAboutToHoldADeviceIsNamed) {
  const std::string device = "frame at claim-begun-" + std::to_string(::getpid());
  const std::string name = "isorig " + device;
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  std::memcpy(address.sun_path + 1, name.data(), name.size());
  const int fd = ::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
  ASSERT_EQ(::bind(fd, reinterpret_cast<const sockaddr*>(&address),
                   static_cast<socklen_t>(offsetof(sockaddr_un, sun_path) + 1 + name.size())),
            0);
  std::thread late([fd] {
    std::this_thread::sleep_for(std::chrono::milliseconds(50));
    EXPECT_EQ(::listen(fd, 8), 0);
  });
  EXPECT_THAT([&] { const DeviceClaim again(device); },
              ThrowsMessage<std::runtime_error>(HasSubstr("process " + std::to_string(::getpid()))));
  late.join();
  ::close(fd);
}

TEST(Devices, PathsOfAnyLengthAreClaimed) {
  clock::RealClock clock;
  auto rig = own_rig();
  rig.teensy->port = "/dev/serial/by-id/" + std::string(300, 'x') + rig.teensy->port;
  const auto first = open_devices(rig, clock);
  EXPECT_THROW((void)open_devices(rig, clock), std::runtime_error);
}

/// The shipped rig on the wire with its Teensy connected in another way.
RigConfig with_teensy(const std::string& keys) {
  return wire_rig_with("transport = \"tty\"\nport = \"/tmp/isorig-sim-teensy\"\nserial = \"1234560\"\n", keys + "\n");
}

TEST(Devices, ATeensyIsReadOverUsbUnlessAPortIsNamed) {
  EXPECT_EQ(with_teensy("serial = \"1234560\"").teensy->where(), "USB serial number 1234560");
  EXPECT_EQ(with_teensy("port = \"/dev/ttyACM0\"").teensy->where(), "/dev/ttyACM0");
  EXPECT_THAT([] { (void)with_teensy("transport = \"usb\""); }, ThrowsMessage<base::ConfigError>(HasSubstr("serial")));
  EXPECT_THAT([] { (void)with_teensy("transport = \"usb\"\nserial = \"1\"\nport = \"/dev/ttyACM0\""); },
              ThrowsMessage<base::ConfigError>(HasSubstr("over USB the serial number finds the device")));
}

}  // namespace
}  // namespace isorig::daemon::test
