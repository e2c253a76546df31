#include "webserver/access.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

/// Links, sessions and control, in virtual time.
namespace isorig::web {
namespace {

using namespace std::chrono_literals;
using ::testing::HasSubstr;

const Time kNow = Time(1000h);

std::string session_of(Access& access, const std::string& name) {
  return access.redeem(access.mint({name, 1000}, kNow), kNow).value();
}

TEST(Access, ALinkWorksOnceAndNotForLong) {
  Access access;
  const auto token = access.mint({"Ann", 1000}, kNow);
  EXPECT_EQ(token.size(), 64U);
  EXPECT_NE(token, access.mint({"Ann", 1000}, kNow));
  EXPECT_FALSE(access.redeem("", kNow));
  EXPECT_FALSE(access.redeem(token.substr(1), kNow));
  const auto session = access.redeem(token, kNow + 119s);
  ASSERT_TRUE(session);
  EXPECT_NE(*session, token);
  EXPECT_EQ(access.who(*session, kNow + 120s)->name, "Ann");
  EXPECT_FALSE(access.redeem(token, kNow + 119s));
  EXPECT_FALSE(access.redeem(access.mint({"Ann", 1000}, kNow), kNow + 120s));
  EXPECT_FALSE(access.who("", kNow));
  EXPECT_FALSE(access.who(token, kNow));
}

TEST(Access, LinksThatNobodyOpensAreBoundedAndExpire) {
  Access access;
  for (int i = 0; i < 32; ++i) (void)access.mint({"Ann", 1000}, kNow);
  EXPECT_THAT(
      [&] {
        (void)access.mint({"Ann", 1000}, kNow);
      },
      ::testing::ThrowsMessage<Access::TooMany>(HasSubstr("32")));
  (void)access.mint({"Ann", 1000}, kNow + 120s);
}

TEST(Access, SessionsAreBoundedAndEndWhenNobodyUsesThem) {
  Access access;
  std::string first;
  for (int i = 0; i < 64; ++i) first = session_of(access, "Ann");
  EXPECT_THROW(session_of(access, "Ann"), Access::TooMany);
  EXPECT_TRUE(access.who(first, kNow + 11h));
  EXPECT_TRUE(access.who(first, kNow + 22h)) << "it was used in between";
  EXPECT_FALSE(access.who(first, kNow + 35h));
  access.expire(kNow + 35h);
  EXPECT_NO_THROW(session_of(access, "Ann"));
}

TEST(Access, OneHasControlAndTakingItOverSaysFromWhom) {
  Access access;
  const auto ann = session_of(access, "Ann"), bob = session_of(access, "Bob");
  EXPECT_FALSE(access.take("nobody", true, kNow).ok);
  EXPECT_FALSE(access.has_control(""));
  ASSERT_TRUE(access.take(ann, false, kNow).ok);
  EXPECT_TRUE(access.has_control(ann));
  const auto refused = access.take(bob, false, kNow);
  EXPECT_FALSE(refused.ok);
  EXPECT_THAT(refused.text, HasSubstr("Ann has control"));
  const auto taken = access.take(bob, true, kNow);
  EXPECT_TRUE(taken.ok);
  EXPECT_EQ(taken.taken_from, "Ann");
  EXPECT_FALSE(access.has_control(ann));
  EXPECT_FALSE(access.give_back(ann)) << "somebody else's control was given back";
  EXPECT_TRUE(access.has_control(bob));
  EXPECT_TRUE(access.give_back(bob));
  EXPECT_FALSE(access.lease());
  ASSERT_TRUE(access.take(ann, false, kNow).ok);
  access.leave(ann);
  EXPECT_FALSE(access.lease());
  EXPECT_FALSE(access.who(ann, kNow));
}

TEST(Access, ControlOfAPageThatIsGoneEnds) {
  Access access;
  const auto ann = session_of(access, "Ann");
  ASSERT_TRUE(access.take(ann, false, kNow).ok);
  access.connected(ann, true, kNow);
  access.connected(ann, true, kNow);
  EXPECT_FALSE(access.expire(kNow + 1h));
  access.connected(ann, false, kNow + 1h);
  EXPECT_FALSE(access.expire(kNow + 2h)) << "another page of the same session is there";
  access.connected(ann, false, kNow + 2h);
  EXPECT_FALSE(access.expire(kNow + 2h + 60s)) << "a reload takes control away";
  const auto gone = access.expire(kNow + 2h + 61s);
  ASSERT_TRUE(gone);
  EXPECT_EQ(gone->name, "Ann");
  EXPECT_FALSE(access.has_control(ann));
  EXPECT_FALSE(access.expire(kNow + 3h)) << "told twice";
}

}  // namespace
}  // namespace isorig::web
