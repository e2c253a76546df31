#include "drivers/config/register_codec.hpp"

#include <gtest/gtest.h>

#include <limits>
#include <ostream>

namespace isorig::modbus {
namespace {

using Words = std::array<std::uint16_t, 2>;

struct OrderCase {
  WordOrder order;
  Words pi;             // 3.14159274F = 0x40490FDB
  Words minus_two;      // -2 as int32 = 0xFFFFFFFE
  std::uint16_t small;  // 0x1234 as uint16
};

// By hand, from the bytes: 40 49 0F DB and FF FF FF FE.
constexpr OrderCase kCases[] = {
    {WordOrder::kABCD, {0x4049, 0x0FDB}, {0xFFFF, 0xFFFE}, 0x1234},
    {WordOrder::kCDAB, {0x0FDB, 0x4049}, {0xFFFE, 0xFFFF}, 0x1234},
    {WordOrder::kBADC, {0x4940, 0xDB0F}, {0xFFFF, 0xFEFF}, 0x3412},
    {WordOrder::kDCBA, {0xDB0F, 0x4940}, {0xFEFF, 0xFFFF}, 0x3412},
};

void PrintTo(const OrderCase& c, std::ostream* out) {
  for (const std::uint16_t word : c.pi) *out << std::hex << word;
}

class EveryOrder : public testing::TestWithParam<OrderCase> {};

TEST_P(EveryOrder, DecodesHandComputedWords) {
  const auto& c = GetParam();
  EXPECT_EQ(join_words(c.pi, RegisterType::kFloat32, c.order), 0x40490FDBU);
  EXPECT_EQ(number_of(join_words(c.pi, RegisterType::kFloat32, c.order), RegisterType::kFloat32), double{3.14159274F});
  EXPECT_EQ(number_of(join_words(c.minus_two, RegisterType::kInt32, c.order), RegisterType::kInt32), -2.0);
  EXPECT_EQ(number_of(join_words(c.minus_two, RegisterType::kUint32, c.order), RegisterType::kUint32), 4294967294.0);
  const Words small{c.small, 0xDEAD};
  EXPECT_EQ(number_of(join_words(small, RegisterType::kUint16, c.order), RegisterType::kUint16), 0x1234);
}

TEST_P(EveryOrder, EncodesToHandComputedWords) {
  const auto& c = GetParam();
  EXPECT_EQ(split_words(*bits_of(double{3.14159274F}, RegisterType::kFloat32), RegisterType::kFloat32, c.order), c.pi);
  EXPECT_EQ(split_words(*bits_of(-2.0, RegisterType::kInt32), RegisterType::kInt32, c.order), c.minus_two);
  EXPECT_EQ(split_words(*bits_of(0x1234, RegisterType::kUint16), RegisterType::kUint16, c.order)[0], c.small);
}

INSTANTIATE_TEST_SUITE_P(RegisterCodec, EveryOrder, testing::ValuesIn(kCases));

TEST(RegisterCodec, SignedSixteenBitKeepsItsSign) {
  const Words words{0xFFFE, 0};
  EXPECT_EQ(number_of(join_words(words, RegisterType::kInt16, WordOrder::kABCD), RegisterType::kInt16), -2.0);
  EXPECT_EQ(number_of(join_words(words, RegisterType::kUint16, WordOrder::kABCD), RegisterType::kUint16), 65534.0);
  EXPECT_EQ(split_words(*bits_of(-2.0, RegisterType::kInt16), RegisterType::kInt16, WordOrder::kABCD)[0], 0xFFFE);
}

TEST(RegisterCodec, RoundsToTheNearestCount) {
  EXPECT_EQ(bits_of(1.6, RegisterType::kUint16), 2U);
  EXPECT_EQ(bits_of(-1.6, RegisterType::kInt32), 0xFFFFFFFEU);
}

TEST(RegisterCodec, RefusesWhatDoesNotFit) {
  EXPECT_EQ(bits_of(65536.0, RegisterType::kUint16), std::nullopt);
  EXPECT_EQ(bits_of(-1.0, RegisterType::kUint32), std::nullopt);
  EXPECT_EQ(bits_of(32768.0, RegisterType::kInt16), std::nullopt);
  EXPECT_EQ(bits_of(2147483648.0, RegisterType::kInt32), std::nullopt);
  EXPECT_EQ(bits_of(1e39, RegisterType::kFloat32), std::nullopt);
  EXPECT_EQ(bits_of(std::numeric_limits<double>::quiet_NaN(), RegisterType::kFloat32), std::nullopt);
  EXPECT_EQ(bits_of(std::numeric_limits<double>::quiet_NaN(), RegisterType::kInt32), std::nullopt);
  EXPECT_EQ(bits_of(4294967295.0, RegisterType::kUint32), 0xFFFFFFFFU);
}

}  // namespace
}  // namespace isorig::modbus
