// What a page names by its file: read whole, or nothing, and never waited for.
#include "webserver/rules/files.hpp"

#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <fstream>

namespace isorig::web {
namespace {

class TextOf : public testing::Test {
 protected:
  TextOf() : folder_(testing::TempDir() + "isorig-files-" + std::to_string(::getpid())) {
    std::filesystem::create_directories(folder_);
  }
  ~TextOf() override { std::filesystem::remove_all(folder_); }
  [[nodiscard]] std::filesystem::path written(const char* name, std::size_t bytes) const {
    std::ofstream(folder_ / name) << std::string(bytes, 'x');
    return folder_ / name;
  }
  std::filesystem::path folder_;
};

TEST_F(TextOf, IsTheWholeFileUpToAMebibyte) {
  EXPECT_EQ(text_of(written("short.toml", 12)), std::string(12, 'x'));
  EXPECT_EQ(text_of(written("longest.toml", kFileBytes)), std::string(kFileBytes, 'x'));
  EXPECT_EQ(text_of(written("longer.toml", kFileBytes + 1)), std::nullopt);
}

TEST_F(TextOf, IsNothingWhereThereIsNoFile) {
  EXPECT_EQ(text_of(folder_ / "none.toml"), std::nullopt);
  EXPECT_EQ(text_of(folder_), std::nullopt);
}

// Nobody writes into it: a reader that opens it waits for ever, and with it every page (the test's own limit of time).
TEST_F(TextOf, IsNothingForAPipe) {
  ASSERT_EQ(::mkfifo((folder_ / "pipe.toml").c_str(), 0600), 0);
  EXPECT_EQ(text_of(folder_ / "pipe.toml"), std::nullopt);
}

}  // namespace
}  // namespace isorig::web
