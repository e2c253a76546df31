// `isorig diagnose` and `isorig predict` from outside, mostly with what is wrong: the message names file and
// line and says what to do, the exit code is not 0, and nothing is left half-written.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <csignal>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <functional>
#include <nlohmann/json.hpp>
#include <sstream>

#include "concealed_specimen.hpp"
#include "tree.hpp"

namespace isorig {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;
using ::testing::Not;

constexpr int kFailure = 1, kUsage = 2, kBadInput = 3;

struct Outcome {
  int code = 0;
  std::string text;
};

Outcome isorig(const std::string& arguments) {
  FILE* pipe = popen((test::program_path("/isorig ") + arguments + " 2>&1").c_str(), "r");
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

void write(const fs::path& file, const std::string& text) {
  std::ofstream(file, std::ios::binary) << text;
}

/// Line `number` of the file replaced by what `edit` makes of it.
void edit_line(const fs::path& file, int number, const std::function<std::string(std::string)>& edit) {
  std::istringstream in(read(file));
  std::string out, line;
  for (int at = 1; std::getline(in, line); ++at) out += (at == number ? edit(line) : line) + "\n";
  write(file, out);
}

std::string cell(const std::string& line, int index) {
  std::istringstream in(line);
  std::string out;
  for (int i = 0; i <= index; ++i) std::getline(in, out, ',');
  return out;
}

const std::string kModel =
    "format = \"isorig-model/1\"\n[[part]]\nphysics = \"spring\"\nstiffness_N_mm = 2.5\n[[part]]\nphysics = "
    "\"maxwell\"\ntime_constant_s = 0.8\nstiffness_N_mm = 2.0\n";

class DiagnoseCommand : public testing::Test {
 protected:
  void SetUp() override {
    fs::remove_all(folder_);
    fs::create_directories(folder_);
    messages::write_recording(recording_, good());
    write(model_, kModel);
  }
  void TearDown() override { fs::remove_all(folder_); }

  static const messages::Recording& good() {
    static const messages::Recording recording = test::record({});
    return recording;
  }
  Outcome predict(const fs::path& out) {
    return isorig("predict " + recording_.string() + " --model " + model_.string() + " --out " + out.string());
  }
  Outcome diagnose(const std::string& model = "slse1") {
    return isorig("diagnose " + recording_.string() + " --model " + model + " --out " + out_.string() +
                  " --no-report --threads 1");
  }
  /// What the model predicts of the recording in the folder, against these forces, rms.
  double predicted_off_by_N(const messages::Recording& against) {
    EXPECT_EQ(predict(folder_ / "p.csv").code, 0);
    std::istringstream in(read(folder_ / "p.csv"));
    std::string line;
    std::getline(in, line);
    double squares = 0.0;
    std::size_t rows = 0;
    while (std::getline(in, line)) squares += std::pow(std::stod(cell(line, 1)) - against.frame.force_N.at(rows++), 2);
    EXPECT_EQ(rows, against.frame.size());
    return std::sqrt(squares / static_cast<double>(rows));
  }
  /// Both commands refuse, say `place` and `advice`, and leave nothing behind.
  void expect_both_refuse(const std::string& place, const std::string& advice) {
    for (const Outcome& outcome : {predict(out_), diagnose()}) {
      EXPECT_EQ(outcome.code, kBadInput) << outcome.text;
      EXPECT_THAT(outcome.text, HasSubstr(place));
      EXPECT_THAT(outcome.text, HasSubstr(advice));
      EXPECT_FALSE(fs::exists(out_)) << outcome.text;
    }
  }
  void expect_diagnose_refuses(const messages::Recording& recording, const std::string& advice) {
    messages::write_recording(recording_, recording);
    const Outcome outcome = diagnose();
    EXPECT_EQ(outcome.code, kBadInput) << outcome.text;
    EXPECT_THAT(outcome.text, ::testing::StartsWith(recording_.string())) << "the place stands first";
    EXPECT_THAT(outcome.text, HasSubstr(advice));
    EXPECT_FALSE(fs::exists(out_));
  }

  fs::path folder_ = fs::path(testing::TempDir()) /
                     (std::string("diagnose-") + testing::UnitTest::GetInstance()->current_test_info()->name());
  fs::path recording_ = folder_ / "recording", frame_ = recording_ / "frame.csv", model_ = folder_ / "m.toml",
           out_ = folder_ / "out";
};

/// `text` without what stands in square brackets.
std::string outside_brackets(const std::string& text) {
  std::string out;
  int depth = 0;
  for (const char c : text) {
    depth += c == '[' ? 1 : 0;
    if (depth == 0) out += c;
    depth -= c == ']' ? 1 : 0;
  }
  return out;
}

TEST_F(DiagnoseCommand, SaysWhatIsMissingInWordsAndUnits) {
  messages::write_recording(recording_, test::record({.friction_N = 0.8}));
  const Outcome outcome = diagnose();
  ASSERT_EQ(outcome.code, 0) << outcome.text;
  EXPECT_THAT(outcome.text,
              ::testing::StartsWith("physics is missing\n  dry friction [coulomb_friction], probability "));
  EXPECT_THAT(outcome.text, HasSubstr(" N: friction force at steady sliding [force_N]\n"));
  EXPECT_THAT(outcome.text, HasSubstr("the given model is off by "));
  // Names of files stand in brackets alone: no word outside of them has an underscore but a file's.
  std::string words = outside_brackets(outcome.text);
  for (const std::string& file : {out_.string(), recording_.string(), std::string("next_experiment.toml")})
    for (std::size_t at = words.find(file); at != std::string::npos; at = words.find(file))
      words.erase(at, file.size());
  EXPECT_THAT(words, Not(HasSubstr("_"))) << outcome.text;
  const auto json = nlohmann::json::parse(read(out_ / "diagnosis.json"));
  EXPECT_EQ(json["verdict"], "missing_physics");
  EXPECT_EQ(json["missing"][0]["effect"], "coulomb_friction");
  EXPECT_FALSE(json.contains("deciding")) << "all as stated";
}

TEST_F(DiagnoseCommand, ListsTheNumbersThatDecideWithoutARecording) {
  const Outcome text = isorig("diagnose --deciding");
  EXPECT_EQ(text.code, 0) << text.text;
  EXPECT_THAT(text.text, HasSubstr("prior_cost_nats = 3 nat  (0 to 1e+06)\n"));
  const Outcome listed = isorig("diagnose --deciding --json");
  EXPECT_EQ(listed.code, 0) << listed.text;
  const auto json = nlohmann::json::parse(listed.text);
  ASSERT_GT(json.size(), 100U);
  EXPECT_EQ(json[0]["name"], "prior_cost_nats");
  for (const auto& one : json) EXPECT_FALSE(one["derivation"].get<std::string>().empty()) << one["name"];
}

TEST_F(DiagnoseCommand, DecidesByAnotherNumberAndSaysSo) {
  messages::write_recording(recording_, test::record({.friction_N = 0.8}));
  const std::string command = "diagnose " + recording_.string() + " --model slse1 --no-report --threads 1 --out " +
                              out_.string() + " --decide ";
  for (const auto& [wrong, advice] :
       {std::pair("prior_cost=3", "near it: prior_cost_nats"), std::pair("prior_cost_nats=nan", "no finite number"),
        std::pair("surest_probability=1.5", "is not within 0 to 1")}) {
    const Outcome refused = isorig(command + wrong);
    EXPECT_EQ(refused.code, kUsage) << refused.text;
    EXPECT_THAT(refused.text, HasSubstr(advice));
    EXPECT_FALSE(fs::exists(out_));
  }
  // No evidence is worth as much as an effect costs now.
  const Outcome outcome = isorig(command + "prior_cost_nats=1e6 --decide unknown_cost_nats=1e6");
  ASSERT_EQ(outcome.code, 0) << outcome.text;
  EXPECT_THAT(outcome.text, ::testing::StartsWith("warning: Decided by other numbers than the stated ones: "
                                                  "[prior_cost_nats = 1e+06 (stated: 3), unknown_cost_nats"));
  const auto json = nlohmann::json::parse(read(out_ / "diagnosis.json"));
  EXPECT_TRUE(json["missing"].empty()) << json["missing"].dump(1);
  EXPECT_EQ(json["deciding"], nlohmann::json::parse(R"({"prior_cost_nats": 1e6, "unknown_cost_nats": 1e6})"));
}

TEST_F(DiagnoseCommand, RefusesABrokenFrameFile) {
  const std::string whole = read(frame_);
  const auto broken = [&](int line, const std::function<std::string(std::string)>& edit, const char* advice) {
    write(frame_, whole);
    edit_line(frame_, line, edit);
    expect_both_refuse("frame.csv:" + std::to_string(line) + ":", advice);
  };
  broken(
      500, [](const std::string& l) { return cell(l, 0) + "," + cell(l, 1) + ",nan"; }, "a finite number");
  broken(
      501, [](const std::string& l) { return cell(l, 0) + "," + cell(l, 1) + ",1e999"; }, "finite");
  broken(
      502, [](const std::string& l) { return cell(l, 0) + ",2 mm," + cell(l, 2); }, "number");
  broken(
      503, [](const std::string& l) { return cell(l, 0) + "," + cell(l, 1); }, "expected 3");
  broken(
      504, [](const std::string&) { return ""; }, "empty");
  broken(
      505, [](const std::string& l) { return "0.5," + cell(l, 1) + "," + cell(l, 2); }, "backwards");
  broken(
      1, [](const std::string&) { return "t_s,position_m,force_N"; }, "`position_mm` is missing");
  write(frame_, whole);
  edit_line(frame_, 700, [&](const std::string& l) { return l + "\n" + l; });
  expect_both_refuse("frame.csv:701:", "stands still");
  write(frame_, whole.substr(0, whole.size() / 2));
  expect_both_refuse("frame.csv:", "cut off");
  write(frame_, "t_s,position_mm,force_N\n");
  expect_both_refuse("frame.csv:2:", "no rows");
  write(frame_, "");
  expect_both_refuse("frame.csv:1:", "empty");
  fs::remove(frame_);
  expect_both_refuse("frame.csv", "no such file");
}

TEST_F(DiagnoseCommand, RefusesABrokenPressureOrRecordingFile) {
  edit_line(recording_ / "pressure.csv", 50, [](const std::string& l) { return cell(l, 0) + ",NaN"; });
  expect_both_refuse("pressure.csv:50:", "a finite number");
  fs::remove(recording_ / "pressure.csv");
  const std::string toml = read(recording_ / "recording.toml");
  const auto broken = [&](const std::string& from, const std::string& to, const char* place, const char* advice) {
    std::string text = toml;
    text.replace(text.find(from), from.size(), to);
    write(recording_ / "recording.toml", text);
    expect_both_refuse(place, advice);
  };
  broken("isorig-recording/1", "isorig-recording/2", "recording.toml:1:", "this reads \"isorig-recording/1\"");
  broken("rest_length_mm = 90.0", "rest_length_mm = \"90 mm\"", "recording.toml:3:", "a number is needed");
  broken("rest_length_mm = 90.0", "rest_length_mm = -90.0", "recording.toml:3:", "rest_length_mm");
  broken("rest_length_mm = 90.0", "rest_length_mm = ", "recording.toml:3:", "");
  fs::remove(recording_ / "recording.toml");
  expect_both_refuse("recording.toml", "no such file");
  fs::remove_all(recording_);
  expect_both_refuse(recording_.string(), "a recording is a folder with recording.toml");
}

TEST_F(DiagnoseCommand, RefusesABrokenModel) {
  const auto broken = [&](const std::string& from, const std::string& to, const char* place, const char* advice) {
    std::string text = kModel;
    text.replace(text.find(from), from.size(), to);
    write(model_, text);
    for (const Outcome& outcome : {predict(out_), diagnose(model_.string())}) {
      EXPECT_EQ(outcome.code, kBadInput) << outcome.text;
      EXPECT_THAT(outcome.text, HasSubstr(place));
      EXPECT_THAT(outcome.text, HasSubstr(advice));
      EXPECT_FALSE(fs::exists(out_));
    }
  };
  broken("\"maxwell\"", "\"flubber\"", "m.toml:6:", "elements: spring, maxwell");
  broken("model/1", "model/9", "m.toml:1:", "this program reads");
  broken("= 2.5", "= -2.5", "m.toml:4:", "at least 0");
  broken("= 2.5", "= \"2.5 N/mm\"", "m.toml:4:", "number");
  broken("= 2.5", "= nan", "m.toml:4:", "stiffness_N_mm");
  broken("stiffness_N_mm = 2.5", "stiffness_N_m = 2500.0", "m.toml:4:", "stiffness_N_mm");
  broken("= 0.8", "= 0.0", "m.toml:7:", "time_constant_s");
  broken("[[part]]", "[[part]", "m.toml:2:", "TOML");
  broken(kModel, "", "m.toml", "format");
  fs::remove(model_);
  const Outcome missing = predict(out_);
  EXPECT_EQ(missing.code, kBadInput);
  EXPECT_THAT(missing.text, HasSubstr("m.toml"));
  const Outcome unknown = diagnose("slse3");
  EXPECT_EQ(unknown.code, kBadInput);
  EXPECT_THAT(unknown.text, HasSubstr("slse1 and slse2"));
  EXPECT_FALSE(fs::exists(out_));
}

/// Recordings that read well and cannot be meant.
TEST_F(DiagnoseCommand, RefusesMistakesOfUnitAndSign) {
  messages::Recording turned = good();
  for (double& force_N : turned.frame.force_N) force_N = -force_N;
  expect_diagnose_refuses(turned, "extension and tension are positive");
  messages::Recording metres = good();
  metres.metadata.rest_length_mm = 0.09;
  metres.metadata.pressurized_rest_length_mm = 0.07;
  expect_diagnose_refuses(metres, "another unit");
  messages::Recording kilopascal = good();
  for (double& pressure : kilopascal.pressure->pressure_psi) pressure *= 6.895;
  messages::write_recording(recording_, kilopascal);
  const Outcome outcome = diagnose();
  EXPECT_EQ(outcome.code, 0);
  EXPECT_THAT(outcome.text, HasSubstr("15 psi is nominal; is pressure.csv in another unit?"));
  const auto json = nlohmann::json::parse(read(out_ / "diagnosis.json"));
  EXPECT_EQ(json["verdict"], "consistent");
  EXPECT_EQ(json["data_faults"][0]["kind"], "pressure");
}

TEST_F(DiagnoseCommand, RefusesWhatIsTooLittleToJudge) {
  messages::Recording slow = good();
  messages::FrameSamples kept;
  for (std::size_t k = 0; k < slow.frame.size(); ++k) {
    if (!kept.t_s.empty() && slow.frame.t_s[k] - kept.t_s.back() < 0.99) continue;
    kept.t_s.push_back(slow.frame.t_s[k]);
    kept.position_mm.push_back(slow.frame.position_mm[k]);
    kept.force_N.push_back(slow.frame.force_N[k]);
  }
  slow.frame = kept;
  expect_diagnose_refuses(slow, "too far apart");
  messages::Recording few = good();
  for (auto* column : {&few.frame.t_s, &few.frame.position_mm, &few.frame.force_N}) column->resize(15);
  expect_diagnose_refuses(few, "15 rows are too few");
  messages::Recording still = good();
  for (double& x : still.frame.position_mm) x = 0.0;
  expect_diagnose_refuses(still, "nothing moves");
  messages::Recording dead = good();
  for (double& force_N : dead.frame.force_N) force_N = -3.3;
  expect_diagnose_refuses(dead, "the force is -3.3 N in every row");
}

TEST_F(DiagnoseCommand, SaysBeforeTheWorkThatItCannotWrite) {
  write(folder_ / "file", "mine");
  for (const char* name : {"file", "file/out"}) {
    out_ = folder_ / name;
    const Outcome outcome = diagnose();
    EXPECT_EQ(outcome.code, kFailure);
    EXPECT_THAT(outcome.text, HasSubstr("is a file; name a folder"));
  }
  EXPECT_EQ(read(folder_ / "file"), "mine");
}

/// The same command twice would ask another model the second time.
TEST_F(DiagnoseCommand, NeverWritesOverTheModelThatIsAskedAbout) {
  fs::create_directories(out_);
  for (const char* name : {"model.toml", "nominal.toml"}) {
    fs::copy_file(model_, out_ / name, fs::copy_options::overwrite_existing);
    const std::string was = read(out_ / name);
    const Outcome outcome = diagnose((out_ / name).string());
    EXPECT_EQ(outcome.code, kFailure);
    EXPECT_THAT(outcome.text, HasSubstr("is the model that is asked about"));
    EXPECT_EQ(read(out_ / name), was);
  }
}

TEST_F(DiagnoseCommand, PredictNeverWritesOverTheRecordingNorHalfAFile) {
  const std::string frame = read(frame_);
  const Outcome over = predict(frame_);
  EXPECT_EQ(over.code, kFailure);
  EXPECT_THAT(over.text, HasSubstr("is part of a recording"));
  EXPECT_EQ(read(frame_), frame);
  fs::create_symlink(frame_, folder_ / "latest.csv");
  EXPECT_THAT(predict(folder_ / "latest.csv").text, HasSubstr("is part of a recording"));
  fs::copy(recording_, folder_ / "other", fs::copy_options::recursive);
  EXPECT_THAT(predict(folder_ / "other" / "frame.csv").text, HasSubstr("is part of a recording"));
  EXPECT_EQ(read(frame_), frame);
  EXPECT_EQ(read(folder_ / "other" / "frame.csv"), frame);
  const Outcome nowhere = predict(folder_ / "no" / "p.csv");
  EXPECT_EQ(nowhere.code, kFailure);
  EXPECT_THAT(nowhere.text, HasSubstr("make it first"));
  const Outcome folder = predict(recording_);
  EXPECT_EQ(folder.code, kFailure);
  EXPECT_THAT(folder.text, HasSubstr("is a folder; name a file"));
  const fs::path model = folder_ / "m.toml";
  write(model,
        "format = \"isorig-model/1\"\nname = \"m\"\n[[part]]\nphysics = \"spring\"\nlaw = \"linear\"\nstiffness_N_mm = "
        "2.0\n");
  const std::string was = read(model);
  const Outcome itself =
      isorig("predict " + recording_.string() + " --model " + model.string() + " --out " + model.string());
  EXPECT_EQ(itself.code, kFailure);
  EXPECT_THAT(itself.text, HasSubstr("is the model itself"));
  EXPECT_EQ(read(model), was);
  // A recording that breaks later than the model is read leaves an earlier prediction as it was.
  write(folder_ / "p.csv", "earlier");
  edit_line(frame_, 900, [](const std::string&) { return "x"; });
  EXPECT_EQ(predict(folder_ / "p.csv").code, kBadInput);
  EXPECT_EQ(read(folder_ / "p.csv"), "earlier");
  for (const auto& entry : fs::directory_iterator(folder_))
    EXPECT_EQ(entry.path().string().find(".part"), std::string::npos) << entry.path();
}

TEST_F(DiagnoseCommand, PredictsEveryRowAndIsBlindToTheForce) {
  ASSERT_EQ(predict(folder_ / "a.csv").code, 0);
  messages::Recording blind = good();
  for (std::size_t k = 0; k < blind.frame.size(); ++k) blind.frame.force_N[k] = k % 2 == 0 ? 1e6 : -3.0;
  messages::write_recording(recording_, blind);
  ASSERT_EQ(predict(folder_ / "b.csv").code, 0);
  const std::string text = read(folder_ / "a.csv");
  EXPECT_EQ(text, read(folder_ / "b.csv"));
  EXPECT_TRUE(text.starts_with("t_s,force_N\n"));
  EXPECT_EQ(static_cast<std::size_t>(std::ranges::count(text, '\n')), good().frame.size() + 1);
  // As a pipe: nothing to rename.
  EXPECT_EQ(isorig("predict " + recording_.string() + " --model " + model_.string() + " --out /dev/stdout | cmp - " +
                   (folder_ / "a.csv").string())
                .code,
            0);
}

/// Recordings of any length: a drift that was described for a shorter one, a slip of another, one row alone.
TEST_F(DiagnoseCommand, PredictsRecordingsOfAnyLength) {
  write(model_, kModel + "[[part]]\nphysics = \"zero_drift\"\nlaw = \"wander\"\nduration_s = 100.0\nc1_N = 0.1\n" +
                    "[[part]]\nphysics = \"grip_slip\"\ntime_s = 50.0\nslip_mm = 0.2\nrecording_id = 100.0\n");
  ASSERT_EQ(predict(folder_ / "long.csv").code, 0);
  write(folder_ / "plain.toml", kModel);
  model_ = folder_ / "plain.toml";
  ASSERT_EQ(predict(folder_ / "plain.csv").code, 0);
  std::istringstream with(read(folder_ / "long.csv")), without(read(folder_ / "plain.csv"));
  std::string a, b;
  std::getline(with, a);
  std::getline(without, b);
  std::size_t rows = 0;
  while (std::getline(with, a) && std::getline(without, b)) {
    const double t = std::stod(cell(a, 0)), drift = std::stod(cell(a, 1)) - std::stod(cell(b, 1));
    ASSERT_NEAR(drift, 0.1 * std::cos(M_PI * std::fmin(t / 100.0, 1.0)), 2e-3) << "at " << t;
    ++rows;
  }
  EXPECT_EQ(rows, good().frame.size());
  messages::Recording one = good();
  for (auto* column : {&one.frame.t_s, &one.frame.position_mm, &one.frame.force_N}) column->resize(1);
  messages::write_recording(recording_, one);
  EXPECT_EQ(predict(folder_ / "one.csv").code, 0);
  EXPECT_THAT(read(folder_ / "one.csv"), Not(HasSubstr("nan")));
}

/// A slip is a slip of its recording: predict knows the recording again, though it looks at no force.
TEST_F(DiagnoseCommand, PredictsASlipInItsOwnRecordingAndInNoOther) {
  const messages::Recording slipped = test::record({.slip_mm = 0.3, .slip_s = 500.3, .seed = 4});
  messages::write_recording(recording_, slipped);
  const Outcome outcome = diagnose();
  ASSERT_EQ(outcome.code, 0) << outcome.text;
  ASSERT_THAT(read(out_ / "model.toml"), HasSubstr("grip_slip"));
  model_ = out_ / "model.toml";
  const auto told = nlohmann::json::parse(read(out_ / "diagnosis.json"));
  EXPECT_NEAR(predicted_off_by_N(slipped), told["fit"]["model"]["train_rmse_N"].get<double>(), 0.002);
  messages::Recording other = slipped;
  other.frame.force_N.front() += 0.001;
  messages::write_recording(recording_, other);
  EXPECT_GT(predicted_off_by_N(slipped), 0.3) << "the stiffness of 2.5 N/mm times 0.3 mm over half of the time";
}

TEST_F(DiagnoseCommand, WritesItsFilesAndAModelThatPredicts) {
  const Outcome outcome = diagnose();
  ASSERT_EQ(outcome.code, 0) << outcome.text;
  for (const char* name : {"diagnosis.json", "nominal.toml", "model.toml"})
    EXPECT_GT(fs::file_size(out_ / name), 100U) << name;
  model_ = out_ / "model.toml";
  // The nominal model is the true one here: its errors are the noise of 0.02 N.
  EXPECT_NEAR(predicted_off_by_N(good()), 0.02, 0.002);
}

// A weight that hangs on a muscle while the pressure steps: the position is what the model answers with.
TEST_F(DiagnoseCommand, AnswersForAPositionAsForAForce) {
  messages::Recording lift;
  lift.metadata.specimen = "coil";
  lift.metadata.output = messages::Output::kPosition;
  lift.pressure.emplace();
  double crept_mm = 0.0;
  for (int k = 0; k < 600; ++k) {
    const double psi = k / 100 % 2 == 0 ? 5.0 : 20.0;
    crept_mm += 0.1 / 3.0 * (-0.2 * (psi - 5.0) - crept_mm);
    lift.frame.t_s.push_back(0.1 * k);
    lift.frame.position_mm.push_back(-0.5 * (psi - 5.0) + crept_mm + 0.001 * (k * 7919 % 13 - 6));
    lift.frame.force_N.push_back(4.9);
    lift.pressure->t_s.push_back(0.1 * k);
    lift.pressure->pressure_psi.push_back(psi);
  }
  messages::write_recording(recording_, lift);
  const Outcome outcome = isorig("diagnose " + recording_.string() + " --model slse1 --out " + out_.string());
  ASSERT_EQ(outcome.code, 0) << outcome.text;
  for (const char* name : {"diagnosis.json", "nominal.toml", "model.toml", "diagnosis-report.html"})
    EXPECT_GT(fs::file_size(out_ / name), 100U) << name;
  EXPECT_THAT(outcome.text, HasSubstr(" mm rms, model.toml by"));
  const auto json = nlohmann::json::parse(read(out_ / "diagnosis.json"));
  EXPECT_EQ(json["output"], "position");
  const Outcome checked =
      isorig("diagnose " + recording_.string() + " --model slse1 --check-names 2 --out " + (folder_ / "none").string());
  EXPECT_EQ(checked.code, kUsage) << checked.text;
  EXPECT_THAT(checked.text, HasSubstr("--check-names: only of recordings that ask for the force"));
  EXPECT_FALSE(fs::exists(folder_ / "none"));
  ASSERT_EQ(diagnose().code, 0);
  EXPECT_FALSE(fs::exists(out_ / "diagnosis-report.html")) << "the page of an earlier diagnosis";
  EXPECT_LT(json["fit"]["model"]["train_rmse_mm"].get<double>(), 0.2);
  // A model of a force does not answer for a position, and says what would.
  EXPECT_THAT(predict(folder_ / "p.csv").text, HasSubstr("isorig-response/1"));
  model_ = out_ / "model.toml";
  ASSERT_EQ(predict(folder_ / "p.csv").code, 0);
  const std::string predicted = read(folder_ / "p.csv");
  messages::write_recording(folder_ / "pulled", good());
  EXPECT_THAT(isorig("predict " + (folder_ / "pulled").string() + " --model " + model_.string() + " --out " +
                     (folder_ / "r.csv").string())
                  .text,
              HasSubstr("describes a position or a pressure"));
  EXPECT_THAT(predicted, ::testing::StartsWith("t_s,position_mm,low95_mm,high95_mm\n"));
  EXPECT_EQ(std::ranges::count(predicted, '\n'), 601);
  // Of what was measured a prediction has seen the first readings alone.
  for (std::size_t k = 10; k < 600; ++k) lift.frame.position_mm[k] += 3.0;
  messages::write_recording(recording_, lift);
  ASSERT_EQ(predict(folder_ / "q.csv").code, 0);
  EXPECT_EQ(read(folder_ / "q.csv"), predicted);
}

// Probabilities by simulation: kept beside the diagnosis, made again for other recordings, gone with a diagnosis that
// did not ask for them.
TEST_F(DiagnoseCommand, ChecksItsNamesOnSimulatedRecordings) {
  const fs::path kept = out_ / "name-check.json";
  const std::string checked = " --check-names 2 --threads 2 --out " + out_.string() + " --model slse1 --no-report";
  const Outcome first = isorig("diagnose " + recording_.string() + checked);
  ASSERT_EQ(first.code, 0) << first.text;
  EXPECT_THAT(first.text, HasSubstr("  simulated from these explanations: names where nothing unknown was told: fewer "
                                    "than 10, so that a name with all of the weight is stated with 0.985"));
  const auto diagnosis = nlohmann::json::parse(read(out_ / "diagnosis.json"));
  ASSERT_EQ(diagnosis["name_check"]["simulated"].size(), 2U);
  EXPECT_EQ(diagnosis["name_check"]["sureness"], nullptr);
  EXPECT_EQ(nlohmann::json::parse(read(kept))["format"], "isorig-name-check/1");

  // What is there is used: a name that no diagnosis gives shows it.
  std::string text = read(kept);
  const std::string nothing = "\"claims\": []";
  ASSERT_NE(text.find(nothing), std::string::npos) << text;
  text.replace(text.find(nothing), nothing.size(),
               "\"claims\": [{\"effect\": \"planted\", \"promised\": 0.9, \"right\": false, \"refused\": false}]");
  write(kept, text);
  ASSERT_EQ(isorig("diagnose " + recording_.string() + checked).code, 0);
  EXPECT_THAT(read(out_ / "diagnosis.json"), HasSubstr("planted"));

  messages::write_recording(recording_, test::record({.seed = 2}));
  ASSERT_EQ(isorig("diagnose " + recording_.string() + checked).code, 0);
  EXPECT_THAT(read(out_ / "diagnosis.json"), Not(HasSubstr("planted"))) << "those of other readings";

  ASSERT_EQ(diagnose().code, 0);
  EXPECT_FALSE(fs::exists(kept));
  EXPECT_THAT(read(out_ / "diagnosis.json"), Not(HasSubstr("name_check")));
}

// Ctrl-C among the simulations costs the last few of them: the diagnosis stands, and the next call goes on.
TEST_F(DiagnoseCommand, AnInterruptedNameCheckKeepsTheDiagnosisAndWhatWasSimulated) {
  const fs::path kept = out_ / "name-check.json";
  const std::string command = "exec " + test::program_path("/isorig diagnose ") + recording_.string() +
                              " --model slse1 --no-report --threads 1 --out " + out_.string() +
                              " --check-names 100000 >" + (folder_ / "log").string() + " 2>&1";
  const pid_t pid = ::fork();
  if (pid == 0) {
    ::execl("/bin/sh", "sh", "-c", command.c_str(), nullptr);
    ::_exit(127);
  }
  for (int tries = 0; tries < 1200 && !fs::exists(kept); ++tries) ::usleep(100'000);
  ::kill(pid, SIGINT);
  int status = 0;
  ASSERT_EQ(::waitpid(pid, &status, 0), pid);
  ASSERT_TRUE(fs::exists(kept)) << read(folder_ / "log");
  EXPECT_FALSE(WIFEXITED(status) && WEXITSTATUS(status) == 0) << read(folder_ / "log");
  EXPECT_EQ(nlohmann::json::parse(read(out_ / "diagnosis.json"))["format"], "isorig-diagnosis/1");
  const auto before = nlohmann::json::parse(read(kept))["rehearsals"];
  ASSERT_GE(before.size(), 4U);

  const std::size_t more = before.size() + 1;
  ASSERT_EQ(isorig("diagnose " + recording_.string() + " --model slse1 --no-report --threads 1 --out " + out_.string() +
                   " --check-names " + std::to_string(more))
                .code,
            0);
  auto after = nlohmann::json::parse(read(kept))["rehearsals"];
  ASSERT_EQ(after.size(), more);
  after.erase(more - 1);
  EXPECT_EQ(after, before);
}

}  // namespace
}  // namespace isorig
