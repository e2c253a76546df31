#include "daemon/host/sample_server.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstring>
#include <optional>
#include <thread>

#include "daemon/recording/sample_stream.hpp"
#include "recording_rig.hpp"
#include "sample_subscription.hpp"

/// Subscribers on real sockets: one that reads, one that stands still, one that dies.
namespace isorig::daemon::testing {
namespace {

using namespace std::chrono_literals;

class SampleServerTest : public ::testing::Test {
 protected:
  void serve(const SampleServer::Limits& limits = {}) {
    server_ = std::make_unique<SampleServer>(socket_, 0640, "bench", 1'700'000'000'000'000, limits);
    thread_ = std::thread([this] { server_->run(); });
  }
  void TearDown() override {
    if (!server_) return;
    server_->stop();
    thread_.join();
  }

  /// One publisher's turn: ten samples of each kind.
  void turn() {
    for (int i = 0; i < 10; ++i, ++n_) {
      streams_.frame.push(frame_record(n_, 7, Keep::kFull));
      streams_.pressure.push(pressure_record(n_, 7, Keep::kFull));
    }
    drain_live(streams_, n_ * kMs, {server_.get()});
  }
  void say(const char* code) {
    streams_.events.push(event_record(n_, 7, code, Severity::kWarning));
    drain_live(streams_, n_ * kMs, {server_.get()});
  }
  /// Turns until `subscriber` is served: connecting is asynchronous on the server's side.
  void until_served(Subscription& subscriber) {
    for (int i = 0; i < 500; ++i) {
      say("first");
      std::this_thread::sleep_for(1ms);
    }
    say("served");
    subscriber.read_to("served");
    ASSERT_FALSE(subscriber.events.empty());
  }

  TemporaryDirectory folder_{"samples"};
  std::string socket_ = (folder_.path() / "s.samples").string();
  Streams streams_;
  std::unique_ptr<SampleServer> server_;
  std::thread thread_;
  std::int64_t n_ = 0;
};

TEST_F(SampleServerTest, EverySampleComesOnceInOrderToTwoAtOnce) {
  serve();
  struct stat there {};
  ASSERT_EQ(::stat(socket_.c_str(), &there), 0);
  EXPECT_EQ(there.st_mode & 0777U, 0640U);
  Subscription one(socket_), two(socket_);
  until_served(one);
  two.read_to("served");
  for (int i = 0; i < 500; ++i) turn();
  ControlRecord control;
  control.mono_ns = 17;
  control.state = RunState::kPaused;
  control.setpoint_psi = 12.5F;
  control.target_mm = -1.25F;
  control.ticks = std::uint64_t{1} << 40U;
  control.remaining_s = 33.0F;
  streams_.control.push(control);
  drain_live(streams_, 0, {server_.get()});
  say("end");
  for (auto* s : {&one, &two}) {
    s->read_to("end");
    EXPECT_EQ(s->rig, "bench");
    ASSERT_EQ(s->frames.size(), 5'000U);
    ASSERT_EQ(s->pressures.size(), 5'000U);
    for (std::int64_t i = 0; i < 5'000; ++i) {
      const auto sent = frame_record(i, 7, Keep::kFull);
      const auto& got = s->frames[static_cast<std::size_t>(i)];
      ASSERT_EQ(got.mono_ns, sent.mono_ns);
      ASSERT_EQ(got.position_mm, sent.position_mm);
      ASSERT_EQ(got.force_N, sent.force_N);
      ASSERT_EQ(got.sequence, sent.sequence);
      ASSERT_EQ(got.step, 7U);
      ASSERT_EQ(s->pressures[static_cast<std::size_t>(i)].pressure_psi,
                pressure_record(i, 7, Keep::kFull).pressure_psi);
    }
    ASSERT_EQ(s->controls.size(), 1U);
    EXPECT_EQ(s->controls[0].state, RunState::kPaused);
    EXPECT_EQ(s->controls[0].setpoint_psi, 12.5F);
    EXPECT_EQ(s->controls[0].target_mm, -1.25F);
    EXPECT_EQ(s->controls[0].ticks, control.ticks);
    EXPECT_EQ(s->controls[0].remaining_s, 33.0F);
    EXPECT_EQ(s->lost, samples::Lost{});
    EXPECT_EQ(s->events.back().severity, Severity::kWarning);
  }
}

TEST_F(SampleServerTest, AStalledSubscriberLosesCountedSamplesAndHoldsUpNobody) {
  SampleServer::Limits limits;
  limits.queue_bytes = 64 * 1024;
  serve(limits);
  Subscription stalled(socket_, 4096), reader(socket_);
  until_served(reader);
  stalled.read_to("served");
  std::thread reading([&] { reader.read_to("end"); });
  std::chrono::nanoseconds worst{0};
  for (int i = 0; i < 2'000; ++i) {  // 20 s of samples, 1.6 MB: far beyond queue and kernel buffers (212 kB)
    const auto before = std::chrono::steady_clock::now();
    turn();
    worst = std::max<std::chrono::nanoseconds>(worst, std::chrono::steady_clock::now() - before);
    std::this_thread::sleep_for(200us);
  }
  say("end");
  reading.join();
  EXPECT_EQ(reader.frames.size(), 20'000U);
  EXPECT_EQ(reader.lost, samples::Lost{});
  EXPECT_LT(worst, 1s) << "the publisher's thread waited for a subscriber";
  // It reads again: what it had in its queue, what it lost, and what comes from now on.
  std::thread late([&] { stalled.read_to("again"); });
  for (int i = 0; i < 200; ++i) {
    std::this_thread::sleep_for(1ms);
    turn();
  }
  say("again");
  late.join();
  EXPECT_GT(stalled.lost.frame, 1'000U);
  EXPECT_EQ(stalled.frames.size() + stalled.lost.frame, static_cast<std::size_t>(n_));
  EXPECT_EQ(stalled.pressures.size() + stalled.lost.pressure, static_cast<std::size_t>(n_));
  const auto ends = std::count_if(stalled.events.begin(), stalled.events.end(),
                                  [](const EventRecord& e) { return std::string_view(e.code) == "end"; });
  EXPECT_EQ(stalled.lost.events + static_cast<std::size_t>(ends), 1U);
  EXPECT_EQ(stalled.lost.before_the_socket, 0U);
}

TEST_F(SampleServerTest, WhatTheDaemonsOwnQueueLostIsTold) {
  serve();
  Subscription reader(socket_);
  until_served(reader);
  Streams small(1024);
  for (std::int64_t i = 0; i < 1024 + 23; ++i) small.frame.push(frame_record(i, 0, Keep::kFull));
  small.events.push(event_record(0, 0, "end", Severity::kInfo));
  drain_live(small, 0, {server_.get()});
  small.events.push(event_record(0, 0, "after", Severity::kInfo));
  drain_live(small, 0, {server_.get()});
  reader.read_to("after");
  EXPECT_EQ(reader.frames.size(), 1024U);
  EXPECT_EQ(reader.lost.before_the_socket, 23U);
  EXPECT_EQ(reader.lost.frame, 0U);
}

TEST_F(SampleServerTest, ASubscriberThatDiesTakesNobodyAlongAndItsPlaceIsFreeAgain) {
  SampleServer::Limits limits;
  limits.subscribers = 2;
  serve(limits);
  Subscription dying(socket_), reader(socket_);
  until_served(reader);
  dying.read_to("served");
  Subscription third(socket_);
  EXPECT_FALSE(third.next()) << "more than two were let in";
  for (int i = 0; i < 100; ++i) {
    if (i == 50) dying.die();
    turn();
  }
  say("end");
  reader.read_to("end");
  EXPECT_EQ(reader.frames.size(), 1'000U);
  // Nothing is sent meanwhile: its end is seen all the same.
  bool served = false;
  for (int i = 0; i < 100 && !served; ++i) {
    std::this_thread::sleep_for(10ms);
    Subscription next(socket_);
    served = next.next().has_value();
  }
  EXPECT_TRUE(served);
}

TEST(SampleStream, AnotherVersionAndNonsenseAreRefusedWithTheReason) {
  std::string bytes;
  samples::append(bytes, samples::Hello{2, 0, "rig"});
  samples::Record record;
  samples::Reader newer;
  newer.feed(bytes);
  EXPECT_THAT([&] { newer.next(record); },
              ::testing::ThrowsMessage<samples::StreamError>(::testing::HasSubstr("version 2")));
  samples::Reader http;
  http.feed("HTTP/1.1 400 Bad Request\r\n");
  EXPECT_THAT([&] { http.next(record); },
              ::testing::ThrowsMessage<samples::StreamError>(::testing::HasSubstr(".samples")));
  std::string no_hello;
  samples::append(no_hello, samples::Lost{});
  samples::Reader headless;
  headless.feed(no_hello);
  EXPECT_THROW(headless.next(record), samples::StreamError);
}

TEST(SampleStream, EveryCutOfARecordIsWaitedForAndAShortBodyIsRefused) {
  std::string bytes;
  samples::append(bytes, samples::Hello{samples::kVersion, 5, "rig"});
  samples::append(bytes, event_record(3, 4, "limit.force", Severity::kProgramStop));
  for (std::size_t cut = 0; cut <= bytes.size(); ++cut) {
    samples::Reader reader;
    samples::Record record;
    int records = 0;
    reader.feed(std::string_view(bytes).substr(0, cut));
    while (reader.next(record)) ++records;
    reader.feed(std::string_view(bytes).substr(cut));
    while (reader.next(record)) ++records;
    ASSERT_EQ(records, 2) << cut;
    ASSERT_STREQ(std::get<EventRecord>(record).code, "limit.force");
  }
  std::string frame;
  samples::append(frame, samples::Hello{});
  const auto hello = frame.size();
  samples::append(frame, FrameRecord{});
  frame.resize(frame.size() - 1);
  frame[hello] = static_cast<char>(frame[hello] - 1);
  samples::Reader reader;
  samples::Record record;
  reader.feed(frame);
  EXPECT_TRUE(reader.next(record));
  EXPECT_THROW(reader.next(record), samples::StreamError);
}

}  // namespace
}  // namespace isorig::daemon::testing
