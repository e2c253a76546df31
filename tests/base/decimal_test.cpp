#include "base/decimal.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace isorig::base {
namespace {

using ::testing::HasSubstr;

std::string refusal_of(std::string_view text) {
  std::string why;
  EXPECT_FALSE(decimal(text, why)) << text;
  return why;
}

TEST(Decimal, TheWholeTextOrNothing) {
  std::string why;
  EXPECT_EQ(decimal("12.5", why), 12.5);
  EXPECT_EQ(decimal(" \t-0.01\r\n", why), -0.01);
  EXPECT_EQ(decimal("+3", why), 3.0);
  EXPECT_EQ(decimal("1e-3", why), 1e-3);
  EXPECT_EQ(why, "");
}

// A prompt of isorig calibrate took "12,5" for 12 N and "7 kPa" for 7 psi.
TEST(Decimal, SaysWhatIsInTheWay) {
  EXPECT_THAT(refusal_of("12,5"), HasSubstr("the decimal point is a point"));
  EXPECT_THAT(refusal_of("0,01"), HasSubstr("comma"));
  EXPECT_THAT(refusal_of("1,234.5"), HasSubstr("thousands are not parted"));
  EXPECT_THAT(refusal_of("7 kPa"), HasSubstr("\" kPa\" behind the number"));
  EXPECT_THAT(refusal_of("1O"), HasSubstr("\"O\" behind the number"));
  EXPECT_THAT(refusal_of("1 2"), HasSubstr("behind the number"));
  EXPECT_THAT(refusal_of("0x10"), HasSubstr("behind the number"));
  EXPECT_THAT(refusal_of(""), HasSubstr("missing"));
  EXPECT_THAT(refusal_of("  "), HasSubstr("missing"));
  EXPECT_THAT(refusal_of("seven"), HasSubstr("no number"));
  EXPECT_THAT(refusal_of("+-1"), HasSubstr("no number"));
  EXPECT_THAT(refusal_of("nan"), HasSubstr("finite"));
  EXPECT_THAT(refusal_of("inf"), HasSubstr("finite"));
  EXPECT_THAT(refusal_of("1e999"), HasSubstr("finite"));
  EXPECT_THAT(refusal_of("7\x1b[2J"), HasSubstr("\\u001b[2J"));
}

}  // namespace
}  // namespace isorig::base
