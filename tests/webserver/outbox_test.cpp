#include "webserver/rules/outbox.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <vector>

namespace isorig::web {
namespace {

using Kind = Message::Kind;
using Texts = std::vector<std::string>;

std::shared_ptr<const Message> message(Kind kind, const std::string& bytes) {
  return std::make_shared<const Message>(Message{bytes, kind});
}

class OutboxTest : public testing::Test {
 protected:
  void put(Kind kind, const std::string& bytes) { EXPECT_TRUE(outbox.put(message(kind, bytes))); }
  Texts taken() {
    Texts out;
    while (const auto next = outbox.take()) out.push_back(next->bytes);
    EXPECT_TRUE(outbox.empty());
    return out;
  }
  Outbox outbox{10};
};

TEST_F(OutboxTest, TheNewestStatusGoesAheadOfTheHistoryAndNoOlderOneIsSent) {
  put(Kind::kSamples, "minute");
  put(Kind::kSamples, "day");
  put(Kind::kStatus, "old state");
  put(Kind::kStatus, "state of now");
  EXPECT_EQ(taken(), (Texts{"state of now", "minute", "day"}));
}

TEST_F(OutboxTest, SamplesAloneAreLeftOutAndThePageIsToldHowMany) {
  put(Kind::kSamples, "123456789");
  put(Kind::kSamples, "12");
  put(Kind::kSamples, "345");
  for (const auto kind : {Kind::kHello, Kind::kLease, Kind::kPlan, Kind::kStatus, Kind::kEvents})
    put(kind, "more than ten bytes");
  const auto all = taken();
  EXPECT_EQ(all.size(), 7U);
  EXPECT_EQ(all.front(), R"({"kind":"left-out","messages":2})");
  EXPECT_EQ(all.back(), "123456789");
  put(Kind::kSamples, "0123456789");
  EXPECT_EQ(taken(), Texts{"0123456789"}) << "there is room again";
}

TEST_F(OutboxTest, AStatusPassesNoEventAndRenewingItKeepsNoPlanWaiting) {
  put(Kind::kStatus, "running");
  put(Kind::kEvents, "a");
  put(Kind::kPlan, "long plan");
  put(Kind::kEvents, "b");
  put(Kind::kStatus, "faulted");
  EXPECT_EQ(taken(), (Texts{"a", "long plan", "b", "faulted"}));
}

TEST_F(OutboxTest, SamplesOfAnotherClockAreVoid) {
  put(Kind::kSamples, "before");
  put(Kind::kAnotherClock, "clock");
  put(Kind::kSamples, "after");
  EXPECT_EQ(taken(), (Texts{"clock", "after"}));
}

TEST_F(OutboxTest, EventsThatNobodyTakesEndThePageAndNotTheMemory) {
  const auto events = message(Kind::kEvents, std::string(1U << 20U, 'e'));
  for (int i = 0; i < 4; ++i) EXPECT_TRUE(outbox.put(events));
  EXPECT_FALSE(outbox.put(events));
  EXPECT_EQ(outbox.take(), events);
  EXPECT_TRUE(outbox.put(events));
}

}  // namespace
}  // namespace isorig::web
