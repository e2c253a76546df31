// The image that is flashed, from reset to a session over USB, on a model of its chip.
#include <gtest/gtest.h>

#include <optional>

#include "k66_machine.hpp"
#include "messages/teensy/decoder.hpp"
#include "messages/teensy/wire.hpp"

namespace isorig::firmware {
namespace {

using namespace messages::teensy;
using Bytes = K66Usb::Bytes;
using Stop = K66Machine::Stop;

constexpr unsigned kFill = 1;
constexpr unsigned kVentClosing = 2;

class K66 : public testing::Test {
 protected:
  void TearDown() override {
    EXPECT_EQ(machine.violations, std::vector<std::string>{});
    EXPECT_EQ(machine.usb.toggle_errors, 0);
  }
  void boot() {
    machine.run_ms(8);
    ASSERT_EQ(machine.stopped, Stop::kRunning) << machine.fault;
  }
  void open() {
    K66Usb& usb = machine.usb;
    ASSERT_TRUE(usb.is_attached());
    usb.bus_reset();
    ASSERT_TRUE(usb.control_in(0x80, 6, 0x0100, 0, 64));
    usb.bus_reset();
    ASSERT_TRUE(usb.control_out(0x00, 5, 11, 0, {}));
    ASSERT_EQ(usb.address(), 11);
    ASSERT_TRUE(usb.control_in(0x80, 6, 0x0200, 0, 67));
    ASSERT_TRUE(usb.control_out(0x00, 9, 1, 0, {}));
    usb.reset_toggles();
    ASSERT_TRUE(usb.control_out(0x21, 0x20, 0, 0, {0x00, 0xC2, 0x01, 0x00, 0, 0, 8}));
    ASSERT_TRUE(usb.control_out(0x21, 0x22, 3, 0, {}));
  }
  template <class T>
  void say(const T& message) {
    const Frame frame = encode(message);
    ASSERT_TRUE(machine.usb.out(3, Bytes(frame.bytes, frame.bytes + frame.size)));
  }
  /// Reads bulk packets until a message of that kind comes; the others are kept apart.
  template <class T>
  std::optional<T> hear(int packets = 400) {
    for (int i = 0; i < packets; ++i) {
      const auto packet = machine.usb.in(4);
      if (!packet) continue;
      std::optional<T> wanted;
      decoder.feed(packet->data(), packet->size(), [&](const Packet& one) {
        T message;
        if (parse(one, message)) wanted = message;
        if (Samples batch; parse(one, batch)) samples.insert(samples.end(), batch.items, batch.items + batch.count);
      });
      if (wanted) return wanted;
    }
    return std::nullopt;
  }
  [[nodiscard]] bool is_unpowered() const {
    return machine.coil_permille(kFill, 0) == 0 && machine.coil_permille(kVentClosing, 1) == 0;
  }

