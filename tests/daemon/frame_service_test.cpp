// The frame's service, turn by turn, on a device that does what the test says.
#include "daemon/io/frame_service.hpp"

#include <gtest/gtest.h>

#include <functional>

namespace isorig::daemon {
namespace {

/// Stands at 1 mm and samples at 1 kHz of the clock.
class StandingFrame final : public frame::Device {
 public:
  explicit StandingFrame(clock::VirtualClock& clock) : clock_(clock) {}
  frame::Identity connect() override { return {"isorig", "standing frame", "1", "1", 1000.0, 1}; }
  void disconnect() noexcept override {}
  frame::Poll poll(std::span<frame::Sample> out) override {
    if (during_poll) during_poll();
    frame::Poll poll;
    const auto now_us = clock_.now_ns() / 1000;
    for (; next_us_ < now_us && poll.samples < out.size(); next_us_ += 1000) {
      out[poll.samples++] = {static_cast<std::uint32_t>(next_us_ / 1000), next_us_, 1.0F, 0.0F};
    }
    poll.has_exchange = true;
    const auto us = static_cast<double>(now_us);
    poll.exchange = {clock_.now_ns() - 1000, clock_.now_ns() + 1000, us, us};
    return poll;
  }
  void start_segment(const frame::Segment&) override {}
  void stop() override { ++stops; }
  void heartbeat(std::uint16_t) override {
    ++heartbeats;
    stops_before_heartbeat = stops;
  }

  std::function<void()> during_poll;
  int stops = 0, heartbeats = 0;
  int stops_before_heartbeat = 0;

 private:
  clock::VirtualClock& clock_;
  std::int64_t next_us_ = 1'000'000;
};

struct FrameServiceTest : testing::Test {
  void turn() {
    clock.sleep_until_ns(clock.now_ns() + 5'000'000);
    link.loop_beat.fetch_add(5);
    service.run_once(clock.now_ns());
  }
  void be_confirmed() {
    for (int i = 0; i < 200 && device.heartbeats == 0; ++i) turn();
    ASSERT_GT(device.heartbeats, 0);
  }
  clock::VirtualClock clock{1'000'000'000};
  StandingFrame device{clock};
  FrameLink link;
  FrameService service{device, link, ServiceConfig{}, clock};
};

// A poll may take four response time-outs: a heartbeat behind it would put the frame's watchdog off by as much.
TEST_F(FrameServiceTest, ARequestDuringThePollKeepsTheHeartbeatBack) {
  ASSERT_NO_FATAL_FAILURE(be_confirmed());
  for (int i = 0; i < 30; ++i) turn();
  clock.sleep_until_ns(clock.now_ns() + 200'000'000);  // the next heartbeat is due
  const int beats = device.heartbeats;
  device.during_poll = [&] { link.stops_requested.store(1); };
  turn();
  device.during_poll = nullptr;
  EXPECT_EQ(device.heartbeats, beats);
  const int stops = device.stops;
  turn();
  EXPECT_EQ(device.stops, stops + 1);
  for (int i = 0; i < 200 && device.heartbeats == beats; ++i) turn();
  EXPECT_GT(device.heartbeats, beats) << "it stands";
  EXPECT_GT(device.stops_before_heartbeat, stops) << "not before the stop was taken";
}

// Somebody leans on the abort button.
TEST_F(FrameServiceTest, ARequestThatIsRenewedAtEveryTurnIsConfirmedAllTheSame) {
  FrameReport report;
  turn();
  while (link.reports.pop(report)) {
  }
  EXPECT_FALSE(report.stop_confirmed) << "connected a moment ago";
  const auto confirmed_within = [&](int turns) {
    for (int i = 0; i < turns; ++i) {
      link.stops_requested.fetch_add(1);
      turn();
      while (link.reports.pop(report)) {
      }
      if (report.stop_confirmed && report.stop_request == link.stops_requested) return true;
    }
    return false;
  };
  EXPECT_TRUE(confirmed_within(20)) << "what was seen of the stop before counts on";
  const int stops = device.stops, beats = device.heartbeats;
  for (int i = 0; i < 100; ++i) EXPECT_TRUE(confirmed_within(1)) << "it stands already";
  EXPECT_EQ(device.stops, stops + 100) << "and each is sent";
  EXPECT_GT(device.heartbeats, beats);
}

// After a segment a stop is judged by what came after it alone.
TEST_F(FrameServiceTest, AStopBehindASegmentBeginsAnew) {
  ASSERT_NO_FATAL_FAILURE(be_confirmed());
  for (int i = 0; i < 50; ++i) turn();
  link.commands.push({{1, 2.0F, 1.0F}, 1, 0});
  turn();
  link.stops_requested.store(1);
  turn();
  FrameReport report;
  while (link.reports.pop(report)) {
  }
  EXPECT_EQ(report.taken_segment, 1U);
  EXPECT_FALSE(report.stop_confirmed) << "its samples of before say nothing";
}

TEST_F(FrameServiceTest, LeavingDuringThePollKeepsTheHeartbeatBack) {
  ASSERT_NO_FATAL_FAILURE(be_confirmed());
  clock.sleep_until_ns(clock.now_ns() + 200'000'000);
  const int beats = device.heartbeats;
  device.during_poll = [&] { service.leave(); };
  turn();
  EXPECT_EQ(device.heartbeats, beats);
}

}  // namespace
}  // namespace isorig::daemon
