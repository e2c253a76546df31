#include "daemon/core/fixed_text.hpp"

#include <gtest/gtest.h>

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

}  // namespace
}  // namespace isorig::daemon
