#include "firmware/usb_device.hpp"

#include <gtest/gtest.h>

#include "fake_sie.hpp"

namespace isorig::firmware {
namespace {

using Bytes = std::vector<std::uint8_t>;

class Usb : public testing::Test {
 protected:
  void plug_in() {
    host.bus_reset();
    device.poll();
  }
  /// What Linux does, in its order.
  void enumerate() {
    plug_in();
    ASSERT_TRUE(host.control_in(0x80, 6, 0x0100, 0, 64));
    plug_in();
    ASSERT_TRUE(host.control_out(0x00, 5, 9, 0, {}));
    ASSERT_EQ(host.address, 9);
    ASSERT_TRUE(host.control_in(0x80, 6, 0x0100, 0, 18));
    ASSERT_TRUE(host.control_in(0x80, 6, 0x0200, 0, 9));
    ASSERT_TRUE(host.control_in(0x80, 6, 0x0200, 0, 67));
    ASSERT_TRUE(host.control_out(0x00, 9, 1, 0, {}));
    host.reset_toggles();
  }
  void open() {
    enumerate();
    ASSERT_TRUE(host.control_out(0x21, 0x20, 0, 0, {0x00, 0xC2, 0x01, 0x00, 0, 0, 8}));
    ASSERT_TRUE(host.control_out(0x21, 0x22, 3, 0, {}));
  }
  Bytes received() {
    std::uint8_t bytes[64];
    const std::size_t size = device.receive(bytes, sizeof bytes);
    return {bytes, bytes + size};
  }
  bool send(const Bytes& bytes) { return device.send(bytes.data(), bytes.size()); }

