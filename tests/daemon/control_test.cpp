#include "daemon/host/control.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <vector>

/// Who has control, in virtual time: terminals and pages under one rule.
namespace isorig::daemon::test {
namespace {

using namespace std::chrono_literals;
using ::testing::AllOf;
using ::testing::HasSubstr;

const Control::Time kNow = Control::Time(1000h);
constexpr std::int64_t kUnix_s = 1'795'422'720;  // 2026-11-23T08:32:00Z

const Seat kAnn{1000, "ann", {}, 1000};
const Seat kBob{1001, "bob", {}, 1001};
const Seat kAnnsPage{1000, "Ann", "a1", 990, true};
const Seat kAnnsOtherPage{1000, "Cleo", "a2", 990, true};
const Seat kBobsPage{1001, "Bob", "b1", 990, true};

class ControlTest : public ::testing::Test {
 protected:
  bool busy_ = false;
  std::vector<std::string> ended_;
  Control control_{[this] { return busy_; }, [this](const Control::Holder& h) { ended_.push_back(h.seat.name); }};

  [[nodiscard]] std::string holder(Control::Time at = kNow) {
    const auto h = control_.holder(at);
    return h ? h->seat.name : "";
  }
  /// Why not; "" when it was let through.
  std::string use(const Seat& seat, Control::Time at = kNow) { return control_.use(seat, at, kUnix_s).refused; }
  Control::Answer take(const Seat& seat, bool over = false, Control::Time at = kNow) {
    return control_.take(seat, over, at, kUnix_s);
  }
};

TEST_F(ControlTest, TheFirstTerminalTakesItWithItsCommandAndTheNextIsToldWhoHasIt) {
  EXPECT_EQ(holder(), "");
  EXPECT_EQ(use(kAnn), "");
  EXPECT_EQ(holder(), "ann");
  EXPECT_EQ(use(kAnn), "");
  EXPECT_THAT(use(kBob), AllOf(HasSubstr("ann has control (at a terminal, since 08:32 UTC)"),
                               HasSubstr("isorig control --take-over")));
  EXPECT_THAT(use(kBobsPage), HasSubstr("ann has control"));
  EXPECT_FALSE(take(kBob).ok);
  EXPECT_EQ(holder(), "ann");
}

TEST_F(ControlTest, ACommandThatWasRefusedLeavesControlWhereItWas) {
  const auto first = control_.use(kAnn, kNow, kUnix_s);
  ASSERT_NE(first.newly, 0U);
  control_.undo(first.newly);
  EXPECT_EQ(holder(), "");
  EXPECT_EQ(use(kBob), "");
  control_.undo(first.newly);
  EXPECT_EQ(holder(), "bob") << "somebody else's control was given back";
  const auto again = control_.use(kBob, kNow, kUnix_s);
  EXPECT_EQ(again.newly, 0U) << "it was his before this command";
  control_.undo(again.newly);
  EXPECT_EQ(holder(), "bob");
}

TEST_F(ControlTest, ACommandThatWasRefusedDoesNotTakeAwayWhatWasConfirmedMeanwhile) {
  const auto by_use = control_.use(kAnn, kNow, kUnix_s);
  EXPECT_EQ(control_.use(kAnn, kNow, kUnix_s).newly, 0U) << "a second command, which is done";
  control_.undo(by_use.newly);
  EXPECT_EQ(holder(), "ann");
  ASSERT_TRUE(control_.give_back(kAnn, kNow).ok);
  const auto by_take = control_.use(kAnn, kNow, kUnix_s);
  EXPECT_TRUE(take(kAnn).ok);
  control_.undo(by_take.newly);
  EXPECT_EQ(holder(), "ann");
}

TEST_F(ControlTest, ACommandThatIsJudgedTwiceConfirmsNothingByItAndMayHaveLostControl) {
  const auto first = control_.use(kAnn, kNow, kUnix_s);
  auto again = control_.use(kAnn, kNow, kUnix_s, first.newly);
  EXPECT_EQ(again.newly, first.newly);
  control_.undo(again.newly);
  EXPECT_EQ(holder(), "");
  const auto waits = control_.use(kAnn, kNow, kUnix_s);
  ASSERT_TRUE(take(kBob, true).ok);
  again = control_.use(kAnn, kNow, kUnix_s, waits.newly);
  EXPECT_THAT(again.refused, HasSubstr("bob has control"));
  control_.undo(again.newly);
  control_.undo(waits.newly);
  EXPECT_EQ(holder(), "bob");
}

TEST_F(ControlTest, WhoOnlySaysThatHeIsSomebodyIsNotTakenForHim) {
  const Seat forged{1000, "Ann", "a1", 1001};
  EXPECT_EQ(use(kAnn), "");
  EXPECT_FALSE(take(forged).ok);
  EXPECT_EQ(holder(), "ann");
  const auto over = take(forged, true);
  EXPECT_EQ(over.taken_from, "ann");
  EXPECT_THAT(use(kAnn), HasSubstr("has control")) << "nor he for whoever said so";
  EXPECT_FALSE(control_.give_back(kAnn, kNow).ok);
  ASSERT_TRUE(take(kAnn, true).ok);
  // A page that she serves herself is hers.
  const Seat own{1000, "Ann", "a1", 1000};
  EXPECT_TRUE(take(own).ok);
  EXPECT_EQ(use(kAnn), "");
}

TEST_F(ControlTest, TakingItOverSaysFromWhomAndCountsTheHolders) {
  const auto ann = take(kAnnsPage);
  ASSERT_TRUE(ann.ok);
  const auto refused = take(kBobsPage);
  EXPECT_FALSE(refused.ok);
  EXPECT_THAT(refused.text, HasSubstr("Ann has control (on the live page"));
  const auto bob = take(kBob, true);
  ASSERT_TRUE(bob.ok);
  EXPECT_EQ(bob.taken_from, "Ann");
  EXPECT_GT(bob.term, ann.term);
  EXPECT_THAT(use(kAnnsPage), HasSubstr("bob has control"));
  EXPECT_FALSE(control_.give_back(kAnnsPage, kNow).ok);
  EXPECT_EQ(holder(), "bob");
  EXPECT_TRUE(control_.give_back(kBob, kNow).ok);
  EXPECT_EQ(holder(), "");
  EXPECT_TRUE(control_.give_back(kBob, kNow).ok) << "nobody has it: nothing to give";
}

TEST_F(ControlTest, NoTermIsThatOfADaemonBefore) {
  std::uint64_t last = 0;
  for (int i = 0; i < 5; ++i) last = control_.take(i % 2 == 0 ? kAnn : kBob, true, kNow, kUnix_s).term;
  Control next([] { return false; });
  EXPECT_GT(next.take(kAnn, false, kNow, kUnix_s + 1).term, last);
}

TEST_F(ControlTest, APageHasToAskAndTwoPagesOfOneUserAreTwo) {
  EXPECT_EQ(use(kAnnsPage), "take control first");
  EXPECT_EQ(holder(), "");
  ASSERT_TRUE(take(kAnnsPage).ok);
  EXPECT_EQ(use(kAnnsPage), "");
  EXPECT_THAT(use(kAnnsOtherPage), HasSubstr("Ann has control"));
  EXPECT_FALSE(take(kAnnsOtherPage).ok);
  // The same page as another process claims it is another page.
  auto forged = kAnnsPage;
  forged.relay = 1001;
  forged.relay_is_trusted = false;
  EXPECT_THAT(use(forged), HasSubstr("Ann has control"));
  EXPECT_FALSE(control_.keep(forged, kNow));
}

TEST_F(ControlTest, ATerminalOfTheHoldersOwnUserIsTheHolder) {
  ASSERT_TRUE(take(kAnnsPage).ok);
  EXPECT_EQ(use(kAnn), "");
  EXPECT_EQ(holder(), "Ann") << "the page keeps it";
  ASSERT_TRUE(control_.give_back(kAnn, kNow).ok);
  EXPECT_EQ(use(kAnn), "");
  const auto moved = take(kAnnsPage);
  EXPECT_TRUE(moved.ok) << moved.text;
  EXPECT_EQ(moved.taken_from, "") << "from oneself";
  EXPECT_EQ(use(kAnnsPage), "");
}

TEST_F(ControlTest, APageThatIsGoneLosesItAfterAMinuteWhateverTheRigDoes) {
  busy_ = true;
  ASSERT_TRUE(take(kAnnsPage).ok);
  EXPECT_EQ(holder(kNow + 60s), "Ann");
  EXPECT_TRUE(control_.keep(kAnnsPage, kNow + 60s));
  EXPECT_EQ(holder(kNow + 120s), "Ann");
  EXPECT_EQ(holder(kNow + 121s), "");
  EXPECT_EQ(ended_, std::vector<std::string>{"Ann"});
  EXPECT_FALSE(control_.keep(kAnnsPage, kNow + 122s)) << "what has ended does not begin again";
  EXPECT_EQ(use(kBob, kNow + 122s), "");
}

TEST_F(ControlTest, ATerminalLosesItFiveMinutesAfterItsLastCommandButNotInARun) {
  EXPECT_EQ(use(kAnn), "");
  EXPECT_EQ(use(kAnn, kNow + 200s), "");
  EXPECT_EQ(holder(kNow + 500s), "ann");
  EXPECT_EQ(holder(kNow + 501s), "");
  EXPECT_EQ(use(kAnn, kNow + 600s), "");
  busy_ = true;
  EXPECT_EQ(holder(kNow + 23h), "ann");
  EXPECT_THAT(use(kBob, kNow + 23h), HasSubstr("ann has control"));
  EXPECT_TRUE(take(kBob, true, kNow + 23h).ok) << "over, whatever the rig does";
  busy_ = false;
  EXPECT_EQ(holder(kNow + 24h), "");
  EXPECT_EQ(ended_, (std::vector<std::string>{"ann", "bob"}));
}

}  // namespace
}  // namespace isorig::daemon::test
