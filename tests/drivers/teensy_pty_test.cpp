#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <poll.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include <atomic>
#include <cmath>
#include <thread>

#include "drivers/clock/real_clock.hpp"
#include "drivers/clock_map/mapping.hpp"
#include "teensy_on_pty.hpp"

namespace isorig::pressure {
namespace {

TEST_F(TeensyOnPty, DeliversEverySampleOnceWithItsTime) {
  start({.skew_ppm = 30.0, .start_us = 123'456'789});
  const Identity identity = device->connect();
  EXPECT_EQ(identity.serial, "1234560");
  EXPECT_EQ(identity.firmware, "emulator");
  const Log run = run_for(2000);
  EXPECT_GT(run.samples.size(), 1950U);
  expect_sequence(run.samples);
  EXPECT_EQ(run.lost, 0U);
  EXPECT_EQ(run.corrupt, 0U);
  for (const Sample& sample : run.samples) {
    // The sequence counts from the start of the emulator, one conversion per true millisecond.
    const std::int64_t true_us = 1'000'000 + std::int64_t{sample.sequence} * 1000;
    ASSERT_EQ(sample.raw_word, Backend::word(true_us));
    ASSERT_NEAR(static_cast<double>(sample.device_us) + 0.5, emulator->device_us(true_us * 1000), 0.5001);
  }
  EXPECT_EQ(emulator->status().corrupt, 0U) << "nothing of the device's own came back as an echo";
  EXPECT_EQ(emulator->status().dropped, 0U);
  EXPECT_GT(backend_.heartbeats, 1000);
}

TEST_F(TeensyOnPty, AKilledHostLeavesThePortFree) {
  start();
  const int killed = ::open(link_.c_str(), O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC);
  ASSERT_GE(killed, 0);
  ASSERT_EQ(::ioctl(killed, TIOCEXCL), 0);
  emulator->service(clock_.now_ns());
  ::close(killed);
  emulator->service(clock_.now_ns());
  const int next = ::open(link_.c_str(), O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC);
  ASSERT_GE(next, 0);
  int exclusive = -1;  // asked for, since root gets in anyway
  ASSERT_EQ(::ioctl(next, TIOCGEXCL, &exclusive), 0);
  EXPECT_EQ(exclusive, 0);
  ::close(next);
  device->connect();
  EXPECT_GT(run_for(100).samples.size(), 90U);
}

TEST_F(TeensyOnPty, BatchesAtFourKilohertz) {
  backend_.period_us = 250;
  start({.core = {.serial = "1234560", .sample_rate_mhz = 4'000'000, .batch_samples = 4}});
  EXPECT_DOUBLE_EQ(device->connect().sample_rate_hz, 4000.0);
  const Log run = run_for(1000);
  EXPECT_GT(run.samples.size(), 3900U);
  expect_sequence(run.samples);
  EXPECT_EQ(run.lost, 0U);
}

TEST_F(TeensyOnPty, ExchangesAreCausalWhateverTheDelays) {
  start({.skew_ppm = -30.0, .start_us = 77});
  emulator->faults().delay_to_host_us = 700;
  device->connect();
  Log run;
  for (int i = 0; i < 50; ++i) {
    device->request_time_sync();
    const Log part = run_for(3);
    run.exchanges.insert(run.exchanges.end(), part.exchanges.begin(), part.exchanges.end());
  }
  EXPECT_GE(run.exchanges.size(), 48U);
  for (const clock::Exchange& exchange : run.exchanges) {
    EXPECT_LE(emulator->device_us(exchange.host_send_ns), exchange.device_rx_us + 1.0);  // rounded down
    EXPECT_LE(exchange.device_tx_us, emulator->device_us(exchange.host_recv_ns));
    EXPECT_GE(exchange.host_recv_ns - exchange.host_send_ns, 700'000);
  }
  EXPECT_EQ(device->counters().unmatched_replies, 0U);
}

TEST_F(TeensyOnPty, ARequestIsNotStampedBeforeItWasSentWhoeverHadTheProcessor) {
  start({.clock = &clock_});
  device->connect();
  run_for(20);
  const std::int64_t looked_ns = clock_.now_ns();  // and then the emulator's thread waits its turn
  clock_.sleep_until_ns(looked_ns + 5'000'000);
  device->request_time_sync();
  pollfd port{emulator->fd(), POLLIN, 0};
  ASSERT_EQ(::poll(&port, 1, 20'000), 1);
  emulator->service(looked_ns);
  const Log run = run_for(5);
  ASSERT_EQ(run.exchanges.size(), 1U);
  const clock::Exchange& exchange = run.exchanges.front();
  EXPECT_LE(emulator->device_us(exchange.host_send_ns), exchange.device_rx_us + 1.0);  // rounded down
  EXPECT_LE(exchange.device_tx_us, emulator->device_us(exchange.host_recv_ns));
}

TEST_F(TeensyOnPty, ValvesFollowCommandsAndTheirEchoComesBack) {
  start();
  device->connect();
  run_for(20);
  EXPECT_EQ(backend_.valves.vent_permille, 1000) << "safe until told otherwise";
  device->command({.fill_permille = 350});
  Log run = run_for(90);
  EXPECT_EQ(backend_.valves.fill_permille, 350);
  EXPECT_EQ(backend_.valves.vent_permille, 0);
  device->command({.vent_permille = 20});
  run = run_for(95);
  EXPECT_EQ(backend_.valves.vent_permille, 20);
  EXPECT_EQ(backend_.valves.fill_permille, 0);
  run = run_for(110);  // not renewed within 100 ms
  EXPECT_EQ(backend_.valves.vent_permille, 0);
  EXPECT_EQ(run.state.vent_permille, 0);
  EXPECT_FALSE(run.was_vented);
}

TEST_F(TeensyOnPty, VentsByItselfWithoutHeartbeatsAndSaysSo) {
  start();
  device->connect();
  run_for(100);
  for (int i = 0; i < 4; ++i) {
    device->command({.fill_permille = 500});
    const Log run = run_for(50, false);
    EXPECT_EQ(run.was_vented, i == 3) << i;
  }
  for (int i = 0; i < 3; ++i) {
    device->command({.fill_permille = 500});
    run_for(50, false);
  }
  EXPECT_EQ(backend_.valves.fill_permille, 0);
  EXPECT_EQ(backend_.valves.vent_permille, 1000);

  device->command({.fill_permille = 500});  // heartbeats are back, but nobody has agreed to the vent
  EXPECT_TRUE(run_for(100).was_vented);
  EXPECT_EQ(backend_.valves.vent_permille, 1000);
  device->command({.vent_permille = 1000});
  run_for(20);
  device->command({.fill_permille = 500});
  EXPECT_FALSE(run_for(20).was_vented);
  EXPECT_EQ(backend_.valves.fill_permille, 500);
}

TEST_F(TeensyOnPty, DeviceTimeGoesOnOverTheWrapOfItsStamps) {
  constexpr std::int64_t kWrap_us = std::int64_t{1} << 32;
  start({.start_us = static_cast<std::uint64_t>(kWrap_us) - 2'000'000});
  device->connect();
  const Log run = run_for(4'000);
  EXPECT_LT(run.samples.front().device_us, kWrap_us - 1'900'000);
  EXPECT_GT(run.samples.back().device_us, kWrap_us + 1'900'000);
  expect_sequence(run.samples);
  EXPECT_EQ(run.lost, 0U);
}

TEST_F(TeensyOnPty, FollowsManyWraps) {
  backend_.period_us = 30'000'000;
  start();
  device->connect();
  Log run;
  for (int i = 0; i < 600; ++i) {  // 10 h, a look each minute
    const Log part = run_for(1);
    run.samples.insert(run.samples.end(), part.samples.begin(), part.samples.end());
    clock_.sleep_until_ns(clock_.now_ns() + 60'000'000'000);
  }
  ASSERT_GT(run.samples.size(), 1100U);
  expect_sequence(run.samples);
  EXPECT_GT(run.samples.back().device_us, 35'000'000'000);
}

TEST_F(TeensyOnPty, MappedSamplesAreWithinTheStatedBoundOfTheTruth) {
  // 0.25 ms there and 1 ms back: the estimate is off by half the difference, and the bound has to say so.
  start({.skew_ppm = 30.0, .start_us = (std::uint64_t{1} << 32U) - 1'500'000});
  emulator->faults().delay_to_device_us = 250;
  emulator->faults().delay_to_host_us = 1000;
  device->connect();
  clock::DeviceClockMap map;
  std::size_t checked = 0;
  double worst_ns = 0.0;
  for (int i = 0; i < 150; ++i) {
    device->request_time_sync();
    const Log log = run_for(20);
    for (const clock::Exchange& exchange : log.exchanges) {
      ASSERT_EQ(map.add(exchange), clock::ExchangeVerdict::kAccepted) << i;
    }
    if (!map.current().known()) continue;
    for (const Sample& sample : log.samples) {
      const clock::MappedTime mapped = map.current().map(static_cast<double>(sample.device_us));
      const std::int64_t true_ns = 1'000'000'000 + std::int64_t{sample.sequence} * 1'000'000;
      const auto error_ns = static_cast<double>(mapped.mono_ns - true_ns);
      ASSERT_LE(std::abs(error_ns), mapped.bound_ns) << i;
      worst_ns = std::max(worst_ns, std::abs(error_ns));
      ++checked;
    }
  }
  EXPECT_GT(checked, 2500U);
  EXPECT_LT(worst_ns, 1e6);
  EXPECT_EQ(map.current().epoch, 1U) << "the wrap is no restart";
}

TEST_F(TeensyOnPty, SyncEdgesCarryTheDeviceTime) {
  start({.start_us = 1'000});
  device->connect();
  const std::int64_t edge_ns = clock_.now_ns();
  emulator->sync_edge(edge_ns, true);
  run_for(5);
  const auto edge = device->take_sync_edge();
  ASSERT_TRUE(edge);
  EXPECT_EQ(edge->device_us, static_cast<std::uint64_t>(emulator->device_us(edge_ns)));
  EXPECT_TRUE(edge->rising);
}

TEST(TeensyInRealTime, SamplesFlowBetweenTwoThreads) {
  const clock::RealClock clock;
  const std::string link = testing::TempDir() + "isorig_teensy_rt_" + std::to_string(getpid());
  Backend backend(clock);
  sim::TeensyPty emulator(link, {}, backend, clock.now_ns());
  std::atomic<bool> is_done{false};
  std::thread device_side([&] {
    clock::RealClock own;
    for (std::int64_t next_ns = own.now_ns(); !is_done; next_ns += 500'000) {
      own.sleep_until_ns(next_ns);
      emulator.service(own.now_ns());
    }
  });
  {
    Teensy device({.serial = "1234560"}, std::make_unique<TtyStream>(TtyStream::Options{.path = link}), clock);
    device.connect();
    std::array<Sample, 256> samples;
    std::array<clock::Exchange, 16> exchanges;
    std::uint64_t received = 0;
    std::uint64_t lost = 0;
    std::uint64_t exchanged = 0;
    int polls = 0;
    const std::int64_t end_ns = clock.now_ns() + 60'000'000'000;
    std::int64_t next_ns = 0;
    while ((received < 500 || exchanged < 5) && clock.now_ns() < end_ns) {
      if (clock.now_ns() >= next_ns) {
        next_ns = clock.now_ns() + 10'000'000;
        device.heartbeat();
        device.request_time_sync();
      }
      const Poll result = device.poll(samples, exchanges, 10'000'000);
      ++polls;
      received += result.samples;
      lost += result.lost;
      exchanged += result.exchanges;
    }
    EXPECT_GE(received, 500U);
    EXPECT_GE(exchanged, 5U);
    // It sleeps until bytes come: a sample and now and then a reply, a status or the rest of a frame.
    EXPECT_LT(polls, 2 * static_cast<int>(received + exchanged));
    is_done = true;
    device_side.join();
    EXPECT_LE(lost, emulator.status().dropped) << "nothing was lost but what the device itself had no room for";
  }
}

}  // namespace
}  // namespace isorig::pressure