  FakeSie host{[this] { device.poll(); }};
  UsbDevice device{host, "1234560"};
};

TEST_F(Usb, DescriptorsAreWhatAHostExpects) {
  plug_in();
  const auto descriptor = host.control_in(0x80, 6, 0x0100, 0, 255);
  ASSERT_TRUE(descriptor);
  ASSERT_EQ(descriptor->size(), 18U);
  EXPECT_EQ((*descriptor)[8] | (*descriptor)[9] << 8, 0x16C0);
  EXPECT_EQ((*descriptor)[10] | (*descriptor)[11] << 8, 0x0483);

  const auto configuration = host.control_in(0x80, 6, 0x0200, 0, 255);
  ASSERT_TRUE(configuration);
  ASSERT_EQ(configuration->size(), 67U);
  // Every descriptor's length leads to the next one, and the last one ends where the total says.
  std::size_t at = 0;
  int interfaces = 0;
  std::vector<int> endpoints;
  while (at < configuration->size()) {
    const std::size_t length = (*configuration)[at];
    ASSERT_GT(length, 0U);
    if ((*configuration)[at + 1] == 4) ++interfaces;
    if ((*configuration)[at + 1] == 5) endpoints.push_back((*configuration)[at + 2]);
    at += length;
  }
  EXPECT_EQ(at, 67U);
  EXPECT_EQ(interfaces, 2);
  EXPECT_EQ(endpoints, (std::vector<int>{0x82, 0x03, 0x84}));
}

TEST_F(Usb, TheSerialNumberIsTheStringThatUdevSees) {
  plug_in();
  const auto serial = host.control_in(0x80, 6, 0x0303, 0x0409, 255);
  ASSERT_TRUE(serial);
  std::string text;
  for (std::size_t i = 2; i < serial->size(); i += 2) text += static_cast<char>((*serial)[i]);
  EXPECT_EQ(text, "1234560");
  EXPECT_EQ((*serial)[0], serial->size());
}

TEST_F(Usb, AnswersNoMoreThanWasAskedFor) {
  plug_in();
  const auto head = host.control_in(0x80, 6, 0x0200, 0, 9);
  ASSERT_TRUE(head);
  EXPECT_EQ(head->size(), 9U);
  const auto whole_packet = host.control_in(0x80, 6, 0x0200, 0, 64);
  ASSERT_TRUE(whole_packet);
  EXPECT_EQ(whole_packet->size(), 64U);
}

TEST_F(Usb, RefusesWhatItDoesNotHaveAndGoesOn) {
  plug_in();
  EXPECT_FALSE(host.control_in(0x80, 6, 0x0600, 0, 10)) << "qualifier: full speed only";
  EXPECT_FALSE(host.control_in(0x80, 6, 0x0304, 0x0409, 255));
  EXPECT_FALSE(host.control_in(0xC0, 1, 0, 0, 10)) << "vendor request";
  EXPECT_FALSE(host.control_out(0x00, 9, 2, 0, {})) << "no such configuration";
  EXPECT_TRUE(host.control_in(0x80, 6, 0x0100, 0, 18));
}

TEST_F(Usb, IsOpenWhileConfiguredWithDtrAndAwake) {
  enumerate();
  EXPECT_FALSE(device.is_open());
  ASSERT_TRUE(host.control_out(0x21, 0x22, 3, 0, {}));
  EXPECT_TRUE(device.is_open());
  host.sleep();
  EXPECT_FALSE(device.is_open()) << "the cable is out, or the host asleep";
  host.frame_start();
  EXPECT_TRUE(device.is_open());
  ASSERT_TRUE(host.control_out(0x21, 0x22, 0, 0, {}));
  EXPECT_FALSE(device.is_open());
  ASSERT_TRUE(host.control_out(0x21, 0x22, 1, 0, {}));
  plug_in();
  EXPECT_FALSE(device.is_open());
}

TEST_F(Usb, EchoesLineCoding) {
  open();
  EXPECT_EQ(device.baud(), 115'200U);
  ASSERT_TRUE(host.control_out(0x21, 0x20, 0, 0, {0x80, 0x25, 0x00, 0x00, 0, 0, 8}));
  const auto coding = host.control_in(0xA1, 0x21, 0, 0, 7);
  ASSERT_TRUE(coding);
  EXPECT_EQ(*coding, (Bytes{0x80, 0x25, 0x00, 0x00, 0, 0, 8}));
  EXPECT_FALSE(device.wants_bootloader());
}

TEST_F(Usb, At134BaudItAsksForTheBootLoaderAfterTheHostHadItsAnswer) {
  open();
  ASSERT_TRUE(host.control_out(0x21, 0x20, 0, 0, {134, 0, 0, 0, 0, 0, 8}));
  for (int i = 0; i < 14; ++i) host.frame_start();
  EXPECT_FALSE(device.wants_bootloader());
  host.frame_start();
  EXPECT_TRUE(device.wants_bootloader());
}

TEST_F(Usb, BytesGoBothWaysInOrder) {
  open();
  for (std::uint8_t i = 0; i < 100; ++i) {
    ASSERT_TRUE(host.bulk_out({i, 1, 2}));
    ASSERT_EQ(received(), (Bytes{i, 1, 2}));
    ASSERT_TRUE(send({3, 4, i}));
    ASSERT_EQ(host.bulk_in(), (Bytes{3, 4, i}));
  }
  EXPECT_EQ(host.toggle_errors, 0);
}

TEST_F(Usb, TakesTwoPacketsAheadAndThenHoldsTheHostOff) {
  open();
  EXPECT_TRUE(host.bulk_out({1}));
  EXPECT_TRUE(host.bulk_out({2}));
  EXPECT_FALSE(host.bulk_out({3})) << "NAK";
  EXPECT_EQ(received(), (Bytes{1}));
  EXPECT_TRUE(host.bulk_out({3}));
  EXPECT_EQ(received(), (Bytes{2}));
  EXPECT_EQ(received(), (Bytes{3}));
  EXPECT_EQ(received(), (Bytes{}));
}

TEST_F(Usb, PartialPacketsAreThereAtOnceAndFullOnesAreEnded) {
  open();
  EXPECT_EQ(host.bulk_in(), std::nullopt) << "NAK";
  ASSERT_TRUE(send(Bytes(21, 7)));
  EXPECT_EQ(host.bulk_in(), Bytes(21, 7));
  ASSERT_TRUE(send(Bytes(64, 8)));
  EXPECT_EQ(host.bulk_in(), Bytes(64, 8));
  EXPECT_EQ(host.bulk_in(), Bytes{});
  EXPECT_EQ(host.bulk_in(), std::nullopt);
}

TEST_F(Usb, AStalledHostCostsFramesNotTime) {
  open();
  int taken = 0;
  while (send(Bytes(33, static_cast<std::uint8_t>(taken)))) ++taken;
  EXPECT_EQ(taken, 16);
  for (int i = 0; i < taken; ++i) ASSERT_EQ(host.bulk_in(), Bytes(33, static_cast<std::uint8_t>(i)));
  EXPECT_EQ(host.bulk_in(), std::nullopt);
  EXPECT_TRUE(send({1}));
}

TEST_F(Usb, NothingIsTakenWhileNotConfigured) {
  EXPECT_FALSE(send({1}));
  plug_in();
  EXPECT_FALSE(send({1}));
}

// The engine's banks go on counting while the toggles start anew: after an odd number of packets they
// disagree.
TEST_F(Usb, SurvivesBeingConfiguredAgain) {
  for (int packets = 0; packets < 4; ++packets) {
    open();
    for (int i = 0; i < packets; ++i) {
      ASSERT_TRUE(host.bulk_out({9}));
      received();
      ASSERT_TRUE(send({8}));
      ASSERT_EQ(host.bulk_in(), Bytes{8});
    }
    ASSERT_TRUE(send({77})) << "left in the queue, to be forgotten";
    ASSERT_TRUE(host.bulk_out({78}));
    ASSERT_TRUE(host.control_out(0x00, 9, 1, 0, {}));
    host.reset_toggles();
    EXPECT_EQ(host.bulk_in(), std::nullopt);
    EXPECT_EQ(received(), Bytes{});
    for (std::uint8_t i = 0; i < 5; ++i) {
      ASSERT_TRUE(host.bulk_out({i}));
      ASSERT_EQ(received(), Bytes{i});
      ASSERT_TRUE(send({i}));
      ASSERT_EQ(host.bulk_in(), Bytes{i});
    }
  }
  EXPECT_EQ(host.toggle_errors, 0);
}

TEST_F(Usb, AClearedHaltStartsTheTogglesAnewAndLosesNothingQueued) {
  open();
  ASSERT_TRUE(send({1}));
  ASSERT_EQ(host.bulk_in(), Bytes{1});
  ASSERT_TRUE(send({2}));
  ASSERT_TRUE(send({3}));
  ASSERT_TRUE(send({4}));
  ASSERT_TRUE(host.bulk_out({5}));
  received();
  ASSERT_TRUE(host.control_out(0x02, 1, 0, 0x84, {}));
  ASSERT_TRUE(host.control_out(0x02, 1, 0, 0x03, {}));
  host.reset_toggles();
  EXPECT_EQ(host.bulk_in(), Bytes{2});
  EXPECT_EQ(host.bulk_in(), Bytes{3});
  EXPECT_EQ(host.bulk_in(), Bytes{4});
  ASSERT_TRUE(host.bulk_out({6}));
  EXPECT_EQ(received(), Bytes{6});
  EXPECT_EQ(host.toggle_errors, 0);
}

TEST_F(Usb, ATransferThatTheHostBreaksOffDoesNotSpoilTheNext) {
  plug_in();
  for (int i = 0; i < 5; ++i) {
    host.setup(0x80, 6, 0x0200, 0, 67);
    const auto part = i % 2 == 0 ? host.in(0) : Bytes(64);  // one of its two packets, or none
    ASSERT_TRUE(part);
    const auto descriptor = host.control_in(0x80, 6, 0x0100, 0, 18);
    ASSERT_TRUE(descriptor);
    EXPECT_EQ(descriptor->size(), 18U);
  }
  EXPECT_EQ(host.toggle_errors, 0);
}

TEST_F(Usb, ForgetsWhatWaitedButNotWhatTheEngineHolds) {
  open();
  for (std::uint8_t i = 0; i < 6; ++i) ASSERT_TRUE(send({i}));
  device.discard_output();
  EXPECT_EQ(host.bulk_in(), Bytes{0});
  EXPECT_EQ(host.bulk_in(), Bytes{1});
  EXPECT_EQ(host.bulk_in(), std::nullopt);
  ASSERT_TRUE(send({9}));
  EXPECT_EQ(host.bulk_in(), Bytes{9});
  EXPECT_EQ(host.toggle_errors, 0);
}

// Any requests in any order, broken off anywhere, between resets: whatever was before, the next host gets a
// port.
TEST_F(Usb, AnyHostLeavesItUsableForTheNext) {
  std::uint32_t state = 12'345;
  const auto random = [&state](std::uint32_t limit) {
    state = state * 1'664'525U + 1'013'904'223U;
    return (state >> 8U) % limit;
  };
  const std::uint8_t requests[] = {0, 1, 3, 5, 6, 8, 9, 9, 10, 11, 0x20, 0x21, 0x22, 0x23, 0xFF};
  int frames_sent = 0;
  for (int round = 0; round < 300; ++round) {
    open();
    if (round % 3 == 0) plug_in();
    for (int i = 0; i < 30; ++i) {
      const std::uint8_t types[] = {0x00, 0x01, 0x02, 0x21, 0x80, 0x81, 0x82, 0xA1, 0xC0};
      const auto value = static_cast<std::uint16_t>(random(2) == 0 ? random(3) : random(0x700));
      host.setup(types[random(9)], requests[random(15)], value, static_cast<std::uint16_t>(random(0x90)),
                 static_cast<std::uint16_t>(random(200)));
      for (std::uint32_t k = random(4); k > 0; --k) {
        if (random(2) == 0) (void)host.in(static_cast<std::uint8_t>(random(2) * 4));
        if (random(2) == 0) (void)host.out(static_cast<std::uint8_t>(random(2) * 3), Bytes(random(65), 1));
        frames_sent += send(Bytes(1 + random(250), 2)) ? 1 : 0;
        (void)received();
        if (random(8) == 0) device.discard_output();
        if (random(8) == 0) host.frame_start();
      }
    }
    open();
    EXPECT_TRUE(device.is_open());
    host.toggle_errors = 0;  // the host above kept no toggles
    for (std::uint8_t i = 0; i < 5; ++i) {
      ASSERT_TRUE(host.bulk_out({i}));
      ASSERT_EQ(received(), Bytes{i});
      ASSERT_TRUE(send({i}));
      ASSERT_EQ(host.bulk_in(), Bytes{i});
    }
    ASSERT_EQ(host.toggle_errors, 0);
  }
  EXPECT_GT(frames_sent, 1'000) << "often enough it was configured all the same";
}

}  // namespace
}  // namespace isorig::firmware
