#include "daemon/core/fixed_text.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <string>

namespace isorig::daemon {
namespace {

TEST(FixedText, WhatIsCutSaysSo) {
  char buffer[16];
  FixedText text(buffer);
  text << "123456789"
       << "012345";
  EXPECT_STREQ(buffer, "123456789012345") << "fits";
  text << "6"
       << "789";
  EXPECT_STREQ(buffer, "123456789012...");
  copy_text(buffer, "/var/lib/isorig/runs");
  EXPECT_STREQ(buffer, "/var/lib/iso...");
  copy_text(buffer, "/var/lib/isorig");
  EXPECT_STREQ(buffer, "/var/lib/isorig");
}

TEST(FixedText, NoCharacterIsCutInTwo) {
  const std::string word = "0123456789\u00e9\u20ac\U0001f600 and more";
  char buffer[16];
  copy_text(buffer, word);
  EXPECT_STREQ(buffer, "0123456789\u00e9...");
  char longer[18];
  FixedText text(longer);
  text << word;
  EXPECT_STREQ(longer, "0123456789\u00e9...");
}

TEST(FixedText, NumbersAreRoundedToTheNearestThousandth) {
  const auto shown = [](double value) {
    char buffer[32];
    FixedText text(buffer);
    text << value;
    return std::string(buffer);
  };
  EXPECT_EQ(shown(0.0), "0.000");
  EXPECT_EQ(shown(0.0005), "0.001");
  EXPECT_EQ(shown(-1.23449), "-1.234");
  // Above 2^52 thousandths a half cannot be added: it would round the sum up to an even number.
  EXPECT_EQ(shown(4503599627370.497), "4503599627370.497");
  EXPECT_EQ(shown(std::nan("")), "nan");
  EXPECT_EQ(shown(-2e15), "-inf");
}

}  // namespace
}  // namespace isorig::daemon
