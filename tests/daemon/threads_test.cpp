#include "daemon/threads.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>

#include "base/toml_reader.hpp"
#include "protocol/compile.hpp"

namespace isorig::daemon {
namespace {

using testing::HasSubstr;

std::size_t own_stack_bytes() {
  pthread_attr_t attributes;
  if (pthread_getattr_np(pthread_self(), &attributes) != 0) return 0;
  std::size_t bytes = 0;
  pthread_attr_getstacksize(&attributes, &bytes);
  pthread_attr_destroy(&attributes);
  return bytes;
}

TEST(Threads, StacksAreAsLargeAsTheirThreadsNeed) {
  RealtimeConfig realtime;
  realtime.enforce = false;
  std::vector<std::thread> threads;
  std::size_t ordinary = 0, real_time = 0;
  spawn(threads, "ordinary", 0, realtime, [&] { ordinary = own_stack_bytes(); });
  spawn(threads, "real-time", realtime.io_priority, realtime, [&] { real_time = own_stack_bytes(); });
  for (auto& thread : threads) thread.join();
  EXPECT_EQ(ordinary, kStackBytes);
  EXPECT_EQ(real_time, kRealtimeStackBytes);
}

TEST(Threads, AStackThatCannotBeHadIsSaid) {
  try {
    set_stack_bytes(1);
    ADD_FAILURE() << "a stack of one byte";
  } catch (const std::runtime_error& e) {
    EXPECT_THAT(e.what(), HasSubstr("no thread can have a stack of 0 KiB"));
  }
}

std::string nested(int depth, const std::string& opening, const std::string& closing) {
  std::string text = "format = \"isorig-protocol/1\"\nname = \"p\"\nsteps = ";
  for (int i = 0; i < depth; ++i) text += opening;
  for (int i = 0; i < depth; ++i) text += closing;
  return text;
}

// What arrives from outside recurses at most so deep; half of the stack must be enough. An overflow ends this program.
TEST(Threads, TheDeepestNestingLeavesHalfOfTheStack) {
  set_stack_bytes(kStackBytes / 2);
  std::vector<std::string> outcomes;
  std::thread reader([&] {
    for (const int depth : {100, 127, 250, 255, 300, 100'000}) {
      for (const auto& text : {nested(depth, "[", "]"), nested(depth, "{ a = ", "}"),
                               nested(depth, "[ { do = \"repeat\", times = 1, steps = ", " } ]")}) {
        try {
          (void)protocol::compile(base::TomlDocument::parse_text(text, "p.toml"));
          outcomes.emplace_back("compiled");
        } catch (const base::ConfigError& e) {
          outcomes.emplace_back(e.what());
        }
      }
    }
  });
  reader.join();
  set_stack_bytes(kStackBytes);
  EXPECT_EQ(outcomes.size(), 18U);
  EXPECT_THAT(outcomes.back(), HasSubstr("p.toml"));
}

}  // namespace
}  // namespace isorig::daemon
