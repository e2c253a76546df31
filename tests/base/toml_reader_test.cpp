#include "base/toml_reader.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <array>
#include <fstream>

namespace isorig::base {
namespace {

using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::EndsWith;
using ::testing::HasSubstr;
using ::testing::Not;

TomlDocument parse(std::string_view text) {
  return TomlDocument::parse_text(text, "t.toml");
}

/// What is wrong, one "line:column: message" each.
std::vector<std::string> faults(const TomlDocument& document) {
  std::vector<std::string> out;
  for (const auto& d : document.diagnostics()) {
    EXPECT_EQ(d.file, "t.toml");
    out.push_back(std::to_string(d.line) + ":" + std::to_string(d.column) + ": " + d.message);
  }
  return out;
}

TEST(TomlReader, ReadsEveryType) {
  const auto d = parse(R"(
number = 2.5
whole = -3
big = 9007199254740993
flag = true
text = "a\tb"
kind = "two"
numbers = [1, 2.5, -3]
strings = ["x", ""]
when = 1979-05-27
[sub]
x = 1
[[list]]
x = 1
[[list]]
x = 2
)");
  const auto r = d.root();
  EXPECT_EQ(r.number("number"), 2.5);
  EXPECT_EQ(r.number("whole"), -3.0) << "an integer is a number";
  EXPECT_EQ(r.integer("whole"), -3);
  EXPECT_EQ(r.integer("big"), 9007199254740993) << "not through a double";
  EXPECT_TRUE(r.boolean("flag"));
  EXPECT_EQ(r.string("text"), "a\tb");
  EXPECT_EQ(r.choice("kind", {"one", "two"}), "two");
  EXPECT_THAT(r.numbers("numbers"), ElementsAre(1.0, 2.5, -3.0));
  EXPECT_THAT(r.strings("strings"), ElementsAre("x", ""));
  EXPECT_EQ(r.table("sub").integer("x"), 1);
  const auto list = r.tables("list");
  ASSERT_EQ(list.size(), 2U);
  EXPECT_EQ(list[0].integer("x"), 1);
  EXPECT_EQ(list[1].integer("x"), 2);

  EXPECT_EQ(r.type_of("number"), "float");
  EXPECT_EQ(r.type_of("whole"), "integer");
  EXPECT_EQ(r.type_of("flag"), "boolean");
  EXPECT_EQ(r.type_of("text"), "string");
  EXPECT_EQ(r.type_of("numbers"), "array");
  EXPECT_EQ(r.type_of("sub"), "table");
  EXPECT_EQ(r.type_of("when"), "date or time");
  EXPECT_EQ(r.type_of("nothing"), "");
  EXPECT_TRUE(r.has("number"));
  EXPECT_FALSE(r.has("nothing"));
  EXPECT_EQ(r.keys().size(), 11U);
  EXPECT_THAT(faults(d), ElementsAre(HasSubstr("unknown key `when`"))) << "type_of does not count as reading";
}

TEST(TomlReader, OptionalFormsFallBackOnlyWhenAbsent) {
  const auto d = parse("number = 1\nwhole = 2\nflag = false\ntext = \"t\"\nkind = \"b\"\n");
  const auto r = d.root();
  EXPECT_EQ(r.number_or("number", 9.0), 1.0);
  EXPECT_EQ(r.integer_or("whole", 9), 2);
  EXPECT_FALSE(r.boolean_or("flag", true));
  EXPECT_EQ(r.string_or("text", "f"), "t");
  EXPECT_EQ(r.choice_or("kind", "a", {"a", "b"}), "b");
  EXPECT_EQ(r.number_or("n", 9.0), 9.0);
  EXPECT_EQ(r.integer_or("i", 9), 9);
  EXPECT_TRUE(r.boolean_or("f", true));
  EXPECT_EQ(r.string_or("t", "f"), "f");
  EXPECT_EQ(r.choice_or("k", "a", {"a", "b"}), "a");
  EXPECT_FALSE(r.table_if("s"));
  EXPECT_TRUE(r.tables("l").empty());
  EXPECT_NO_THROW(d.finish());
}

TEST(TomlReader, MissingRequiredKeysAreNamedAtTheirTable) {
  const auto d = parse("x = 1\n\n  [sub]\ny = 1\n");
  const auto r = d.root();
  static_cast<void>(r.number("x"));
  static_cast<void>(r.number("a"));
  const auto sub = r.table("sub");
  static_cast<void>(sub.integer("y"));
  static_cast<void>(sub.integer("b"));
  static_cast<void>(sub.boolean("c"));
  static_cast<void>(sub.string("d"));
  static_cast<void>(sub.numbers("e"));
  static_cast<void>(sub.strings("f"));
  static_cast<void>(sub.choice("g", {"one", "two"}));
  static_cast<void>(r.table("lost").number("inside"));  // one error for the table, none for what it lacks
  EXPECT_THAT(faults(d),
              ElementsAre("1:1: `a` is missing here", "1:1: table [lost] is missing", "3:3: `b` is missing here",
                          "3:3: `c` is missing here", "3:3: `d` is missing here", "3:3: `e` is missing here",
                          "3:3: `f` is missing here", "3:3: `g` is missing here; one of \"one\" \"two\""));
}

TEST(TomlReader, WrongTypesAreNamedAtTheValue) {
  const auto d = parse(
      "a = \"1\"\nb = 1.5\nc = 1\n  d = 2\ne = 3\nf = [1, \"two\", 3]\ng = [\"x\", 1]\nh = 1\ni = [1]\nj = "
      "true\nk = 7\n");
  const auto r = d.root();
  EXPECT_EQ(r.number_or("a", 5.0), 5.0);
  EXPECT_EQ(r.integer_or("b", 5), 5);
  EXPECT_FALSE(r.boolean_or("c", false));
  EXPECT_EQ(r.string_or("d", "f"), "f");
  static_cast<void>(r.numbers("e"));
  EXPECT_THAT(r.numbers("f"), ElementsAre(1.0, 3.0));
  EXPECT_THAT(r.strings("g"), ElementsAre("x"));
  EXPECT_FALSE(r.table_if("h"));
  EXPECT_TRUE(r.tables("i").empty());
  EXPECT_EQ(r.number_or("j", 5.0), 5.0) << "true is not 1";
  EXPECT_EQ(r.choice_or("k", "one", {"one", "two"}), "one");
  EXPECT_THAT(
      faults(d),
      ElementsAre("1:5: `a` is a string; a number is needed", "2:5: `b` is a float; a whole number is needed",
                  "3:5: `c` is an integer; true or false is needed", "4:7: `d` is an integer; a \"string\" is needed",
                  "5:5: `e` is an integer; a list of numbers is needed", "6:9: `f` holds a string; a number is needed",
                  "7:11: `g` holds an integer; a \"string\" is needed", "8:5: `h` is an integer; a table [h] is needed",
                  "9:6: `i` holds an integer; a table is needed", "10:5: `j` is a boolean; a number is needed",
                  "11:5: `k` is an integer; a \"string\" is needed"));
}

TEST(TomlReader, Ranges) {
  const auto d =
      parse("a = 0\nb = -1\nc = 11\nd = nan\ne = inf\nf = 70000\ng = [1, 2, 30]\nh = 0.25\ni = 10\nj = 12000000\n");
  const auto r = d.root();
  static_cast<void>(r.number("a", kPositive));
  static_cast<void>(r.number("b", kNonNegative));
  static_cast<void>(r.number("c", Range{0.0, 10.0}));
  static_cast<void>(r.number("d"));
  static_cast<void>(r.number("e"));
  static_cast<void>(r.integer("f", Range{1, 65535}));
  EXPECT_THAT(r.numbers("g", Range{0.0, 10.0, true}), ElementsAre(1.0, 2.0));
  EXPECT_EQ(r.number("h", kPositive), 0.25);
  EXPECT_EQ(r.integer("i", Range{0.0, 10.0}), 10) << "both ends belong to a range";
  static_cast<void>(r.integer("j", Range{-std::numeric_limits<double>::infinity(), 10000000.0}));
  EXPECT_THAT(
      faults(d),
      ElementsAre("1:5: `a` = 0; it has to be greater than 0", "2:5: `b` = -1; it has to be at least 0",
                  "3:5: `c` = 11; it has to be from 0 to 10", AllOf(HasSubstr("4:5"), EndsWith("be finite")),
                  AllOf(HasSubstr("5:5"), EndsWith("be finite")), "6:5: `f` = 70000; it has to be from 1 to 65535",
                  "7:12: `g` holds 30; each has to be above 0 to 10",
                  "10:5: `j` = 12000000; it has to be at most 10000000"));
}

TEST(TomlReader, ChoicesListWhatIsAllowed) {
  const auto d = parse("a = \"three\"\nb = \"four\"\n");
  EXPECT_EQ(d.root().choice("a", {"one", "two"}), "one");
  EXPECT_EQ(d.root().choice_or("b", "two", {"one", "two"}), "two");
  EXPECT_THAT(faults(d), ElementsAre("1:5: `a` = \"three\"; it has to be one of \"one\" \"two\"",
                                     "2:5: `b` = \"four\"; it has to be one of \"one\" \"two\""));
}

TEST(TomlReader, UnknownKeysSuggestTheNearest) {
  const auto d =
      parse("velocity_mm_s = 1\nvelocty_mm_s = 2\nacceleration = 3\n\n[ramp]\ntarget = 1\nqqqqqq = 2\n[rmap]\n");
  const auto r = d.root();
  static_cast<void>(r.number("velocity_mm_s"));
  static_cast<void>(r.number_or("acceleration_mm_s2", 1.0));
  static_cast<void>(r.table("ramp").number_or("targets", 1.0));
  EXPECT_THAT(faults(d),
              ElementsAre(AllOf(HasSubstr("2:1: unknown key `velocty_mm_s`"), Not(HasSubstr("did you mean"))),
                          "3:1: unknown key `acceleration`; did you mean `acceleration_mm_s2`?",
                          "6:1: unknown key `target`; did you mean `targets`?",
                          "7:1: unknown key `qqqqqq`; known here: targets", HasSubstr("8:2: unknown key `rmap`")))
      << "a key that is there already is no suggestion";
}

TEST(TomlReader, AKeyInAnotherUnitSaysByWhatToMultiply) {
  const auto d = parse("pressure_kPa = 50\nduration_ms = 5\nvelocity_m_s = 1\nforce_lbs = 2\n");
  const auto r = d.root();
  for (const char* key : {"pressure_psi", "duration_s", "velocity_mm_s", "force_N"})
    static_cast<void>(r.number_or(key, 1.0));
  EXPECT_THAT(
      faults(d),
      ElementsAre(EndsWith("did you mean `pressure_psi`? Its unit is another: multiply the number by 0.1450377"),
                  EndsWith("did you mean `duration_s`? Its unit is another: multiply the number by 0.001"),
                  EndsWith("did you mean `velocity_mm_s`? Its unit is another: multiply the number by 1000"),
                  EndsWith("did you mean `force_N`?")));
}

/// A value per minute is a sixtieth per second, a time in minutes sixty times one in seconds.
TEST(TomlReader, WhatAValueIsCountedPerIsToldFromATime) {
  const std::vector<std::array<const char*, 3>> keys = {{"velocity_mm_min", "velocity_mm_s", "0.01666667"},
                                                        {"speed_max_mm_h", "speed_max_mm_s", "0.0002777778"},
                                                        {"rate_psi_min", "rate_psi_s", "0.01666667"},
                                                        {"force_rate_max_N_ms", "force_rate_max_N_s", "1000"},
                                                        {"fill_gain_per_min", "fill_gain_per_s", "0.01666667"},
                                                        {"force_rate_max_kN_s", "force_rate_max_N_s", "1000"},
                                                        {"velocity_um_s", "velocity_mm_s", "0.001"},
                                                        {"rate_kPa_s", "rate_psi_s", "0.1450377"},
                                                        {"velocity_in_min", "velocity_mm_s", "0.4233333"},
                                                        {"timeout_min", "timeout_s", "60"},
                                                        {"time_max_h", "time_max_s", "3600"}};
  for (const auto& [given, meant, factor] : keys) {
    const auto d = parse(std::string(given) + " = 12\n");
    const auto r = d.root();
    static_cast<void>(r.number_or(meant, 1.0));
    EXPECT_THAT(faults(d), ElementsAre(EndsWith(std::string("did you mean `") + meant +
                                                "`? Its unit is another: multiply the number by " + factor)));
  }
}

TEST(TomlReader, ADecimalCommaIsNamed) {
  const auto said = [](const std::string& text) -> std::string {
    try {
      (void)parse(text);
    } catch (const ConfigError& e) {
      return e.what();
    }
    return "";
  };
  EXPECT_THAT(said("a = 1\nsteps = [ { duration_s = 3,5 } ]\n"),
              EndsWith("; a number has a decimal point: 3.5, not 3,5"));
  EXPECT_THAT(said("a = -0,25\n"), EndsWith("; a number has a decimal point: -0.25, not -0,25"));
  EXPECT_THAT(said("a = 0,25\r\nb = 1\n"), EndsWith("0.25, not 0,25"));
  EXPECT_THAT(said("a = [1,2\nb = = 3\n"), Not(HasSubstr("decimal point")));
  EXPECT_THAT(said("a = 1 2\n"), Not(HasSubstr("decimal point")));
}

TEST(TomlReader, AFileOfAnotherKindIsSaidToBeThatAndNothingElse) {
  const auto d = parse("format = \"isorig-rig/1\"\n[frame]\nx = 1\n");
  const auto r = d.root();
  static_cast<void>(r.choice("format", {"isorig-protocol/1"}));
  static_cast<void>(r.string("name"));
  EXPECT_THAT(faults(d), ElementsAre("1:10: `format` = \"isorig-rig/1\"; it has to be one of \"isorig-protocol/1\""));
}

TEST(TomlReader, UnknownKeysAreFoundAtEveryDepth) {
  const auto d = parse("[a.b]\nx = 1\ny = 2\n[[l]]\nx = 1\n[[l]]\nz = 3\n[m]\ninline = { x = 1, w = 2 }\n");
  const auto r = d.root();
  static_cast<void>(r.table("a").table("b").number("x"));
  for (const auto& t : r.tables("l")) static_cast<void>(t.number_or("x", 0.0));
  static_cast<void>(r.table("m").table("inline").number("x"));
  EXPECT_THAT(faults(d), ElementsAre(HasSubstr("3:1: unknown key `y`"), HasSubstr("7:1: unknown key `z`"),
                                     HasSubstr("9:19: unknown key `w`")));
}

TEST(TomlReader, IgnoringTheRestOfATableIsNotInherited) {
  const auto d = parse("a = 1\nextra = 2\n[read]\nx = 1\nwrong = 2\n[unread]\ny = 1\n");
  const auto r = d.root();
  r.ignore_rest();
  static_cast<void>(r.number("a"));
  static_cast<void>(r.table("read").number("x"));
  EXPECT_THAT(faults(d), ElementsAre(HasSubstr("5:1: unknown key `wrong`")));
}

TEST(TomlReader, FinishThrowsEverythingSortedByPlace) {
  const auto d = parse("c = 1\nb = \"x\"\na = \"y\"\n");
  const auto r = d.root();
  static_cast<void>(r.number("a"));
  static_cast<void>(r.number("b"));
  try {
    d.finish();
    FAIL() << "did not throw";
  } catch (const ConfigError& e) {
    EXPECT_STREQ(e.what(),
                 "t.toml:1:1: unknown key `c`; known here: a b\n"
                 "t.toml:2:5: `b` is a string; a number is needed\n"
                 "t.toml:3:5: `a` is a string; a number is needed");
    EXPECT_EQ(e.diagnostics().size(), 3U);
  }
}

TEST(TomlReader, ReadersCanAddTheirOwn) {
  const auto d = parse("a = 1\n[t]\nb = 2\n");
  const auto t = d.root().table("t");
  static_cast<void>(d.root().number("a"));
  static_cast<void>(t.number("b"));
  t.error("b", "too much");
  t.error("", "the table is wrong");
  t.error("absent", "needs this");
  EXPECT_THAT(faults(d), ElementsAre("2:1: the table is wrong", "2:1: needs this", "3:5: too much"));
  EXPECT_EQ(t.where("b").line, 3U);
  EXPECT_EQ(t.where().line, 2U);
}

TEST(TomlReader, NotToml) {
  for (const auto& [text, place] : std::vector<std::pair<std::string, std::string>>{{"a = \n", "t.toml:1:"},
                                                                                    {"a = 1\na = 2\n", "t.toml:2:"},
                                                                                    {"ok = 1\n[x\n", "t.toml:2:"},
                                                                                    {"s = \"open\n", "t.toml:1:"},
                                                                                    {"a = 01\n", "t.toml:1:"}}) {
    try {
      static_cast<void>(parse(text));
      ADD_FAILURE() << text;
    } catch (const ConfigError& e) {
      EXPECT_THAT(e.what(), AllOf(HasSubstr(place), HasSubstr("not valid TOML"))) << text;
    }
  }
}

TEST(TomlReader, EmptyTextIsAnEmptyTable) {
  const auto d = parse("");
  EXPECT_TRUE(d.root().keys().empty());
  EXPECT_NO_THROW(d.finish());
  static_cast<void>(d.root().number("a"));
  EXPECT_THROW(d.finish(), ConfigError);
}

TEST(TomlReader, UnreadDocumentHasOnlyUnknownKeys) {
  EXPECT_THAT(faults(parse("a = 1\n[b]\nc = 2\n")), ElementsAre("1:1: unknown key `a`", "2:2: unknown key `b`"));
}

TEST(TomlReader, Files) {
  const auto path = std::filesystem::temp_directory_path() / ("isorig-toml-" + std::to_string(::getpid()) + ".toml");
  std::ofstream(path) << "a = 1\n";
  auto d = TomlDocument::parse_file(path);
  EXPECT_EQ(d.root().number("a"), 1.0);
  EXPECT_EQ(d.name(), path.string());
  EXPECT_EQ(d.text(), "a = 1\n");
  auto moved = std::move(d);
  EXPECT_NO_THROW(moved.finish());
  std::filesystem::remove(path);
  for (const auto& bad : {path, std::filesystem::temp_directory_path()}) {
    try {
      static_cast<void>(TomlDocument::parse_file(bad));
      ADD_FAILURE() << bad;
    } catch (const ConfigError& e) {
      EXPECT_THAT(e.what(), AllOf(HasSubstr(bad.string()), HasSubstr("cannot be opened")));
    }
  }
}

}  // namespace
}  // namespace isorig::base
