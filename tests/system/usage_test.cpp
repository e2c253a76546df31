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
}

TEST(Usage, WhatIsNoTypingErrorIsLeftToTheParser) {
  const TempDir dir;
  const auto missing = isorig(dir, {"start"});
  EXPECT_EQ(missing.code, kUsage);
  EXPECT_THAT(missing.text, HasSubstr("protocol is required"));
  const auto bare = isorig(dir, {});
  EXPECT_EQ(bare.code, kUsage);
  EXPECT_THAT(bare.text, HasSubstr("--help"));
  const auto help = isorig(dir, {"start", "--help"});
  EXPECT_EQ(help.code, 0);
  EXPECT_THAT(help.text, Not(HasSubstr("there is no")));
}

}  // namespace
}  // namespace isorig::system_test
