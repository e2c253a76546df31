// The USB driver on a real kernel: enumeration, cdc_acm, usbfs and udev are the kernel's and the distribution's.
#include <fcntl.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <termios.h>

#include <cstdio>
#include <fstream>

#include "drivers/pressure/tty_stream.hpp"
#include "usb_bench.hpp"

namespace isorig::pressure {
namespace {

using testing::HasSubstr;

std::size_t open_files() {
  std::size_t count = 0;
  for ([[maybe_unused]] const auto& entry : std::filesystem::directory_iterator("/proc/self/fd")) ++count;
  return count;
}

TEST_F(UsbBench, ReadsEverySampleAndNeverTouchesTheBaudRate) {
  plug();
  const auto codings_of_the_kernel = teensy->seen().line_codings.load();
  open();
  device->connect();
  EXPECT_TRUE(teensy->seen().dtr);
  EXPECT_EQ(present().tty, "") << "cdc_acm still has it";
  run_for(200);
  const Log log = run_for(1500);
  EXPECT_EQ(log.lost, 0U);
  EXPECT_EQ(log.corrupt, 0U);
  ASSERT_GT(log.samples.size(), 1000U);
  for (std::size_t i = 1; i < log.samples.size(); ++i)
    ASSERT_EQ(log.samples[i].sequence, log.samples[i - 1].sequence + 1) << i;
  ASSERT_GT(log.exchanges.size(), 30U);
  EXPECT_EQ(teensy->seen().line_codings, codings_of_the_kernel);
  EXPECT_NE(teensy->seen().baud, 134U);
  EXPECT_EQ(stream->counters().errors + stream->counters().stalls + stream->counters().overruns, 0U);
  device->disconnect();
  EXPECT_TRUE(eventually([&] { return !teensy->seen().dtr; })) << "DTR is still up";
  EXPECT_TRUE(eventually([] { return is_ready(); })) << "cdc_acm has not got its port back";
}

TEST_F(UsbBench, StampsWhatArrivedWhenItArrived) {
  plug();
  open();
  device->connect();
  device->request_time_sync();
  std::this_thread::sleep_for(std::chrono::milliseconds(300));
  const Log log = run_for(100);
  ASSERT_FALSE(log.exchanges.empty());
  const auto& late = log.exchanges.front();
  EXPECT_LT(late.host_recv_ns - late.host_send_ns, 150'000'000) << "stamped when it was read, not when it came";
}

TEST_F(UsbBench, ClearsAStallAndGoesOn) {
  plug();
  open();
  device->connect();
  run_for(200);
  teensy->usb().stall_in = true;
  const Log after = run_for(800);
  EXPECT_GT(after.samples.size(), 500U);
  EXPECT_EQ(stream->counters().stalls, 1U);
  EXPECT_EQ(teensy->seen().cleared_halts, 1U);
  teensy->usb().stall_out = true;
  const auto failure = failure_of([&] { run_for(500); });
  EXPECT_EQ(failure.fault, Fault::kTimeout);
  EXPECT_THAT(failure.what, HasSubstr("failed on the bus"));
  EXPECT_GT(run_for(500).exchanges.size(), 5U) << "writing goes on after it";
  EXPECT_EQ(stream->counters().stalls, 2U);
}

TEST_F(UsbBench, TriesAgainAfterBusErrorsAndGivesUpWhenTheyDoNotEnd) {
  plug();
  open();
  device->connect();
  run_for(200);
  teensy->usb().errors_in = 3;
  const Log after = run_for(600);
  EXPECT_GT(after.samples.size(), 300U);
  EXPECT_GE(stream->counters().errors, 1U);
  teensy->usb().errors_in = 1'000'000;
  const auto failure = failure_of([&] { run_for(5000); });
  EXPECT_EQ(failure.fault, Fault::kDisconnected);
  EXPECT_THAT(failure.what, HasSubstr("check cable"));
  teensy->usb().errors_in = 0;
  device->connect();
  EXPECT_GT(run_for(300).samples.size(), 100U);
}

TEST_F(UsbBench, ASilentEndpointNeitherBlocksReadingNorClosing) {
  plug();
  open();
  device->connect();
  run_for(100);
  teensy->usb().silent_in = true;
  std::array<std::uint8_t, 256> buffer{};
  while (stream->read_some(buffer, 100'000'000) > 0) {
  }
  EXPECT_GE(teensy->seen().pending_reads, 16U) << "several transfers are queued";
  const auto start = std::chrono::steady_clock::now();
  device->disconnect();
  EXPECT_LT(since_ms(start), 1000.0);
  EXPECT_EQ(failure_of([&] { device->connect(); }).fault, Fault::kTimeout);
  teensy->usb().silent_in = false;
  device->connect();
  EXPECT_GT(run_for(300).samples.size(), 100U);
}

TEST_F(UsbBench, AFirmwareThatHangsIsSaidSoAndDoesNotHoldClosing) {
  plug();
  open();
  device->connect();
  run_for(100);
  teensy->faults().frozen = true;
  const auto failure = failure_of([&] { run_for(5000); });
  EXPECT_EQ(failure.fault, Fault::kTimeout);
  EXPECT_THAT(failure.what, HasSubstr("its program hangs"));
  EXPECT_LT(failure.after_ms, 1000.0);
  teensy->usb().silent_control = true;
  const auto start = std::chrono::steady_clock::now();
  device->disconnect();
  EXPECT_LT(since_ms(start), 1000.0);
  teensy->usb().silent_control = false;
  teensy->faults().frozen = false;
  ASSERT_TRUE(eventually([] { return is_ready(); }));
  device->connect();
  EXPECT_GT(run_for(300).samples.size(), 100U);
}

TEST_F(UsbBench, FollowsThePlugWhileRunning) {
  plug();
  open();
  device->connect();
  const std::size_t files = open_files();
  for (int round = 0; round < 5; ++round) {
    run_for(100);
    teensy->faults().unplugged = true;
    const auto failure = failure_of([&] { run_for(5000); });
    EXPECT_EQ(failure.fault, Fault::kDisconnected);
    EXPECT_THAT(failure.what, HasSubstr("gone"));
    device->disconnect();
    ASSERT_TRUE(eventually([] { return list_usb_devices().empty(); }));
    const auto absent = failure_of([&] { device->connect(); });
    EXPECT_EQ(absent.fault, Fault::kDisconnected);
    EXPECT_THAT(absent.what, HasSubstr("no Teensy with serial number 1234560 is on USB"));
    EXPECT_FALSE(device->has_reappeared());
    teensy->faults().unplugged = false;
    const auto start = std::chrono::steady_clock::now();
    ASSERT_TRUE(eventually([&] { return device->has_reappeared(); }));
    std::printf("round %d: loss seen after %.0f ms, back after %.0f ms (%s)\n", round, failure.after_ms,
                since_ms(start), stream->has_hotplug() ? "hot-plug callback" : "polling");
    ASSERT_TRUE(eventually([] { return is_ready(); }));
    device->connect();
  }
  EXPECT_EQ(open_files(), files);
}

TEST_F(UsbBench, KnowsTheBootLoader) {
  plug();
  open();
  device->connect();
  run_for(50);
  device->disconnect();
  ASSERT_TRUE(eventually([] { return is_ready(); }));
  {
    // What a program does that probes the port with odd baud rates.
    const int fd = ::open(present().tty.c_str(), O_RDWR | O_NOCTTY | O_NONBLOCK);
    ASSERT_GE(fd, 0);
    termios tio{};
    ASSERT_EQ(tcgetattr(fd, &tio), 0);
    cfsetspeed(&tio, B134);
    ASSERT_EQ(tcsetattr(fd, TCSANOW, &tio), 0);
    ::close(fd);
  }
  ASSERT_TRUE(eventually([] { return present().kind == UsbKind::kBootloader; }));
  EXPECT_EQ(present().serial, "0001E240");
  const auto failure = failure_of([&] { device->connect(); });
  EXPECT_EQ(failure.fault, Fault::kDisconnected);
  EXPECT_THAT(failure.what, HasSubstr("is in its boot loader"));
  teensy->usb().bootloader = false;
  ASSERT_TRUE(eventually([] { return is_ready(); }));
  device->connect();
  EXPECT_GT(run_for(300).samples.size(), 100U);
}

TEST_F(UsbBench, TheSerialPortIsNeverOpenedAt134Baud) {
  plug();
  TtyStream tty({.path = present().tty});
  tty.open();
  EXPECT_TRUE(eventually([&] { return teensy->seen().baud == 115200U; }));
  tty.close();
}

TEST_F(UsbBench, TellsOthersFromTheRight) {
  LiveTeensy other("7654321");
  LiveTeensy raw_hid("1234560", {.vendor_id = 0x16c0, .product_id = 0x0486, .product = "Teensyduino RawHID"});
  ASSERT_TRUE(eventually([] { return is_ready("7654321") && list_usb_devices().size() == 2; }));
  open();
  const auto failure = failure_of([&] { device->connect(); });
  EXPECT_EQ(failure.fault, Fault::kIdentity);
  EXPECT_THAT(failure.what, HasSubstr("is a Teensy with another program"));
  plug();
  open({.serial = ""});
  const auto several = failure_of([&] { device->connect(); });
  EXPECT_EQ(several.fault, Fault::kIdentity);
  EXPECT_THAT(several.what, HasSubstr("several Teensys"));
  open();
  device->connect();
  EXPECT_GT(run_for(300).samples.size(), 100U);
}

TEST_F(UsbBench, AnFtdiAdapterIsNoTeensy) {
  LiveTeensy ftdi("1234560", {.vendor_id = 0x0403, .product_id = 0x6001, .product = "FT232R USB UART"});
  ASSERT_TRUE(eventually([] { return !list_usb_devices().empty(); }));
  open();
  const auto failure = failure_of([&] { device->connect(); });
  EXPECT_EQ(failure.fault, Fault::kIdentity);
  EXPECT_THAT(failure.what, HasSubstr("is no Teensy"));
  EXPECT_THAT(failure.what, HasSubstr("0403:6001"));
}

TEST_F(UsbBench, SaysWhoHoldsIt) {
  plug();
  open();
  device->connect();
  UsbStream second({.serial = "1234560"});
  const auto claimed = failure_of([&] { second.open(); });
  EXPECT_EQ(claimed.fault, Fault::kDisconnected);
  EXPECT_THAT(claimed.what, HasSubstr("another program holds it"));
  device->disconnect();
  ASSERT_TRUE(eventually([] { return is_ready(); }));
  const std::string tty = present().tty;
  std::array<int, 2> ready{};
  ASSERT_EQ(::pipe(ready.data()), 0);
  const pid_t program = ::fork();
  if (program == 0) {
    const int fd = ::open(tty.c_str(), O_RDWR | O_NOCTTY | O_NONBLOCK);
    (void)!::write(ready[1], &fd, sizeof fd);
    for (;;) ::pause();
  }
  int fd = -1;
  ASSERT_EQ(::read(ready[0], &fd, sizeof fd), static_cast<ssize_t>(sizeof fd));
  ASSERT_GE(fd, 0);
  const auto open_port = failure_of([&] { device->connect(); });
  ::kill(program, SIGKILL);
  ::waitpid(program, nullptr, 0);
  ::close(ready[0]);
  ::close(ready[1]);
  EXPECT_EQ(open_port.fault, Fault::kDisconnected);
  EXPECT_THAT(open_port.what, HasSubstr("has its port " + tty + " open"));
  EXPECT_THAT(open_port.what, HasSubstr("pid " + std::to_string(program)));
  device->connect();
}

TEST_F(UsbBench, SaysWhichRuleGivesPermission) {
  plug();
  const auto node = present().node;
  ASSERT_EQ(::chmod(node.c_str(), 0600), 0);
  const pid_t nobody = ::fork();
  if (nobody == 0) {
    if (::setgid(65534) != 0 || ::setuid(65534) != 0) ::_exit(2);
    UsbStream plain({.serial = "1234560"});
    try {
      plain.open();
    } catch (const DeviceError& error) {
      const bool is_told =
          error.fault() == Fault::kRefused && std::string(error.what()).find("60-isorig.rules") != std::string::npos;
      ::_exit(is_told ? 0 : 3);
    }
    ::_exit(4);
  }
  int status = -1;
  ::waitpid(nobody, &status, 0);
  EXPECT_EQ(status, 0);
}

TEST_F(UsbBench, TheEventThreadHasItsPriority) {
  plug();
  open({.serial = "1234560", .event_priority = 61});
  device->connect();
  bool is_found = false;
  for (const auto& task : std::filesystem::directory_iterator("/proc/self/task")) {
    std::string name;
    std::getline(std::ifstream(task.path() / "comm"), name);
    if (name != "isorig-usb") continue;
    is_found = true;
    const auto id = static_cast<pid_t>(std::stoi(task.path().filename()));
    sched_param parameters{};
    EXPECT_EQ(::sched_getscheduler(id), SCHED_FIFO);
    EXPECT_EQ(::sched_getparam(id, &parameters), 0);
    EXPECT_EQ(parameters.sched_priority, 61);
  }
  EXPECT_TRUE(is_found);
}

/// Processor time of the thread that handles USB's events.
double event_thread_ms() {
  for (const auto& task : std::filesystem::directory_iterator("/proc/self/task")) {
    std::string name;
    std::getline(std::ifstream(task.path() / "comm"), name);
    double ran_ns = 0.0;
    if (name == "isorig-usb" && std::ifstream(task.path() / "schedstat") >> ran_ns) return 1e-6 * ran_ns;
  }
  ADD_FAILURE() << "no event thread";
  return 0.0;
}

// Between the plug's pull and the kernel's last clean-up poll() reports the device at once, again and again, with
// nothing to collect. On one processor an event thread that asks without pause keeps the kernel from cleaning up.
TEST_F(UsbBench, ADeviceThatGoesDoesNotKeepTheProcessor) {
  plug();
  open({.serial = "1234560", .event_priority = 61});
  for (int round = 0; round < 10; ++round) {
    ASSERT_TRUE(eventually([] { return is_ready(); }));
    device->connect();
    run_for(100);
    const double before_ms = event_thread_ms();
    const auto start = std::chrono::steady_clock::now();
    teensy->faults().unplugged = true;
    (void)failure_of([&] { run_for(5000); });
    const double seen_ms = since_ms(start);
    ASSERT_TRUE(eventually([] { return list_usb_devices().empty(); }));
    const double gone_ms = since_ms(start), used_ms = event_thread_ms() - before_ms;
    std::printf("round %d: loss seen after %.0f ms, gone after %.0f ms, %.1f ms of processor time\n", round, seen_ms,
                gone_ms, used_ms);
    EXPECT_LT(used_ms, 0.25 * gone_ms);
    device->disconnect();
    teensy->faults().unplugged = false;
  }
}

}  // namespace
}  // namespace isorig::pressure
