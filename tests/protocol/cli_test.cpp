// `isorig check` and `isorig plan` as a user runs them: what they print and what they return.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/wait.h>

#include <cstdio>
#include <filesystem>
#include <fstream>
#include <sstream>

#include "tree.hpp"

namespace {

using testing::HasSubstr;

struct Outcome {
  int code = -1;
  std::string out;  ///< both streams
};

Outcome isorig(const std::string& arguments) {
  const std::string command =
      "cd " + isorig::test::source_path() + " && " + isorig::test::program_path("/isorig ") + arguments + " 2>&1";
  Outcome outcome;
  FILE* pipe = popen(command.c_str(), "r");
  if (pipe == nullptr) return outcome;
  char buffer[4096];
  for (std::size_t n = 0; (n = fread(buffer, 1, sizeof buffer, pipe)) > 0;) outcome.out.append(buffer, n);
  const int status = pclose(pipe);
  outcome.code = WIFEXITED(status) ? WEXITSTATUS(status) : -1;
  return outcome;
}

std::string file_text(const std::filesystem::path& path) {
  std::ostringstream text;
  text << std::ifstream(path).rdbuf();
  return text.str();
}

class CliFiles : public testing::Test {
 protected:
  CliFiles()
      : folder_(std::filesystem::path(testing::TempDir()) /
                (std::string("isorig-") + testing::UnitTest::GetInstance()->current_test_info()->name())) {
    std::filesystem::create_directories(folder_);
  }
  ~CliFiles() override { std::filesystem::remove_all(folder_); }
  std::string write(const std::string& name, const std::string& text) {
    std::ofstream(folder_ / name) << text;
    return (folder_ / name).string();
  }