  const ElfImage elf{ISORIG_FIRMWARE_DIR "/isorig-teensy36.elf"};
  K66Machine machine{read_hex(ISORIG_FIRMWARE_DIR "/isorig-teensy36.hex"),
                     elf.symbols.at("_ZN6isorig8firmware11Application4stepEv").value};
  Decoder decoder;
  std::vector<Sample> samples;
};

TEST_F(K66, StartsAt180MegahertzWithTheCoilsOffAndTheWatchdogOn) {
  boot();
  EXPECT_EQ(machine.core_Hz, 180'000'000U);
  EXPECT_TRUE(is_unpowered());
  EXPECT_TRUE(machine.is_watchdog_on);
  EXPECT_EQ(machine.watchdog_ms, 50U);
  EXPECT_TRUE(machine.usb.is_attached());
  EXPECT_EQ(machine.reg(0xE000'ED88) >> 20 & 15, 15U) << "FPU";
}

TEST_F(K66, FeedsTheWatchdogAndReadsTheSensorFourThousandTimesASecond) {
  boot();
  const int before = machine.sensor_reads;
  machine.run_ms(60);
  EXPECT_EQ(machine.stopped, Stop::kRunning) << machine.fault;
  EXPECT_NEAR(machine.sensor_reads - before, 240, 2);
  EXPECT_GE(machine.feeds, 10);
  EXPECT_LT(machine.longest_unfed_cycles, 6'000 * K66Machine::kCyclesPerUs);
}

TEST_F(K66, EnumeratesAndNamesItselfByTheFactoryNumber) {
  boot();
  open();
  const auto serial = machine.usb.control_in(0x80, 6, 0x0303, 0x0409, 255);
  ASSERT_TRUE(serial);
  std::string text;
  for (std::size_t i = 2; i < serial->size(); i += 2) text += static_cast<char>((*serial)[i]);
  EXPECT_EQ(text, "1234560");
  EXPECT_FALSE(machine.usb.control_in(0x80, 6, 0x0600, 0, 10)) << "stalls, and goes on:";
  EXPECT_TRUE(machine.usb.control_in(0x80, 6, 0x0100, 0, 18));
}

TEST_F(K66, OpensASessionAndStreams) {
  boot();
  open();
  say(IdentityRequest{.session = 99});
  const auto identity = hear<Identity>();
  ASSERT_TRUE(identity);
  EXPECT_EQ(identity->session, 99U);
  EXPECT_STREQ(identity->serial, "1234560");
  say(TimeSyncRequest{.cookie = 5});
  const auto reply = hear<TimeSyncReply>();
  ASSERT_TRUE(reply);
  EXPECT_EQ(reply->cookie, 5U);
  EXPECT_NEAR(static_cast<double>(reply->device_tx_us), 1e-3 * static_cast<double>(machine.now_ns()), 3'000.0);
  RecordProperty("opening_pass_instructions", static_cast<int>(machine.longest_pass_cycles * 4 / 5));
  ASSERT_TRUE(hear<Status>());
  samples.clear();
  machine.longest_pass_cycles = 0;
  machine.passes = 0;
  const std::uint64_t start_ns = machine.now_ns();
  while (machine.now_ns() < start_ns + 50'000'000) (void)hear<Samples>(1);
  EXPECT_GT(samples.size(), 90U);
  for (std::size_t i = 1; i < samples.size(); ++i) {
    ASSERT_EQ(samples[i].sequence, samples[i - 1].sequence + 1);
    ASSERT_NEAR(samples[i].device_us - samples[i - 1].device_us, 460.0, 270.0);
    ASSERT_EQ(messages::unpack_elvh(samples[i].raw_word).pressure_raw, SimulatedElvh::kRestRaw);
  }
  RecordProperty("longest_pass_instructions", static_cast<int>(machine.longest_pass_cycles * 4 / 5));
  RecordProperty("mean_pass_ns", static_cast<int>((machine.now_ns() - start_ns) / machine.passes));
  EXPECT_LT(machine.longest_pass_cycles, 50 * K66Machine::kCyclesPerUs);
}

TEST_F(K66, DrivesTheCoilsAndVentsWhenTheHostFallsSilent) {
  boot();
  open();
  say(IdentityRequest{});
  say(Limits{.pressure_max_raw = 12'124, .fill_allowance_permille = 100, .fill_max_ms = 2'000});
  say(Heartbeat{});
  say(ValveCommand{.sequence = 1, .fill_permille = 250, .vent_permille = 0, .validity_ms = 1'000});
  machine.run_ms(1);
  EXPECT_EQ(machine.coil_permille(kFill, 0), 250);
  EXPECT_EQ(machine.coil_permille(kVentClosing, 1), 1000);
  say(ValveCommand{.sequence = 2, .fill_permille = 0, .vent_permille = 400, .validity_ms = 1'000});
  machine.run_ms(1);
  EXPECT_EQ(machine.coil_permille(kFill, 0), 0);
  EXPECT_EQ(machine.coil_permille(kVentClosing, 1), 600);
  machine.run_ms(190);
  EXPECT_FALSE(is_unpowered());
  machine.run_ms(12);
  EXPECT_TRUE(is_unpowered()) << "200 ms without a heartbeat, and nobody even reads";
}

TEST_F(K66, VentsByItselfWhenItsSensorDiesWhileItFills) {
  boot();
  open();
  say(IdentityRequest{});
  say(ValveCommand{.sequence = 1, .fill_permille = 250, .vent_permille = 0, .validity_ms = 1'000});
  say(Heartbeat{});
  machine.run_ms(1);
  EXPECT_TRUE(is_unpowered()) << "no limits, no filling";
  say(Limits{.pressure_max_raw = 12'124, .fill_allowance_permille = 100, .fill_max_ms = 2'000});
  say(ValveCommand{.sequence = 2, .fill_permille = 250, .vent_permille = 0, .validity_ms = 1'000});
  machine.run_ms(20);
  EXPECT_EQ(machine.coil_permille(kFill, 0), 250);
  machine.sensor.set_fault(SimulatedElvh::Fault::kAbsent);
  machine.run_ms(90);
  EXPECT_EQ(machine.coil_permille(kFill, 0), 250);
  machine.run_ms(15);
  EXPECT_TRUE(is_unpowered());
  std::optional<Status> status;
  for (int i = 0; i < 4 && (!status || status->cause == VentCause::kNone); ++i)
    status = hear<Status>();  // some are older
  ASSERT_TRUE(status);
  EXPECT_EQ(status->cause, VentCause::kSensorSilent);
}

TEST_F(K66, AHostThatDoesNotReadCostsNoTime) {
  boot();
  open();
  machine.run_ms(30);
  EXPECT_EQ(machine.stopped, Stop::kRunning) << machine.fault;
  EXPECT_LT(machine.longest_pass_cycles, 100 * K66Machine::kCyclesPerUs);
  EXPECT_GE(machine.feeds, 5);
  const auto status = hear<Status>();
  ASSERT_TRUE(status);
  EXPECT_GT(status->dropped, 10U);
}

TEST_F(K66, At134BaudItVentsStopsTheWatchdogAndWaitsForTheBootLoader) {
  boot();
  open();
  say(IdentityRequest{});
  say(Limits{.pressure_max_raw = 12'124, .fill_allowance_permille = 100, .fill_max_ms = 2'000});
  say(Heartbeat{});
  say(ValveCommand{.sequence = 1, .fill_permille = 500, .vent_permille = 0, .validity_ms = 1'000});
  machine.run_ms(1);
  ASSERT_EQ(machine.coil_permille(kFill, 0), 500);
  ASSERT_TRUE(machine.usb.control_out(0x21, 0x20, 0, 0, {134, 0, 0, 0, 0, 0, 8}));
  for (int i = 0; i < 15; ++i) machine.usb.frame_start();
  EXPECT_EQ(machine.stopped, Stop::kBreakpoint);
  EXPECT_TRUE(is_unpowered());
  EXPECT_FALSE(machine.is_watchdog_on);
}

TEST_F(K66, RaisesTheSyncLine) {
  boot();
  bool was_high = false;
  std::uint64_t edge_ns = 0;
  while (machine.now_ns() < 1'010'000'000 && machine.stopped == Stop::kRunning) {
    machine.run_us(100);
    if (!was_high && machine.pin_d(0)) edge_ns = machine.now_ns();
    was_high = machine.pin_d(0);
  }
  // The device clock starts with the cycle counter, within a few milliseconds of reset.
  EXPECT_NEAR(1e-6 * static_cast<double>(edge_ns), 1'000.0, 5.0);
}

}  // namespace
}  // namespace isorig::firmware
