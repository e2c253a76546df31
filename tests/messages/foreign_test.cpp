// Files of other programs: every dialect that Bluehill writes, logs without a header, and what a damaged file becomes.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <functional>

#include "messages/foreign/decoded_text.hpp"
#include "messages/foreign/samples.hpp"
#include "messages/recording.hpp"

namespace isorig::foreign {
namespace {

using messages::RecordingError;
using testing::AnyOf;
using testing::ElementsAre;
using testing::HasSubstr;

/// The numbers of all tests of a file, in its order: time, position, force or pressure. Throws where it is not clear.
std::vector<std::vector<double>> imported(const std::string& bytes, const Mapping& mapping = {}) {
  const auto parsed = parse_tables(decode(bytes, "file").utf8, "file", mapping.dialect);
  std::vector<std::vector<double>> tests;
  for (const Table& table : parsed.tables) {
    const auto understood = understand(table, mapping);
    if (!understood.questions.empty()) throw std::invalid_argument(understood.questions.front().text);
    if (understood.sources.empty()) continue;
    const auto test = convert(table, understood.sources, parsed.decimal, mapping.zero_mm.value_or(0.0), "file");
    auto& out = tests.emplace_back();
    if (test.frame)
      for (std::size_t i = 0; i < test.frame->size(); ++i)
        out.insert(out.end(), {test.frame->t_s[i], test.frame->position_mm[i], test.frame->force_N[i]});
    if (test.pressure) out.insert(out.end(), test.pressure->pressure_psi.begin(), test.pressure->pressure_psi.end());
  }
  return tests;
}

std::string utf16(const std::string& utf8, bool little) {
  std::string out;
  for (std::size_t i = 0; i < utf8.size(); ++i) {
    unsigned code = static_cast<unsigned char>(utf8[i]);
    if (code >= 0xC0) code = (code & 0x1FU) << 6U | (static_cast<unsigned char>(utf8[++i]) & 0x3FU);
    const char low = static_cast<char>(code & 0xFFU), high = static_cast<char>(code >> 8U);
    out += little ? low : high;
    out += little ? high : low;
  }
  return out;
}

std::string said(const std::function<void()>& call) {
  try {
    call();
  } catch (const std::exception& e) {
    return e.what();
  }
  return "nothing was said";
}

/// As a real one stands on GitHub (Kelsey151/Instron, taco_test_001.csv): thousands are grouped in quoted cells.
const std::string kEnglish =
    "Test : Rate 1,\"600.00000\",mm/min\r\n\r\nTime,Extension,Load\r\n(s),(mm),(N)\r\n"
    "\"0.00000\",\"66.50750\",\"100.28658\"\r\n\"0.10000\",\"67.37132\",\"-23.44689\"\r\n\"0.18500\",\"68.25761\",\"1,"
    "021.21619\"\r\n";
/// German settings of Windows: semicolons, decimal commas; a table of results first, and two tests.
const std::string kGerman =
    "\"Pr\xC3\xBC"
    "fverfahren\";\"Zug.im_tens\"\r\n\"Ergebnistabelle 1\"\r\n;\"Maximale "
    "Kraft\";\"Verl\xC3\xA4ngerung\"\r\n;\"(N)\";\"(mm)\"\r\n"
    "\"1\";\"8,1\";\"1,9\"\r\n\r\n\"Zeit\";\"Verl\xC3\xA4ngerung\";\"Standardkraft\"\r\n\"(s)\";\"(mm)\";\"(kN)\"\r\n"
    "\"0,00000\";\"0,50000\";\"0,00125\"\r\n\"0,02000\";\"1.000,25000\";\"0,00250\"\r\n\r\n"
    "\"Zeit\";\"Verl\xC3\xA4ngerung\";\"Standardkraft\"\r\n\"(s)\";\"(mm)\";\"(kN)\"\r\n"
    "\"0,00000\";\"0,75000\";\"0,00375\"\r\n\"0,02000\";\"1,00000\";\"0,00500\"\r\n";

std::vector<std::vector<double>> german(const std::string& bytes) {
  // Its first table has no time: what `isorig import` leaves out.
  const auto parsed = parse_tables(decode(bytes, "file").utf8, "file", {});
  EXPECT_EQ(parsed.tables.size(), 3U);
  EXPECT_EQ(parsed.tables[0].rows.size(), 1U);
  EXPECT_THAT(parsed.header, ElementsAre("Pr\xC3\xBC"
                                         "fverfahren = Zug.im_tens",
                                         "Ergebnistabelle 1"));
  std::vector<std::vector<double>> tests;
  for (std::size_t t = 1; t < 3; ++t) {
    const auto understood = understand(parsed.tables[t], {});
    EXPECT_TRUE(understood.questions.empty());
    const auto test = convert(parsed.tables[t], understood.sources, parsed.decimal, 0.0, "file");
    tests.push_back({test.frame->t_s[1], test.frame->position_mm[1], test.frame->force_N[0], test.frame->force_N[1]});
  }
  return tests;
}

TEST(Foreign, EnglishBluehillIsReadWithItsThousands) {
  EXPECT_THAT(imported(kEnglish),
              ElementsAre(ElementsAre(0.0, 66.5075, 100.28658, 0.1, 67.37132, -23.44689, 0.185, 68.25761, 1021.21619)));
}

TEST(Foreign, GermanBluehillIsReadInEveryEncoding) {
  std::string windows1252;
  for (std::size_t i = 0; i < kGerman.size(); ++i)
    windows1252 += kGerman[i] == '\xC3' ? static_cast<char>((kGerman[++i] & 0x3F) | 0xC0) : kGerman[i];
  for (const auto& bytes :
       {kGerman, "\xEF\xBB\xBF" + kGerman, "\xFF\xFE" + utf16(kGerman, true), "\xFE\xFF" + utf16(kGerman, false),
        utf16(kGerman, true), utf16(kGerman, false), windows1252}) {
    const auto tests = german(bytes);
    EXPECT_THAT(tests, ElementsAre(ElementsAre(0.02, 1000.25, 1.25, 2.5), ElementsAre(0.02, 1.0, 3.75, 5.0)));
  }
}

TEST(Foreign, UnitsAreConvertedByTheirDefinitions) {
  const auto one = [](const std::string& position, const std::string& force, const std::string& pressure) {
    const auto tests = imported("Time (ms)\tPosition (" + position + ")\tForce [" + force + "]\tPressure (" + pressure +
                                ")\n0\t1\t1\t1\n1\t2\t2\t2\n");
    return std::vector<double>{tests.at(0)[1], tests.at(0)[2], tests.at(0)[6], tests.at(0)[3]};
  };
  // inch and pound-force by definition; 1 psi = 6894.757293168 Pa (NIST SP 811)
  EXPECT_THAT(one("in", "lbf", "kPa"),
              ElementsAre(25.4, 4.4482216152605, testing::DoubleNear(1.0 / 6.894757293168, 1e-12), 0.001));
  EXPECT_THAT(one("m", "kgf", "bar"),
              ElementsAre(1000.0, 9.80665, testing::DoubleNear(100.0 / 6.894757293168, 1e-11), 0.001));
  EXPECT_THAT(one("\xC2\xB5m", "mN", "MPa"),
              ElementsAre(1e-3, 1e-3, testing::DoubleNear(1000.0 / 6.894757293168, 1e-9), 0.001));
}

TEST(Foreign, AnElvhLogInCountsIsItsDatasheetsPressure) {
  Mapping mapping;
  mapping.column = {{Field::kTime, "#1"}, {Field::kPressure, "#2"}};
  mapping.unit = {{"#1", "us"}, {"#2", "elvh_counts"}};
  // DS-0376 Rev G: 1638 counts are 0 psi, 14746 are 30 psi
  EXPECT_THAT(imported("100 1638\n200 14746\n", mapping),
              ElementsAre(ElementsAre(0.0, testing::DoubleNear(30.0, 1e-12))));
}

TEST(Foreign, ALogWithoutAHeaderAsksForEverything) {
  const auto parsed = parse_tables("12034,5.03\n12044,5.04\n", "log", {});
  auto mapping = Mapping{};
  std::vector<std::string> answers;
  for (const char* answer : {"#1", "ms", "#2", "psi"}) {
    const auto understood = understand(parsed.tables[0], mapping);
    ASSERT_FALSE(understood.questions.empty());
    EXPECT_FALSE(understood.questions[0].take("nonsense", mapping));
    EXPECT_TRUE(understood.questions[0].take(answer, mapping)) << understood.questions[0].text;
    answers.push_back(understood.questions[0].answer);
  }
  EXPECT_THAT(answers, ElementsAre("--column time='#1'", "--unit '#1=s'", "--column pressure='#2'", "--unit '#2=psi'"));
  EXPECT_TRUE(understand(parsed.tables[0], mapping).questions.empty());
}

TEST(Foreign, ACounterOf32BitsGoesOn) {
  Mapping mapping;
  mapping.column = {{Field::kTime, "#1"}, {Field::kPressure, "#2"}};
  mapping.unit = {{"#1", "us"}, {"#2", "psi"}};
  const auto parsed = parse_tables("4294960000,5.0\n4294967000,5.1\n1000,5.2\n8000,5.3\n", "log", {});
  const auto test = convert(parsed.tables[0], understand(parsed.tables[0], mapping).sources, '.', 0.0, "log");
  EXPECT_NEAR(test.pressure->t_s[2] - test.pressure->t_s[1], (4294967296.0 + 1000.0 - 4294967000.0) * 1e-6,
              1e-11);  // 4295 s in a double
  EXPECT_EQ(test.pressure->t_s[1], 4294.967) << "a millionth of 4294967000, as somebody would write it";
  EXPECT_THAT(test.notes, ElementsAre(HasSubstr("line 3: the 32-bit counter")));
}

TEST(Foreign, ATimeOfDayIsSecondsSinceMidnight) {
  for (const char* cell : {"10:15:00.37", "2026-11-29 10:15:00,37", "2026-11-29T10:15:00.370Z",
                           "29.11.2026 10:15:00.37", "11/29/2026 10:15:00.37 AM"})
    EXPECT_EQ(clock_s(cell), 36900.37) << cell;
  EXPECT_EQ(clock_s("12:00:01 AM"), 1.0);
  EXPECT_EQ(clock_s("12:00:01 pm"), 43201.0);
  EXPECT_EQ(clock_s("7:05.25"), 425.25);
  for (const char* cell :
       {"", ":", "10:15", "10:15 AM", "24:00:00", "10:60:00", "10:15:60", "10:15:00.", "10:15:00 CET", "a:b:c",
        "1:2:3:4", "100:15:00", "mon 10:15:00", "2026-11-29 15:00.25", "36900.37"})
    EXPECT_FALSE(clock_s(cell)) << cell;
}

TEST(Foreign, ATimeOfDayIsAskedNothingAndGoesOnPastMidnight) {
  const std::string rows[] = {"23:59:59.5,1,2\n23:59:59.9,2,3\n00:00:00.3,3,4\n",
                              "59:59.5,1,2\n59:59.9,2,3\n00:00.3,3,4\n"};
  const double day_s[] = {86400.0, 3600.0};
  for (const std::string unit : {"Time", "Time (hh:mm:ss)"})
    for (std::size_t k = 0; k < 2; ++k) {
      const auto parsed = parse_tables(unit + ",Extension (mm),Load (N)\n" + rows[k], "log", {});
      const auto understood = understand(parsed.tables[0], {});
      ASSERT_TRUE(understood.questions.empty()) << understood.questions[0].text;
      const auto test = convert(parsed.tables[0], understood.sources, '.', 0.0, "log");
      EXPECT_THAT(test.frame->t_s, ElementsAre(day_s[k] - 0.5, ::testing::DoubleNear(day_s[k] - 0.1, 1e-10),
                                               ::testing::DoubleNear(day_s[k] + 0.3, 1e-10)));
      EXPECT_THAT(test.notes, ElementsAre(HasSubstr("it was taken to go on")));
    }
  const auto parsed = parse_tables("Time,Extension (mm),Load (N)\n10:00:00,1,2\n10:00:00,2,3\n", "log", {});
  EXPECT_THAT(said([&] {
                static_cast<void>(convert(parsed.tables[0], understand(parsed.tables[0], {}).sources, '.', 0.0, "log"));
              }),
              HasSubstr("time stands still: 36000 s after 36000 s"));
}

TEST(Foreign, NothingIsGuessed) {
  const auto why = [](const std::string& text) { return said([&] { static_cast<void>(imported(text)); }); };
  EXPECT_THAT(why("Time,Extension,Load\n0.0,1.0,2.0\n0.1,1.1,2.1\n"), HasSubstr("column \"Time\" has no unit"));
  EXPECT_THAT(why("Time (s),Extension (mm),Load (N),Force 2 (N)\n0.0,1.0,2.0,1\n0.1,1.1,2.1,1\n"),
              HasSubstr("which column is the force: \"Load\" (N), \"Force 2\" (N)"));
  EXPECT_THAT(why("Time (s),Extension (%),Load (N)\n0.0,1.0,2.0\n0.1,1.1,2.1\n"),
              HasSubstr("no column is known to be the position"));
  EXPECT_THAT(why("Time (s);Extension (mm);Load (N)\n0;1,234;1,000\n1;1,235;2,000\n"),
              HasSubstr("decimals or thousands"));
  EXPECT_THAT(why("a;b\n1,5;2\n1.5;2\n"), HasSubstr("some a decimal comma"));
  // What stands above the table decides nothing: 1,234 is not a thousand because of a version.
  const std::string doubtful = "Time (s);Extension (mm);Load (N)\n0;1,234;1,000\n1;1,235;2,000\n";
  EXPECT_THAT(why("Version;2.5\n\n" + doubtful), HasSubstr("file:5: numbers like these may have decimals or"));
  EXPECT_THAT(imported("Version;2.5\n\nTime (s);Extension (mm);Load (N)\n0;1,234;1,0\n1;1,235;2,0\n"),
              ElementsAre(ElementsAre(0.0, 1.234, 1.0, 1.0, 1.235, 2.0)));
}

TEST(Foreign, StressIsNoPressureAndStrainNoPosition) {
  const auto tests = imported(
      "Time (s),Extension (mm),Tensile strain (mm/mm),Load (N),Tensile stress "
      "(MPa)\n0.0,1.0,0.1,2.0,9\n0.1,1.1,0.2,2.1,9\n");
  EXPECT_THAT(tests, ElementsAre(ElementsAre(0.0, 1.0, 2.0, 0.1, 1.1, 2.1)));
}

TEST(Foreign, AWordInsideAnotherMeansNothing) {
  EXPECT_EQ(imported("Time (s),Calibrated position (mm),Calibrated force (N)\n0.0,1.0,2.0\n0.1,1.1,2.1\n").at(0).size(),
            6U);
  // A stress in a compound of German, and a rate that follows a word with "rate" inside.
  EXPECT_EQ(imported("Zeit (s),Weg (mm),Kraft (N),Druckspannung (MPa),Calibrated force rate (N)\n0.0,1.0,2.0,9,9\n"
                     "0.1,1.1,2.1,9,9\n"),
            imported("Zeit (s),Weg (mm),Kraft (N)\n0.0,1.0,2.0\n0.1,1.1,2.1\n"));
}

TEST(Foreign, UsualNamesOfAPositionAreKnown) {
  for (const char* name :
       {"length_m", "Length (m)", "specimen_length_m", "Stroke [m]", "stroke_m", "Probenl\xC3\xA4nge (m)",
        "Longueur (m)", "Longitud (m)", "Lunghezza (m)", "Hub (m)", "hub_m", "Course (m)", "Carrera (m)", "Corsa (m)",
        "Elongation (m)", "weg_m", "Travel (m)", "Deflection (m)", "L\xC3\xA4ngen\xC3\xA4nderung (m)"}) {
    const auto tests = imported(std::string("Time (s),") + name + ",Force (N)\n0,0.001,1\n1,0.002,2\n");
    EXPECT_THAT(tests, ElementsAre(ElementsAre(0.0, 1.0, 1.0, 1.0, 2.0, 2.0))) << name;
  }
  // A word that may mean something else too is asked for nothing where another column is plain.
  EXPECT_EQ(imported("Time (s),Stroke,Position (mm),Length (mm),Force (N)\n0,1,2,3,4\n1,1,3,4,5\n"),
            imported("Time (s),Position (mm),Force (N)\n0,2,4\n1,3,5\n"));
  // Lengths that are none of the specimen's in the test.
  for (const char* name : {"Gauge length (mm)", "initial_length_mm", "Rest length (mm)", "Wavelength (um)",
                           "Messl\xC3\xA4nge (mm)", "Longueur initiale (mm)"})
    EXPECT_THAT(
        said([&] { static_cast<void>(imported(std::string("Time (s),") + name + ",Force (N)\n0,1,2\n1,1,3\n")); }),
        HasSubstr("no column is known to be the position"))
        << name;
}

TEST(Foreign, ALengthIsToldFromAPosition) {
  const auto of = [](const std::string& column) {
    const auto parsed = parse_tables("Time (s)," + column + ",Force (N)\n0,1,2\n1,2,3\n", "log", {});
    return understand(parsed.tables[0], {}).whole_length;
  };
  EXPECT_EQ(of("length_mm"), 1U);
  EXPECT_EQ(of("Stroke (mm)"), std::nullopt);
  EXPECT_EQ(of("L\xC3\xA4ngen\xC3\xA4nderung (mm)"), std::nullopt);
}

TEST(Foreign, APositionWithoutAForceAsksForTheOutputAndTheLoad) {
  const auto parsed = parse_tables("Time (s),Position (mm),Pressure (psi),Note 1\n0,1,5,3\n1,2,6,4\n", "log", {});
  Mapping mapping;
  auto understood = understand(parsed.tables[0], mapping);
  ASSERT_EQ(understood.questions.size(), 1U);
  EXPECT_THAT(understood.questions[0].text,
              HasSubstr("no column is known to be the force; which is it: \"Note 1\"; or"));
  // A column may be the force all the same.
  Mapping other;
  EXPECT_TRUE(understood.questions[0].take("Note 1", other));
  EXPECT_EQ(other.column.at(Field::kForce), "Note 1");
  EXPECT_FALSE(understood.questions[0].take("heat", mapping));
  ASSERT_TRUE(understood.questions[0].take("position", mapping));
  understood = understand(parsed.tables[0], mapping);
  ASSERT_EQ(understood.questions.size(), 1U);
  ASSERT_TRUE(understood.questions[0].take("-2 N", mapping));
  understood = understand(parsed.tables[0], mapping);
  EXPECT_TRUE(understood.questions.empty());
  EXPECT_TRUE(understood.loaded);
  const auto test = convert(parsed.tables[0], understood.sources, '.', 0.0, "log", mapping.load_N);
  EXPECT_THAT(test.frame->force_N, ElementsAre(-2.0, -2.0));
  EXPECT_THAT(test.pressure->pressure_psi, ElementsAre(5.0, 6.0));
}

TEST(Foreign, APressureAsTheOutputNeedsNoForce) {
  Mapping mapping;
  mapping.output = messages::Output::kPressure;
  const auto parsed = parse_tables("Time (s),Load,Pressure (psi)\n0,1,5\n1,2,6\n", "log", {});
  const auto understood = understand(parsed.tables[0], mapping);
  EXPECT_TRUE(understood.questions.empty());
  EXPECT_FALSE(understood.framed);
  EXPECT_TRUE(understood.gauged);
  EXPECT_EQ(understood.sources.size(), 2U);
}

TEST(Foreign, ALoadIsAForceOrAMass) {
  const auto load_N = [](std::string_view text) {
    Mapping mapping;
    return take_load(text, mapping) ? mapping.load_N : std::nullopt;
  };
  EXPECT_EQ(load_N("0.5"), 0.5);
  EXPECT_EQ(load_N(" 2 N "), 2.0);
  EXPECT_EQ(load_N("0.1 kg"), 0.1 * 9.80665);
  EXPECT_DOUBLE_EQ(load_N("100g").value(), 0.980665);
  for (const char* none : {"", " ", "heavy", "1 mm", "1 psi", "kg", "2e9 N", "1e"})
    EXPECT_EQ(load_N(none), std::nullopt) << none;
}

TEST(Foreign, FurtherColumnsOfNumbersAreKeptByNamesOfTheirOwn) {
  const auto parsed = parse_tables(
      "Time (s);Position (mm);Force (N);Temperature (\xC2\xB0"
      "C);Strom \xC3\xBC"
      "ber Spule [A];Step;Step;Note;Temperature (\xC2\xB0"
      "C);Empty\n"
      "0,0;1,0;2,0;21,25;;1;1;on;1.000,5;\n0,1;1,1;2,1;21,5;0,25;2;1;off;2;\n",
      "log", {});
  const auto understood = understand(parsed.tables[0], {});
  ASSERT_TRUE(understood.questions.empty()) << understood.questions[0].text;
  const auto test = convert(parsed.tables[0], understood.sources, parsed.decimal, 0.0, "log");
  std::vector<std::string> names;
  for (const auto& kept : test.kept) names.push_back(kept.column.name);
  // `step` is the export's and no other program's; a word and an empty column are no numbers.
  EXPECT_THAT(names, ElementsAre("temperature_C", "strom_uber_spule_A", "Step", "Step_2", "temperature_C_2"));
  EXPECT_THAT(test.kept.at(0).column.cells, ElementsAre("21.25", "21.5"));
  EXPECT_THAT(test.kept.at(1).column.cells, ElementsAre("", "0.25"));
  EXPECT_THAT(test.kept.at(4).column.cells, ElementsAre("1000.5", "2"));
  EXPECT_THAT(test.not_kept, ElementsAre(7U, 9U));
}

TEST(Foreign, ANumberThatIsMissingInAFurtherColumnIsEmpty) {
  const auto parsed =
      parse_tables("Time (s),Position (mm),Force (N),Temperature (C)\n0,1,2,NaN\n1,1,2,21.5\n2,1,2,N/A\n", "log", {});
  const auto test = convert(parsed.tables.at(0), understand(parsed.tables[0], {}).sources, '.', 0.0, "log");
  ASSERT_EQ(test.kept.size(), 1U);
  EXPECT_THAT(test.kept[0].column.cells, ElementsAre("", "21.5", ""));
}

TEST(Foreign, AbsolutePressureIsRefused) {
  const auto of = [](const std::string& column, const Mapping& mapping = {}) {
    const auto parsed = parse_tables("Time (s)," + column + "\n0.0,101.3\n0.1,101.4\n", "log", {});
    return understand(parsed.tables[0], mapping);
  };
  for (const char* column : {"Absolute pressure (kPa)", "pressure_abs_kPa", "Pressure (abs) (kPa)", "Pressure (psia)",
                             "Pressure [bar abs]", "Absolutdruck (bar)", "Pression absolue (bar)"}) {
    const auto understood = of(column);
    EXPECT_THAT(understood.refusal, HasSubstr("is absolute, and a recording has gauge pressure")) << column;
    EXPECT_TRUE(understood.timed);
  }
  Mapping named;
  named.column = {{Field::kPressure, "p_abs"}};
  EXPECT_THAT(of("p_abs (kPa)", named).refusal, HasSubstr("is absolute"));
  for (const char* column : {"Pressure (kPa)", "Pressure absorber (kPa)"}) EXPECT_EQ(of(column).refusal, "") << column;
  // The gauge pressure beside it is taken.
  const auto parsed =
      parse_tables("Time (s),Absolute pressure (kPa),Pressure (kPa)\n0.0,101,0\n0.1,101,0\n", "log", {});
  const auto both = understand(parsed.tables[0], {});
  EXPECT_EQ(both.refusal, "");
  ASSERT_EQ(both.sources.size(), 2U);
  EXPECT_EQ(both.sources[1].column, 2U);
}

TEST(Understand, APressureInAnotherUnitIsNotLostWithoutAWord) {
  const auto of = [](const std::string& head) {
    const auto parsed =
        parse_tables("Time (s),Extension (mm),Load (N)," + head + "\n0.0,1.0,2.0,3.0\n0.1,1.1,2.1,3.1\n", "log", {});
    return understand(parsed.tables.at(0), {});
  };
  for (const char* unit :
       {"Bar", "BAR", "barg", "Barg", "MPag", "kpa", "KPa", "PSIG", "kPag", "kPa gauge", "psi g", "mmHg", "N/mm2"}) {
    const auto understood = of(std::string("Pressure (") + unit + ")");
    EXPECT_TRUE(understood.questions.empty()) << unit;
    EXPECT_EQ(understood.sources.size(), 4U) << unit;
  }
  const auto asked = of("Pressure (kgf/cm2)");
  ASSERT_EQ(asked.questions.size(), 1U);
  EXPECT_THAT(asked.questions[0].text, HasSubstr("\"kgf/cm2\", which is no unit of a pressure"));
  // Volts are no pressure that a factor would give.
  EXPECT_TRUE(of("Pressure (V)").questions.empty());
}

/// A command has the unit and the name of what it commands.
TEST(Understand, WhatIsNoMeasurementIsTakenForNoneUnasked) {
  const auto of = [](const std::string& head) {
    const auto parsed = parse_tables("time_s," + head + "\n0.0,1.0,2.0,3.0,4.0\n0.1,1.1,2.1,3.1,4.1\n", "log", {});
    return understand(parsed.tables.at(0), {});
  };
  for (const auto& [head, field] : {std::pair{"position_command_mm,encoder_mm,force_N,pressure_psi", "position"},
                                    {"Crosshead target (mm),Encoder (mm),force_N,pressure_psi", "position"},
                                    {"position_mm,Force limit (N),Fz (N),pressure_psi", "force"},
                                    {"position_mm,load_cell_zero_N,Fz_N,pressure_psi", "force"}}) {
    const auto understood = of(head);
    ASSERT_EQ(understood.questions.size(), 1U) << head;
    EXPECT_THAT(understood.questions[0].text, HasSubstr(std::string("no column is known to be the ") + field));
    EXPECT_THAT(understood.questions[0].text, HasSubstr(field == std::string("force") ? "Fz" : "ncoder"));
  }
  const auto supply = of("position_mm,force_N,supply_pressure_psi,p_muscle_psi");
  EXPECT_TRUE(supply.questions.empty());
  ASSERT_EQ(supply.notes.size(), 1U);
  EXPECT_THAT(supply.notes[0], HasSubstr("\"supply_pressure_psi\" is no pressure that was measured"));
  // Beside what was measured the command is not in the way, and a zeroed force is one.
  const auto both = of("position_command_mm,position_mm,Zeroed force (N),pressure_psi");
  EXPECT_TRUE(both.questions.empty());
  EXPECT_EQ(both.sources.size(), 4U);
}

/// A sensor that is not there yet, a cell that a program left empty, an amplifier that was overloaded.
TEST(Foreign, AHeaderIsFoundWhateverTheFirstRowsHold) {
  const std::string rest = "0.1,1.0,2.0\n0.2,1.1,2.1\n";
  for (const std::string names :
       {"Time (s),Position (mm),Force (N)\n", "time,position,force\n(s),(mm),(N)\n", "Zeit,Weg,Kraft\ns,mm,N\n"}) {
    for (const std::string first : {"0.00,NaN,NaN\n", "NaN,NaN,NaN\n", "0.00,,\n", ",,2.0\n", "0.00,-,-----\n",
                                    "0.00,#N/A,#NV\n", "0.00,-nan(ind),1.#INF\n", "0.00,overload,2.0\n"}) {
      const auto parsed = parse_tables(names + first + first + rest, "file", {});
      ASSERT_EQ(parsed.tables.size(), 1U) << names << first;
      EXPECT_EQ(parsed.tables[0].rows.size(), 4U) << names << first;
      EXPECT_EQ(parsed.tables[0].columns.at(1).unit, "mm");
      EXPECT_THAT(said([&] { static_cast<void>(imported(names + first + rest)); }),
                  AnyOf(HasSubstr("file:2: \""), HasSubstr("file:3: \"")))
          << first;
    }
    // Cells that are all empty say nothing; below other rows they end the table.
    EXPECT_THAT(imported(names + ",,\n,,\n" + rest), ElementsAre(ElementsAre(0.1, 1.0, 2.0, 0.2, 1.1, 2.1)));
  }
  EXPECT_THAT(said([&] { static_cast<void>(imported("Time (s),Position (mm),Force (N)\n0.0,NaN,NaN\n" + rest)); }),
              HasSubstr("file:2: \"Position\" (mm) is \"NaN\"; a number is needed"));
  // A column of words is one from its first row on.
  const auto parsed = parse_tables("t,x,f,state\n0.0,NaN,NaN,idle\n0.1,1.0,2.0,moving\n", "file", {});
  ASSERT_EQ(parsed.tables.size(), 1U);
  EXPECT_EQ(parsed.tables[0].columns.at(3).name, "state");
}

TEST(Foreign, LinesAboveATableAreNotItsHeader) {
  const std::string rows = "0.1,1.0,2.0\n0.2,1.1,2.1\n";
  const auto names = [](const std::string& text) {
    std::vector<std::string> out;
    const auto parsed = parse_tables(text, "file", {});
    for (const auto& column : parsed.tables.at(0).columns) out.push_back(column.name);
    return out;
  };
  const std::string above = "Operator,Sample,Remark\nJo,A1,new\nRate 1,600.0,mm/min\n";
  EXPECT_THAT(names(above + "t,x,f\n0.0,NaN,NaN\n" + rows), ElementsAre("t", "x", "f"));
  EXPECT_THAT(names("Operator,Sample,Remark\nt,s,F\n" + rows), ElementsAre("t", "s", "F"));
  EXPECT_THAT(names(above + rows), ElementsAre("", "", ""));
}

/// Of a second test nothing is lost, whatever its first rows hold.
TEST(Foreign, ATestThatBeginsWithoutNumbersIsNotLost) {
  const std::string head = "Time (s),Extension (mm),Load (N)\n", good = head + "0.0,1.0,2.0\n0.1,1.1,2.1\n\n";
  const auto why = [](const std::string& text) { return said([&] { static_cast<void>(imported(text)); }); };
  EXPECT_THAT(why(good + head + "0.0,NaN,NaN\n0.1,NaN,NaN\n"), HasSubstr("file:6: \"Extension\" (mm) is \"NaN\""));
  EXPECT_THAT(why(good + "0.0,NaN,NaN\n0.1,NaN,NaN\n"), HasSubstr("file:5: 3 cells with 1 numbers"));
  EXPECT_THAT(why(head + "0.0,NaN,NaN,ok\n0.1,1.0,2.0,ok\n\n" + good), HasSubstr("file:2: 4 cells with 1 numbers"));
  EXPECT_THAT(why(good + "time,position,force\ns,mm,N\n"), HasSubstr("file:7: a table of 3 columns has no row"));
}

/// As LabVIEW and MATLAB write them.
TEST(Foreign, ARowOfUnitsNeedsNoBrackets) {
  const auto expected = ElementsAre(ElementsAre(0.0, 10.0, 250.0, 0.5, 20.0, 500.0));
  const std::string rows = "0,1.0,0.25\n500,2.0,0.5\n";
  for (const std::string units : {"ms,cm,kN", "(ms),(cm),(kN)", "ms,[cm],(kN)", "\"ms\",\"cm\",\"kN\"", "ms,cm,kN,"})
    EXPECT_THAT(imported("time,position,force\n" + units + "\n" + rows), expected) << units;
  EXPECT_THAT(imported("Zeit;Weg;Kraft\nms;cm;kN\n0;1,0;0,25\n500;2,0;0,5\n"), expected);
  EXPECT_THAT(imported("time position force\nms cm kN\n0 1.0 0.25\n500 2.0 0.5\n"), expected);
  // What is further in a row has units of its own, or none.
  const auto parsed = parse_tables(
      "time,position,force,temperature,speed,voltage,state\nms,cm,kN,\xC2\xB0"
      "C,1/min,V,-\n0,1,1,20,5,3,7\n1,2,2,21,5,3,7\n",
      "file", {});
  std::vector<std::string> units;
  for (const auto& column : parsed.tables.at(0).columns) units.push_back(column.unit);
  EXPECT_THAT(units, ElementsAre("ms", "cm", "kN",
                                 "\xC2\xB0"
                                 "C",
                                 "1/min", "V", ""));
  EXPECT_EQ(parsed.tables[0].columns[0].name, "time");
  // Names that nobody knows have units all the same.
  EXPECT_EQ(parse_tables("a,b,c\ns,mm,N\n0,1,2\n1,2,3\n", "file", {}).tables.at(0).columns.at(1).unit, "mm");
}

TEST(Foreign, AUnitThatIsNotKnownIsSaidWithItsPlace) {
  const auto why = [](const std::string& text) { return said([&] { static_cast<void>(imported(text)); }); };
  const std::string rows = "0.0,1.0,2.0\n0.1,1.1,2.1\n";
  for (const std::string units : {"s,mm,klbf", "(s),(mm),(klbf)"})
    EXPECT_THAT(why("# a line\ntime,position,force\n" + units + "\n" + rows),
                HasSubstr("column \"force\" (klbf) is in \"klbf\", which is no unit of a force (line 3, column 3)"));
  EXPECT_THAT(
      why("time,position,force\nSekunden,mm,N\n" + rows),
      HasSubstr("column \"time\" (Sekunden) is in \"Sekunden\", which is no unit of a time (line 2, column 1)"));
  Mapping mapping;
  mapping.unit = {{"force", "kN"}};
  EXPECT_THAT(imported("time,position,force\ns,mm,Kilonewton\n" + rows, mapping),
              ElementsAre(ElementsAre(0.0, 1.0, 2000.0, 0.1, 1.1, 2100.0)));
  EXPECT_THAT(why("time,position,force\ns,mm\n" + rows), HasSubstr("file:2: 2 units for 3 columns"));
  // A name and a row that say two things: one of them is wrong by a factor.
  for (const std::string name : {"force (kN)", "force_kN"})
    EXPECT_THAT(why("time,position," + name + "\ns,mm,N\n" + rows),
                HasSubstr("is in \"kN\" by its name and in \"N\" by this row of units"));
  EXPECT_EQ(imported("time (s),position_in,Force (filtered)\n(s),(mm),(N)\n" + rows).at(0).size(), 6U);
}

TEST(Foreign, CountsAreOfNoKnownSensor) {
  const auto parsed = parse_tables("Time (s),Pressure (counts)\n0.0,1638\n0.1,14746\n", "log", {});
  const auto understood = understand(parsed.tables[0], {});
  ASSERT_EQ(understood.questions.size(), 1U);
  EXPECT_THAT(understood.questions[0].text, HasSubstr("\"counts\", which is no unit of a pressure"));
  Mapping mapping;
  EXPECT_FALSE(understood.questions[0].take("counts", mapping));
  EXPECT_TRUE(understood.questions[0].take("elvh_counts", mapping));
  EXPECT_TRUE(understand(parsed.tables[0], mapping).questions.empty());
}

TEST(Foreign, CompressionIsTurnedRoundByNameOrByWord) {
  const std::string compressive =
      "Time (s),Compressive extension (mm),Compressive load (N)\n0.0,1.0,2.0\n0.1,1.1,2.1\n";
  EXPECT_THAT(imported(compressive), ElementsAre(ElementsAre(0.0, -1.0, -2.0, 0.1, -1.1, -2.1)));
  Mapping mapping;
  mapping.compression_positive = {{Field::kPosition, false}, {Field::kForce, true}};
  EXPECT_THAT(imported(compressive, mapping), ElementsAre(ElementsAre(0.0, 1.0, -2.0, 0.1, 1.1, -2.1)));
}

TEST(Foreign, FaultsNameTheLine) {
  const std::string head = "Time (s),Extension (mm),Load (N)\n0.0,1.0,2.0\n";
  const auto why = [&](const std::string& rest) { return said([&] { static_cast<void>(imported(head + rest)); }); };
  EXPECT_THAT(why("0.1,-----,2.0\n"), HasSubstr("file:3: \"Extension\" (mm) is \"-----\"; a number is needed"));
  EXPECT_THAT(why("0.1,2.0\n"), HasSubstr("file:3: 2 cells where the table has 3"));
  EXPECT_THAT(why("0.1,2.0,3.0\n0.05,2.0,3.0\n"), HasSubstr("file:4: time runs backwards"));
  EXPECT_THAT(why("0.0,2.0,3.0\n"), HasSubstr("file:3: time stands still"));
  EXPECT_THAT(why("0.1,2e9,3.0\n"), HasSubstr("file:3: \"Extension\" (mm): 2e+09 mm are"));
  EXPECT_THAT(why("\n0.1,2.0,3.0\n"), HasSubstr("file:4: rows without a header behind an empty line"));
  EXPECT_THAT(why("0.1,\"2.0,3.0\n"), HasSubstr("never closed"));
  EXPECT_THAT(why("0.1,2.0,3.25"), HasSubstr("file:3: the last line has no line end"));
  EXPECT_THAT(said([] { static_cast<void>(decode(std::string("a\0b", 3), "file")); }),
              HasSubstr("file:1: a zero byte"));
}

TEST(Foreign, ATestWhoseRowsHaveAnUnnamedCellIsNotLost) {
  const std::string head = "Time (s),Extension (mm),Load (N)\n";
  const std::string good = head + "0.0,1.0,2.0\n0.1,1.1,2.1\n", odd = head + "0.0,1.0,2.0,ok\n0.1,1.1,2.1,ok\n";
  const auto why = [](const std::string& text) { return said([&] { static_cast<void>(imported(text)); }); };
  EXPECT_THAT(why(good + "\n" + odd), HasSubstr("file:6: 4 cells with 3 numbers (\"0.0\" ...) belong to no table"));
  EXPECT_THAT(why(odd + "\n" + good), HasSubstr("file:2: 4 cells with 3 numbers"));
  EXPECT_THAT(why(good + "\nMean,1.05,2.05\n"), HasSubstr("file:5: 3 cells with 2 numbers (\"Mean\" ...)"));
  // Lines of a header between two tests have a number at most.
  EXPECT_EQ(imported(good + "\nTest : Rate 1,600.0,mm/min\n\n" + good).size(), 2U);
}

TEST(Foreign, AMappingIsReadAsItWasWritten) {
  Mapping mapping;
  mapping.dialect = {.delimiter = '\t', .decimal = ','};
  mapping.column = {{Field::kForce, "Load \"2\""}, {Field::kTime, "#1"}};
  mapping.unit = {{"Load \"2\"", "kN"}, {"#1", "us"}, {"of\ttwo\r\nlines\x01\x7F \xC2\xB5", "mm"}};
  mapping.compression_positive = {{Field::kForce, true}};
  mapping.output = messages::Output::kPosition;
  mapping.load_N = 0.980665;
  mapping.specimen = "ecoflex 1";
  mapping.rest_length_mm = 94.3;
  mapping.zero_mm = -0.125;
  const auto file = std::filesystem::temp_directory_path() / ("isorig-mapping-" + std::to_string(::getpid()) + ".toml");
  std::ofstream(file) << mapping_text(mapping);
  const auto read = read_mapping(file);
  std::filesystem::remove(file);
  EXPECT_EQ(mapping_text(read), mapping_text(mapping));
  EXPECT_EQ(read.column, mapping.column);
  EXPECT_EQ(read.unit, mapping.unit);
  EXPECT_EQ(read.zero_mm, mapping.zero_mm);
  EXPECT_EQ(read.output, mapping.output);
  EXPECT_EQ(read.load_N, mapping.load_N);
  EXPECT_EQ(read.specimen, std::nullopt);  // the next file is of another
  mapping.rest_length_mm.reset();
  mapping.no_rest_length = true;
  std::ofstream(file) << mapping_text(mapping);
  EXPECT_TRUE(read_mapping(file).no_rest_length);
  mapping.zero_mm.reset();
  mapping.whole_length = true;
  std::ofstream(file) << mapping_text(mapping);
  EXPECT_TRUE(read_mapping(file).whole_length);
  std::filesystem::remove(file);
}

/// A file of `rows` rows in one dialect, and where each of its rows ends (without its line end).
struct Made {
  std::string text;
  std::vector<std::size_t> ends;
};
Made made(const std::string& quote, char delimiter, char decimal, const std::string& line_end) {
  const auto row = [&](const std::vector<std::string>& cells) {
    std::string out;
    for (const auto& cell : cells) out += (out.empty() ? "" : std::string(1, delimiter)) + quote + cell + quote;
    return out;
  };
  const auto number = [&](double value) {
    char digits[32];
    std::snprintf(digits, sizeof digits, "%.5f", value);
    std::string out = digits;
    out[out.find('.')] = decimal;
    return out;
  };
  Made file{.text = row({"Time", "Extension", "Load"}) + line_end + row({"(s)", "(mm)", "(N)"}) + line_end, .ends = {}};
  for (int k = 0; k < 6; ++k) {
    file.text += row({number(0.1 * k), number(0.25 * k), number(3.5 + 111.125 * k)});
    file.ends.push_back(file.text.size());
    file.text += line_end;
  }
  return file;
}

/// Cut anywhere, a file is refused, or gives every row that stands whole in it: never a number that was cut, never one
/// row less. A cut exactly behind a row leaves a file that nothing tells from a shorter one.
TEST(Foreign, ACutFileIsRefusedOrGivesItsWholeRows) {
  std::size_t refused = 0, taken = 0;
  for (const bool wide : {false, true}) {
    for (const auto& file : {made("\"", ',', '.', "\r\n"), made("", ',', '.', "\n"), made("\"", ';', ',', "\r\n"),
                             made("", '\t', '.', "\n")}) {
      const auto whole = imported(wide ? "\xFF\xFE" + utf16(file.text, true) : file.text);
      ASSERT_EQ(whole.at(0).size(), 3 * file.ends.size());
      const std::string bytes = wide ? "\xFF\xFE" + utf16(file.text, true) : file.text;
      for (std::size_t length = 0; length < bytes.size(); ++length) {
        const std::size_t characters = wide ? (length < 2 ? 0 : (length - 2) / 2) : length;
        const auto rows = static_cast<std::size_t>(
            std::ranges::count_if(file.ends, [&](std::size_t end) { return end <= characters; }));
        try {
          const auto read = imported(bytes.substr(0, length));
          ASSERT_EQ(read.size(), 1U) << length;
          ASSERT_EQ(read[0].size(), 3 * rows) << length;
          ASSERT_TRUE(std::equal(read[0].begin(), read[0].end(), whole[0].begin())) << length;
          ++taken;
        } catch (const RecordingError&) {
          ++refused;
        } catch (const std::invalid_argument&) {  // a question
          ++refused;
        }
      }
    }
  }
  EXPECT_GT(refused, 2000U);
  EXPECT_GT(taken, 50U);
}

TEST(Foreign, NoByteMakesItFail) {
  for (const auto& text : {kEnglish, kGerman, "\xFF\xFE" + utf16(kGerman, true)}) {
    for (std::size_t at = 0; at < text.size(); ++at) {
      for (const char byte : {'\0', '"', ';', ',', '\n', '9', '\xFF', '\xD8'}) {
        auto bytes = text;
        bytes[at] = byte;
        try {
          for (const auto& test : imported(bytes))
            for (const double value : test) ASSERT_TRUE(std::isfinite(value));
        } catch (const RecordingError&) {
        } catch (const std::invalid_argument&) {
        }
      }
    }
  }
}

}  // namespace
}  // namespace isorig::foreign
