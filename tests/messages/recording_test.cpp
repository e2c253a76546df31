#include "messages/recording.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/inotify.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cmath>
#include <csignal>
#include <cstdlib>
#include <ctime>
#include <fstream>
#include <limits>
#include <random>
#include <sstream>

#include "messages/further_columns.hpp"
#include "tree.hpp"

namespace isorig::messages {
namespace {

namespace fs = std::filesystem;
using ::testing::AllOf;
using ::testing::HasSubstr;
using Fault = RecordingFault;

constexpr const char* kToml =
    "format = \"isorig-recording/1\"\nspecimen = \"A-3\"\nrest_length_mm = 90.0\n"
    "pressurized_rest_length_mm = 75.0\nnominal_pressure_psi = 15\n";
constexpr const char* kFrame = "t_s,position_mm,force_N\n0.0,-0.5,44.5\n0.1,1e-3,-2\n0.25,3,1.25\n";
constexpr const char* kPressure = "t_s,pressure_psi\n0.003,20.0008\n0.203,19.9824\n";

class RecordingTest : public ::testing::Test {
 protected:
  void SetUp() override {
    const auto* test = ::testing::UnitTest::GetInstance()->current_test_info();
    folder_ = fs::temp_directory_path() / ("isorig-recording-" + std::to_string(::getpid()) + "-" + test->name());
    fs::remove_all(folder_);
    fs::create_directories(folder_);
    put("recording.toml", kToml);
    put("frame.csv", kFrame);
    put("pressure.csv", kPressure);
  }
  void TearDown() override { fs::remove_all(folder_); }

  void put(const char* name, std::string_view text) const { std::ofstream(folder_ / name, std::ios::binary) << text; }
  std::string get(const char* name) const {
    std::ostringstream text;
    text << std::ifstream(folder_ / name, std::ios::binary).rdbuf();
    return text.str();
  }

  std::vector<std::string> names() const {
    std::vector<std::string> out;
    for (const auto& entry : fs::directory_iterator(folder_)) out.push_back(entry.path().filename().string());
    return out;
  }

  /// The whole recording has to be refused with this fault, naming file and line.
  void expect_fault(Fault fault, const char* file, std::size_t line, const ::testing::Matcher<std::string>& text) {
    try {
      static_cast<void>(read_recording(folder_));
      ADD_FAILURE() << "was read";
    } catch (const RecordingError& e) {
      EXPECT_EQ(e.fault(), fault) << e.what();
      EXPECT_EQ(e.file(), folder_ / file) << e.what();
      EXPECT_EQ(e.line(), line) << e.what();
      EXPECT_THAT(e.what(), text);
      const std::string place = (folder_ / file).string() + (line > 0 ? ":" + std::to_string(line) : "") + ": ";
      EXPECT_THAT(e.what(), ::testing::StartsWith(place));
    }
  }

  void expect_frame_fault(std::string_view csv, Fault fault, std::size_t line,
                          const ::testing::Matcher<std::string>& text) {
    SCOPED_TRACE(csv);
    put("frame.csv", csv);
    expect_fault(fault, "frame.csv", line, text);
  }

