#include "firmware/packet_queue.hpp"

#include <gtest/gtest.h>

#include <vector>

namespace isorig::firmware {
namespace {

std::vector<std::uint8_t> frame_of(std::size_t size) {
  std::vector<std::uint8_t> frame(size);
  for (std::size_t i = 0; i < size; ++i) frame[i] = static_cast<std::uint8_t>(i);
  return frame;
}

std::vector<std::size_t> sizes_of(PacketQueue& queue) {
  std::vector<std::size_t> sizes;
  for (std::size_t i = 0; i < queue.count(); ++i) sizes.push_back(queue.at(i).size);
  return sizes;
}

// A bulk transfer ends with a packet that is not full.
TEST(PacketQueue, EveryFrameEndsWithAPartialPacket) {
  const std::vector<std::pair<std::size_t, std::vector<std::size_t>>> cases = {
      {1, {1}}, {33, {33}}, {63, {63}}, {64, {64, 0}}, {65, {64, 1}}, {128, {64, 64, 0}}, {256, {64, 64, 64, 64, 0}}};
  for (const auto& [size, expected] : cases) {
    PacketQueue queue;
    const auto frame = frame_of(size);
    ASSERT_TRUE(queue.push(frame.data(), frame.size()));
    EXPECT_EQ(sizes_of(queue), expected) << size;
    EXPECT_EQ(queue.at(0).bytes[0], 0);
    EXPECT_EQ(queue.at((size - 1) / 64).bytes[(size - 1) % 64], (size - 1) % 256);
  }
}

TEST(PacketQueue, TakesAFrameWholeOrNotAtAll) {
  PacketQueue queue;
  const auto large = frame_of(256);
  ASSERT_TRUE(queue.push(large.data(), large.size()));
  ASSERT_TRUE(queue.push(large.data(), large.size()));
  ASSERT_TRUE(queue.push(large.data(), large.size()));  // 15 of 16
  const auto small = frame_of(64);                      // needs two
  EXPECT_FALSE(queue.push(small.data(), small.size()));
  EXPECT_EQ(queue.count(), 15U);
  ASSERT_TRUE(queue.push(small.data(), 10));
  EXPECT_FALSE(queue.push(small.data(), 10));
  queue.pop();
  EXPECT_TRUE(queue.push(small.data(), 10));
}

TEST(PacketQueue, KeepsTheOrderAcrossItsEnd) {
  PacketQueue queue;
  for (std::uint8_t i = 0; i < 200; ++i) {
    ASSERT_TRUE(queue.push(&i, 1));
    if (i >= 5) {
      ASSERT_EQ(queue.at(0).bytes[0], i - 5);
      queue.pop();
    }
  }
}

}  // namespace
}  // namespace isorig::firmware
