#include "base/process.hpp"

#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <stdexcept>

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

}  // namespace
}  // namespace isorig::base
