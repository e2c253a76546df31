#include "base/printable.hpp"

#include <gtest/gtest.h>

#include <algorithm>

#include "base/toml_reader.hpp"

namespace isorig::base {
namespace {

using namespace std::string_view_literals;

TEST(Printable, PlainTextOfAnyScriptStays) {
  for (const auto text : {"", "psi, 12.5 +- 0.1 %", "Größe μm ° 測定 Ω", "C:\\path \"quoted\""})
    EXPECT_EQ(printable(text), text);
}

TEST(Printable, WhatATerminalWouldObeyIsShown) {
  EXPECT_EQ(printable("\x1b[2Jgone"), "\\u001b[2Jgone");
  EXPECT_EQ(printable("a\nb\r\tc\x7f"), "a\\nb\\r\\tc\\u007f");
  EXPECT_EQ(printable("nul\0inside"sv), "nul\\u0000inside");
  EXPECT_EQ(printable("\xc2\x9b"
                      "31m"),
            "\\u009b31m");  // C1: the one-character CSI
  EXPECT_EQ(printable("\u202e"
                      "gnp.exe"),
            "\\u202egnp.exe");                                   // right-to-left override
  EXPECT_EQ(printable("a\u2066b\u2069c"), "a\\u2066b\\u2069c");  // isolates
  EXPECT_EQ(printable("pay\u200bpal\ufeff"), "pay\\u200bpal\\ufeff");
  EXPECT_EQ(printable("\U000e0041"), "\\U000e0041");  // a tag
  EXPECT_EQ(printable_lines("a\n\tb\x1b"), "a\n\tb\\u001b");
}

TEST(Printable, BytesThatAreNoUtf8AreShown) {
  EXPECT_EQ(printable("\xff\xfet"), "\\xff\\xfet");
  EXPECT_EQ(printable("\xc0\xaf"), "\\xc0\\xaf");                    // overlong
  EXPECT_EQ(printable("\xed\xa0\x80"), "\\xed\\xa0\\x80");           // a surrogate
  EXPECT_EQ(printable("\xf4\x90\x80\x80"), "\\xf4\\x90\\x80\\x80");  // beyond U+10FFFF
  EXPECT_EQ(printable("cut \xe2\x82"), "cut \\xe2\\x82");
}

// Escape codes and right-to-left marks of a protocol's text went to the terminal as they were.
TEST(Printable, DiagnosticsEchoNothingRaw) {
  const auto document =
      TomlDocument::parse_text("do = \"\\u202e\\u0007\\u001b[2J\\nfake.toml:1:1: all well\"\n", "a\x1b[1m.toml");
  (void)document.root().choice_or("do", "hold", {"hold", "ramp"});
  (void)document.root().choice("\x1b]0;", {"a"});
  try {
    document.finish();
    FAIL();
  } catch (const ConfigError& e) {
    const std::string text = e.what();
    EXPECT_EQ(text.find_first_of("\x1b\x07"), std::string::npos) << text;
    EXPECT_NE(text.find("\\u202e\\u0007\\u001b[2J\\nfake.toml:1:1"), std::string::npos) << text;
    EXPECT_EQ(std::count(text.begin(), text.end(), '\n'), 1) << text;  // two faults, two lines
    EXPECT_NE(text.find("a\\u001b[1m.toml:"), std::string::npos) << text;
  }
  try {
    (void)TomlDocument::parse_text("a = \x1b[2J\n", "x");
    FAIL();
  } catch (const ConfigError& e) {
    EXPECT_EQ(std::string_view(e.what()).find('\x1b'), std::string_view::npos) << e.what();
  }
}

TEST(Printable, AnArgumentThatWouldDoSomethingToATerminalIsNotTaken) {
  const auto why = [](const char* argument) {
    const char* argv[] = {"isorig", "note", argument};
    return why_not_arguments(3, argv);
  };
  for (const auto good : {"", "--operator", "Größe", "a b", "C:\\runs"}) EXPECT_EQ(why(good), "") << good;
  for (const auto bad : {"a\x1b[31m", "--x=\x1b", "a\nb", "\u202e", "\xff", "\x7f"}) {
    EXPECT_NE(why(bad), "") << printable(bad);
    EXPECT_EQ(why(bad), printable(why(bad)));
  }
  EXPECT_NE(why("a\x1b[31m").find("\"a\\u001b[31m\""), std::string::npos) << why("a\x1b[31m");
}

TEST(Name, WhatMayNameFiles) {
  for (const auto good : {"Control2", "a", "ecoflex-3.2_b", "7"}) EXPECT_EQ(why_not_a_name(good), "") << good;
  EXPECT_EQ(why_not_a_name(std::string(64, 'a')), "");
  for (const auto bad : {""sv, "a/b"sv, "a/../../outside/planted"sv, ".."sv, ".hidden"sv, "-rf"sv, "two words"sv,
                         "a\nb"sv, "\x1b[2J"sv, "a\0b"sv,
                         "\u202e"
                         "abc"sv,
                         "Größe"sv, "a\\b"sv, "\xff"sv}) {
    EXPECT_NE(why_not_a_name(bad), "") << printable(bad);
  }
  EXPECT_NE(why_not_a_name(std::string(65, 'a')), "");
  EXPECT_NE(why_not_a_name("a/b").find("`/`"), std::string::npos);
  EXPECT_NE(why_not_a_name("a\x1b").find("`\\u001b`"), std::string::npos);
}

}  // namespace
}  // namespace isorig::base
