// What the driver makes of a bus, on a sysfs made of files. With a kernel: tests/vm/usb_stream_test.cpp.
#include "drivers/pressure/usb_devices.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <fstream>

#include "drivers/api/error.hpp"

namespace isorig::pressure {
namespace {

namespace fs = std::filesystem;
using drivers::DeviceError;
using drivers::Fault;
using testing::AllOf;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::SizeIs;

class UsbDevices : public testing::Test {
 protected:
  ~UsbDevices() override { fs::remove_all(sys_); }

  void plug(const std::string& name, const std::string& ids, const std::string& serial, const std::string& tty = "",
            const std::string& driver = "") {
    const fs::path device = sys_ / "bus/usb/devices" / name;
    const auto write = [&](const char* file, const std::string& text) { std::ofstream(device / file) << text << '\n'; };
    fs::create_directories(device);
    write("idVendor", ids.substr(0, 4));
    write("idProduct", ids.substr(5));
    write("busnum", "1");
    write("devnum", std::to_string(++address_));
    write("serial", serial);
    write("product", "USB Serial");
    const fs::path interface = device / (name + ":1.0");
    fs::create_directories(interface);
    if (tty.starts_with("ttyACM")) fs::create_directories(interface / "tty" / tty);
    if (tty.starts_with("ttyUSB")) fs::create_directories(interface / tty);
    if (!driver.empty()) fs::create_symlink("../../../../bus/usb/drivers/" + driver, interface / "driver");
  }
  [[nodiscard]] std::vector<UsbDevice> list() const { return list_usb_devices(sys_); }
  std::pair<Fault, std::string> refusal(const std::string& serial, std::vector<UsbDevice> devices) {
    for (auto& device : devices) device.is_accessible = true;
    try {
      (void)find_teensy(serial, devices);
    } catch (const DeviceError& error) {
      return {error.fault(), error.what()};
    }
    return {Fault::kProtocol, ""};
  }
  std::pair<Fault, std::string> refusal(const std::string& serial) { return refusal(serial, list()); }

