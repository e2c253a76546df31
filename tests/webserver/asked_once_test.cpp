#include "webserver/rules/asked_once.hpp"

#include <gtest/gtest.h>

#include <string>
#include <vector>

namespace isorig::web {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;

/// Pages that ask, and a daemon that is asked.
class AskedOnceTest : public testing::Test {
 protected:
  void get(const std::string& what) {
    once.get(what, now, [this](const PageAnswer& a) { got.push_back(std::to_string(a.status) + " " + a.text); });
  }
  void answer(const std::string& what, const std::string& text, int status = 200) {
    once.answered(what, {status, text}, now);
  }
  Time now = Time() + seconds(100);
  std::vector<std::string> asked, got;
  AskedOnce once{[this](const std::string& what) { asked.push_back(what); }};
};

using Texts = std::vector<std::string>;

TEST_F(AskedOnceTest, OneQuestionIsUnderWayWhoeverAsksAndAllGetItsAnswer) {
  for (int i = 0; i < 100; ++i) get("runs");
  get("calibrations");
  EXPECT_EQ(asked, (Texts{"runs", "calibrations"}));
  answer("runs", "r");
  EXPECT_EQ(got, Texts(100, "200 r"));
  answer("calibrations", "c");
  EXPECT_EQ(got.back(), "200 c");
}

TEST_F(AskedOnceTest, AnAnswerIsGoodForTwoSeconds) {
  get("runs");
  answer("runs", "old");
  now += milliseconds(1999);
  get("runs");
  EXPECT_EQ(got, (Texts{"200 old", "200 old"}));
  now += milliseconds(1);
  get("runs");
  EXPECT_EQ(asked.size(), 2U);
  answer("runs", "new");
  EXPECT_EQ(got.back(), "200 new");
}

TEST_F(AskedOnceTest, QuestionsOfThoseWhoHaveGoneAreNotKept) {
  for (int i = 0; i < 100; ++i) {
    get("may see " + std::to_string(i));
    answer("may see " + std::to_string(i), "yes");
    now += seconds(1);
  }
  EXPECT_LE(once.kept(), 2U);
}

TEST_F(AskedOnceTest, ARefusalIsNotKept) {
  get("runs");
  answer("runs", "busy", 503);
  get("runs");
  EXPECT_EQ(asked.size(), 2U);
}

TEST_F(AskedOnceTest, WhoAsksAfterAChangeGetsNoAnswerOfBefore) {
  get("runs");
  answer("runs", "old");
  once.forget();
  get("runs");
  EXPECT_EQ(asked.size(), 2U) << "what is kept is void";
  once.forget();  // while it is under way
  get("runs");
  get("runs");
  EXPECT_EQ(asked.size(), 2U) << "one at a time";
  answer("runs", "before");
  EXPECT_EQ(got, (Texts{"200 old", "200 before"}));
  EXPECT_EQ(asked.size(), 3U);
  answer("runs", "after");
  EXPECT_EQ(got, (Texts{"200 old", "200 before", "200 after", "200 after"}));
  get("runs");
  EXPECT_EQ(asked.size(), 3U);
}

}  // namespace
}  // namespace isorig::web
