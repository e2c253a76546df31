// The page of a run is written by another process: what is started, when, and what a process that fails, hangs or
// cannot be started does to the daemon (nothing).
#include "daemon/host/run_reporter.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <chrono>
#include <fstream>
#include <functional>
#include <memory>
#include <mutex>
#include <thread>
#include <vector>

#include "wait_until.hpp"

namespace isorig::daemon::test {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

class RunReporterTest : public ::testing::Test {
 protected:
  RunReporterTest() {
    std::filesystem::remove_all(folder_);
    std::filesystem::create_directories(folder_);
  }
  void TearDown() override {
    stop();
    std::filesystem::remove_all(folder_);
  }
  void stop() {
    if (reporter_) reporter_->stop();
    if (thread_.joinable()) thread_.join();
  }
  void start(const std::string& script) {
    std::ofstream(folder_ / "isorig") << "#!/bin/sh\n" << script << "\n";
    ::chmod((folder_ / "isorig").c_str(), 0755);
    start_program(folder_ / "isorig");
  }
  void start_program(const std::filesystem::path& program) {
    reporter_ = std::make_unique<RunReporter>(program, [this](const std::string& line) {
      const std::lock_guard lock(mutex_);
      log_.push_back(line);
    });
    thread_ = std::thread([this] { reporter_->run(); });
  }
  std::filesystem::path run(const std::string& name) {
    std::filesystem::create_directories(folder_ / "runs" / name);
    std::ofstream(folder_ / "runs" / name / "run.toml") << "\n";
    return folder_ / "runs" / name;
  }
  std::vector<std::string> log() {
    const std::lock_guard lock(mutex_);
    return log_;
  }
  std::vector<std::string> lines(const std::string& name) const {
    std::vector<std::string> out;
    std::ifstream in(folder_ / name);
    for (std::string line; std::getline(in, line);) out.push_back(line);
    return out;
  }

  const std::filesystem::path folder_ =
      std::filesystem::path(::testing::TempDir()) /
      ("run-reporter-" + std::string(::testing::UnitTest::GetInstance()->current_test_info()->name()) + "-" +
       std::to_string(::getpid()));
  std::unique_ptr<RunReporter> reporter_;
  std::thread thread_;
  std::mutex mutex_;
  std::vector<std::string> log_;
};

TEST_F(RunReporterTest, AsksForEachRunOnceAndInOrder) {
  start("echo \"$@\" >> " + (folder_ / "calls").string());
  const auto first = run("20260301-a"), second = run("20260302-b");
  reporter_->on_closed(first);
  reporter_->on_closed(second);
  ASSERT_TRUE(wait_until(10.0, [&] { return lines("calls").size() >= 2; }));
  EXPECT_THAT(log(), IsEmpty());  // now: the second may just be ending, and stop() would end it
  stop();
  EXPECT_THAT(lines("calls"),
              ElementsAre("report " + first.string() + " --background", "report " + second.string() + " --background"));
}

TEST_F(RunReporterTest, WhatFailsIsSaidWithTheWayOut) {
  start("echo 'no room' >&2; exit 4");
  reporter_->on_closed(run("20260301-a"));
  ASSERT_TRUE(wait_until(10.0, [&] { return !log().empty(); }));
  EXPECT_THAT(log().front(), HasSubstr("20260301-a"));
  EXPECT_THAT(log().front(), HasSubstr("exit code 4: no room"));
  EXPECT_THAT(log().front(), HasSubstr("isorig report"));
}

TEST_F(RunReporterTest, AProgramThatCannotBeStartedIsSaid) {
  start_program(folder_ / "not-there");
  reporter_->on_closed(run("20260301-a"));
  ASSERT_TRUE(wait_until(10.0, [&] { return !log().empty(); }));
  EXPECT_THAT(log().front(), HasSubstr("cannot be started"));
}

TEST_F(RunReporterTest, AProcessThatHangsDoesNotKeepTheDaemonFromEnding) {
  start("echo begun > " + (folder_ / "begun").string() + "; exec sleep 600");
  reporter_->on_closed(run("20260301-a"));
  reporter_->on_closed(run("20260301-b"));
  ASSERT_TRUE(wait_until(10.0, [&] { return !lines("begun").empty(); }));
  const auto before = std::chrono::steady_clock::now();
  stop();
  // A look every 50 ms, SIGTERM at once, SIGKILL after a second.
  EXPECT_LT(std::chrono::steady_clock::now() - before, std::chrono::seconds(5));
  ASSERT_EQ(log().size(), 1U) << "the second was not begun";
  EXPECT_THAT(log().front(), HasSubstr("20260301-a"));
}

TEST_F(RunReporterTest, TheNewestRunWithoutAPageIsMadeUpFor) {
  start("echo \"$2\" >> " + (folder_ / "calls").string());
  run("20260301-a");
  const auto newest = run("20260302-b");
  std::filesystem::create_directories(folder_ / "runs" / "calibration");  // no run
  reporter_->catch_up(folder_ / "runs");
  ASSERT_TRUE(wait_until(10.0, [&] { return !lines("calls").empty(); }));
  stop();
  EXPECT_THAT(lines("calls"), ElementsAre(newest.string()));
}

TEST_F(RunReporterTest, ARunThatHasItsPageIsLeftAlone) {
  start("echo \"$2\" >> " + (folder_ / "calls").string());
  const auto newest = run("20260302-b");
  std::ofstream(newest / "report.html") << "there";
  reporter_->catch_up(folder_ / "runs");
  reporter_->catch_up(folder_ / "nothing-there");
  const auto other = run("20260303-c");
  reporter_->on_closed(other);  // behind what catch_up() would have queued
  ASSERT_TRUE(wait_until(10.0, [&] { return !lines("calls").empty(); }));
  stop();
  EXPECT_THAT(lines("calls"), ElementsAre(other.string()));
}

TEST_F(RunReporterTest, WithoutAProgramNothingIsQueued) {
  RunReporter none({}, {});
  EXPECT_FALSE(none.enabled());
  none.on_closed(run("20260301-a"));
  none.stop();
  none.run();  // returns
}

}  // namespace
}  // namespace isorig::daemon::test
