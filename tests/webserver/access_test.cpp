#include "webserver/rules/access.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <vector>

/// Links, sessions and what the daemon says of control, in virtual time.
namespace isorig::web {
namespace {

using namespace std::chrono_literals;
using ::testing::HasSubstr;

const Time kNow = Time(1000h);

std::string session_of(Access& access, const std::string& name) {
  return access.redeem(access.mint({name, 1000, 1000, {27}, {}}, kNow), kNow).value();
}

TEST(Access, ALinkWorksOnceAndNotForLong) {
  Access access;
  const auto token = access.mint({"Ann", 1000, 1000, {}, {}}, kNow);
  EXPECT_EQ(token.size(), 64U);
  EXPECT_NE(token, access.mint({"Ann", 1000, 1000, {}, {}}, kNow));
  EXPECT_FALSE(access.redeem("", kNow));
  EXPECT_FALSE(access.redeem(token.substr(1), kNow));
  const auto session = access.redeem(token, kNow + 119s);
  ASSERT_TRUE(session);
  EXPECT_NE(*session, token);
  EXPECT_EQ(access.who(*session, kNow + 120s)->name, "Ann");
  EXPECT_FALSE(access.redeem(token, kNow + 119s));
  EXPECT_FALSE(access.redeem(access.mint({"Ann", 1000, 1000, {}, {}}, kNow), kNow + 120s));
  EXPECT_FALSE(access.who("", kNow));
  EXPECT_FALSE(access.who(token, kNow));
}

TEST(Access, LinksThatNobodyOpensAreBoundedAndExpire) {
  Access access;
  for (int i = 0; i < 32; ++i) (void)access.mint({"Ann", 1000, 1000, {}, {}}, kNow);
  EXPECT_THAT(
      [&] {
        (void)access.mint({"Ann", 1000, 1000, {}, {}}, kNow);
      },
      ::testing::ThrowsMessage<Access::TooMany>(HasSubstr("32")));
  (void)access.mint({"Ann", 1000, 1000, {}, {}}, kNow + 120s);
}

TEST(Access, WhereEverySessionHasAPageAnotherIsRefusedAndItsLinkStaysGood) {
  Access access;
  std::string first;
  for (int i = 0; i < 64; ++i) {
    first = session_of(access, "Ann");
    access.connected(first, true, kNow);
  }
  const auto token = access.mint({"Ann", 1000, 1000, {}, {}}, kNow);
  EXPECT_THROW((void)access.redeem(token, kNow), Access::TooMany);
  access.connected(first, false, kNow);
  EXPECT_TRUE(access.redeem(token, kNow)) << "the link was not used up by the refusal";
  EXPECT_FALSE(access.who(first, kNow)) << "the one without a page made room";
}

TEST(Access, TheSessionThatNobodyHasUsedForTheLongestMakesRoom) {
  Access access;
  std::vector<std::string> sessions;
  for (int i = 0; i < 64; ++i) sessions.push_back(session_of(access, "Ann"));
  for (int i = 0; i < 64; ++i) EXPECT_TRUE(access.who(sessions[i], kNow + (i == 5 ? 1s : 2s)));
  EXPECT_NO_THROW(session_of(access, "Bob"));
  EXPECT_FALSE(access.who(sessions[5], kNow + 3s));
  for (int i = 0; i < 64; ++i) EXPECT_EQ(access.who(sessions[i], kNow + 3s).has_value(), i != 5) << i;
}

TEST(Access, SessionsEndWhenNobodyUsesThem) {
  Access access;
  const auto first = session_of(access, "Ann");
  EXPECT_TRUE(access.who(first, kNow + 11h));
  EXPECT_TRUE(access.who(first, kNow + 22h)) << "it was used in between";
  EXPECT_FALSE(access.who(first, kNow + 35h));
}

TEST(Access, ASessionWithAnOpenPageLastsAsLongAsThePage) {
  Access access;
  const auto session = session_of(access, "Ann");
  access.connected(session, true, kNow);
  access.expire(kNow + 23h);
  EXPECT_TRUE(access.who(session, kNow + 23h)) << "the page shows Pause: it has to work";
  access.connected(session, false, kNow + 47h);
  EXPECT_TRUE(access.who(session, kNow + 58h)) << "12 h count from when the page was closed";
  access.expire(kNow + 71h);
  EXPECT_FALSE(access.who(session, kNow + 71h));
}

TEST(Access, ASessionIsAUserWithGroupsAndAPageOfItsOwn) {
  Access access;
  const auto one = session_of(access, "Ann"), other = session_of(access, "Ann");
  const auto who = access.who(one, kNow).value();
  EXPECT_EQ(who.uid, 1000U);
  EXPECT_EQ(who.groups, std::vector<gid_t>{27});
  EXPECT_EQ(who.page.size(), 16U);
  EXPECT_NE(who.page, access.who(other, kNow)->page);
  EXPECT_EQ(one.find(who.page), std::string::npos) << "the daemon's log would have the secret";
  access.leave(one);
  EXPECT_FALSE(access.who(one, kNow));
}

TEST(Access, ControlIsWhereTheDaemonSaysItIs) {
  Access access;
  const auto ann = session_of(access, "Ann"), bob = session_of(access, "Bob");
  EXPECT_FALSE(access.has_control(""));
  EXPECT_FALSE(access.has_control(ann)) << "nobody has it: the term of none is nobody's";
  EXPECT_FALSE(access.control_is(std::nullopt));
  access.won(ann, 7);
  EXPECT_FALSE(access.has_control(ann)) << "not before the daemon says that this term is";
  EXPECT_TRUE(access.control_is(Access::Control{"Ann", 7}));
  EXPECT_FALSE(access.control_is(Access::Control{"Ann", 7})) << "told twice";
  EXPECT_TRUE(access.has_control(ann));
  EXPECT_FALSE(access.has_control(bob));
  EXPECT_FALSE(access.has_control(""));
  EXPECT_TRUE(access.control_is(Access::Control{"ann (terminal)", 8}));
  EXPECT_FALSE(access.has_control(ann));
  EXPECT_EQ(access.control()->holder, "ann (terminal)");
  EXPECT_TRUE(access.control_is(std::nullopt));
  EXPECT_FALSE(access.control());
}

TEST(Access, OnlyAHolderWhoLooksAtAPageIsSaidToBeThere) {
  Access access;
  const auto ann = session_of(access, "Ann"), bob = session_of(access, "Bob");
  access.won(ann, 3);
  access.control_is(Access::Control{"Ann", 3});
  EXPECT_FALSE(access.present_holder());
  access.connected(bob, true, kNow);
  EXPECT_FALSE(access.present_holder());
  access.connected(ann, true, kNow);
  access.connected(ann, true, kNow);
  ASSERT_TRUE(access.present_holder());
  EXPECT_EQ(*access.present_holder(), ann);
  access.connected(ann, false, kNow);
  EXPECT_TRUE(access.present_holder()) << "another page of the same session is there";
  EXPECT_TRUE(access.is_present(ann));
  access.connected(ann, false, kNow);
  EXPECT_FALSE(access.is_present(ann));
  EXPECT_FALSE(access.is_present("of nobody"));
  EXPECT_FALSE(access.present_holder());
}

}  // namespace
}  // namespace isorig::web