 private:
  std::filesystem::path folder_;
};

/// A shipped rig, to be written anywhere.
std::string whole_rig(const std::string& name) {
  const auto config = isorig::test::source_path() + "/config";
  auto text = file_text(config + "/rigs/" + name + ".toml");
  for (auto up = text.find("\"../"); up != std::string::npos; up = text.find("\"../")) text.replace(up + 1, 2, config);
  return text;
}

/// An 8800 whose line is too slow for a stop to be seen in time would be a rig on which every stop is a fault.
TEST_F(CliFiles, CheckRefusesARigThatTheDaemonWouldRefuseWithTheNumberToWrite) {
  auto rig = whole_rig("sim-8800");
  const auto check = [&] { return isorig("check config/protocols/vma-smoke.toml --rig " + write("rig.toml", rig)); };
  EXPECT_EQ(check().code, 0) << check().out;
  const std::string time_out = "response_timeout_ms = 400";
  rig.replace(rig.find(time_out), time_out.size(), "response_timeout_ms = 600");
  const std::string answers = "[sim.controller]\n";
  rig.insert(rig.find(answers) + answers.size(), "answer_us = 30000\n");
  const auto slow = check();
  EXPECT_EQ(slow.code, 3) << slow.out;
  EXPECT_THAT(slow.out,
              testing::ContainsRegex("`stop_confirm_max_s` = 0.3 \\(by default\\); it has to be at least [0-9.]+ s"));
  const std::string supervisor = "[supervisor]\n";
  rig.insert(rig.find(supervisor) + supervisor.size(), "stop_confirm_max_s = 1.9\n");
  EXPECT_EQ(check().code, 0) << check().out;
}

/// What the daemon would refuse, `check --rig` refuses.
TEST_F(CliFiles, CheckKnowsTheRegulatorAndThePressureLoop) {
  const std::string rig = whole_rig("sim-8800-regulator");
  const auto with = [&](const std::string& from, const std::string& to) {
    const auto at = rig.find(from);
    EXPECT_NE(at, std::string::npos) << from;
    return write("rig.toml", std::string(rig).replace(at, from.size(), to));
  };
  const auto check = [](const std::string& file) {
    return isorig("check config/protocols/vma-isovelocity.toml --rig " + file);
  };
  const auto whole = check(write("rig.toml", rig));
  EXPECT_EQ(whole.code, 0) << whole.out;
  const auto weak = check(with("\nmax_psi = ", "\nmax_psi = 12 # "));
  EXPECT_EQ(weak.code, 3) << weak.out;
  EXPECT_THAT(weak.out, HasSubstr("the rig's regulator takes at most 12 (regulator.max_psi)"));
  const auto slow = check(with("\nrate_limit_psi_s = ", "\nrate_limit_psi_s = 0.1 # "));
  EXPECT_EQ(slow.code, 3) << slow.out;
  EXPECT_THAT(slow.out, HasSubstr("at 0.1 psi/s, the most that the rig's pressure loop follows"));
}

TEST(Cli, PlanOfTheShortProtocolIsAsItWas) {
  const auto plan = isorig("plan config/protocols/vma-short.toml");
  EXPECT_EQ(plan.code, 0);
  EXPECT_EQ(plan.out, file_text(isorig::test::source_path("/tests/protocol/vma-short.plan.txt")))
      << "If the change is meant: build/bin/isorig plan config/protocols/vma-short.toml > "
         "tests/protocol/vma-short.plan.txt";
}

TEST(Cli, CheckSaysWhatThePapersProtocolTakes) {
  const auto check = isorig("check config/protocols/vma-isovelocity.toml");
  EXPECT_EQ(check.code, 0);
  EXPECT_THAT(check.out, HasSubstr("23 h 02 min expected"));
  EXPECT_THAT(check.out, HasSubstr("880: 20 pressurize, 40 settle, 400 ramp, 400 hold, 20 wave"));
  EXPECT_THAT(check.out, HasSubstr("20: \"repetition 1, 5 psi\" to \"repetition 5, 20 psi\""));
  EXPECT_THAT(check.out, HasSubstr("1020 mm, between -4 and +4 mm"));
  EXPECT_THAT(check.out, HasSubstr("peak speed  10 mm/s"));
  EXPECT_THAT(check.out, HasSubstr("NOT checked"));
}

TEST_F(CliFiles, OneComplaintForOneFaultAndWhereItIs) {
  const auto path = write(
      "x.toml", "format = \"isorig-protocol/1\"\nname = \"x\"\n\nsteps = [ { do = \"hold\", duration_s = nan } ]\n");
  const auto nan = isorig("check " + path);
  EXPECT_THAT(nan.out, HasSubstr("`duration_s` = nan"));
  EXPECT_THAT(nan.out, testing::Not(HasSubstr("`duration_s` = 0")));
  const auto first =
      isorig("check " +
             write("y.toml",
                   "format = \"isorig-protocol/1\"\nname = \"y\"\n\nsteps = [ { do = \"hold\", duration_s = 1 } ]\n"));
  EXPECT_THAT(first.out, HasSubstr("y.toml:4:"));  // where the steps are
  EXPECT_THAT(first.out, HasSubstr("begins with a pressurize"));
  const auto missing = isorig("check nowhere.toml");
  EXPECT_THAT(missing.out, HasSubstr("nowhere.toml: cannot be opened"));
}

TEST_F(CliFiles, APlaceThatCannotBeUsedIsNamedWithWhatToDo) {
  const auto file = write("afile", "");
  const auto run = isorig("run config/protocols/vma-smoke.toml --rig config/rigs/sim.toml --quiet --runs " + file);
  EXPECT_EQ(run.code, 1);
  EXPECT_THAT(run.out, HasSubstr("cannot use " + file));
  EXPECT_THAT(run.out, HasSubstr("name another place"));
}

TEST(Cli, PlanAsJsonIsWhole) {
  const auto plan = isorig("plan --json config/protocols/vma-isovelocity.toml");
  EXPECT_EQ(plan.code, 0);
  EXPECT_THAT(plan.out, HasSubstr("\"format\": \"isorig-plan/1\""));
  EXPECT_THAT(plan.out, HasSubstr("\"index\": 879"));
}

TEST_F(CliFiles, EveryFaultOfBothFilesIsPrintedAtOnce) {
  const auto rig = write("rig.toml", "[frame]\nany = 1\n[limits]\ntravel_min_mm = -6\n");
  const auto protocol = write("p.toml", "format = \"isorig-protocol/1\"\nnam = \"x\"\nsteps = [ { do = \"jump\" } ]\n");
  const auto check = isorig("check " + protocol + " --rig " + rig);
  EXPECT_EQ(check.code, 3);
  EXPECT_THAT(check.out, HasSubstr("rig.toml:3:1: `travel_max_mm` is missing here"));
  EXPECT_THAT(check.out, HasSubstr("p.toml:2:1: unknown key `nam`; did you mean `name`?"));
  EXPECT_THAT(check.out, HasSubstr("p.toml:3:18: `do` = \"jump\""));
}

TEST_F(CliFiles, LimitsComeFromTheRigsFileAndTheRestOfItIsNotLookedAt) {
  const auto rig = write("rig.toml",
                         "whatever = 1\n[frame]\nany = 1\n[limits]\ntravel_min_mm = -3\ntravel_max_mm = 6\n"
                         "speed_max_mm_s = 8\nforce_min_N = -5\nforce_max_N = 200\npressure_max_psi = 22\n");
  const auto check = isorig("check config/protocols/vma-isovelocity.toml --rig " + rig);
  EXPECT_EQ(check.code, 3);
  EXPECT_THAT(check.out, HasSubstr("config/protocols/vma-isovelocity.toml:34:57: `amplitude_mm` = 4 about 0 mm goes to "
                                   "-4; the rig travels from -3 to 6 mm"));
  EXPECT_THAT(check.out, HasSubstr(":37:73: `velocity_mm_s` = 10 with speed_mm_s = 10; the rig allows 0 to 8 mm/s"));
  EXPECT_EQ(isorig("check config/protocols/vma-smoke.toml").code, 0);
}

TEST(Cli, ShippedProtocolsKeepTheSimulatedRigsLimits) {
  for (const auto& entry : std::filesystem::directory_iterator(isorig::test::source_path("/config/protocols"))) {
    const auto check = isorig("check " + entry.path().string() + " --rig config/rigs/sim.toml");
    EXPECT_EQ(check.code, 0) << check.out;
    EXPECT_THAT(check.out, HasSubstr("within those of config/rigs/sim.toml"));
  }
}

TEST(Cli, ExitCodes) {
  EXPECT_EQ(isorig("--help").code, 0);
  EXPECT_EQ(isorig("").code, 2);
  EXPECT_EQ(isorig("check").code, 2);
  EXPECT_EQ(isorig("nonsense").code, 2);
  const auto missing = isorig("check no-such-file.toml");
  EXPECT_EQ(missing.code, 3);
  EXPECT_THAT(missing.out, HasSubstr("no-such-file.toml"));
}

}  // namespace
