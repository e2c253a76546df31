#include "daemon/host/unix_listener.hpp"

#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/file.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <string>

#include "recording_rig.hpp"

/// Who may listen on a path: no file is taken that is no dead socket, and of two daemons one lives.
namespace isorig::daemon::test {
namespace {

using ::testing::HasSubstr;

sockaddr_un address_of(const std::filesystem::path& path) {
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  std::strcpy(address.sun_path, path.c_str());
  return address;
}

bool somebody_listens(const std::filesystem::path& path) {
  const auto address = address_of(path);
  const int fd = ::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
  const bool answers = ::connect(fd, reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0;
  ::close(fd);
  return answers;
}

/// As a daemon that was killed leaves it.
void leave_dead_socket(const std::filesystem::path& path) {
  const auto address = address_of(path);
  const int fd = ::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
  ASSERT_EQ(::bind(fd, reinterpret_cast<const sockaddr*>(&address), sizeof address), 0);
  ::close(fd);
}

TEST(UnixListener, LeavesAFileThatIsNoSocket) {
  const testing::TemporaryDirectory folder("listener");
  const auto path = folder.path() / "thesis.txt";
  std::ofstream(path) << "three years of work";
  try {
    const UnixListener listener(path, 0600);
    ADD_FAILURE() << "it was taken for a socket";
  } catch (const std::runtime_error& e) {
    EXPECT_THAT(e.what(), HasSubstr("is no socket; isorigd does not touch it"));
  }
  EXPECT_EQ(std::filesystem::file_size(path), 19U);
  std::filesystem::create_symlink(path, folder.path() / "link");
  EXPECT_THROW(UnixListener(folder.path() / "link", 0600), std::runtime_error);
}

TEST(UnixListener, ReplacesADeadSocketAndNotALiveOne) {
  const testing::TemporaryDirectory folder("listener");
  const auto path = folder.path() / "s";
  leave_dead_socket(path);
  const UnixListener first(path, 0600);
  EXPECT_THROW(UnixListener(path, 0600), std::runtime_error);
  EXPECT_TRUE(somebody_listens(path));
}

/// Somebody else's lock is no daemon: said, and not waited for for ever.
TEST(UnixListener, SaysWhoseFolderIsLocked) {
  const testing::TemporaryDirectory folder("listener");
  const int held = ::open(folder.path().c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  ASSERT_EQ(::flock(held, LOCK_EX), 0);
  try {
    const UnixListener listener(folder.path() / "s", 0600);
    ADD_FAILURE() << "made in a locked folder";
  } catch (const std::runtime_error& e) {
    EXPECT_THAT(e.what(), HasSubstr("another process has locked " + folder.path().string()));
  }
  ::close(held);
  const UnixListener listener(folder.path() / "s", 0600);
  EXPECT_TRUE(somebody_listens(folder.path() / "s"));
}

/// A process that waits for another in the same memory, then makes a listener and keeps it until it is told to end.
class Rival {
 public:
  Rival(const std::filesystem::path& path, std::atomic<int>& line) {
    EXPECT_EQ(::pipe2(said_.data(), O_CLOEXEC), 0);
    EXPECT_EQ(::pipe2(end_.data(), O_CLOEXEC), 0);
    pid_ = ::fork();
    if (pid_ != 0) {
      ::close(said_[1]);
      ::close(end_[0]);
      return;
    }
    ::close(end_[1]);
    ++line;
    while (line.load() < 2) {
    }
    try {
      const UnixListener listener(path, 0600);
      say("listens");
      char byte = 0;
      (void)!::read(end_[0], &byte, 1);
    } catch (const std::exception& e) {
      say(e.what());
    }
    ::_exit(0);
  }
  ~Rival() {
    ::close(end_[1]);
    ::close(said_[0]);
    ::waitpid(pid_, nullptr, 0);
  }
  Rival(const Rival&) = delete;
  Rival& operator=(const Rival&) = delete;

  [[nodiscard]] std::string said() const {
    std::array<char, 512> text{};
    const ssize_t n = ::read(said_[0], text.data(), text.size());
    return {text.data(), n > 0 ? static_cast<std::size_t>(n) : 0};
  }

 private:
  void say(const std::string& text) const { (void)!::write(said_[1], text.data(), text.size()); }
  std::array<int, 2> said_{}, end_{};
  pid_t pid_ = -1;
};

TEST(UnixListener, OfTwoThatBeginAtOnceOneLivesWhateverWasThereBefore) {
  const testing::TemporaryDirectory folder("listener");
  auto* memory = ::mmap(nullptr, sizeof(std::atomic<int>), PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
  ASSERT_NE(memory, MAP_FAILED);
  for (int round = 0; round < 400; ++round) {
    const auto path = folder.path() / ("s" + std::to_string(round));
    if (round % 2 == 0) leave_dead_socket(path);
    auto* line = new (memory) std::atomic<int>(0);
    const Rival one(path, *line), two(path, *line);
    const std::array<std::string, 2> said{one.said(), two.said()};
    ASSERT_EQ(std::count(said.begin(), said.end(), "listens"), 1)
        << "round " << round << ": " << said[0] << " / " << said[1];
    EXPECT_THAT(said[0] == "listens" ? said[1] : said[0], HasSubstr("another daemon answers on " + path.string()));
    EXPECT_TRUE(somebody_listens(path)) << "round " << round;
  }
  ::munmap(memory, sizeof(std::atomic<int>));
}

}  // namespace
}  // namespace isorig::daemon::test
