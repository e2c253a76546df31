#include "firmware/serial_text.hpp"

#include <gtest/gtest.h>

#include <string>

namespace isorig::firmware {
namespace {

std::string text_of(std::uint32_t number) {
  char text[kSerialTextSize];
  write_serial(number, text);
  return text;
}

TEST(SerialText, IsThatOfThePjrcTools) {
  EXPECT_EQ(text_of(123'456), "1234560");
  EXPECT_EQ(text_of(9'999'999), "99999990");
  EXPECT_EQ(text_of(10'000'000), "10000000");
  EXPECT_EQ(text_of(4'294'967'295U), "4294967295") << "a chip whose field was never written";
  EXPECT_EQ(text_of(0), "0");
}

}  // namespace
}  // namespace isorig::firmware
