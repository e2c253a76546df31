#include "sim/wire/wire_ends.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <poll.h>
#include <termios.h>
#include <unistd.h>

#include <filesystem>
#include <stdexcept>
#include <string>

namespace isorig::sim {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::ThrowsMessage;

TEST(WireEnds, APortThatIsTakenIsNamed) {
  const auto first = listen_on("127.0.0.1", 0);
  ASSERT_NE(first.port, 0);
  EXPECT_THAT([&] { (void)listen_on("127.0.0.1", first.port); },
              ThrowsMessage<std::runtime_error>(
                  AllOf(HasSubstr("127.0.0.1:" + std::to_string(first.port)), HasSubstr("Address already in use"))));
  EXPECT_THAT([] { (void)listen_on("localhost", 0); },
              ThrowsMessage<std::runtime_error>(HasSubstr("`localhost` is no IPv4 address")));
}

TEST(WireEnds, ARawLineEchoesNothingACookedOneDoes) {
  for (const bool raw : {true, false}) {
    const auto pty = open_pseudo_terminal(raw);
    termios mode{};
    ASSERT_EQ(::tcgetattr(pty.slave.get(), &mode), 0);
    EXPECT_EQ((mode.c_lflag & ECHO) == 0, raw);
    EXPECT_EQ((mode.c_lflag & ICANON) == 0, raw);
    char back = 0;
    EXPECT_EQ(::read(pty.master.get(), &back, 1), -1) << "the master does not block";
  }
}

TEST(WireEnds, ALinkGoesOverToTheNextLine) {
  const auto link =
      (std::filesystem::path(::testing::TempDir()) / ("wire-ends-" + std::to_string(::getpid()))).string();
  const auto first = open_pseudo_terminal(true);
  const auto second = open_pseudo_terminal(true);
  link_to(first.path, link);
  EXPECT_EQ(std::filesystem::read_symlink(link), first.path);
  link_to(second.path, link);
  EXPECT_EQ(std::filesystem::read_symlink(link), second.path);
  EXPECT_FALSE(std::filesystem::exists(link + ".new"));
  std::filesystem::remove(link);
  EXPECT_THAT([&] { link_to(first.path, "/no/such/folder/link"); },
              ThrowsMessage<std::runtime_error>(HasSubstr("cannot link /no/such/folder/link")));
}

TEST(WireEnds, AStopStaysRaised) {
  StopEvent stop;
  pollfd wait{stop.fd(), POLLIN, 0};
  EXPECT_EQ(::poll(&wait, 1, 0), 0);
  stop.raise();
  for (int i = 0; i < 2; ++i) EXPECT_EQ(::poll(&wait, 1, 0), 1);
}

}  // namespace
}  // namespace isorig::sim