  fs::path sys_ = testing::TempDir() + "isorig_sysfs_" + std::to_string(getpid());
  int address_ = 3;
};

TEST(TeensySerial, SmallNumbersAreShownTimesTen) {
  EXPECT_EQ(teensy_serial(123'456), "1234560");
  EXPECT_EQ(teensy_serial(9'999'999), "99999990");
  EXPECT_EQ(teensy_serial(10'000'000), "10000000");
  EXPECT_EQ(teensy_serial(4'294'967'295U), "4294967295");
}

TEST_F(UsbDevices, ListsTeensysAndSerialAdaptersAndNothingElse) {
  plug("1-1", "16c0:0483", "1234560", "ttyACM0", "cdc_acm");
  plug("1-2", "0403:6001", "A5XK3RJT", "ttyUSB0", "usb");
  plug("1-3", "046d:c52b", "");  // a mouse
  plug("usb1", "1d6b:0002", "0000:00:14.0");
  fs::create_directories(sys_ / "bus/usb/devices/1-1:1.0");
  const auto devices = list();
  ASSERT_THAT(devices, SizeIs(2));
  EXPECT_EQ(devices[0].kind, UsbKind::kTeensy);
  EXPECT_EQ(devices[0].tty, "/dev/ttyACM0");
  EXPECT_EQ(devices[0].node, "/dev/bus/usb/001/004");
  EXPECT_EQ(devices[0].serial, "1234560");
  EXPECT_FALSE(devices[0].is_claimed);
  EXPECT_EQ(devices[1].kind, UsbKind::kOther);
  EXPECT_EQ(describe(devices[1]), "0403:6001 USB Serial serial A5XK3RJT at 1-2 (/dev/ttyUSB0)");
  EXPECT_THAT(problem_of(devices[1]), HasSubstr("is no Teensy"));
}

TEST_F(UsbDevices, FindsBySerialNumberOrTheOnlyOne) {
  plug("1-1", "16c0:0483", "1234560");
  auto devices = list();
  for (auto& device : devices) device.is_accessible = true;
  EXPECT_EQ(find_teensy("1234560", devices).name, "1-1");
  EXPECT_EQ(find_teensy("", devices).name, "1-1");
}

TEST_F(UsbDevices, SaysThatNothingIsThere) {
  EXPECT_THAT(list(), IsEmpty());
  const auto [fault, what] = refusal("1234560");
  EXPECT_EQ(fault, Fault::kDisconnected);
  EXPECT_THAT(what, AllOf(HasSubstr("no Teensy with serial number 1234560 is on USB"), HasSubstr("isorig devices")));
}

TEST_F(UsbDevices, NamesWhatIsThereInstead) {
  plug("1-1", "16c0:0483", "7654320");
  const auto [fault, what] = refusal("1234560");
  EXPECT_EQ(fault, Fault::kIdentity);
  EXPECT_THAT(what, AllOf(HasSubstr("no Teensy with serial number 1234560"), HasSubstr("serial 7654320 at 1-1")));
}

TEST_F(UsbDevices, KnowsTheNumberOfTheFuses) {
  plug("1-1", "16c0:0483", "1234560");
  EXPECT_THAT(refusal("123456").second, HasSubstr("write serial = \"1234560\""));
}

TEST_F(UsbDevices, KnowsTheBootLoaderByTheNumberItShows) {
  plug("1-1", "16c0:0478", "0001E240");
  const auto [fault, what] = refusal("1234560");
  EXPECT_EQ(fault, Fault::kDisconnected);
  EXPECT_THAT(what, AllOf(HasSubstr("boot loader"), HasSubstr("flash")));
  EXPECT_THAT(refusal("7654320").second, HasSubstr("no Teensy with serial number 7654320"));
}

TEST_F(UsbDevices, TellsOtherProgramsAndTheRebootor) {
  plug("1-1", "16c0:0486", "1234560");
  plug("1-2", "16c0:0477", "77");
  const auto [fault, what] = refusal("1234560");
  EXPECT_EQ(fault, Fault::kIdentity);
  EXPECT_THAT(what, AllOf(HasSubstr("another program"), HasSubstr("0486")));
  EXPECT_THAT(problem_of(list().at(1)), HasSubstr("rebootor"));
}

TEST_F(UsbDevices, ManyNeedASerialNumber) {
  plug("1-1", "16c0:0483", "1234560");
  plug("1-2", "16c0:0483", "7654320");
  const auto [fault, what] = refusal("");
  EXPECT_EQ(fault, Fault::kIdentity);
  EXPECT_THAT(what, AllOf(HasSubstr("several"), HasSubstr("1234560"), HasSubstr("7654320")));
  EXPECT_EQ(refusal("7654320").second, "");
}

TEST_F(UsbDevices, TellsClaimedFromForbidden) {
  plug("1-1", "16c0:0483", "1234560", "", "usbfs");
  const auto [fault, what] = refusal("1234560");
  EXPECT_EQ(fault, Fault::kDisconnected);
  EXPECT_THAT(what, AllOf(HasSubstr("another program holds it"), HasSubstr("fuser -v /dev/bus/usb/001/004")));
  auto devices = list();
  devices[0].is_claimed = devices[0].is_accessible = false;
  try {
    (void)find_teensy("1234560", devices);
    FAIL();
  } catch (const DeviceError& error) {
    EXPECT_EQ(error.fault(), Fault::kRefused);
    EXPECT_THAT(error.what(), AllOf(HasSubstr("no permission"), HasSubstr("60-isorig.rules"), HasSubstr("isorig")));
  }
}

TEST(ProgramsWithOpen, LeavesOutItself) {
  EXPECT_EQ(programs_with_open("/proc/self/exe"), "");
  const std::string path = testing::TempDir() + "isorig_open_" + std::to_string(getpid());
  const std::ofstream file(path);
  EXPECT_EQ(programs_with_open(path), "");
  fs::remove(path);
}

}  // namespace
}  // namespace isorig::pressure
