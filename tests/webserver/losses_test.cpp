#include "webserver/rules/losses.hpp"

#include <gtest/gtest.h>

namespace isorig::web {
namespace {

TEST(Losses, ASampleThatTheDaemonCountedAndWhoseNumberIsMissingIsOne) {
  Losses losses;
  losses.connected();
  losses.record();
  losses.told({10, 2, 0});
  EXPECT_EQ(losses.all(10), 12U);
  EXPECT_EQ(losses.all(0), 12U) << "the next number has not come yet";
  EXPECT_EQ(losses.all(15), 17U) << "five never reached the daemon";
  EXPECT_EQ(losses.on_the_way(), 12U);
}

TEST(Losses, WhatWasLostBeforeTheSocketCountsFromTheConnectionOnAndOnce) {
  Losses losses;
  losses.connected();
  losses.told({0, 0, 100});  // since the daemon's start: nobody was here
  losses.record();
  EXPECT_EQ(losses.all(0), 0U);
  losses.told({0, 0, 130});
  EXPECT_EQ(losses.all(20), 30U) << "20 samples, and 10 of another kind at least";
  losses.connected();
  losses.told({0, 0, 130});
  losses.record();
  EXPECT_EQ(losses.all(20), 30U) << "again at each connection";
  losses.connected();
  losses.record();
  losses.told({1, 1, 4});  // another daemon
  EXPECT_EQ(losses.all(20), 36U);
}

}  // namespace
}  // namespace isorig::web
