// What the USB driver decides, on a bus that does what a test says. On a real kernel: tests/vm/usb_stream_test.cpp.
#include "drivers/pressure/usb_session.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>
#include <chrono>
#include <cstdint>
#include <functional>
#include <initializer_list>
#include <memory>
#include <numeric>
#include <string>
#include <thread>
#include <vector>

#include "drivers/api/error.hpp"
#include "drivers/clock/real_clock.hpp"
#include "drivers/pressure/usb_stream.hpp"
#include "error_of.hpp"
#include "fake_libusb.hpp"

namespace isorig::pressure {
namespace {

using drivers::DeviceError;
using drivers::Fault;
using test::error_of;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::SizeIs;

constexpr std::uint8_t kIn = 0x84, kOut = 0x03;

class UsbSessionTest : public testing::Test {
 protected:
  UsbSessionTest() {
    fake_libusb::start_anew();
    options.read_transfers = 4;
    options.write_transfers = 2;
    options.write_timeout_ns = 20'000'000;
    options.error_pause_ns = 1'000'000;
    options.error_patience_ns = 60'000'000;
    options.queued_packets = 3;
    device.node = "/dev/null";
    device.serial = "1234560";
    device.vendor_id = 0x16c0;
    device.product_id = 0x0483;
  }
  ~UsbSessionTest() override {
    if (session) shut();
  }

  void open() {
    session = std::make_unique<UsbSession>(nullptr, device, options, counters);
    ASSERT_THAT(bus().pending_on(0), SizeIs(1));
    bus().complete(bus().pending_on(0).front(), LIBUSB_TRANSFER_COMPLETED);
  }
  /// All that is under way comes back, whatever it was.
  void shut() {
    (void)session->close(0);
    for (int turn = 0; turn < 4 && !session->is_closed(); ++turn) {
      session->service();
      bus().return_cancelled();
      while (!bus().pending.empty()) bus().complete(bus().pending.front(), LIBUSB_TRANSFER_COMPLETED);
    }
    EXPECT_TRUE(session->is_closed());
  }
  /// What the reads were told last, in the order of submission.
  static void arrive(std::initializer_list<std::uint8_t> bytes) {
    const std::vector<std::uint8_t> copy(bytes);
    ASSERT_FALSE(bus().pending_on(kIn).empty()) << "no read is under way";
    bus().complete(bus().pending_on(kIn).front(), LIBUSB_TRANSFER_COMPLETED, copy);
  }
  std::vector<std::uint8_t> read(std::size_t most = 64) {
    std::vector<std::uint8_t> bytes(most);
    bytes.resize(session->read(bytes, 0).size);
    return bytes;
  }
  void write(std::size_t size) {
    std::vector<std::uint8_t> bytes(size);
    std::iota(bytes.begin(), bytes.end(), std::uint8_t{0});
    session->write(bytes);
  }
  /// service() as the event thread calls it, until it has nothing to do at once.
  void serve_until(const std::function<bool()>& done) {
    const auto deadline = std::chrono::steady_clock::now() + std::chrono::seconds(5);
    while (!done() && std::chrono::steady_clock::now() < deadline) {
      session->service();
      bus().return_cancelled();
      std::this_thread::sleep_for(std::chrono::microseconds(200));
    }
    EXPECT_TRUE(done());
  }
  static fake_libusb::Bus& bus() { return fake_libusb::bus(); }

