#include "base/process.hpp"

#include <gtest/gtest.h>
#include <unistd.h>

#include <csignal>
#include <filesystem>
#include <stdexcept>
#include <thread>

#include "base/text_file.hpp"

namespace isorig::base {
namespace {

namespace fs = std::filesystem;

TEST(Process, MeasuresAProcessAndKeepsItsOutput) {
  const fs::path log = fs::temp_directory_path() / ("isorig-process-log-" + std::to_string(getpid()));
  const ProcessResult result = run_process({"sh", "-c", "echo said; exit 3"}, log);
  EXPECT_EQ(result.exit_code, 3);
  EXPECT_GE(result.wall_s, 0.0);
  EXPECT_EQ(read_text_file(log), "said\n");
  fs::remove(log);
  EXPECT_THROW((void)run_process({"/no/such/program"}, log), std::runtime_error);
  fs::remove(log);
}

TEST(Process, RunsInAFolderWithNothingOnItsInput) {
  const fs::path folder = fs::temp_directory_path() / ("isorig-process-" + std::to_string(getpid()));
  fs::create_directories(folder);
  ASSERT_EQ(run_process({"sh", "-c", "pwd; cat"}, folder / "log", {.working_directory = folder}).exit_code, 0);
  EXPECT_EQ(read_text_file(folder / "log"), fs::canonical(folder).string() + "\n");
  fs::remove_all(folder);
}

TEST(Process, EndsWithAllItsChildrenWhenTheGroupIsEnded) {
  const fs::path log = fs::temp_directory_path() / ("isorig-process-end-" + std::to_string(getpid()));
  Processes all;
  ProcessResult result;
  // The pipe is written to by the grandchild too: `cat` ends only when both are gone.
  std::jthread runs([&] {
    result = run_process({"sh", "-c", "(sleep 1000 & echo begun; wait) | cat"}, log, {.among = &all});
  });
  while (!fs::exists(log) || fs::file_size(log) == 0) std::this_thread::yield();
  all.end(SIGTERM);
  runs.join();
  EXPECT_EQ(result.signal, SIGTERM);
  EXPECT_EQ(result.exit_code, 128 + SIGTERM);
  // One that begins when all are being ended already.
  EXPECT_EQ(run_process({"sleep", "1000"}, log, {.among = &all}).signal, SIGTERM);
  fs::remove(log);
}

}  // namespace
}  // namespace isorig::base
