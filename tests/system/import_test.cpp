// isorig import from outside: files of other programs become recordings that every command takes, or nothing is
// written.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <random>

#include "messages/recording.hpp"
#include "processes.hpp"
#include "terminal.hpp"

namespace isorig::system_test {
namespace {

using testing::AllOf;
using testing::HasSubstr;
using testing::Not;
using testing::StartsWith;

constexpr int kBadInput = 3;

/// Strokes of a standard linear solid (k1 = 1.7, k2 = 1.3 N/mm, tau = 0.8 s), at moments that do not repeat.
struct Strokes {
  std::vector<double> t_s, position_mm, force_N;
};
Strokes strokes(double seconds = 20.0) {
  constexpr double kStep_s = 0.02;
  constexpr double kMoments_s[] = {1.0, 3.7, 5.2, 9.1, 11.0, 14.9, 16.1, 21.3, 24.0, 31.7, 35.2, 44.4, 50.1, 52.9};
  Strokes out;
  double arm_N = 0.0, before_mm = 0.0;
  for (double t = 0.0; t < seconds; t += kStep_s) {
    double x = 0.0, sign = 1.0;
    for (const double at : kMoments_s) {
      x += sign * 2.0 * std::clamp((t - at) / 0.5, 0.0, 1.0);
      sign = -sign;
    }
    arm_N = arm_N * std::exp(-kStep_s / 0.8) + 1.3 * (x - before_mm);
    before_mm = x;
    out.t_s.push_back(t);
    out.position_mm.push_back(x);
    out.force_N.push_back(1.7 * (x + 10.0) + arm_N);
  }
  return out;
}

/// Of a regulator that brings the pressure back at 1.5 per second after each stroke; a reading beside every position.
std::vector<double> pressure_beside(const Strokes& made) {
  std::mt19937 random(7);
  std::normal_distribution<double> noise_psi(0.0, 0.002);
  std::vector<double> pressure_psi(made.t_s.size(), 10.0);
  double response_mm = 0.0;
  for (std::size_t i = 1; i < made.t_s.size(); ++i) {
    response_mm = response_mm * std::exp(-1.5 * 0.02) + made.position_mm[i] - made.position_mm[i - 1];
    pressure_psi[i] = 10.0 + 0.05 * response_mm + noise_psi(random);
  }
  return pressure_psi;
}

std::string table(const Strokes& s, const std::string& header, double length_factor = 1.0, double force_factor = 1.0) {
  std::string text = header;
  char row[96];
  for (std::size_t i = 0; i < s.t_s.size(); ++i) {
    std::snprintf(row, sizeof row, "\"%.5f\",\"%.7f\",\"%.5f\"\r\n", s.t_s[i], length_factor * s.position_mm[i],
                  force_factor * s.force_N[i]);
    text += row;
  }
  return text;
}

const std::string kBluehill = "Test : Rate 1,\"240.00000\",mm/min\r\n\r\nTime,Extension,Load\r\n(s),(mm),(N)\r\n";

class Import : public testing::Test {
 protected:
  Answer import(std::vector<std::string> words, const std::string& out = "out") {
    words.insert(words.begin(), "import");
    words.insert(words.end(), {"--out", (dir_ / out).string()});
    return isorig(dir_, std::move(words));
  }
  Answer import_of_specimen(std::vector<std::string> words, const std::string& out = "out") {
    words.insert(words.end(), {"--specimen", "A 1", "--rest-length-mm", "94.3", "--pressurized-rest-length-mm", "84.3",
                               "--nominal-pressure-psi", "10"});
    return import(std::move(words), out);
  }
  std::string file(const std::string& name, const std::string& text) {
    spit(dir_ / name, text);
    return (dir_ / name).string();
  }
  TempDir dir_;
};

TEST_F(Import, ABluehillFileBecomesARecordingThatSaysWhereItIsFrom) {
  const auto made = strokes();
  const auto path = file("a.csv", table(made, kBluehill));
  const auto done = import_of_specimen({path});
  ASSERT_EQ(done.code, 0) << done.text;
  EXPECT_THAT(done.text,
              HasSubstr("time from \"Time\" (s), position from \"Extension\" (mm), force from \"Load\" (N)"));
  const auto recording = messages::read_recording(dir_ / "out");
  ASSERT_EQ(recording.frame.size(), made.t_s.size());
  for (std::size_t i = 0; i < made.t_s.size(); ++i) {
    EXPECT_NEAR(recording.frame.position_mm[i], made.position_mm[i], 5.1e-8);  // as printed
    EXPECT_NEAR(recording.frame.force_N[i], made.force_N[i], 5.1e-6);
  }
  Process sum({"sha256sum", path}, dir_ / "sum");
  ASSERT_EQ(sum.wait(20), 0);
  const auto toml = slurp(dir_ / "out/recording.toml");
  EXPECT_THAT(toml,
              AllOf(HasSubstr("file = \"a.csv\""), HasSubstr("sha256 = \"" + slurp(dir_ / "sum").substr(0, 64) + "\""),
                    HasSubstr("units = \"s, mm, N, psi\""), HasSubstr("Test : Rate 1 = 240.00000 mm/min"),
                    HasSubstr("command = \"isorig import"),
                    HasSubstr("field = \"force\"\nname = \"Load\"\nnumber = 3\nunit = \"N\"")));
  const auto fv = isorig(dir_, {"fv", (dir_ / "out").string(), "--out", (dir_ / "fv").string()});
  EXPECT_NE(fv.code, kBadInput) << fv.text;
  // Nothing is replaced unless it is asked for.
  EXPECT_THAT(import_of_specimen({path}).text, HasSubstr("a recording is there already"));
  EXPECT_EQ(import_of_specimen({path, "--replace"}).code, 0);
}

TEST_F(Import, SeveralTestsOfAFileAreSeveralRecordings) {
  const auto text =
      table(strokes(), kBluehill) + "\r\n" + table(strokes(12.0), "Time,Extension,Load\r\n(s),(mm),(N)\r\n");
  const auto done = import_of_specimen({file("two.csv", text)});
  ASSERT_EQ(done.code, 0) << done.text;
  EXPECT_EQ(messages::read_recording(dir_ / "out/test-1").frame.size(), strokes().t_s.size());
  EXPECT_EQ(messages::read_recording(dir_ / "out/test-2").frame.size(), strokes(12.0).t_s.size());
}

TEST_F(Import, ATestWhoseTimeHasNoUnitIsAskedNotLeftOut) {
  const auto text = table(strokes(), kBluehill) + "\r\n" + table(strokes(12.0), "Zeit,Extension,Load\r\n,(mm),(N)\r\n");
  const auto done = import_of_specimen({file("two.csv", text)});
  EXPECT_EQ(done.code, kBadInput);
  EXPECT_THAT(done.text, AllOf(HasSubstr("column \"Zeit\" has no unit"), HasSubstr("--unit 'Zeit=s'")));
  const auto told = import_of_specimen({(dir_ / "two.csv").string(), "--unit", "Zeit=s"});
  ASSERT_EQ(told.code, 0) << told.text;
  EXPECT_EQ(messages::read_recording(dir_ / "out/test-2").frame.size(), strokes(12.0).t_s.size());
}

TEST_F(Import, WhatHasNoLengthIsSaidToHaveNone) {
  const auto path = file("a.csv", table(strokes(), kBluehill));
  const auto none = import({path, "--specimen", "damper", "--rest-length-mm", "none"});
  ASSERT_EQ(none.code, 0) << none.text;
  EXPECT_FALSE(messages::read_recording(dir_ / "out").metadata.rest_length_mm);
  EXPECT_THAT(import({path, "--specimen", "damper", "--rest-length-mm", "long"}, "other").text,
              HasSubstr("a length up to 10000 mm, or none"));
  EXPECT_THAT(
      import({path, "--specimen", "damper", "--rest-length-mm", "none", "--pressurized-rest-length-mm", "80"}, "other")
          .text,
      HasSubstr("needs --rest-length-mm"));
  EXPECT_FALSE(std::filesystem::exists(dir_ / "other"));
}

TEST_F(Import, WithoutATerminalItSaysWhatToSay) {
  const auto path = file("a.csv", table(strokes(), "Time,Extension,Load\r\n"));
  const auto done = import({path});
  EXPECT_EQ(done.code, kBadInput);
  for (const char* said : {"column \"Extension\" has no unit", "--unit 'Extension=mm'", "--unit 'Load=N'",
                           "--unit 'Time=s'", "--specimen NAME", "--rest-length-mm L"})
    EXPECT_THAT(done.text, HasSubstr(said));
  EXPECT_FALSE(std::filesystem::exists(dir_ / "out"));
}

TEST_F(Import, AtATerminalItAsksAndRemembers) {
  const auto path = file("a.csv", table(strokes(), "Time,Extension,Load\r\n"));
  Terminal terminal({bin("isorig"), "import", path, "--out", (dir_ / "out").string()});
  ASSERT_TRUE(terminal.shows("in which unit is the time"));
  terminal.type("s\n");
  ASSERT_TRUE(terminal.shows("in which unit is the position"));
  terminal.type("furlong\n");
  ASSERT_TRUE(terminal.shows("that is none of them"));
  terminal.type("mm\n");
  ASSERT_TRUE(terminal.shows("in which unit is the force"));
  terminal.type("N\n");
  ASSERT_TRUE(terminal.shows("what is the specimen called?"));
  terminal.type("A 1\n");
  ASSERT_TRUE(terminal.shows("how long is the specimen"));
  terminal.type("94.3\n");
  ASSERT_TRUE(terminal.shows("mapping.toml: --mapping uses it again"));
  const auto first = messages::read_recording(dir_ / "out");
  // What was answered answers for the next file; its specimen is another.
  const std::string mapping = (dir_ / "out/mapping.toml").string();
  const auto unnamed = import({path, "--mapping", mapping}, "again");
  EXPECT_EQ(unnamed.code, kBadInput);
  EXPECT_THAT(unnamed.text, AllOf(HasSubstr("what is the specimen called?"), HasSubstr("--specimen NAME"),
                                  Not(HasSubstr("how long is the specimen"))));
  const auto again = import({path, "--mapping", mapping, "--specimen", "A 2"}, "again");
  ASSERT_EQ(again.code, 0) << again.text;
  EXPECT_THAT(again.text, HasSubstr("specimen A 2 (--specimen), rest length 94.3 mm (from " + mapping +
                                    "), zero of the position at the unpressurized rest length (not told otherwise)"));
  EXPECT_THAT(slurp(dir_ / "again/recording.toml"), HasSubstr("\"rest length 94.3 mm (from "));
  EXPECT_EQ(messages::read_recording(dir_ / "again").metadata.specimen, "A 2");
  EXPECT_EQ(messages::read_recording(dir_ / "again").frame.force_N, first.frame.force_N);
  EXPECT_EQ(slurp(dir_ / "again/mapping.toml"), slurp(dir_ / "out/mapping.toml"));
}

TEST_F(Import, AMappingOfAnEarlierVersionNamesItsSpecimenAndThatIsSaid) {
  const auto mapping = file("earlier.toml",
                            "format = \"isorig-mapping/1\"\n[specimen]\nname = \"A 1\"\nrest_length_mm = 94.3\n"
                            "zero_mm = 1.5\n");
  const auto done = import({file("a.csv", table(strokes(), kBluehill)), "--mapping", mapping});
  ASSERT_EQ(done.code, 0) << done.text;
  EXPECT_THAT(done.text, HasSubstr("specimen A 1 (from " + mapping + "), rest length 94.3 mm (from " + mapping +
                                   "), zero of the position at 1.5 mm (from " + mapping + ")"));
  EXPECT_THAT(slurp(dir_ / "out/mapping.toml"), AllOf(HasSubstr("zero_mm = 1.5"), Not(HasSubstr("A 1"))));
}

TEST_F(Import, AnswersOutliveARefusal) {
  // Metres without a unit: whoever answers "mm" is refused at the end, after every question.
  const auto path = file("a.csv", table(strokes(), "Time,Extension,Load\r\n(s),,(N)\r\n", 1e-3));
  const auto answer = [&](const std::string& out) {
    Terminal terminal({bin("isorig"), "import", path, "--out", (dir_ / out).string()});
    EXPECT_TRUE(terminal.shows("in which unit is the position"));
    terminal.type("mm\n");
    EXPECT_TRUE(terminal.shows("what is the specimen called?"));
    terminal.type("Ann's\n");
    EXPECT_TRUE(terminal.shows("how long is the specimen"));
    terminal.type("94.3\n");
    EXPECT_TRUE(terminal.shows("is a unit wrong?"));
    EXPECT_EQ(terminal.wait(), kBadInput);
    return terminal.shown();
  };
  const auto said = answer("out");
  const std::string mapping = (dir_ / "out/mapping.toml").string();
  EXPECT_THAT(said, HasSubstr("--mapping '" + mapping + R"(' --specimen 'Ann'\''s')"));
  EXPECT_FALSE(std::filesystem::exists(dir_ / "out/recording.toml"));
  // Nothing but the one wrong answer is said again.
  const auto done = import({path, "--mapping", mapping, "--specimen", "Ann's", "--unit", "Extension=m"});
  ASSERT_EQ(done.code, 0) << done.text;
  EXPECT_EQ(messages::read_recording(dir_ / "out").metadata.rest_length_mm, 94.3);
  // The mapping of a recording that was made is not replaced by the answers of an import that was not.
  const auto of_made = slurp(mapping);
  EXPECT_THAT(answer("out"), HasSubstr("out/mapping-answers.toml' --specimen"));
  EXPECT_EQ(slurp(mapping), of_made);
}

TEST_F(Import, AnswersOutliveCtrlC) {
  const auto path = file("a.csv", table(strokes(), "Time,Extension,Load\r\n(s),,(N)\r\n"));
  Terminal terminal({bin("isorig"), "import", path, "--out", (dir_ / "out").string()});
  ASSERT_TRUE(terminal.shows("in which unit is the position"));
  terminal.type("mm\n");
  ASSERT_TRUE(terminal.shows("what is the specimen called?"));
  terminal.type("A 1\n");
  ASSERT_TRUE(terminal.shows("how long is the specimen"));
  terminal.type(Terminal::kCtrlC);
  ASSERT_TRUE(terminal.shows("interrupted; no recording was made"));
  const std::string mapping = (dir_ / "out/mapping.toml").string();
  ASSERT_TRUE(terminal.shows("--mapping '" + mapping + "' --specimen 'A 1'"));
  EXPECT_EQ(terminal.wait(), -SIGINT);
  EXPECT_FALSE(std::filesystem::exists(dir_ / "out/recording.toml"));
  // What is left to say is the question that Ctrl-C answered.
  const auto open = import({path, "--mapping", mapping, "--specimen", "A 1"});
  EXPECT_EQ(open.code, kBadInput);
  EXPECT_THAT(open.text, AllOf(HasSubstr("how long is the specimen"), Not(HasSubstr("in which unit"))));
  EXPECT_EQ(import({path, "--mapping", mapping, "--specimen", "A 1", "--rest-length-mm", "94.3"}).code, 0);
}

TEST_F(Import, CtrlCAtTheFirstQuestionLeavesNothing) {
  const auto path = file("a.csv", table(strokes(), "Time,Extension,Load\r\n(s),,(N)\r\n"));
  Terminal terminal({bin("isorig"), "import", path, "--out", (dir_ / "out").string()});
  ASSERT_TRUE(terminal.shows("in which unit is the position"));
  terminal.type(Terminal::kCtrlC);
  EXPECT_EQ(terminal.wait(), -SIGINT);
  EXPECT_THAT(terminal.shown(), Not(HasSubstr("the answers are kept")));
  EXPECT_FALSE(std::filesystem::exists(dir_ / "out"));
}

TEST_F(Import, AnswersOutliveAQuestionThatIsNotAnswered) {
  const auto path = file("a.csv", table(strokes(), "Time,Extension,Load\r\n(s),,(N)\r\n"));
  Terminal terminal({bin("isorig"), "import", path, "--out", (dir_ / "out").string()});
  ASSERT_TRUE(terminal.shows("in which unit is the position"));
  terminal.type("mm\n");
  ASSERT_TRUE(terminal.shows("what is the specimen called?"));
  terminal.type(Terminal::kCtrlD);
  ASSERT_TRUE(terminal.shows("the answers are kept"));
  EXPECT_EQ(terminal.wait(), kBadInput);
  EXPECT_THAT(slurp(dir_ / "out/mapping.toml"), HasSubstr("\"Extension\" = \"mm\""));
}

/// Positions are counted from the rest length: 96 mm of a specimen of 94.3 mm are no strain of 102 %.
TEST_F(Import, ALengthIsNoPositionBeforeItsZeroIsTold) {
  auto whole = strokes();
  for (double& x : whole.position_mm) x += 94.3;
  const auto path = file("l.csv", table(whole, "time_s,length_m,force_N\r\n", 1e-3));
  const std::vector<std::string> specimen{path, "--specimen", "A 1", "--rest-length-mm", "94.3"};
  const auto asked = import(specimen);
  EXPECT_EQ(asked.code, kBadInput);
  EXPECT_THAT(asked.text, AllOf(HasSubstr("\"length_m\" is a length by its name"), HasSubstr("--zero-mm whole-length"),
                                Not(HasSubstr("which is it"))));
  auto words = specimen;
  words.insert(words.end(), {"--zero-mm", "whole-length"});
  ASSERT_EQ(import(words).code, 0);
  // Seven decimals of a metre are 1e-4 mm, rounded by half of that.
  EXPECT_NEAR(messages::read_recording(dir_ / "out").frame.position_mm.at(150), strokes().position_mm.at(150), 5.1e-5);
  // Where there is no rest length nothing is counted from it.
  EXPECT_EQ(import({path, "--specimen", "A 1", "--rest-length-mm", "none"}, "other").code, 0);
  Terminal terminal({bin("isorig"), "import", path, "--specimen", "A 1", "--rest-length-mm", "94.3", "--out",
                     (dir_ / "typed").string()});
  ASSERT_TRUE(terminal.shows("is a length by its name"));
  terminal.type("far\n");
  ASSERT_TRUE(terminal.shows("that is none of them"));
  terminal.type("-94.3\n");
  ASSERT_TRUE(terminal.shows("zero of the position at -94.3 mm (answered)"));
  ASSERT_TRUE(terminal.shows("--mapping uses it again"));
  EXPECT_THAT(import({path, "--specimen", "A 1", "--rest-length-mm", "94.3", "--zero-mm", "far"}, "far").text,
              HasSubstr("a position within 10000 mm, or whole-length"));
  EXPECT_THAT(import({path, "--specimen", "A 1", "--rest-length-mm", "none", "--zero-mm", "whole-length"}, "far").text,
              HasSubstr("--zero-mm whole-length needs --rest-length-mm"));
  // In a mapping it is of any specimen: another one has another zero.
  const auto longer =
      import({path, "--mapping", (dir_ / "out/mapping.toml").string(), "--specimen", "A 2", "--rest-length-mm", "95.3"},
             "longer");
  ASSERT_EQ(longer.code, 0) << longer.text;
  EXPECT_THAT(longer.text, HasSubstr("position by the whole length (from "));
  EXPECT_NEAR(messages::read_recording(dir_ / "longer").frame.position_mm.at(150), strokes().position_mm.at(150) - 1.0,
              5.1e-5);
}

/// A muscle that lifts a weight: the pressure goes to and fro between two values within a row, and the position follows
/// at once and creeps after it with one retardation time (2 s). Metres, as a vibrometer's log has them.
std::string lifted(bool with_force) {
  constexpr double kRow_s = 0.02, kRetardation_s = 2.0;
  constexpr int kSteps = 100;  // within a row: Euler's error is 0.02 / 2 / 100 / 2 of a stroke of 1.1 mm, 0.06 um
  const auto pressure_kPa = [](int i) { return (i + 799) % 800 < 400 ? 20.0 : 300.0; };
  std::mt19937 random(11);
  std::normal_distribution<double> noise_mm(0.0, 0.002);
  std::string text = std::string("time_s,pressure_kPa,displacement_m") + (with_force ? ",force_N" : "") + "\n";
  double crept_mm = -0.004 * pressure_kPa(1);
  char row[128];
  for (int i = 1; i <= 2000; ++i) {
    for (int k = 0; k < kSteps; ++k) {
      const double now_kPa = pressure_kPa(i - 1) + (pressure_kPa(i) - pressure_kPa(i - 1)) * (k + 0.5) / kSteps;
      crept_mm += kRow_s / kSteps / kRetardation_s * (-0.004 * (i == 1 ? pressure_kPa(1) : now_kPa) - crept_mm);
    }
    const double position_mm = -0.006 * pressure_kPa(i) + crept_mm + noise_mm(random);
    std::snprintf(row, sizeof row, "%.3f,%.3f,%.8f", kRow_s * i, pressure_kPa(i), 1e-3 * position_mm);
    text += row;
    if (with_force) text += i % 2 == 0 ? ",0.98" : ",0.99";
    text += '\n';
  }
  return text;
}

TEST_F(Import, APositionUnderALoadIsImportedAndDiagnosed) {
  const auto path = file("lift.csv", lifted(false));
  const std::vector<std::string> specimen{path, "--specimen", "coil", "--rest-length-mm", "29"};
  const auto with = [&](std::vector<std::string> more, const std::string& out = "out") {
    more.insert(more.begin(), specimen.begin(), specimen.end());
    return import(std::move(more), out);
  };
  const auto asked = with({});
  EXPECT_EQ(asked.code, kBadInput);
  EXPECT_THAT(asked.text, AllOf(HasSubstr("no column is left to be the force; what is a model to predict"),
                                HasSubstr("--output position, or --output pressure")));
  EXPECT_THAT(with({"--output", "position"}).text,
              AllOf(HasSubstr("which constant load"), HasSubstr("--load-N F, or --load-kg M")));
  EXPECT_FALSE(std::filesystem::exists(dir_ / "out"));
  const auto done = with({"--output", "position", "--load-kg", "0.1"});
  ASSERT_EQ(done.code, 0) << done.text;
  EXPECT_THAT(done.text, AllOf(HasSubstr("load 0.980665 N (--load-kg 0.1)"), HasSubstr("the output is the position"),
                               HasSubstr("force a constant load of 0.980665 N")));
  const auto recording = messages::read_recording_of_any_output(dir_ / "out");
  EXPECT_EQ(recording.metadata.output, messages::Output::kPosition);
  EXPECT_EQ(recording.frame.force_N, std::vector<double>(2000, 0.980665));
  ASSERT_TRUE(recording.pressure.has_value());
  EXPECT_THAT(slurp(dir_ / "out/recording.toml"), HasSubstr("\nforce = \"constant load\"\n"));
  const auto diagnosed =
      isorig(dir_, {"diagnose", (dir_ / "out").string(), "--model", "slse1", "--out", (dir_ / "d").string()});
  ASSERT_EQ(diagnosed.code, 0) << diagnosed.text;
  // The compliance and one retardation time are the nominal model: nothing is missing.
  EXPECT_THAT(diagnosed.text, StartsWith("nothing is missing\n"));
  // The next file of the same rig needs no word but its specimen's.
  const auto next = import({path, "--mapping", (dir_ / "out/mapping.toml").string(), "--specimen", "coil 2"}, "next");
  ASSERT_EQ(next.code, 0) << next.text;
  EXPECT_EQ(messages::read_recording_of_any_output(dir_ / "next").frame.force_N, recording.frame.force_N);
}

TEST_F(Import, AForcesColumnGoesBeforeALoad) {
  const auto path = file("lift.csv", lifted(true));
  const auto with = [&](std::vector<std::string> more, const std::string& out) {
    more.insert(more.begin(), {path, "--specimen", "coil", "--rest-length-mm", "29"});
    return import(std::move(more), out);
  };
  const auto done = with({"--output", "position"}, "out");
  ASSERT_EQ(done.code, 0) << done.text;
  EXPECT_EQ(messages::read_recording_of_any_output(dir_ / "out").frame.force_N.at(0), 0.99);
  EXPECT_THAT(slurp(dir_ / "out/recording.toml"), HasSubstr("\nforce = \"column\"\n"));
  const auto refused = with({"--output", "position", "--load-N", "1"}, "two");
  EXPECT_EQ(refused.code, kBadInput);
  EXPECT_THAT(refused.text, HasSubstr("a load is told, and no force is made of it"));
  EXPECT_FALSE(std::filesystem::exists(dir_ / "two"));
}

TEST_F(Import, AtATerminalTheOutputAndTheLoadAreAsked) {
  const auto path = file("lift.csv", lifted(false));
  Terminal terminal({bin("isorig"), "import", path, "--out", (dir_ / "out").string()});
  ASSERT_TRUE(terminal.shows("what is a model to predict"));
  terminal.type("position\n");
  ASSERT_TRUE(terminal.shows("which constant load"));
  terminal.type("heavy\n");
  ASSERT_TRUE(terminal.shows("that is none of them"));
  terminal.type("100 g\n");
  ASSERT_TRUE(terminal.shows("what is the specimen called?"));
  terminal.type("coil\n");
  ASSERT_TRUE(terminal.shows("how long is the specimen"));
  terminal.type("29\n");
  ASSERT_TRUE(terminal.shows("output position (answered), load 0.980665 N (answered)"));
  ASSERT_TRUE(terminal.shows("--mapping uses it again"));
  EXPECT_EQ(terminal.wait(), 0);
}

/// A closed volume that leaks: an exponential of 40 s towards zero.
std::string leaking() {
  std::mt19937 random(12);
  std::normal_distribution<double> noise(0.0, 0.3);
  std::string text = "time_s,pressure_kPa\n";
  char row[64];
  for (int i = 0; i < 1200; ++i) {
    std::snprintf(row, sizeof row, "%.2f,%.4f\n", 0.1 * i, 400.0 * std::exp(-0.1 * i / 40.0) + noise(random));
    text += row;
  }
  return text;
}

TEST_F(Import, APressureAloneIsImportedAndDiagnosed) {
  const auto path = file("leak.csv", leaking());
  const auto asked = import({path, "--specimen", "tube"});
  EXPECT_EQ(asked.code, kBadInput);
  EXPECT_THAT(asked.text, AllOf(HasSubstr("--output pressure"), HasSubstr("name the frame's file too")));
  const auto done = import({path, "--specimen", "tube", "--output", "pressure"});
  ASSERT_EQ(done.code, 0) << done.text;  // no length is asked for: nothing moves
  EXPECT_THAT(done.text, AllOf(HasSubstr("no frame, 1200 of pressure, 119.9 s; the output is the pressure"),
                               Not(HasSubstr("zero of the position"))));
  EXPECT_FALSE(std::filesystem::exists(dir_ / "out/frame.csv"));
  const auto recording = messages::read_recording_of_any_output(dir_ / "out");
  EXPECT_EQ(recording.metadata.output, messages::Output::kPressure);
  EXPECT_EQ(recording.pressure->size(), 1200U);
  EXPECT_FALSE(recording.metadata.rest_length_mm);
  const auto diagnosed =
      isorig(dir_, {"diagnose", (dir_ / "out").string(), "--model", "slse1", "--out", (dir_ / "d").string()});
  ASSERT_EQ(diagnosed.code, 0) << diagnosed.text;
  EXPECT_THAT(diagnosed.text, StartsWith("nothing is missing\n"));
  // Several logs are several recordings.
  const auto two = import({path, file("leak_2.csv", leaking()), "--specimen", "tube", "--output", "pressure"}, "two");
  ASSERT_EQ(two.code, 0) << two.text;
  EXPECT_TRUE(std::filesystem::exists(dir_ / "two/leak_2/pressure.csv"));
  EXPECT_THAT(import({file("a.csv", table(strokes(), kBluehill)), "--specimen", "tube", "--output", "pressure",
                      "--rest-length-mm", "94.3"},
                     "none")
                  .text,
              HasSubstr("the pressure is the output, and no column is known to be one"));
}

/// Puts the same cell behind each row of a file.
std::string with_cells(const std::string& text, const std::string& header, const std::string& cell) {
  std::string out;
  for (std::size_t at = 0, end = 0; at < text.size(); at = end + 1) {
    end = text.find('\n', at);
    out += text.substr(at, end - at) + "," + (at == 0 ? header : cell) + '\n';
  }
  return out;
}

TEST_F(Import, FurtherColumnsOfNumbersAreKeptAndWordsAreNamed) {
  const auto path = file("lift.csv", with_cells(lifted(true), "Temperature (C),Current (A),Phase", "21.5,0.25,up"));
  const auto done = import({path, "--specimen", "coil", "--rest-length-mm", "29"});
  ASSERT_EQ(done.code, 0) << done.text;
  EXPECT_THAT(done.text,
              AllOf(HasSubstr("kept as in the file: \"Temperature\" (C) as temperature_C, \"Current\" (A) as "
                              "current_A\n"),
                    HasSubstr("not kept, as they hold more than numbers or none: \"Phase\"\n")));
  const auto frame = slurp(dir_ / "out/frame.csv");
  EXPECT_THAT(frame, StartsWith("t_s,position_mm,force_N,temperature_C,current_A\n"));
  EXPECT_EQ(std::ranges::count(frame, '\n'), 2001);
  std::size_t with_both = 0;
  for (auto at = frame.find(",21.5,0.25\n"); at != std::string::npos; at = frame.find(",21.5,0.25\n", at + 1))
    ++with_both;
  EXPECT_EQ(with_both, 2000U);
  EXPECT_EQ(messages::read_recording(dir_ / "out").frame.size(), 2000U);
  EXPECT_THAT(slurp(dir_ / "out/recording.toml"),
              AllOf(HasSubstr("not_kept = [\"\\\"Phase\\\"\"]"),
                    HasSubstr("column = \"temperature_C\"\nname = \"Temperature\"\nnumber = 5\nunit = \"C\"\n")));
  // Of a pressure alone they are the pressure's.
  const auto leak = file("leak.csv", with_cells(leaking(), "Temperature (C)", "20"));
  ASSERT_EQ(import({leak, "--specimen", "tube", "--output", "pressure"}, "leak").code, 0);
  EXPECT_THAT(slurp(dir_ / "leak/pressure.csv"), StartsWith("t_s,pressure_psi,temperature_C\n"));
}

TEST_F(Import, AlignKeepsFurtherColumns) {
  const auto made = strokes(60.0);
  std::string frame = "t_s,position_mm,force_N,temperature_C,averaged\n", log = "t_s,pressure_psi,current_A\n";
  const std::vector<double> pressure_psi = pressure_beside(made);
  char row[96];
  for (std::size_t i = 1; i < made.t_s.size(); ++i) {
    std::snprintf(row, sizeof row, "%.3f,%.6f,%.4f,21.50,\n", made.t_s[i], made.position_mm[i], made.force_N[i]);
    frame += row;
    std::snprintf(row, sizeof row, "%.3f,%.4f,0.250\n", made.t_s[i] + 12.0, pressure_psi[i]);
    log += row;
  }
  const std::vector<std::string> words{"align", file("frame.csv", frame), file("log.csv", log)};
  const auto toml =
      file("recording.toml", "format = \"isorig-recording/1\"\nspecimen = \"A 1\"\nrest_length_mm = 94.3\n");
  const auto align = [&](const char* out, std::vector<std::string> more) {
    auto all = words;
    all.insert(all.end(), {"--out", (dir_ / out).string()});
    all.insert(all.end(), more.begin(), more.end());
    const auto done = isorig(dir_, all);
    EXPECT_EQ(done.code, 0) << done.text;
    EXPECT_THAT(slurp(dir_ / out / "frame.csv"),
                AllOf(StartsWith("t_s,position_mm,force_N,temperature_C,averaged\n"), HasSubstr(",21.50,\n")));
    EXPECT_THAT(slurp(dir_ / out / "pressure.csv"),
                AllOf(StartsWith("t_s,pressure_psi,current_A\n"), HasSubstr(",0.250\n")));
  };
  align("streams", {});
  align("whole", {"--toml", toml});
  EXPECT_EQ(messages::read_recording(dir_ / "whole").pressure->size(), made.t_s.size() - 1);
}

/// The same test on two clocks, in times of nanoseconds.
std::pair<std::string, std::string> streams_on_two_clocks() {
  const auto made = strokes(60.0);
  std::string frame = "t_s,position_mm,force_N\n", log = "t_s,pressure_psi,mono_ns\n";
  const std::vector<double> pressure_psi = pressure_beside(made);
  char row[96];
  for (std::size_t i = 1; i < made.t_s.size(); ++i) {
    std::snprintf(row, sizeof row, "%.3f,%.6f,%.4f\n", made.t_s[i], made.position_mm[i], made.force_N[i]);
    frame += row;
    std::snprintf(row, sizeof row, "%.9f,%.4f,%zu\n", made.t_s[i] + 12.0 + 1e-9 * static_cast<double>(i % 7),
                  pressure_psi[i], 1'000'000'000 + i);
    log += row;
  }
  return {frame, log};
}

TEST_F(Import, AlignDestroysNothing) {
  const auto [frame, log] = streams_on_two_clocks();
  for (const char* folder : {"in", "linked", "hard", "other", "recording"})
    std::filesystem::create_directories(dir_ / folder);
  const auto frame_file = file("in/frame.csv", frame), log_file = file("in/pressure.csv", log);
  const auto align = [&](const char* out, std::vector<std::string> more = {}) {
    std::vector<std::string> words{"align", frame_file, log_file, "--out", (dir_ / out).string()};
    words.insert(words.end(), more.begin(), more.end());
    return isorig(dir_, words);
  };
  std::filesystem::create_symlink("../in/pressure.csv", dir_ / "linked/pressure.csv");
  std::filesystem::create_hard_link(log_file, dir_ / "hard/pressure.csv");
  for (const char* out : {"in", "linked", "hard"}) {
    for (const auto& more : {std::vector<std::string>{}, {"--replace"}}) {
      const auto refused = align(out, more);
      EXPECT_EQ(refused.code, kBadInput) << out;
      EXPECT_THAT(refused.text, HasSubstr(".csv: is what the numbers are read from")) << out;
    }
    EXPECT_FALSE(std::filesystem::exists(dir_ / out / "align.json"));
  }
  const auto toml =
      file("recording/recording.toml", "format = \"isorig-recording/1\"\nspecimen = \"A 1\"\nrest_length_mm = 94.3\n");
  EXPECT_THAT(align("recording", {"--toml", toml, "--replace"}).text,
              HasSubstr("recording.toml: is what the numbers are read from"));
  // The streams of one test below the specimen of another.
  for (const auto& more : {std::vector<std::string>{}, {"--replace"}})
    EXPECT_THAT(align("recording", more).text,
                HasSubstr("its recording.toml would be taken for that of these streams"));
  file("other/frame.csv", "somebody's\n");
  const auto refused = align("other");
  EXPECT_EQ(refused.code, kBadInput);
  EXPECT_THAT(refused.text, HasSubstr("frame.csv: is there already; name another folder with --out, or --replace it"));
  EXPECT_EQ(slurp(dir_ / "other/frame.csv"), "somebody's\n");
  EXPECT_EQ(slurp(frame_file), frame);
  EXPECT_EQ(slurp(log_file), log);
  const auto done = align("other", {"--replace"});
  ASSERT_EQ(done.code, 0) << done.text;
  EXPECT_EQ(slurp(dir_ / "other/frame.csv"), frame);
}

TEST_F(Import, AlignKeepsNanoseconds) {
  const auto [frame, log] = streams_on_two_clocks();
  const std::vector<std::string> words{"align", file("f.csv", frame), file("p.csv", log), "--out",
                                       (dir_ / "out").string()};
  const auto done = isorig(dir_, words);
  ASSERT_EQ(done.code, 0) << done.text;
  const auto before = messages::read_pressure_csv(dir_ / "p.csv");
  const auto after = messages::read_pressure_csv(dir_ / "out/pressure.csv");
  ASSERT_EQ(after.size(), before.size());
  // The mapping is a straight line: what a time is off the one between two others is as it was.
  for (std::size_t i = 1; i + 1 < before.size(); ++i) {
    const auto bent = [i](const std::vector<double>& t) { return t[i] - 0.5 * (t[i - 1] + t[i + 1]); };
    ASSERT_NEAR(bent(after.t_s), bent(before.t_s), 1e-11) << i;
  }
  EXPECT_EQ(after.pressure_psi, before.pressure_psi);
  EXPECT_THAT(slurp(dir_ / "out/pressure.csv"), HasSubstr(",1000000001\n"));
}

/// A log without a stroke in it: what an earlier call aligned stays, and no align.json says that it is not.
TEST_F(Import, AnAlignmentThatFailsReplacesNothing) {
  const auto [frame, log] = streams_on_two_clocks();
  const auto frame_file = file("f.csv", frame);
  std::string flat = "t_s,pressure_psi\n";
  for (int i = 0; i < 3000; ++i) flat += std::to_string(0.02 * i) + ",10.0" + std::to_string(i * 7919 % 97) + "\n";
  const auto flat_file = file("flat.csv", flat), log_file = file("p.csv", log);
  const auto align = [&](const std::string& pressure, std::vector<std::string> more) {
    more.insert(more.begin(), {"align", frame_file, pressure, "--out", (dir_ / "out").string()});
    return isorig(dir_, more).code;
  };
  EXPECT_EQ(align(flat_file, {}), 1);
  EXPECT_THAT(slurp(dir_ / "out/align.json"), HasSubstr("\"aligned\": false"));
  ASSERT_EQ(align(log_file, {"--replace"}), 0);
  const auto made = slurp(dir_ / "out/align.json");
  EXPECT_THAT(made, HasSubstr("\"aligned\": true"));
  EXPECT_EQ(align(flat_file, {"--replace"}), 1);
  EXPECT_EQ(slurp(dir_ / "out/align.json"), made);
}

/// What never changes was told, or is dead.
TEST_F(Import, AForceThatNeverChangesIsNoMeasurement) {
  auto dead = strokes();
  std::ranges::fill(dead.force_N, 12.5);
  const auto path = file("dead.csv", table(dead, kBluehill));
  const auto refused = import_of_specimen({path});
  EXPECT_EQ(refused.code, kBadInput);
  const std::string rows = " in all " + std::to_string(dead.t_s.size()) + " rows";
  EXPECT_THAT(
      refused.text,
      AllOf(HasSubstr("dead.csv:3: column \"Load\" (N) never changes: 12.5 N" + rows + ", so no force was measured"),
            HasSubstr("--column force=NAME"), HasSubstr("--output position"), HasSubstr("--as-stated")));
  EXPECT_FALSE(std::filesystem::exists(dir_ / "out"));
  const auto stated = import_of_specimen({path, "--as-stated"}, "stated");
  ASSERT_EQ(stated.code, 0) << stated.text;
  EXPECT_THAT(stated.text, HasSubstr("note: column \"Load\" (N) never changes: 12.5 N"));
  EXPECT_THAT(slurp(dir_ / "stated/recording.toml"), HasSubstr("never changes"));
  // As a load it may be constant, and a crosshead may stand still; that is said.
  EXPECT_EQ(import_of_specimen({path, "--output", "position"}, "load").code, 0);
  auto still = strokes();
  std::ranges::fill(still.position_mm, 1.0);
  const auto isometric = import_of_specimen({file("still.csv", table(still, kBluehill))}, "still");
  ASSERT_EQ(isometric.code, 0) << isometric.text;
  EXPECT_THAT(isometric.text, HasSubstr("note: column \"Extension\" (mm) never changes: 1 mm" + rows));
}

TEST_F(Import, ARowOfUnitsWithoutBracketsIsTaken) {
  const auto text = [](const std::string& names, const std::string& units) {
    return table(strokes(), names + "\r\n" + units + "\r\n", 1.0, 1e-3);
  };
  const auto done = import_of_specimen({file("bare.csv", text("time,position,force", "s,mm,kN"))});
  ASSERT_EQ(done.code, 0) << done.text;
  EXPECT_NEAR(messages::read_recording(dir_ / "out").frame.force_N.at(0), 17.0, 1e-9);
  const auto unknown = import_of_specimen({file("odd.csv", text("time,position,force", "s,mm,klbf"))}, "odd");
  EXPECT_EQ(unknown.code, kBadInput);
  EXPECT_THAT(unknown.text,
              AllOf(HasSubstr("odd.csv:1: column \"force\" (klbf) is in \"klbf\", which is no unit of a force (line 2, "
                              "column 3)"),
                    HasSubstr("--unit 'force=N'")));
}

TEST_F(Import, OfARecordingThatIsReplacedNothingStays) {
  const auto path = file("a.csv", table(strokes(), kBluehill));
  ASSERT_EQ(import_of_specimen({path}).code, 0);
  file("out/ramps.csv", "step\n1\n");
  file("out/notes.txt", "somebody's\n");
  const auto done = import_of_specimen({path, "--replace"});
  ASSERT_EQ(done.code, 0) << done.text;
  EXPECT_THAT(done.text, AllOf(HasSubstr("removed with the recording that was there: ramps.csv\n"),
                               HasSubstr("left alone, as no part of a recording: notes.txt\n")));
  EXPECT_FALSE(std::filesystem::exists(dir_ / "out/ramps.csv"));
  EXPECT_EQ(slurp(dir_ / "out/notes.txt"), "somebody's\n");
  // A table of the recording may be what is read.
  const auto ramps = file("out/ramps.csv", table(strokes(), kBluehill));
  EXPECT_THAT(import_of_specimen({ramps, "--replace"}).text, HasSubstr("ramps.csv: is what the numbers are read from"));
  EXPECT_TRUE(std::filesystem::exists(ramps));
  std::filesystem::remove(ramps);
  // Of an import with more tests, or of one alone, recordings stay beside the new ones.
  const auto two =
      table(strokes(), kBluehill) + "\r\n" + table(strokes(12.0), "Time,Extension,Load\r\n(s),(mm),(N)\r\n");
  const auto several = import_of_specimen({file("two.csv", two), "--replace"});
  ASSERT_EQ(several.code, 0) << several.text;
  EXPECT_THAT(several.text, HasSubstr("note: " + (dir_ / "out").string() + " is a recording that was there before"));
}

TEST_F(Import, MetresThatAreCalledMillimetresAreRefused) {
  const auto path = file("m.csv", table(strokes(), kBluehill, 1e-3));
  const auto refused = import_of_specimen({path});
  EXPECT_EQ(refused.code, kBadInput);
  EXPECT_THAT(refused.text,
              AllOf(HasSubstr("a stroke of 0.002 mm"), HasSubstr("is a unit wrong?"), HasSubstr("--unit COLUMN=UNIT")));
  EXPECT_FALSE(std::filesystem::exists(dir_ / "out"));
  ASSERT_EQ(import_of_specimen({path, "--unit", "Extension=m"}).code, 0);
  EXPECT_NEAR(messages::read_recording(dir_ / "out").frame.position_mm.at(100), strokes().position_mm.at(100), 1e-4);
  EXPECT_EQ(import_of_specimen({path, "--as-stated"}, "stated").code, 0);
}

TEST_F(Import, ASignThatIsTurnedRoundIsRefusedHereAndByFv) {
  const auto path = file("c.csv", table(strokes(), kBluehill, 1.0, -1.0));
  const auto refused = import_of_specimen({path});
  EXPECT_EQ(refused.code, kBadInput);
  EXPECT_THAT(refused.text,
              AllOf(HasSubstr("which no spring of the model can"), HasSubstr("--positive force=compression")));
  ASSERT_EQ(import_of_specimen({path, "--positive", "force=compression"}).code, 0);
  EXPECT_NEAR(messages::read_recording(dir_ / "out").frame.force_N.at(0), 17.0, 1e-5);
  ASSERT_EQ(import_of_specimen({path, "--as-stated"}, "stated").code, 0);
  const auto fv = isorig(dir_, {"fv", (dir_ / "stated").string(), "--out", (dir_ / "fv").string()});
  EXPECT_EQ(fv.code, kBadInput);
  EXPECT_THAT(fv.text, HasSubstr("is the sign of force_N or of position_mm turned round?"));
}

/// The paper's data: force and length by the testing machine, pressure by a microcontroller that was switched on
/// before.
TEST_F(Import, ALogOfAnotherClockIsAlignedByItsStrokes) {
  constexpr double kOffset_s = 412.25, kNoise_psi = 0.002, kRecovery_per_s = 1.5, kResponse_psi_mm = 0.05;
  const auto made = strokes(60.0);
  std::mt19937 random(7);
  std::normal_distribution<double> noise(0.0, kNoise_psi);
  std::string log;
  double response = 0.0;
  for (std::size_t i = 1; i < made.t_s.size(); ++i) {
    response = response * std::exp(-kRecovery_per_s * 0.02) + made.position_mm[i] - made.position_mm[i - 1];
    char row[64];
    std::snprintf(row, sizeof row, "%lld,%.4f\n", std::llround((made.t_s[i] + kOffset_s) * 1e6),
                  10.0 + kResponse_psi_mm * response + noise(random));
    log += row;
  }
  const std::vector<std::string> words{file("frame.csv", table(made, kBluehill)),
                                       file("log.txt", log),
                                       "--column",
                                       "time=#1",
                                       "--column",
                                       "pressure=#2",
                                       "--unit",
                                       "#1=us",
                                       "--unit",
                                       "#2=psi"};
  const auto done = import_of_specimen(words);
  ASSERT_EQ(done.code, 0) << done.text;
  EXPECT_THAT(done.text, HasSubstr("two, aligned by"));
  const auto recording = messages::read_recording(dir_ / "out");
  ASSERT_TRUE(recording.pressure.has_value());
  // One sample of either file is 20 ms.
  EXPECT_NEAR(recording.pressure->t_s.at(1000), made.t_s.at(1001), 0.02);
  auto one_clock = words;
  one_clock.emplace_back("--one-clock");
  EXPECT_THAT(import_of_specimen(one_clock, "one").text, HasSubstr("no moment in common"));
  const auto alone = import_of_specimen({words.begin() + 1, words.end()}, "alone");
  EXPECT_THAT(alone.text, HasSubstr("name the frame's file too"));
}

TEST_F(Import, ANameThatNoColumnHasIsNotIgnored) {
  const auto path = file("a.csv", table(strokes(), kBluehill));
  for (const auto& [option, value] :
       {std::pair{"--column", "force=Laod"}, {"--unit", "Extensoin=in"}, {"--unit", "#3=kN"}}) {
    const auto refused = import_of_specimen({path, option, value});
    EXPECT_EQ(refused.code, kBadInput);
    EXPECT_THAT(refused.text, AllOf(HasSubstr(std::string(option) + " " + value + ": no column is called"),
                                    HasSubstr("there are \"Time\" (s), \"Extension\" (mm), \"Load\" (N)")));
    EXPECT_FALSE(std::filesystem::exists(dir_ / "out"));
  }
  // A mapping is for other files too: what it has besides is said, and no fault.
  const auto mapping = file("mapping.toml", "format = \"isorig-mapping/1\"\n[unit]\nForce2 = \"N\"\n");
  const auto done = import_of_specimen({path, "--mapping", mapping});
  ASSERT_EQ(done.code, 0) << done.text;
  EXPECT_THAT(done.text, HasSubstr("mapping.toml: no column is called \"Force2\"; it was left aside"));
}

/// The numbers' only copy may be called what a recording's files are called.
TEST_F(Import, WhatItReadsIsNotReplacedByWhatItWrites) {
  const auto raw = file("frame.csv", table(strokes(), kBluehill));
  for (const bool replace : {false, true}) {
    const auto refused =
        import_of_specimen(replace ? std::vector<std::string>{raw, "--replace"} : std::vector<std::string>{raw}, ".");
    EXPECT_EQ(refused.code, 3);
    EXPECT_THAT(refused.text, HasSubstr("frame.csv: is what the numbers are read from"));
    EXPECT_EQ(slurp(raw), table(strokes(), kBluehill));
    EXPECT_FALSE(std::filesystem::exists(dir_ / "recording.toml"));
  }
  // Another's file of that name needs --replace as well.
  std::filesystem::create_directories(dir_ / "other");
  file("other/frame.csv", "somebody's\n");
  EXPECT_THAT(import_of_specimen({raw}, "other").text, HasSubstr("frame.csv: is there already"));
  EXPECT_EQ(slurp(dir_ / "other/frame.csv"), "somebody's\n");
  EXPECT_EQ(import_of_specimen({raw, "--replace"}, "other").code, 0);
}

TEST_F(Import, WrongOptionsAreNamed) {
  const auto path = file("a.csv", table(strokes(), kBluehill));
  EXPECT_THAT(import_of_specimen({path, "--unit", "Load=pound"}).text,
              HasSubstr("unknown unit \"pound\"; time: s, ms"));
  EXPECT_THAT(import_of_specimen({path, "--column", "kraft=Load"}).text,
              HasSubstr("time|position|force|pressure=NAME"));
  EXPECT_THAT(import_of_specimen({path, "--positive", "force=up"}).text, HasSubstr("tension|compression"));
  EXPECT_THAT(import_of_specimen({(dir_ / "none.csv").string()}).text, HasSubstr("none.csv: no such file"));
  EXPECT_THAT(import_of_specimen({file("text", "hello\n")}).text, HasSubstr("no table of numbers is in it"));
  EXPECT_THAT(import_of_specimen({file("mapping.toml", "format = \"isorig-mapping/1\"\n[unit]\nLoad = \"pound\"\n"),
                                  "--mapping", (dir_ / "mapping.toml").string()})
                  .text,
              HasSubstr("mapping.toml:3"));
  EXPECT_FALSE(std::filesystem::exists(dir_ / "out"));
}

}  // namespace
}  // namespace isorig::system_test
