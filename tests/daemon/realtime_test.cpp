#include "daemon/core/realtime.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>

#include "base/toml_reader.hpp"

namespace isorig::daemon {
namespace {

using testing::HasSubstr;

template <class Call>
std::string refusal(Call&& call) {
  try {
    call();
  } catch (const RealtimeError& error) {
    return error.what();
  }
  return "none";
}

TEST(Realtime, DevicesStayBelowTheLoop) {
  const auto read = [](const std::string& text) {
    const auto document = base::TomlDocument::parse_text(text, "rig.toml");
    const auto config = RealtimeConfig::read(document.root());
    document.finish();
    return config;
  };
  const auto config = read("period_us = 500\npriority = 70\nio_priority = 69\ncpu = 1\n");
  EXPECT_EQ(config.period_ns, 500'000);
  EXPECT_EQ(config.priority, 70);
  EXPECT_EQ(config.io_priority, 69);
  EXPECT_EQ(config.cpu, 1);
  try {
    (void)read("priority = 60\nio_priority = 60\n");
    ADD_FAILURE() << "a device thread may keep the loop waiting";
  } catch (const base::ConfigError& error) {
    EXPECT_THAT(error.what(), HasSubstr("`io_priority` has to be below `priority`"));
  }
}

// What no machine grants: a priority beyond SCHED_FIFO's 99, a processor that is not there.
TEST(Realtime, WhatTheMachineDoesNotGrantIsSaidUnlessItIsNotAskedFor) {
  RealtimeConfig config;
  config.cpu = 1023;
  EXPECT_THAT(refusal([&] { pin(config); }), HasSubstr("cannot be pinned to CPU 1023"));
  EXPECT_THAT(refusal([&] { enter_realtime(config, 1000); }), HasSubstr("or start with --no-realtime"));
  config.enforce = false;
  EXPECT_EQ(refusal([&] { pin(config); }), "none");
  EXPECT_EQ(refusal([&] { enter_realtime(config, 1000); }), "none");
  config = {};
  EXPECT_EQ(refusal([&] { pin(config); }), "none") << "no processor was named";
}

}  // namespace
}  // namespace isorig::daemon