  UsbSession::Options options;
  UsbDevice device;
  UsbCounters counters;
  std::unique_ptr<UsbSession> session;
};

TEST_F(UsbSessionTest, ClaimsBothInterfacesRaisesDtrAndQueuesItsReads) {
  open();
  EXPECT_THAT(bus().claimed, ElementsAre(0, 1));
  EXPECT_THAT(bus().line_states, ElementsAre(1));
  ASSERT_THAT(bus().pending_on(kIn), SizeIs(4));
  for (const auto* transfer : bus().pending_on(kIn)) EXPECT_EQ(transfer->length, 64) << "a longer one waits for two";
  EXPECT_THAT(bus().pending_on(kOut), IsEmpty());
}

TEST_F(UsbSessionTest, HandsOutWhatArrivedInOrderWithItsTime) {
  open();
  const auto before_ns = clock::RealClock{}.now_ns();
  arrive({1, 2, 3});
  arrive({4});
  const auto after_ns = clock::RealClock{}.now_ns();
  std::array<std::uint8_t, 2> two{};
  const auto first = session->read(two, 0);
  EXPECT_EQ(first.size, 2U);
  EXPECT_GE(first.mono_ns, before_ns);
  EXPECT_LE(first.mono_ns, after_ns);
  EXPECT_THAT(read(), ElementsAre(3)) << "the rest of the packet, not of the next";
  EXPECT_THAT(read(), ElementsAre(4));
  EXPECT_THAT(read(), IsEmpty());
  EXPECT_THAT(bus().pending_on(kIn), SizeIs(4)) << "each that came back goes out again";
}

TEST_F(UsbSessionTest, ThrowsAwayTheNewestWhenNobodyReads) {
  open();
  for (std::uint8_t k = 0; k < 5; ++k) arrive({k});
  EXPECT_EQ(counters.overruns, 2U);
  EXPECT_THAT(read(), ElementsAre(0));
  arrive({7});
  EXPECT_THAT(read(), ElementsAre(1));
  EXPECT_THAT(read(), ElementsAre(2));
  EXPECT_THAT(read(), ElementsAre(7));
}

TEST_F(UsbSessionTest, AStallIsClearedOnceNothingIsUnderWayAndReadingGoesOn) {
  open();
  bus().complete(bus().pending_on(kIn).front(), LIBUSB_TRANSFER_STALL);
  bus().complete(bus().pending_on(kIn).front(), LIBUSB_TRANSFER_STALL);
  EXPECT_EQ(counters.stalls, 1U) << "what was queued fails with the first";
  session->service();
  EXPECT_THAT(bus().cleared, IsEmpty()) << "transfers are still under way";
  bus().return_cancelled();
  session->service();
  EXPECT_THAT(bus().cleared, ElementsAre(kIn));
  EXPECT_THAT(bus().pending_on(kIn), SizeIs(4));
  arrive({5});
  EXPECT_THAT(read(), ElementsAre(5));
}

TEST_F(UsbSessionTest, AHaltThatCannotBeClearedIsTriedAgainUntilTheDeviceIsGone) {
  open();
  bus().clear_error = LIBUSB_ERROR_TIMEOUT;
  bus().complete(bus().pending_on(kIn).front(), LIBUSB_TRANSFER_STALL);
  serve_until([&] { return bus().cleared.size() >= 3; });
  EXPECT_THAT(bus().pending_on(kIn), IsEmpty());
  EXPECT_THAT(read(), IsEmpty()) << "not given up yet";
  bus().clear_error = LIBUSB_ERROR_NO_DEVICE;
  const auto tries = bus().cleared.size();
  serve_until([&] { return bus().cleared.size() > tries; });
  const auto error = error_of([&] { read(); });
  EXPECT_EQ(error.fault(), Fault::kDisconnected);
  EXPECT_THAT(error.what(), HasSubstr("1234560"));
  EXPECT_THAT(error.what(), HasSubstr("the device is gone"));
}

TEST_F(UsbSessionTest, BusErrorsThatDoNotEndAreALossAndThoseThatEndAreNot) {
  open();
  std::uint64_t incidents = 0;
  // For longer than the patience, which each success ends.
  const auto enough = std::chrono::steady_clock::now() + std::chrono::nanoseconds(3 * options.error_patience_ns);
  for (; std::chrono::steady_clock::now() < enough; ++incidents) {
    bus().complete(bus().pending_on(kIn).front(), LIBUSB_TRANSFER_ERROR);
    EXPECT_THAT(read(), IsEmpty());
    serve_until([&] { return bus().pending_on(kIn).size() == 4; });
    arrive({9});
    EXPECT_THAT(read(), ElementsAre(9));
  }
  EXPECT_EQ(counters.errors, incidents);
  EXPECT_THAT(bus().cleared, IsEmpty()) << "no halt, nothing to clear";
  std::string lost;
  serve_until([&] {
    while (!bus().pending_on(kIn).empty()) bus().complete(bus().pending_on(kIn).front(), LIBUSB_TRANSFER_ERROR);
    try {
      read();
    } catch (const DeviceError& error) {
      lost = error.what();
    }
    return !lost.empty();
  });
  EXPECT_THAT(lost, HasSubstr("every transfer fails; check cable and hub"));
}

TEST_F(UsbSessionTest, WhatArrivedBeforeTheLossIsHandedOutFirst) {
  open();
  arrive({1});
  bus().complete(bus().pending_on(kIn).front(), LIBUSB_TRANSFER_NO_DEVICE);
  EXPECT_THAT(read(), ElementsAre(1));
  EXPECT_EQ(error_of([&] { read(); }).fault(), Fault::kDisconnected);
  EXPECT_EQ(error_of([&] { write(1); }).fault(), Fault::kDisconnected);
}

TEST_F(UsbSessionTest, ADeviceThatGoesBetweenTwoTransfersIsGone) {
  open();
  bus().submit_error = LIBUSB_ERROR_NO_DEVICE;
  arrive({1});
  EXPECT_THAT(read(), ElementsAre(1));
  EXPECT_THAT(error_of([&] { read(); }).what(), HasSubstr("the device is gone"));
}

TEST_F(UsbSessionTest, ATransferThatIsNotTakenIsAnErrorOfTheBus) {
  open();
  bus().submit_error = LIBUSB_ERROR_IO;
  arrive({1});
  bus().submit_error = 0;
  EXPECT_EQ(counters.errors, 1U);
  EXPECT_THAT(read(), ElementsAre(1));
  serve_until([&] { return bus().pending_on(kIn).size() == 4; });
}

TEST_F(UsbSessionTest, ADeviceThatTakesNoLineStateIsLost) {
  session = std::make_unique<UsbSession>(nullptr, device, options, counters);
  bus().complete(bus().pending_on(0).front(), LIBUSB_TRANSFER_TIMED_OUT);
  EXPECT_THAT(error_of([&] { read(); }).what(), HasSubstr("does not answer (SET_CONTROL_LINE_STATE)"));
}

TEST_F(UsbSessionTest, WritesInPiecesOfATransfer) {
  open();
  write(300);
  ASSERT_THAT(bus().pending_on(kOut), SizeIs(2));
  const auto sent = bus().pending_on(kOut);
  EXPECT_EQ(sent[0]->length, 256);
  EXPECT_EQ(sent[1]->length, 44);
  EXPECT_EQ(sent[1]->buffer[0], 0);
  EXPECT_EQ(sent[1]->buffer[43], 43);
}

TEST_F(UsbSessionTest, ADeviceThatTakesNothingIsATimeOutAndNoFailureOfTheBus) {
  open();
  write(300);
  EXPECT_THAT(error_of([&] { write(1); }).what(), HasSubstr("takes no data; its program hangs"));
  for (auto* transfer : bus().pending_on(kOut)) bus().complete(transfer, LIBUSB_TRANSFER_TIMED_OUT);
  EXPECT_EQ(counters.lost_writes, 2U);
  const auto error = error_of([&] { write(1); });
  EXPECT_EQ(error.fault(), Fault::kTimeout) << "the caller learns of what was lost";
  EXPECT_THAT(error.what(), HasSubstr("takes no data"));
  write(1);
  EXPECT_THAT(bus().pending_on(kOut), SizeIs(1)) << "once";
  EXPECT_THAT(bus().cleared, IsEmpty());
  EXPECT_EQ(counters.errors + counters.stalls, 0U);
}

TEST_F(UsbSessionTest, AWriteThatFailedIsToldAndWritingGoesOnWhenItIsCleared) {
  open();
  write(1);
  bus().complete(bus().pending_on(kOut).front(), LIBUSB_TRANSFER_STALL);
  const auto error = error_of([&] { write(1); });
  EXPECT_EQ(error.fault(), Fault::kTimeout);
  EXPECT_THAT(error.what(), HasSubstr("an earlier write failed on the bus"));
  EXPECT_THAT(error_of([&] { write(1); }).what(), HasSubstr("takes no data")) << "not before the halt is cleared";
  session->service();
  EXPECT_THAT(bus().cleared, ElementsAre(kOut));
  write(1);
  EXPECT_THAT(bus().pending_on(kOut), SizeIs(1));
  EXPECT_THAT(bus().pending_on(kIn), SizeIs(4)) << "reading is not touched";
}

TEST_F(UsbSessionTest, AWriteThatIsNotTakenIsToldAtOnce) {
  open();
  bus().submit_error = LIBUSB_ERROR_IO;
  const auto error = error_of([&] { write(1); });
  EXPECT_EQ(error.fault(), Fault::kTimeout);
  EXPECT_THAT(error.what(), HasSubstr("the bus takes no write"));
  EXPECT_EQ(counters.lost_writes, 1U);
  bus().submit_error = 0;
  bool is_written = false;
  serve_until([&] {  // once the pause after the error is over
    try {
      if (!is_written) write(1);
      is_written = true;
    } catch (const DeviceError&) {
    }
    return is_written;
  });
  EXPECT_THAT(bus().pending_on(kOut), SizeIs(1));
  EXPECT_EQ(counters.lost_writes, 1U);

  bus().submit_error = LIBUSB_ERROR_NO_DEVICE;
  EXPECT_THAT(error_of([&] { write(1); }).what(), HasSubstr("the device is gone"));
  EXPECT_EQ(counters.lost_writes, 2U);
}

TEST_F(UsbSessionTest, ClosingLetsTheLastWriteGoThenDropsDtrAndGivesBackTheDataInterfaceFirst) {
  open();
  write(1);
  auto* order_to_vent = bus().pending_on(kOut).front();
  EXPECT_FALSE(session->close(0));
  session->service();
  bus().return_cancelled();
  ASSERT_THAT(bus().pending, ElementsAre(order_to_vent)) << "reads come back, the write does not";
  session->service();
  EXPECT_THAT(bus().line_states, ElementsAre(1)) << "not before the write went";
  bus().complete(order_to_vent, LIBUSB_TRANSFER_COMPLETED);
  session->service();
  EXPECT_THAT(bus().line_states, ElementsAre(1, 0));
  EXPECT_FALSE(session->is_closed());
  bus().complete(bus().pending_on(0).front(), LIBUSB_TRANSFER_TIMED_OUT);
  session->service();
  EXPECT_TRUE(session->is_closed()) << "the device need not take it";
  EXPECT_THAT(bus().released, ElementsAre(1, 0));
  EXPECT_EQ(bus().closed, 1);
  EXPECT_TRUE(session->close(0));
}

TEST_F(UsbSessionTest, ALostDeviceIsGivenBackWithoutAskingItForAnything) {
  open();
  bus().complete(bus().pending_on(kIn).front(), LIBUSB_TRANSFER_NO_DEVICE);
  EXPECT_FALSE(session->close(0));
  session->service();
  bus().return_cancelled();
  session->service();
  EXPECT_TRUE(session->is_closed());
  EXPECT_THAT(bus().line_states, ElementsAre(1));
}

TEST_F(UsbSessionTest, SaysWhyADeviceCannotBeOpenedAndLeavesNothingBehind) {
  const auto refusal = [&] { return error_of([&] { UsbSession refused(nullptr, device, options, counters); }); };
  device.node = "/dev/bus/usb/none";
  EXPECT_THAT(refusal().what(), HasSubstr("cannot open /dev/bus/usb/none: No such file or directory"));
  device.node = "/dev/null";

  bus().wrap_error = LIBUSB_ERROR_ACCESS;
  EXPECT_THAT(refusal().what(), HasSubstr("cannot be opened: LIBUSB_ERROR_ACCESS"));
  bus().wrap_error = 0;

  bus().claim_errors = {{1, LIBUSB_ERROR_BUSY}};
  const auto held = refusal();
  EXPECT_EQ(held.fault(), Fault::kDisconnected);
  EXPECT_THAT(held.what(), HasSubstr("another program holds it; stop it first (`fuser -v /dev/null` names it)"));
  EXPECT_THAT(bus().released, ElementsAre(0)) << "what was claimed";
  bus().claim_errors = {{0, LIBUSB_ERROR_IO}};
  EXPECT_THAT(refusal().what(), HasSubstr("cannot be claimed: LIBUSB_ERROR_IO"));
  bus().claim_errors.clear();

  bus().has_data_interface = false;
  const auto other = refusal();
  EXPECT_EQ(other.fault(), Fault::kIdentity);
  EXPECT_THAT(other.what(), HasSubstr("it is no Teensy"));
  EXPECT_THAT(bus().pending, IsEmpty());
  EXPECT_EQ(bus().opened, bus().closed);
}

TEST(UsbStream, SaysThatUsbCannotBeUsedOrThatTheTeensyIsAbsent) {
  fake_libusb::start_anew();
  {
    UsbStream stream({.serial = "0000001"});
    EXPECT_EQ(stream.name(), "Teensy 0000001 on USB");
    EXPECT_EQ(stream.counters().errors, 0U);
    fake_libusb::bus().init_error = LIBUSB_ERROR_OTHER;
    const auto refused = error_of([&] { stream.open(); });
    EXPECT_EQ(refused.fault(), Fault::kRefused);
    EXPECT_THAT(refused.what(), HasSubstr("is /dev/bus/usb there?"));

    fake_libusb::bus().init_error = 0;
    EXPECT_THROW(stream.open(), DeviceError) << "no Teensy has this number";
    EXPECT_FALSE(stream.is_open());
    EXPECT_FALSE(stream.has_hotplug());
    EXPECT_FALSE(stream.has_reappeared());
    std::array<std::uint8_t, 1> byte{};
    EXPECT_THAT(error_of([&] { stream.read_some(byte, 0); }).what(), HasSubstr("not open"));
    EXPECT_THAT(error_of([&] { stream.write_all(byte); }).what(), HasSubstr("not open"));
  }
  EXPECT_EQ(fake_libusb::bus().contexts, 0) << "its thread ended and gave the context back";
}

}  // namespace
}  // namespace isorig::pressure
