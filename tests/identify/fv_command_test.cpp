#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/resource.h>
#include <sys/wait.h>

#include <cstdio>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>

#include "iso_velocity_recording.hpp"
#include "tree.hpp"

/// `isorig fv` as a user runs it: files in, files and words out.
namespace isorig {
namespace {

namespace fs = std::filesystem;
using identify::testing::IsoVelocityTest;
using identify::testing::simulate;
using ::testing::HasSubstr;

struct Outcome {
  int code = 0;
  std::string text;
};

Outcome isorig(const std::string& arguments) {
  const std::string command = test::program_path("/isorig ") + arguments + " 2>&1";
  FILE* pipe = popen(command.c_str(), "r");
  Outcome out;
  char buffer[4096];
  while (std::fgets(buffer, sizeof buffer, pipe) != nullptr) out.text += buffer;
  const int status = pclose(pipe);
  out.code = WIFEXITED(status) ? WEXITSTATUS(status) : -1;
  return out;
}

std::string read(const fs::path& file) {
  std::ifstream in(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

class FvCommand : public ::testing::Test {
 protected:
  fs::path folder_ = fs::path(::testing::TempDir()) /
                     (std::string("fv-") + ::testing::UnitTest::GetInstance()->current_test_info()->name());
  void SetUp() override {
    fs::remove_all(folder_);
    fs::create_directories(folder_);
  }
  void TearDown() override { fs::remove_all(folder_); }

  messages::Recording recording(IsoVelocityTest test, const std::string& specimen) {
    auto r = simulate(test);
    r.metadata.specimen = specimen;
    messages::PressureSamples p;
    for (double t = 0; t < r.frame.t_s.back(); t += 0.2) {
      p.t_s.push_back(t);
      p.pressure_psi.push_back(10.0);
    }
    r.pressure = p;
    return r;
  }
  fs::path save(const messages::Recording& r, const std::string& name) {
    messages::write_recording(folder_ / name, r);
    return folder_ / name;
  }
  std::string out() const { return " --out " + (folder_ / "out").string(); }
  nlohmann::json result() const { return nlohmann::json::parse(read(folder_ / "out/fv.json")); }
};

TEST_F(FvCommand, ControlThenSheath) {
  IsoVelocityTest test;
  test.speeds_mm_s = {0.05, 0.5, 2, 5, 10};
  test.force_noise_N = 0.005;
  test.elements = {{200.0, 100.0, 100.0}};  // kappa 0.5, gamma 1
  std::string controls, sheathed;
  for (unsigned seed : {1U, 2U}) {
    test.seed = seed;
    controls += " " + save(recording(test, "control"), "c" + std::to_string(seed)).string();
  }
  test.elements.push_back({100.0, 200.0, 10.0});  // beta 0.5, kappa 2, gamma 20
  for (unsigned seed : {3U, 4U}) {
    test.seed = seed;
    sheathed += " " + save(recording(test, "sheathed"), "s" + std::to_string(seed)).string();
  }
  const Outcome first = isorig("fv" + controls + out());
  ASSERT_EQ(first.code, 0) << first.text;
  EXPECT_THAT(first.text, HasSubstr("control at 10 psi: 20 points"));
  auto json = result();
  EXPECT_EQ(json["format"], "isorig-fv/1");
  EXPECT_NEAR(json["curves"][0]["fit"]["parameters"]["kappa"]["value"].get<double>(), 0.5, 0.02);
  EXPECT_NEAR(json["curves"][0]["fit"]["parameters"]["gamma_per_s"]["value"].get<double>(), 1.0, 0.04);
  EXPECT_EQ(json["curves"][0]["means"].size(), 10U);
  EXPECT_EQ(json["curves"][0]["means"][0]["repetitions"], 2);
  EXPECT_EQ(json["recordings"][0]["ramps"].size(), 10U);
  for (const char* file : {"ramps.csv", "moves.csv", "curves.csv", "parameters.csv", "fv-report.html"})
    EXPECT_GT(fs::file_size(folder_ / "out" / file), 100U) << file;
  fs::rename(folder_ / "out", folder_ / "control-out");
  fs::create_directory(folder_ / "out");
  std::ofstream(folder_ / "out/fv-report.html") << "of an earlier analysis";
  const Outcome second = isorig("fv" + sheathed + " --model slse2 --no-report --control " +
                                (folder_ / "control-out/fv.json").string() + out());
  ASSERT_EQ(second.code, 0) << second.text;
  EXPECT_FALSE(fs::exists(folder_ / "out/fv-report.html"))
      << "the page of an earlier analysis beside this one's numbers";
  json = result();
  const auto& p = json["curves"][0]["fit"]["parameters"];
  // The control's own error (2 %) is carried into the sheath's parameters several times over.
  EXPECT_NEAR(p["beta"]["value"].get<double>(), 0.5, 0.15);
  EXPECT_NEAR(p["gamma_per_s"]["value"].get<double>(), 20.0, 6.0);
  EXPECT_GT(json["curves"][0]["fit"]["r_squared"].get<double>(), 0.9999);
  EXPECT_FALSE(fs::exists(folder_ / "out/fv-report.html"));
}

TEST_F(FvCommand, PressuresRiseInEveryTableHoweverTheFoldersAreSorted) {
  IsoVelocityTest test;
  test.speeds_mm_s = {2, 10};
  test.precondition = false;
  std::string paths;
  for (const int psi : {10, 15, 20, 5}) {  // as a shell sorts them
    test.seed = static_cast<unsigned>(psi);
    auto r = recording(test, "one");
    r.metadata.nominal_pressure_psi = psi;
    for (double& p : r.pressure->pressure_psi) p = psi;
    paths += " " + save(r, "rep-1_" + std::to_string(psi) + "-psi").string();
  }
  const Outcome o = isorig("fv" + paths + " --no-report" + out());
  ASSERT_EQ(o.code, 0) << o.text;
  const auto json = result();
  for (const char* list : {"recordings", "curves"}) {
    std::vector<double> psi;
    for (const auto& entry : json[list]) psi.push_back(entry["nominal_pressure_psi"].get<double>());
    EXPECT_THAT(psi, ::testing::ElementsAre(5, 10, 15, 20)) << list;
  }
  for (std::size_t i = 0; i < 4; ++i) EXPECT_EQ(json["curves"][i]["recordings"], nlohmann::json::array({i}));
}

TEST_F(FvCommand, ARecordingCountsOnce) {
  IsoVelocityTest test;
  test.speeds_mm_s = {2, 10};
  test.precondition = false;
  const auto path = save(recording(test, "one"), "one");
  fs::copy(path, folder_ / "copy");
  for (const auto& second : {path, folder_ / "copy"}) {
    const Outcome o = isorig("fv " + path.string() + " " + second.string() + " --no-report" + out());
    EXPECT_EQ(o.code, 2);
    EXPECT_THAT(o.text, HasSubstr("the same samples as " + path.string()));
  }
  EXPECT_FALSE(fs::exists(folder_ / "out"));
}

TEST_F(FvCommand, LengthsThatContradictEachOtherAreSaid) {
  IsoVelocityTest test;
  test.precondition = false;
  std::string paths;
  for (const double length_mm : {79.0, 84.0}) {
    auto r = recording(test, "one");
    r.metadata.pressurized_rest_length_mm = length_mm;
    test.seed += 1;
    paths += " " + save(r, std::to_string(static_cast<int>(length_mm))).string();
  }
  const Outcome o = isorig("fv" + paths + " --no-report" + out());
  EXPECT_EQ(o.code, 0) << o.text;
  EXPECT_THAT(o.text, HasSubstr("contradict each other: the rest length (pressurized, where stated) is 79 mm in "));
  EXPECT_THAT(o.text, HasSubstr("84 mm in "));
}

TEST_F(FvCommand, AForceAtRestThatWandersIsSaid) {
  IsoVelocityTest test;
  test.precondition = false;
  test.return_speed_mm_s = 0.05;
  test.force_drift_N_s = 0.005;
  const Outcome o = isorig("fv " + save(recording(test, "one"), "one").string() + " --no-report" + out());
  EXPECT_EQ(o.code, 0) << o.text;
  EXPECT_THAT(o.text, HasSubstr("A zero that drifts bends the curve, a specimen that creeps does not"));
  EXPECT_THAT(o.text, HasSubstr("If the zero drifted, kappa = 0.799"));
  EXPECT_TRUE(result()["recordings"][0]["ramps"][3]["normalized_force_if_zero_drifts"].is_number());
}

TEST_F(FvCommand, APressureThatIsNotTheRecordingsIsSaid) {
  IsoVelocityTest test;
  test.speeds_mm_s = {2, 10};
  test.precondition = false;
  auto r = recording(test, "one");
  for (double& p : r.pressure->pressure_psi) p = 5.0;
  const Outcome other = isorig("fv " + save(r, "other").string() + " --no-report" + out());
  EXPECT_EQ(other.code, 0);
  EXPECT_THAT(other.text, HasSubstr("measured pressure before the ramps is 5 psi, the nominal one 10 psi"));
  for (double& t : r.pressure->t_s) t += 1e6;
  const Outcome elsewhere = isorig("fv " + save(r, "elsewhere").string() + " --no-report" + out());
  EXPECT_THAT(elsewhere.text, HasSubstr("no sample before any ramp"));
}

TEST_F(FvCommand, ACurveWorseThanTheMeanIsNoFit) {
  IsoVelocityTest test;
  test.speeds_mm_s = {2, 10};
  test.precondition = false;
  auto r = recording(test, "one");
  for (double& f : r.frame.force_N) f += 5e5;  // not zeroed: the normalised force is 1 whatever the speed
  const Outcome o = isorig("fv " + save(r, "one").string() + " --no-report" + out());
  EXPECT_EQ(o.code, 1) << o.text;
  EXPECT_THAT(o.text, HasSubstr("follow no force-velocity curve"));
  EXPECT_TRUE(result()["curves"][0]["fit"].is_null());
}

TEST_F(FvCommand, SheathNeedsItsControl) {
  const auto path = save(recording({}, "sheathed"), "s").string();
  EXPECT_EQ(isorig("fv " + path + " --model slse2" + out()).code, 2);
  std::ofstream(folder_ / "other.json") << "{\"format\": \"something\"}";
  const Outcome wrong = isorig("fv " + path + " --model slse2 --control " + (folder_ / "other.json").string() + out());
  EXPECT_EQ(wrong.code, 3);
  EXPECT_THAT(wrong.text, HasSubstr("isorig-fv/1"));
}

/// A recording that the rig has exported has a ramps.csv of its own.
TEST_F(FvCommand, ARecordingIsNoFolderForItsResults) {
  const auto r = save(recording({}, "Control"), "r");
  std::ofstream(r / "ramps.csv") << "step,t_start_s\n";
  const auto refused = isorig("fv " + r.string() + " --out " + r.string());
  EXPECT_EQ(refused.code, 1);
  EXPECT_THAT(refused.text, HasSubstr("is a recording, whose own ramps.csv would be lost"));
  EXPECT_EQ(read(r / "ramps.csv"), "step,t_start_s\n");
}

TEST_F(FvCommand, AFewRowsAreTooFewWhateverTheirNumber) {
  for (const std::size_t rows : {1U, 2U, 3U}) {
    auto r = recording({}, "Control");
    r.pressure.reset();
    for (auto* column : {&r.frame.t_s, &r.frame.position_mm, &r.frame.force_N}) column->resize(rows);
    const auto said = isorig("fv " + save(r, "few-" + std::to_string(rows)).string() + out());
    EXPECT_NE(said.code, 0) << rows;
    EXPECT_NE(said.code, -1) << rows << ": a signal";
    EXPECT_THAT(said.text, HasSubstr("only " + std::to_string(rows) + " sample")) << said.text;
  }
}

TEST_F(FvCommand, NoRampsIsSaid) {
  auto r = recording({}, "still");
  for (double& x : r.frame.position_mm) x = 0.0;
  const Outcome o = isorig("fv " + save(r, "still").string() + out());
  EXPECT_EQ(o.code, 1);
  EXPECT_THAT(o.text, HasSubstr("Nothing moves"));
  EXPECT_TRUE(result()["curves"][0]["fit"].is_null());
  EXPECT_TRUE(fs::exists(folder_ / "out/fv-report.html"));
}

TEST_F(FvCommand, OneRampIsNotEnough) {
  IsoVelocityTest test;
  test.speeds_mm_s = {5};
  test.precondition = false;
  auto r = recording(test, "one");
  const auto cut =
      static_cast<std::size_t>(std::lower_bound(r.frame.t_s.begin(), r.frame.t_s.end(), 65.0) - r.frame.t_s.begin());
  r.frame.t_s.resize(cut);
  r.frame.position_mm.resize(cut);
  r.frame.force_N.resize(cut);
  const Outcome o = isorig("fv " + save(r, "one").string() + out());
  EXPECT_EQ(o.code, 1);
  EXPECT_THAT(o.text, HasSubstr("1 usable ramp,"));
  EXPECT_TRUE(result()["curves"][0]["fit"].is_null());
  EXPECT_EQ(result()["recordings"][0]["ramps"].size(), 1U);
}

TEST_F(FvCommand, ClippedForceGivesNoNumbers) {
  auto r = recording({}, "clipped");
  double highest = -1e9, lowest = 1e9;
  for (double f : r.frame.force_N) {
    highest = std::max(highest, f);
    lowest = std::min(lowest, f);
  }
  for (double& f : r.frame.force_N) f = std::clamp(f, lowest + 2.5, highest - 2.5);
  const Outcome o = isorig("fv " + save(r, "clipped").string() + out());
  EXPECT_THAT(o.text, HasSubstr("saturated"));
  const auto written = result();
  int clipped = 0;
  for (const auto& ramp : written["recordings"][0]["ramps"]) {
    const auto& flags = ramp["flags"];
    if (std::find(flags.begin(), flags.end(), "force_clipped") == flags.end()) continue;
    ++clipped;
    EXPECT_TRUE(ramp["normalized_force"].is_null());
  }
  EXPECT_GT(clipped, 0);
  EXPECT_FALSE(written["recordings"][0]["whole_series_refusal"].is_null());
}

TEST_F(FvCommand, MissingPressureFileIsSaidAndTheRestIsDone) {
  auto r = recording({}, "no-pressure");
  r.pressure.reset();
  const Outcome o = isorig("fv " + save(r, "r").string() + out());
  EXPECT_EQ(o.code, 0) << o.text;
  EXPECT_THAT(o.text, HasSubstr("no pressure.csv"));
}

TEST_F(FvCommand, BadFilesAreNamedWithTheirLineAndNothingIsWritten) {
  const auto good = save(recording({}, "good"), "good");
  auto broken = [&](const std::string& name, auto&& change) {
    fs::copy(good, folder_ / name);
    std::string text = read(folder_ / name / "frame.csv");
    change(text);
    std::ofstream(folder_ / name / "frame.csv", std::ios::binary) << text;
    return (folder_ / name).string();
  };
  const std::string paths = " " + broken("nan", [](std::string& t) { t.insert(t.find('\n', 200) + 1, "nan,0,0\n"); }) +
                            " " + broken("column", [](std::string& t) { t.replace(0, 3, "tim"); }) + " " +
                            broken("truncated", [](std::string& t) { t.resize(t.size() - 4); }) + " " + good.string();
  const Outcome o = isorig("fv" + paths + out());
  EXPECT_EQ(o.code, 3);
  EXPECT_THAT(o.text, HasSubstr("nan/frame.csv:"));
  EXPECT_THAT(o.text, HasSubstr("column/frame.csv:1"));
  EXPECT_THAT(o.text, HasSubstr("truncated/frame.csv:"));
  EXPECT_FALSE(fs::exists(folder_ / "out"));
}

TEST_F(FvCommand, AlignMakesARecordingOfTwoStreams) {
  IsoVelocityTest test;
  test.precondition = false;
  auto r = simulate(test);
  r.metadata.specimen = "streams";
  // The pressure dips with every stroke and recovers within a second; its clock began 12.5 s later.
  messages::PressureSamples p;
  double dip = 0.0;
  std::size_t k = 0;
  for (double t = 0; t + 12.5 < r.frame.t_s.back(); t += 0.02) {
    double moved = 0.0;
    for (; k + 1 < r.frame.size() && r.frame.t_s[k + 1] <= t + 12.5; ++k)
      moved += r.frame.position_mm[k + 1] - r.frame.position_mm[k];
    dip = dip * std::exp(-0.02) + moved;
    p.t_s.push_back(t);
    p.pressure_psi.push_back(10.0 - 0.2 * dip + 0.003 * std::sin(1e4 * t));
  }
  auto separate = r;
  separate.pressure = p;
  const auto folder = save(separate, "separate");
  const std::string streams = (folder / "frame.csv").string() + " " + (folder / "pressure.csv").string();
  const Outcome o = isorig("align " + streams + " --toml " + (folder / "recording.toml").string() + out());
  ASSERT_EQ(o.code, 0) << o.text;
  const auto json = nlohmann::json::parse(read(folder_ / "out/align.json"));
  EXPECT_NEAR(json["offset_s"]["value"].get<double>(), 12.5, 0.02);
  const auto aligned = messages::read_recording(folder_ / "out");
  EXPECT_NEAR(aligned.pressure->t_s.front(), 12.5, 0.05);
  EXPECT_EQ(aligned.metadata.specimen, "streams");
  EXPECT_EQ(isorig("fv " + (folder_ / "out").string() + " --no-report --out " + (folder_ / "fv").string()).code, 0);

  for (double& v : separate.pressure->pressure_psi) v = 10.0 + 0.01 * std::sin(1e5 * v);
  const auto flat = save(separate, "flat");
  const Outcome refused = isorig("align " + (flat / "frame.csv").string() + " " + (flat / "pressure.csv").string() +
                                 " --out " + (folder_ / "flat-out").string());
  EXPECT_EQ(refused.code, 1);
  EXPECT_THAT(refused.text, HasSubstr("Not aligned"));
}

TEST_F(FvCommand, FiftyThousandSamplesTakeWellUnderASecond) {
  IsoVelocityTest test;
  test.dense_step_s = 0.0015;
  auto r = recording(test, "long");
  ASSERT_GT(r.frame.size(), 40000U);
  const auto path = save(r, "long").string();
  rusage before{}, after{};
  getrusage(RUSAGE_CHILDREN, &before);
  const Outcome o = isorig("fv " + path + out());
  getrusage(RUSAGE_CHILDREN, &after);
  ASSERT_EQ(o.code, 0) << o.text;
  const double cpu_s = static_cast<double>(after.ru_utime.tv_sec - before.ru_utime.tv_sec) +
                       1e-6 * static_cast<double>(after.ru_utime.tv_usec - before.ru_utime.tv_usec);
  std::printf("%zu samples: %.2f s of processor time, report included\n", r.frame.size(), cpu_s);
  EXPECT_LT(cpu_s, 1.0);
}

}  // namespace
}  // namespace isorig