  fs::path folder_;
};

TEST_F(RecordingTest, ReadsAllThreeFiles) {
  const auto r = read_recording(folder_);
  EXPECT_EQ(r.metadata.specimen, "A-3");
  EXPECT_EQ(r.metadata.rest_length_mm, 90.0);
  EXPECT_EQ(r.metadata.pressurized_rest_length_mm, 75.0);
  EXPECT_EQ(r.metadata.nominal_pressure_psi, 15.0);
  EXPECT_EQ(r.metadata.further_toml, "");
  EXPECT_EQ(r.frame.t_s, (std::vector{0.0, 0.1, 0.25}));
  EXPECT_EQ(r.frame.position_mm, (std::vector{-0.5, 1e-3, 3.0}));
  EXPECT_EQ(r.frame.force_N, (std::vector{44.5, -2.0, 1.25}));
  ASSERT_TRUE(r.pressure);
  EXPECT_EQ(r.pressure->t_s, (std::vector{0.003, 0.203}));
  EXPECT_EQ(r.pressure->pressure_psi, (std::vector{20.0008, 19.9824}));
}

TEST_F(RecordingTest, StrainIsThePapers) {
  const auto r = read_recording(folder_);
  // At -15 mm the specimen has its pressurized length of 75 mm; 7.5 mm further it is strained by a tenth.
  EXPECT_DOUBLE_EQ(r.strain(-15.0), 0.0);
  EXPECT_DOUBLE_EQ(r.strain(-7.5), 0.1);
  EXPECT_DOUBLE_EQ(r.metadata.position_mm(0.1), -7.5);
  EXPECT_THAT(r.strain(), ::testing::ElementsAre(::testing::DoubleNear((90 - 0.5 - 75) / 75.0, 1e-15),
                                                 ::testing::DoubleNear((90 + 1e-3 - 75) / 75.0, 1e-15),
                                                 ::testing::DoubleNear((90 + 3.0 - 75) / 75.0, 1e-15)));
}

TEST_F(RecordingTest, PneumaticPartIsOptional) {
  fs::remove(folder_ / "pressure.csv");
  put("recording.toml", "format = \"isorig-recording/1\"\nspecimen = \"tape\"\nrest_length_mm = 100\n");
  const auto r = read_recording(folder_);
  EXPECT_FALSE(r.pressure);
  EXPECT_FALSE(r.metadata.pressurized_rest_length_mm);
  EXPECT_FALSE(r.metadata.nominal_pressure_psi);
  EXPECT_DOUBLE_EQ(r.strain(5.0), 0.05);
}

TEST_F(RecordingTest, FurtherKeysAreKeptVerbatim) {
  const std::string further =
      "# by hand\noperator = 'jo'  # two letters\ngains = [\n  1,\n  2.50,\n]\n[rig]\nname = \"b\"\n";
  put("recording.toml", std::string("\"specimen\" = \"\"\"A-3\n2\"\"\"\n") + further.substr(0, 10) +
                            "rest_length_mm = 9e1 # ruler\nformat = \"isorig-recording/1\"\n" + further.substr(10));
  auto r = read_recording(folder_);
  EXPECT_EQ(r.metadata.specimen, "A-3\n2");
  EXPECT_EQ(r.metadata.further_toml, further);
  r.metadata.specimen = "quote \" and \\ and \xC3\xA9";
  write_recording(folder_, r);
  const auto again = read_recording(folder_);
  EXPECT_EQ(again.metadata.further_toml, further);
  EXPECT_EQ(again.metadata.specimen, r.metadata.specimen);
}

TEST_F(RecordingTest, WhatHasNoLengthHasNoStrain) {
  put("recording.toml", "format = \"isorig-recording/1\"\nspecimen = \"damper\"\n");
  const Recording r = read_recording(folder_);
  EXPECT_FALSE(r.metadata.rest_length_mm);
  EXPECT_TRUE(std::isnan(r.strain(5.0)));
  EXPECT_EQ(r.metadata.elongation_at_zero_mm(), 0.0);
  EXPECT_EQ(unit_in_doubt(r.metadata, r.frame), "");
  write_recording(folder_, r);
  EXPECT_FALSE(read_recording(folder_).metadata.rest_length_mm);
}

TEST_F(RecordingTest, BadMetadata) {
  const auto expect = [this](const char* toml, Fault fault, std::size_t line, const char* text) {
    SCOPED_TRACE(toml);
    put("recording.toml", toml);
    expect_fault(fault, "recording.toml", line, HasSubstr(text));
  };
  expect("specimen = \"a\"\nrest_length_mm = 90\n", Fault::kMetadata, 1, "`format` is missing");
  expect("format = 1\nspecimen = \"a\"\nrest_length_mm = 90\n", Fault::kMetadata, 1, "`format` is an integer");
  expect("specimen = \"a\"\nrest_length_mm = 90\nformat = \"isorig-recording/2\"\n", Fault::kFormat, 3,
         "isorig-recording/1");
  expect("format = \"isorig-recording/1\"\nspecimen = \"a\"\npressurized_rest_length_mm = 9\n", Fault::kMetadata, 3,
         "without `rest_length_mm`");
  expect("format = \"isorig-recording/1\"\nrest_length_mm = 9\n", Fault::kMetadata, 1, "`specimen` is missing");
  expect("format = \"isorig-recording/1\"\nspecimen = \"a\"\nrest_length_mm = 0\n", Fault::kMetadata, 3, "above 0");
  expect("format = \"isorig-recording/1\"\nspecimen = \"a\"\nrest_length_mm = nan\n", Fault::kMetadata, 3, "nan");
  expect("format = \"isorig-recording/1\"\nspecimen = \"a\"\nrest_length_mm = 9\nnominal_pressure_psi = \"x\"\n",
         Fault::kMetadata, 4, "number is needed");
  expect("format = \"isorig-recording/1\"\nspecimen = \"a\nrest_length_mm = 9\n", Fault::kMetadata, 2,
         "not valid TOML");
  const std::string good = "format = \"isorig-recording/1\"\nspecimen = \"a\"\nrest_length_mm = 9\n";
  // Of other outputs: what analyses forces says so, and says who answers.
  for (const char* output : {"position", "pressure"})
    expect((good + "output = \"" + output + "\"\n").c_str(), Fault::kMetadata, 0,
           "`isorig diagnose` and `isorig predict` answer");
  expect((good + "output = \"forse\"\n").c_str(), Fault::kMetadata, 4, "one of \"force\" \"position\" \"pressure\"");
  expect((good + "output = 1\n").c_str(), Fault::kMetadata, 4, "`output` is an integer");
  put("recording.toml", good + "output = \"force\"\n");
  EXPECT_EQ(read_recording(folder_).metadata.output, Output::kForce);
  fs::remove(folder_ / "recording.toml");
  expect_fault(Fault::kMissingFile, "recording.toml", 0, HasSubstr("no such file"));
}

TEST_F(RecordingTest, MissingAndUnreadableFiles) {
  fs::remove(folder_ / "frame.csv");
  expect_fault(Fault::kMissingFile, "frame.csv", 0, HasSubstr("no such file"));
  fs::create_directory(folder_ / "frame.csv");
  expect_fault(Fault::kUnreadable, "frame.csv", 0, HasSubstr("it is a folder"));
  fs::remove_all(folder_ / "frame.csv");
  ASSERT_EQ(::mkfifo((folder_ / "frame.csv").c_str(), 0600), 0);
  expect_fault(Fault::kUnreadable, "frame.csv", 0, HasSubstr("is a pipe and no file"));
  fs::remove(folder_ / "frame.csv");
  put("frame.csv", kFrame);
  fs::remove(folder_ / "pressure.csv");
  fs::create_symlink("gone.csv", folder_ / "pressure.csv");
  expect_fault(Fault::kMissingFile, "pressure.csv", 0, HasSubstr("no such file"));
  try {
    static_cast<void>(read_recording(folder_ / "nowhere"));
    FAIL() << "was read";
  } catch (const RecordingError& e) {
    EXPECT_EQ(e.fault(), Fault::kMissingFile);
    EXPECT_THAT(e.what(), HasSubstr("no such folder"));
  }
}

TEST_F(RecordingTest, AFolderOfRecordingsIsNamedAsSuch) {
  const auto parent = folder_.parent_path() / "of-two";
  fs::create_directories(parent / "b");
  fs::create_directories(parent / "a");
  fs::create_directories(parent / "notes");
  for (const char* name : {"a", "b"}) fs::copy(folder_ / "recording.toml", parent / name / "recording.toml");
  try {
    static_cast<void>(read_recording(parent));
    FAIL() << "was read";
  } catch (const RecordingError& e) {
    EXPECT_EQ(e.fault(), Fault::kMissingFile);
    EXPECT_THAT(e.what(), HasSubstr("a folder of 2 (a, ...)"));
    EXPECT_THAT(e.what(), HasSubstr((parent / "*").string()));
  }
  fs::remove_all(parent);
}

TEST_F(RecordingTest, ARunIsNamedAsSuch) {
  const auto run = folder_.parent_path() / "a-run";
  fs::create_directories(run / "recordings");
  std::ofstream(run / "run.toml") << "format = \"isorig-run/1\"\n";
  try {
    static_cast<void>(read_recording(run));
    FAIL() << "was read";
  } catch (const RecordingError& e) {
    EXPECT_EQ(e.fault(), Fault::kMissingFile);
    EXPECT_THAT(e.what(), HasSubstr("a run, and not a recording: `isorig export " + run.string() + " --out DIR`"));
  }
  fs::remove_all(run);
}

TEST_F(RecordingTest, Headers) {
  expect_frame_fault("", Fault::kEmpty, 1, HasSubstr("t_s,position_mm,force_N"));
  expect_frame_fault("\n0,0,0\n", Fault::kHeader, 1, HasSubstr("expected `t_s,position_mm,force_N`"));
  expect_frame_fault("t_s,position_mm\n0,0\n", Fault::kHeader, 1, HasSubstr("column `force_N` is missing"));
  expect_frame_fault("t_s,force_N,position_mm\n0,0,0\n", Fault::kHeader, 1, HasSubstr("expected"));
  expect_frame_fault("t_s,position_mm,x,force_N\n0,0,0,0\n", Fault::kHeader, 1, HasSubstr("expected"));
  expect_frame_fault("t_s,position_mm,force_Newton\n0,0,0\n", Fault::kHeader, 1, HasSubstr("`force_N` is missing"));
  expect_frame_fault("t_s,position_mm,force_N,\n0,0,0,0\n", Fault::kHeader, 1, HasSubstr("without a name"));
  expect_frame_fault("t_s,position_mm,force_N,t_s\n0,0,0,0\n", Fault::kHeader, 1, HasSubstr("twice"));
  expect_frame_fault("t_s,position_in,force_N\n0,0,0\n", Fault::kHeader, 1, HasSubstr("`position_mm` is missing"));
  expect_frame_fault("0,0,0\n1,0,0\n", Fault::kHeader, 1, HasSubstr("expected"));
  expect_frame_fault("t_s,position_mm,force_N", Fault::kEmpty, 2, HasSubstr("no rows"));
  expect_frame_fault("t_s,position_mm,force_N\n", Fault::kEmpty, 2, HasSubstr("no rows"));
  put("frame.csv", kFrame);
  put("pressure.csv", "t_s,pressure_psi\n");
  expect_fault(Fault::kEmpty, "pressure.csv", 2, HasSubstr("no rows"));
}

TEST_F(RecordingTest, ByteOrderMarkAndCrLfAreRead) {
  put("frame.csv", "\xEF\xBB\xBFt_s,position_mm,force_N\r\n0,1,2\r\n1,3,4\r\n");
  EXPECT_EQ(read_recording(folder_).frame.force_N, (std::vector{2.0, 4.0}));
  put("frame.csv", "t_s,position_mm,force_N\r\n0, +1 ,2\n1,3,4\n");
  EXPECT_EQ(read_recording(folder_).frame.position_mm, (std::vector{1.0, 3.0}));
}

TEST_F(RecordingTest, BadCells) {
  const std::string head = "t_s,position_mm,force_N\n0,0,0\n";
  expect_frame_fault(head + "1,abc,0\n2,0,0\n", Fault::kNotNumber, 3,
                     AllOf(HasSubstr("position_mm"), HasSubstr("abc")));
  expect_frame_fault(head + "1,0,\n", Fault::kNotNumber, 3, HasSubstr("force_N"));
  expect_frame_fault(head + "1,0,1.2.3\n", Fault::kNotNumber, 3, HasSubstr("1.2.3"));
  expect_frame_fault(head + "1,0,0x10\n", Fault::kNotNumber, 3, HasSubstr("0x10"));
  expect_frame_fault(head + "1,0,+-1\n", Fault::kNotNumber, 3, HasSubstr("force_N"));
  expect_frame_fault(head + std::string("1,0,\0\n", 6), Fault::kNotNumber, 3, HasSubstr("force_N"));
  expect_frame_fault(head + "1,nan,0\n", Fault::kNotFinite, 3, HasSubstr("finite"));
  expect_frame_fault(head + "1,0,NaN\n", Fault::kNotFinite, 3, HasSubstr("force_N"));
  expect_frame_fault(head + "1,0,-inf\n", Fault::kNotFinite, 3, HasSubstr("force_N"));
  expect_frame_fault(head + "nan,0,0\n", Fault::kNotFinite, 3, HasSubstr("t_s"));
  expect_frame_fault(head + "1,0,1e999\n", Fault::kNotFinite, 3, HasSubstr("1e999"));
  expect_frame_fault(head + "1,0\n2,0,0\n", Fault::kColumns, 3, HasSubstr("2 cells, expected 3"));
  expect_frame_fault(head + "1,0,0,0\n", Fault::kColumns, 3, HasSubstr("4 cells"));
  expect_frame_fault(head + "1,0,0\n\n2,0,0\n", Fault::kColumns, 4, HasSubstr("empty line"));
}

TEST_F(RecordingTest, TimeHasToIncrease) {
  const std::string head = "t_s,position_mm,force_N\n0,0,0\n1,0,0\n";
  expect_frame_fault(head + "0.999,0,0\n", Fault::kTime, 4, HasSubstr("backwards: 0.999 s after 1 s"));
  expect_frame_fault(head + "1,0,0\n", Fault::kTime, 4, HasSubstr("stands still"));
  put("frame.csv", kFrame);
  put("pressure.csv", "t_s,pressure_psi\n1,2\n0.5,2\n");
  expect_fault(Fault::kTime, "pressure.csv", 3, HasSubstr("backwards"));
}

TEST_F(RecordingTest, FurtherColumnsAreCountedAndLeftAlone) {
  put("frame.csv", "t_s,position_mm,force_N,temperature_C,note\r\n0,1,2,21.5,\r\n1, 3,4,,\"warm\"\r\n");
  put("pressure.csv", "t_s,pressure_psi,mono_ns\n0,5,9223372036854775807\n");
  const auto r = read_recording(folder_);
  EXPECT_EQ(r.frame.position_mm, (std::vector<double>{1, 3}));
  EXPECT_EQ(r.frame.force_N, (std::vector<double>{2, 4}));
  EXPECT_EQ(r.pressure->pressure_psi, std::vector<double>{5});
  const std::string head = "t_s,position_mm,force_N,temperature_C\n0,0,0,21\n";
  expect_frame_fault(head + "1,0,0\n", Fault::kColumns, 3, HasSubstr("3 cells, expected 4"));
  expect_frame_fault(head + "1,0,0,21,\n", Fault::kColumns, 3, HasSubstr("5 cells, expected 4"));
  expect_frame_fault(head + "1,0,0", Fault::kTruncated, 3, HasSubstr("cut off"));
  expect_frame_fault(head + "1,0,x,21\n", Fault::kNotNumber, 3, HasSubstr("force_N"));
}

TEST_F(RecordingTest, FurtherColumnsAreCarriedAsTheyStand) {
  put("frame.csv",
      "\xEF\xBB\xBFt_s,position_mm,force_N,mono_ns,note, temperature_C\r\n0,1,2,1672284036844000,up,21.50\r\n"
      "1,2,3,,down,\r\n");
  const auto read = read_recording(folder_);
  const FurtherColumns further{read_further_columns(folder_ / "frame.csv", kFrameColumns),
                               read_further_columns(folder_ / "pressure.csv", kPressureColumns)};
  ASSERT_EQ(further.frame.size(), 3U);
  EXPECT_TRUE(further.pressure.empty());
  write_recording(folder_, read, further);
  EXPECT_EQ(get("frame.csv"),
            "t_s,position_mm,force_N,mono_ns,note,temperature_C\n0,1,2,1672284036844000,up,21.50\n1,2,3,,down,\n");
  EXPECT_EQ(read_recording(folder_).frame.force_N, read.frame.force_N);
  // Nothing is written that could not be read back.
  const auto refuses = [&](const FurtherColumn& column, const char* why) {
    try {
      write_recording(folder_, read, {{column}, {}});
      ADD_FAILURE() << "was written: " << why;
    } catch (const RecordingError& e) {
      EXPECT_EQ(e.fault(), Fault::kInconsistent);
      EXPECT_THAT(e.what(), HasSubstr(why));
    }
  };
  refuses({"current_A", {"1"}}, "`current_A` has 1 rows, `t_s` has 2");
  refuses({"force_N", {"1", "2"}}, "two columns are called `force_N`");
  refuses({"current_A", {"1,5", "2"}}, "a comma, a quote or a line end");
  refuses({" ", {"1", "2"}}, "has no name");
}

TEST_F(RecordingTest, TruncatedAtAnyByteIsNeverReadAsWhole) {
  const std::string whole = "t_s,position_mm,force_N\n0.000,1.00,44.5150\n0.125,1.00,44.5100\n0.250,1.50,40.1234\n";
  const auto rows_at = [&](std::size_t length) {
    put("frame.csv", whole.substr(0, length));
    try {
      return static_cast<int>(read_recording(folder_).frame.size());
    } catch (const RecordingError& e) {
      EXPECT_TRUE(e.fault() == Fault::kTruncated || e.fault() == Fault::kEmpty || e.fault() == Fault::kHeader)
          << e.what();
      return -1;
    }
  };
  for (std::size_t length = 0; length <= whole.size(); ++length) {
    // Only a cut at a line's end leaves a well-formed file; the last digit of the fixed-width column may
    // stand without its newline once there are rows to compare with.
    const bool at_line_end = length > 24 && (whole[length - 1] == '\n' || (length > 43 && whole[length] == '\n'));
    EXPECT_EQ(rows_at(length) > 0, at_line_end || length == whole.size()) << length;
  }
  EXPECT_EQ(rows_at(whole.size()), 3);
  EXPECT_EQ(rows_at(whole.size() - 1), 3);
  EXPECT_EQ(rows_at(whole.size() - 2), -1);
}

TEST_F(RecordingTest, LastLineWithoutEndIsRefusedWhenItCannotBeToldFromACut) {
  const std::string head = "t_s,position_mm,force_N\n0,0,0\n";
  expect_frame_fault(head + "1,0", Fault::kTruncated, 3, HasSubstr("no line end"));
  expect_frame_fault(head + "1,0,4", Fault::kTruncated, 3, HasSubstr("newline"));
  expect_frame_fault("t_s,position_mm,force_N\n0,0,1.5\n1,0,1.25\n2,0,3.5", Fault::kTruncated, 4, HasSubstr("cut off"));
}

TEST_F(RecordingTest, EverySingleByteFaultIsHandled) {
  // Whatever one wrong byte makes of the file, it is read as numbers or refused with a place; never worse.
  const std::string whole = kFrame;
  for (std::size_t i = 0; i < whole.size(); ++i) {
    for (const char c : {'\0', '\n', '\r', ',', '-', 'e', '\xFF'}) {
      auto broken = whole;
      broken[i] = c;
      put("frame.csv", broken);
      try {
        const auto r = read_recording(folder_);
        EXPECT_EQ(r.frame.position_mm.size(), r.frame.size());
        EXPECT_EQ(r.frame.force_N.size(), r.frame.size());
      } catch (const RecordingError& e) {
        EXPECT_GT(e.line(), 0U);
      }
    }
  }
}

TEST_F(RecordingTest, StreamsAreReadAlone) {
  EXPECT_EQ(read_frame_csv(folder_ / "frame.csv").size(), 3U);
  EXPECT_EQ(read_pressure_csv(folder_ / "pressure.csv").size(), 2U);
  EXPECT_THROW(static_cast<void>(read_pressure_csv(folder_ / "frame.csv")), RecordingError);
}

Recording made_up(std::size_t rows, unsigned seed) {
  std::mt19937_64 random(seed);
  std::uniform_real_distribution<double> step(1e-4, 0.2), value(-50.0, 50.0);
  Recording r;
  r.metadata = {"made up", 91.25, 70.1, 20.0, "seed = 1\n"};
  r.pressure.emplace();
  double t_s = -1.0;
  for (std::size_t i = 0; i < rows; ++i) {
    t_s += step(random);
    r.frame.t_s.push_back(t_s);
    r.frame.position_mm.push_back(value(random));
    r.frame.force_N.push_back(value(random) * 1e-7);
    r.pressure->t_s.push_back(t_s);
    r.pressure->pressure_psi.push_back(std::ldexp(value(random), static_cast<int>(i % 100) - 100));
  }
  return r;
}

TEST_F(RecordingTest, WritesWhatItReads) {
  const auto r = made_up(500, 1);
  write_recording(folder_ / "deep" / "er", r);
  const auto again = read_recording(folder_ / "deep" / "er");
  EXPECT_EQ(again.frame.t_s, r.frame.t_s);
  EXPECT_EQ(again.frame.position_mm, r.frame.position_mm);
  EXPECT_EQ(again.frame.force_N, r.frame.force_N);
  ASSERT_TRUE(again.pressure);
  EXPECT_EQ(again.pressure->t_s, r.pressure->t_s);
  EXPECT_EQ(again.pressure->pressure_psi, r.pressure->pressure_psi);
  EXPECT_EQ(again.metadata.specimen, r.metadata.specimen);
  EXPECT_EQ(again.metadata.rest_length_mm, r.metadata.rest_length_mm);
  EXPECT_EQ(again.metadata.pressurized_rest_length_mm, r.metadata.pressurized_rest_length_mm);
  EXPECT_EQ(again.metadata.nominal_pressure_psi, r.metadata.nominal_pressure_psi);
  EXPECT_EQ(again.metadata.further_toml, r.metadata.further_toml);
}

TEST_F(RecordingTest, AnOldPressureFileDoesNotSurviveARewriteWithoutOne) {
  auto r = read_recording(folder_);
  r.pressure.reset();
  write_recording(folder_, r);
  EXPECT_FALSE(read_recording(folder_).pressure);
}

TEST_F(RecordingTest, NothingOfAnotherRecordingStays) {
  fs::remove(folder_ / "recording.toml");
  put("ramps.csv", "step\n1\n");
  // Without a recording.toml it was of no recording.
  EXPECT_FALSE(write_recording(folder_, made_up(5, 2)));
  EXPECT_EQ(get("ramps.csv"), "step\n1\n");
  for (const auto table : kRecordingTables) put((std::string(table) + ".csv").c_str(), "step\n1\n");
  put("notes.txt", "somebody's\n");
  fs::create_directory(folder_ / "diagnosis");
  auto r = made_up(5, 3);
  r.pressure.reset();
  const auto replaced = write_recording(folder_, r);
  ASSERT_TRUE(replaced);
  EXPECT_THAT(replaced->removed, ::testing::ElementsAre("setpoints.csv", "steps.csv", "ramps.csv", "holds.csv",
                                                        "events.csv", "sessions.csv", "pressure.csv"));
  EXPECT_THAT(replaced->left, ::testing::ElementsAre("diagnosis", "notes.txt"));
  EXPECT_THAT(names(), ::testing::UnorderedElementsAre("diagnosis", "notes.txt", "frame.csv", "recording.toml"));
}

/// A writer that is killed in the middle of frame.csv: recording.toml is small, and would be through.
TEST_F(RecordingTest, AWriterThatIsKilledLeavesTheRecordingThatWasThere) {
  put("ramps.csv", "step\n1\n");
  const auto big = made_up(20'000, 4);
  const pid_t child = ::fork();
  if (child == 0) {
    const rlimit limit{100'000, 100'000};
    ::setrlimit(RLIMIT_FSIZE, &limit);  // SIGXFSZ kills it
    write_recording(folder_, big);
    ::_exit(0);
  }
  int status = 0;
  ASSERT_EQ(::waitpid(child, &status, 0), child);
  ASSERT_TRUE(WIFSIGNALED(status) && WTERMSIG(status) == SIGXFSZ) << status;
  EXPECT_EQ(get("recording.toml"), kToml);
  EXPECT_EQ(get("frame.csv"), kFrame);
  EXPECT_EQ(get("pressure.csv"), kPressure);
  EXPECT_EQ(get("ramps.csv"), "step\n1\n");
}

TEST_F(RecordingTest, AWriteThatFailsLeavesTheRecordingThatWasThere) {
  fs::remove(folder_ / "pressure.csv");
  fs::create_directories(folder_ / "pressure.csv" / "in");  // neither to be replaced nor to be removed
  auto r = made_up(5, 5);
  for (int k = 0; k < 2; ++k) {
    try {
      write_recording(folder_, r);
      ADD_FAILURE() << "was written";
    } catch (const RecordingError& e) {
      EXPECT_EQ(e.fault(), Fault::kUnreadable);
      EXPECT_THAT(e.what(), AllOf(HasSubstr("pressure.csv: "), HasSubstr("is a folder")));
    }
    EXPECT_EQ(get("recording.toml"), kToml);
    EXPECT_EQ(get("frame.csv"), kFrame);
    EXPECT_THAT(names(), ::testing::UnorderedElementsAre("frame.csv", "pressure.csv", "recording.toml"));
    r.pressure.reset();
  }
}

/// Whoever is killed in between, or reads meanwhile: while streams and tables are replaced there is no recording.toml.
TEST_F(RecordingTest, BetweenTwoRecordingsThereIsNone) {
  put("ramps.csv", "step\n1\n");
  const int watch = ::inotify_init1(IN_NONBLOCK | IN_CLOEXEC);
  ASSERT_GE(watch, 0);
  ASSERT_GE(::inotify_add_watch(watch, folder_.c_str(), IN_DELETE | IN_MOVED_TO), 0);
  write_recording(folder_, made_up(5, 6));
  alignas(inotify_event) char buffer[4096];
  const auto got = ::read(watch, buffer, sizeof buffer);
  ::close(watch);
  std::vector<std::string> seen;
  for (::ssize_t at = 0; at < got;) {
    const auto* event = reinterpret_cast<const inotify_event*>(buffer + at);
    seen.push_back((event->mask & IN_DELETE ? "-" : "+") + std::string(event->name));
    at += static_cast<::ssize_t>(sizeof(inotify_event) + event->len);
  }
  EXPECT_THAT(
      seen, ::testing::ElementsAre("-ramps.csv", "-recording.toml", "+frame.csv", "+pressure.csv", "+recording.toml"));
}

TEST_F(RecordingTest, RefusesToWriteWhatCouldNotBeRead) {
  const auto refuses = [this](const Recording& r, const char* why) {
    try {
      write_recording(folder_, r);
      ADD_FAILURE() << "was written: " << why;
    } catch (const RecordingError& e) {
      EXPECT_EQ(e.fault(), Fault::kInconsistent);
      EXPECT_THAT(e.what(), HasSubstr(why));
    }
    EXPECT_EQ(get("frame.csv"), kFrame) << "the earlier recording was touched";
    EXPECT_EQ(get("recording.toml"), kToml);
  };
  const auto good = made_up(5, 2);
  auto r = good;
  r.frame.force_N.pop_back();
  refuses(r, "force_N");
  r = good;
  r.frame.position_mm[2] = std::numeric_limits<double>::quiet_NaN();
  refuses(r, "frame.csv:4");
  r = good;
  r.frame.t_s[3] = r.frame.t_s[2];
  refuses(r, "frame.csv:5");
  r = good;
  r.pressure->t_s.clear();
  r.pressure->pressure_psi.clear();
  refuses(r, "no rows");
  r = good;
  r.metadata.rest_length_mm = -1.0;
  refuses(r, "rest_length_mm");
  r = good;
  r.metadata.further_toml = "specimen = \"twice\"\n";
  refuses(r, "recording.toml");
}

TEST_F(RecordingTest, ReadsThirtyThousandRowsInMilliseconds) {
  write_recording(folder_, made_up(30000, 3));
  double best_ms = std::numeric_limits<double>::infinity();
  for (int i = 0; i < 5; ++i) {
    const auto start = std::clock();  // processor time: what others use of the machine is not the reader's
    EXPECT_EQ(read_frame_csv(folder_ / "frame.csv").size(), 30000U);
    best_ms = std::min(best_ms, 1e3 * static_cast<double>(std::clock() - start) / CLOCKS_PER_SEC);
  }
  RecordProperty("best_ms", std::to_string(best_ms));
  std::printf("30,000 rows of 3 full-precision columns: %.2f ms\n", best_ms);
#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
  EXPECT_LT(best_ms, 50.0);  // 10 ms on a quiet machine; five times that only fails for a change in kind
#endif
}

/// Further recordings, where there are some: every folder with a recording.toml below ISORIG_SHARED, or below
/// ../shared beside the sources, has to be read and to survive being written again.
TEST_F(RecordingTest, RecordingsBesideTheSourcesAreRead) {
  const char* set = std::getenv("ISORIG_SHARED");
  const fs::path shared = set != nullptr ? fs::path(set) : fs::path(test::source_path()) / ".." / "shared";
  std::vector<fs::path> folders{folder_};  // never nothing to read
  if (fs::is_directory(shared)) {
    for (const auto& entry : fs::recursive_directory_iterator(shared)) {
      if (entry.path().filename() == "recording.toml") folders.push_back(entry.path().parent_path());
    }
  } else {
    ASSERT_EQ(set, nullptr) << shared << " is not a folder";
  }
  std::size_t rows = 0;
  for (std::size_t i = 0; i < folders.size(); ++i) {
    const auto& folder = folders[i];
    SCOPED_TRACE(folder);
    Recording r;
    ASSERT_NO_THROW(r = read_recording(folder));
    rows += r.frame.size();
    if (i % 8 != 0) continue;  // writing a few of them is enough
    write_recording(folder_ / "copy", r);
    const auto again = read_recording(folder_ / "copy");
    EXPECT_EQ(again.frame.force_N, r.frame.force_N);
    EXPECT_EQ(again.pressure.has_value(), r.pressure.has_value());
  }
  std::printf("%zu recordings, %zu frame rows\n", folders.size(), rows);
  EXPECT_GE(rows, 3U);
}

}  // namespace
}  // namespace isorig::messages
