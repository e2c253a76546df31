#include "base/text_file.hpp"

#include <gtest/gtest.h>
#include <sys/stat.h>

#include <fstream>

#include "base/toml_reader.hpp"

namespace isorig::base {
namespace {

TEST(TextFile, APipeIsRefusedAndNotWaitedFor) {
  std::string folder = testing::TempDir() + "text-file-XXXXXX";
  ASSERT_NE(::mkdtemp(folder.data()), nullptr);
  const std::filesystem::path pipe = folder + "/rig.toml", file = folder + "/file.toml";
  ASSERT_EQ(::mkfifo(pipe.c_str(), 0600), 0);
  std::ofstream(file) << "a = 1\n";
  EXPECT_NE(why_not_a_file(pipe), "");
  EXPECT_NE(why_not_a_file("/dev/zero"), "");
  EXPECT_EQ(why_not_a_file(file), "");
  EXPECT_EQ(why_not_a_file(folder), "");
  EXPECT_EQ(why_not_a_file(folder + "/none"), "");
  std::filesystem::create_symlink(pipe, folder + "/link");
  EXPECT_NE(why_not_a_file(folder + "/link"), "");
  try {
    (void)TomlDocument::parse_file(pipe);
    FAIL() << "was opened";
  } catch (const ConfigError& e) {
    EXPECT_NE(std::string(e.what()).find("is a pipe and no file"), std::string::npos) << e.what();
  }
  std::filesystem::remove_all(folder);
}

}  // namespace
}  // namespace isorig::base
