// What isorig says to a command line that is wrong: the word, what was most likely meant, where to read more.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "processes.hpp"

namespace isorig::system_test {
namespace {

using testing::HasSubstr;
using testing::Not;

constexpr int kUsage = 2;

void expect_said(std::vector<std::string> words, const std::string& said) {
  const TempDir dir;
  const auto answer = isorig(dir, std::move(words));
  EXPECT_EQ(answer.code, kUsage) << answer.text;
  EXPECT_EQ(answer.text, said + "\n");
}

TEST(Usage, AMistypedCommandIsNamedWithWhatWasMeant) {
  expect_said({"strat", "p.toml"},
              "isorig: there is no command `strat`; did you mean `start`? `isorig --help` lists all");
  expect_said({"calibrat"},
              "isorig: there is no command `calibrat`; did you mean `calibrate`? `isorig --help` lists all");
  expect_said({"zzzzzzzz"}, "isorig: there is no command `zzzzzzzz`; `isorig --help` lists all");
  expect_said({std::string(5000, 'a')},
              "isorig: there is no command `" + std::string(5000, 'a') + "`; `isorig --help` lists all");
}

TEST(Usage, AMistypedOptionIsNamedWithWhatWasMeant) {
  expect_said(
      {"start", "p.toml", "--opertor", "me"},
      "isorig: start: there is no option `--opertor`; did you mean `--operator`? `isorig start --help` lists all");
  expect_said(
      {"start", "p.toml", "--opertor=me"},
      "isorig: start: there is no option `--opertor`; did you mean `--operator`? `isorig start --help` lists all");
  // The dashes are in every option: a word that shares no more than these with --go is not taken for it.
  expect_said({"start", "p.toml", "--rigg", "rig.toml"},
              "isorig: start: there is no option `--rigg`; `isorig start --help` lists all");
}

TEST(Usage, AnOptionBeforeAnyCommandIsNamedToo) {
  expect_said({"--versio"},
              "isorig: there is no option `--versio`; did you mean `--version`? `isorig --help` lists all");
}

TEST(Usage, WhatACommandMissesIsSaidWithItsName) {
  expect_said({"fv", "rec"}, "isorig: fv: --out is required; `isorig fv --help` says what it takes");
  expect_said({"start", "p.toml", "--operator"},
              "isorig: start: --operator: 1 required TEXT missing; `isorig start --help` says what it takes");
}

TEST(Usage, ADamagedJsonFileIsNamedWithoutTheLibrarysNames) {
  const TempDir dir;
  std::filesystem::create_directories(dir / "r");
  for (const auto* text : {"{\"format\": ", "[1, 2]", "{}"}) {
    spit(dir / "fv.json", text);
    const auto fv = isorig(dir, {"fv", (dir / "r").string(), "--model", "slse2", "--control",
                                 (dir / "fv.json").string(), "--out", (dir / "out").string()});
    EXPECT_EQ(fv.code, 3) << fv.text;
    EXPECT_THAT(fv.text, HasSubstr("fv.json: "));
    EXPECT_THAT(fv.text, HasSubstr("valid JSON"));
    EXPECT_THAT(fv.text, Not(HasSubstr("json.exception"))) << fv.text;
  }
}

/// A script that keeps what is printed must not take half of it for all of it.
TEST(Usage, WhatCannotBePrintedIsAnError) {
  for (const auto& words : std::vector<std::vector<std::string>>{{"schema", "rig"}, {"effects"}, {"--help"}}) {
    std::string command = bin("isorig");
    for (const auto& word : words) command += " " + word;
    for (const auto* to : {" >/dev/full", " >&-"}) {
      const TempDir dir;
      const auto answer = run(dir, {"/bin/sh", "-c", command + to + " 2>" + (dir / "said").string()});
      EXPECT_EQ(answer.code, 1) << command << to;
      EXPECT_THAT(slurp(dir / "said"), HasSubstr("isorig: not everything could be printed")) << command << to;
    }
  }
}

TEST(Usage, AFileThatIsNoLogIsNoRecording) {
  const TempDir dir;
  spit(dir / "README.md", "# Read me\n");
  for (const auto& words : std::vector<std::vector<std::string>>{
           {"show", (dir / "README.md").string()},
           {"report", (dir / "README.md").string(), "--out", (dir / "page.html").string()},
           {"export", (dir / "README.md").string(), "--out", (dir / "out").string()}}) {
    const auto answer = isorig(dir, words);
    EXPECT_EQ(answer.code, 3) << answer.text;
    EXPECT_THAT(answer.text, HasSubstr("README.md: is no LCM log"));
  }
  EXPECT_FALSE(std::filesystem::exists(dir / "page.html"));
  EXPECT_FALSE(std::filesystem::exists(dir / "out"));
}

TEST(Usage, ASeedThatNoRecordingCanHoldIsRefused) {
  const TempDir dir;
  for (const auto* seed : {"-1", "18446744073709551615", "99999999999999999999999", "1.5", "x"}) {
    const auto answer =
        isorig(dir, {"run", source("config/protocols/vma-smoke.toml"), "--rig", source("config/rigs/sim.toml"),
                     "--runs", (dir / "runs").string(), "--seed", seed});
    EXPECT_EQ(answer.code, kUsage) << seed << ": " << answer.text;
    EXPECT_THAT(answer.text, HasSubstr("is no seed: a whole number from 0 to 9223372036854775807")) << seed;
  }
  EXPECT_FALSE(std::filesystem::exists(dir / "runs"));
}

TEST(Usage, WhatIsNoTypingErrorIsLeftToTheParser) {
  const TempDir dir;
  const auto missing = isorig(dir, {"start"});
  EXPECT_EQ(missing.code, kUsage);
  EXPECT_THAT(missing.text, HasSubstr("protocol is required"));
  expect_said({}, "isorig: name a command: `isorig --help` lists all, `isorig COMMAND --help` explains one");
  const auto help = isorig(dir, {"start", "--help"});
  EXPECT_EQ(help.code, 0);
  EXPECT_THAT(help.text, Not(HasSubstr("there is no")));
}

}  // namespace
}  // namespace isorig::system_test
