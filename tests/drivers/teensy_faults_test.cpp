#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <filesystem>

#include "messages/elvh.hpp"
#include "teensy_on_pty.hpp"

namespace isorig::pressure {
namespace {

using testing::HasSubstr;

TEST_F(TeensyOnPty, ReconnectsAfterAHangUpAndKnowsWhatItMissed) {
  start();
  device->connect();
  run_for(300);
  device->command({.fill_permille = 500});
  run_for(20);
  emulator->faults().hung_up = true;
  // The status in which the device says that it vented cannot arrive; the counter tells later.
  EXPECT_EQ(fault_of([&] { run_for(100); }), Fault::kDisconnected);
  device->disconnect();
  EXPECT_EQ(fault_of([&] { device->connect(); }), Fault::kDisconnected);
  EXPECT_FALSE(std::filesystem::exists(std::filesystem::symlink_status(link_)));
  for (int i = 0; i < 500; ++i) {
    clock_.sleep_until_ns(clock_.now_ns() + 1'000'000);
    emulator->service(clock_.now_ns());
  }
  EXPECT_EQ(backend_.valves.vent_permille, 1000);
  emulator->faults().hung_up = false;
  connect_with_backoff();
  const Log after = run_for(300);
  expect_sequence(after.samples);
  EXPECT_TRUE(after.was_vented);
  EXPECT_GT(after.lost, 490U);
}

TEST_F(TeensyOnPty, CountsEverySampleOfAnOutage) {
  start();
  device->connect();
  Log run = run_for(200);
  emulator->faults().hung_up = true;
  EXPECT_EQ(fault_of([&] {
              for (;;) poll_into(run, 1'000'000);
            }),
            Fault::kDisconnected);
  clock_.sleep_until_ns(clock_.now_ns() + 50'000'000);
  emulator->faults().hung_up = false;
  emulator->service(clock_.now_ns());
  connect_with_backoff();
  const Log after = run_for(200);
  EXPECT_GT(after.lost, 45U);
  ASSERT_FALSE(run.samples.empty());
  ASSERT_FALSE(after.samples.empty());
  EXPECT_EQ(after.samples.front().sequence - run.samples.back().sequence - 1, after.lost);
}

TEST_F(TeensyOnPty, StartsOverAfterThePlugWasPulled) {
  start({.start_us = 5'000'000'000});
  device->connect();
  run_for(20);
  device->command({.fill_permille = 500});
  run_for(50);
  EXPECT_EQ(backend_.valves.fill_permille, 500);
  emulator->faults().unplugged = true;
  EXPECT_EQ(fault_of([&] { run_for(100); }), Fault::kDisconnected);
  EXPECT_EQ(backend_.valves.vent_permille, 1000) << "without power the vent is open";
  emulator->faults().unplugged = false;
  emulator->service(clock_.now_ns());
  connect_with_backoff();
  const Log run = run_for(100);
  EXPECT_EQ(run.lost, 0U);
  EXPECT_FALSE(run.was_vented);
  ASSERT_FALSE(run.samples.empty());
  EXPECT_LT(run.samples.back().device_us, 10'000'000);
}

TEST_F(TeensyOnPty, CorruptFramesCostThemselvesOnly) {
  start();
  device->connect();
  emulator->faults().corrupt_permille = 100;
  Log run = run_for(2000);
  emulator->faults().corrupt_permille = 0;
  const Log clean = run_for(20);
  run.lost += clean.lost;
  run.samples.insert(run.samples.end(), clean.samples.begin(), clean.samples.end());
  EXPECT_GT(run.corrupt, 100U);
  EXPECT_GT(run.lost, 100U);
  for (const Sample& sample : run.samples) {
    ASSERT_EQ(sample.raw_word, Backend::word(1'000'000 + std::int64_t{sample.sequence} * 1000));
  }
  const std::uint32_t span = run.samples.back().sequence - run.samples.front().sequence + 1;
  EXPECT_LE(run.samples.size() + run.lost - span, 2U);  // those lost before the first that arrived
}

TEST_F(TeensyOnPty, DroppedFramesAreCountedAndRepeatedOnesAreNot) {
  start();
  device->connect();
  run_for(10);
  emulator->faults().drop_permille = 50;
  emulator->faults().repeat_permille = 50;
  Log run = run_for(2000);
  EXPECT_GT(run.lost, 50U);
  EXPECT_GT(device->counters().duplicates, 50U);
  EXPECT_EQ(run.corrupt, 0U);
  std::uint32_t gaps = 0;
  for (std::size_t i = 1; i < run.samples.size(); ++i) {
    ASSERT_GT(run.samples[i].sequence, run.samples[i - 1].sequence);
    gaps += run.samples[i].sequence - run.samples[i - 1].sequence - 1;
  }
  EXPECT_GE(run.lost, gaps);
  EXPECT_LE(run.lost, gaps + 3);
}

TEST_F(TeensyOnPty, ADeviceThatHoldsNothingBackCountsWhatAStalledHostLoses) {
  start();
  device->connect();
  Log run = run_for(50);
  device->command({.fill_permille = 500});
  // The kernel's buffers take some seconds of samples; then the device's own fill up.
  for (int i = 0; i < 10'000; ++i) {
    clock_.sleep_until_ns(clock_.now_ns() + 1'000'000);
    emulator->service(clock_.now_ns());
  }
  const std::uint32_t dropped = emulator->status().dropped;
  EXPECT_GT(dropped, 1000U);
  drain(run);
  const Log after = run_for(300);
  EXPECT_EQ(run.lost + after.lost, emulator->status().dropped);
  EXPECT_EQ(after.state.dropped, emulator->status().dropped);
  EXPECT_TRUE(run.was_vented || after.was_vented);
}

TEST_F(TeensyOnPty, AWrongDeviceIsRefused) {
  start();
  emulator->faults().wrong_serial = true;
  try {
    device->connect();
    FAIL();
  } catch (const DeviceError& error) {
    EXPECT_EQ(error.fault(), Fault::kIdentity);
    EXPECT_THAT(error.what(), HasSubstr("'9999990'"));
    EXPECT_THAT(error.what(), HasSubstr("'1234560'"));
  }
  emulator->faults().wrong_serial = false;
  device->connect();
}

TEST_F(TeensyOnPty, SensorFaultsArriveAsTheSensorSendsThem) {
  start();
  device->connect();
  run_for(20);
  emulator->faults().stale_sensor = true;
  run_for(20);
  for (const Sample& sample : run_for(20).samples) {
    EXPECT_EQ(messages::unpack_elvh(sample.raw_word).status, messages::ElvhStatus::kStale);
  }
  emulator->faults().stale_sensor = false;
  emulator->faults().sensor_fault = true;
  run_for(20);
  const Log run = run_for(20);
  ASSERT_FALSE(run.samples.empty());
  for (const Sample& sample : run.samples) {
    EXPECT_EQ(messages::unpack_elvh(sample.raw_word).status, messages::ElvhStatus::kFault);
  }
}

TEST_F(TeensyOnPty, AFrozenDeviceIsSilentTimesOutAndCanBeClosed) {
  start();
  device->connect();
  run_for(20);
  emulator->faults().frozen = true;
  run_for(5);
  const Log silent = run_for(50);
  EXPECT_TRUE(silent.samples.empty());
  EXPECT_EQ(fault_of([&] {
              for (int i = 0; i < 100'000; ++i) device->heartbeat();
            }),
            Fault::kTimeout);
  const auto start_time = std::chrono::steady_clock::now();
  device->disconnect();
  EXPECT_LT(std::chrono::steady_clock::now() - start_time, std::chrono::seconds(10)) << "the kernel's own wait is 30 s";
  emulator->faults().frozen = false;
  device->connect();
  EXPECT_FALSE(run_for(20).samples.empty());
}

TEST_F(TeensyOnPty, OnlyOneProgramHasTheDevice) {
  start();
  device->connect();
  TtyStream second({.path = link_});
  try {
    second.open();
    FAIL();
  } catch (const DeviceError& error) {
    EXPECT_EQ(error.fault(), Fault::kDisconnected);
    EXPECT_THAT(error.what(), HasSubstr("another program has it open"));
  }
  EXPECT_FALSE(run_for(20).samples.empty()) << "the failed attempt did no harm";
  device->disconnect();
  second.open();
  EXPECT_TRUE(second.is_open());
}

}  // namespace
}  // namespace isorig::pressure
