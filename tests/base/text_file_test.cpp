#include "base/text_file.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <string>

#include "base/toml_reader.hpp"

namespace isorig::base {
namespace {

namespace fs = std::filesystem;
using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::StartsWith;

class TextFileTest : public ::testing::Test {
 protected:
  void SetUp() override { fs::create_directories(folder_); }
  void TearDown() override { fs::remove_all(folder_); }
  fs::path put(const char* name, const std::string& text) const {
    const auto path = folder_ / name;
    std::ofstream(path, std::ios::binary) << text;
    return path;
  }
  /// What read_text_file says of it, and that read_config_file says the same as a ConfigError.
  static std::string refusal(const fs::path& path, bool missing) {
    std::string said;
    try {
      static_cast<void>(read_text_file(path));
      ADD_FAILURE() << path << " was read";
    } catch (const FileError& e) {
      EXPECT_EQ(e.path(), path);
      EXPECT_EQ(e.missing(), missing);
      EXPECT_EQ(e.what(), path.string() + ": " + e.reason());
      said = e.what();
    }
    try {
      static_cast<void>(read_config_file(path));
      ADD_FAILURE() << path << " was read";
    } catch (const ConfigError& e) {
      EXPECT_EQ(e.what(), said);
    }
    return said;
  }

  fs::path folder_ = fs::temp_directory_path() / ("text-file-" + std::to_string(::getpid()));
};

TEST_F(TextFileTest, EveryByteOfIt) {
  std::string text = "a\r\nb\0c\xff";
  text += std::string(1, '\0') + "end";
  EXPECT_EQ(read_text_file(put("bytes", text)), text);
  EXPECT_EQ(read_text_file(put("empty", "")), "");
  const std::string large(1'000'003, 'x');  // many chunks
  EXPECT_EQ(read_text_file(put("large", large)), large);
  EXPECT_EQ(read_config_file(put("config", "a = 1\n")), "a = 1\n");
}

TEST_F(TextFileTest, AFileThatSaysItIsEmptyIsReadAllTheSame) {
  ASSERT_EQ(fs::file_size("/proc/self/status"), 0U);
  EXPECT_THAT(read_text_file("/proc/self/status"), HasSubstr("VmLck"));
}

TEST_F(TextFileTest, NoMoreThanAsked) {
  EXPECT_EQ(read_text_file(put("text", "abcdef"), 4), "abcd");
  EXPECT_EQ(read_text_file(put("text", "abcd"), 4), "abcd");
  EXPECT_THAT(refusal("/dev/zero", false), HasSubstr("is a device and no file"));
}

TEST_F(TextFileTest, SaysWhatIsWrongWithWhichFileAndWhatToDo) {
  EXPECT_THAT(refusal(folder_ / "nowhere", true),
              AllOf(HasSubstr("nowhere: cannot be opened: No such file"), HasSubstr("check the path")));
  EXPECT_THAT(refusal(put("file", "") / "below", true), HasSubstr("Not a directory"));
  EXPECT_THAT(refusal(folder_, false), AllOf(HasSubstr("it is a folder"), HasSubstr("name a file in it")));
  // A disk that fails while it is read: of a process's memory the first page cannot be read.
  EXPECT_THAT(refusal("/proc/self/mem", false), HasSubstr("cannot be read to its end: Input/output error"));
}

TEST_F(TextFileTest, AFileThatMayNotBeRead) {
  const auto path = put("secret", "x");
  ASSERT_EQ(::chmod(path.c_str(), 0), 0);
  // Root may read everything: for this one question it is somebody else.
  const uid_t own = ::geteuid();
  const struct Restore {
    uid_t uid;
    ~Restore() { EXPECT_EQ(::seteuid(uid), 0); }
  } restore{own};
  constexpr uid_t kNobody = 65534;
  ASSERT_EQ(::seteuid(own == 0 ? kNobody : own), 0);
  EXPECT_THAT(refusal(path, false), AllOf(HasSubstr("Permission denied"), HasSubstr("permissions")));
}

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
