// The driver against the emulator over a real pseudo-terminal, in one thread and virtual time: whenever the
// driver reads, time moves and the emulator is serviced. Only the kernel's own hand-over of bytes is real.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <atomic>
#include <chrono>
#include <filesystem>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "bench/teensy_backend.hpp"
#include "drivers/backoff.hpp"
#include "drivers/error.hpp"
#include "drivers/pressure/teensy.hpp"
#include "drivers/pressure/tty_stream.hpp"
#include "messages/elvh.hpp"
#include "sim/pressure/teensy_pty.hpp"

namespace isorig::pressure {
namespace {

using drivers::DeviceError;
using drivers::Fault;
using testing::HasSubstr;

using Backend = bench::TeensyBackend;

/// Moves time and the emulator while the driver waits.
class PumpedStream final : public ByteStream {
 public:
  PumpedStream(std::string path, clock::VirtualClock& clock, sim::TeensyPty*& emulator)
      : tty({.path = std::move(path)}), clock_(clock), emulator_(emulator) {}
  void open() override { tty.open(); }
  void close() noexcept override { tty.close(); }
  [[nodiscard]] bool is_open() const noexcept override { return tty.is_open(); }
  std::size_t read_some(std::span<std::uint8_t> out, std::int64_t timeout_ns) override {
    const std::int64_t deadline_ns = clock_.now_ns() + timeout_ns;
    for (;;) {
      emulator_->service(clock_.now_ns());
      const std::size_t size = tty.read_some(out, 100'000);
      if (size > 0 || clock_.now_ns() >= deadline_ns) return size;
      clock_.sleep_until_ns(std::min(deadline_ns, clock_.now_ns() + 250'000));
    }
  }
  void write_all(std::span<const std::uint8_t> bytes) override { tty.write_all(bytes); }
  [[nodiscard]] std::string name() const override { return tty.name(); }

  TtyStream tty;

 private:
  clock::VirtualClock& clock_;
  sim::TeensyPty*& emulator_;
};

struct Log {
  std::vector<Sample> samples;
  std::vector<clock::Exchange> exchanges;
  std::uint64_t lost = 0;
  std::uint64_t corrupt = 0;
  bool was_vented = false;
  State state;
};

class TeensyOnPty : public testing::Test {
 protected:
  TeensyOnPty() : link_(testing::TempDir() + "isorig_teensy_" + std::to_string(getpid())) {}

  void start(sim::TeensyPty::Options options = {}, const std::string& serial = "1234560") {
    options.link_path = link_;
    emulator_ = std::make_unique<sim::TeensyPty>(options, backend_, clock_.now_ns());
    emulator = emulator_.get();
    auto owned = std::make_unique<PumpedStream>(link_, clock_, emulator);
    stream_ = owned.get();
    device = std::make_unique<Teensy>(Teensy::Options{.serial = serial}, std::move(owned), clock_);
  }
  Poll poll_into(Log& run, std::int64_t timeout_ns) {
    const Poll result = device->poll(samples_, exchanges_, timeout_ns);
    run.samples.insert(run.samples.end(), samples_.begin(),
                       samples_.begin() + static_cast<long>(result.samples));
    run.exchanges.insert(run.exchanges.end(), exchanges_.begin(),
                         exchanges_.begin() + static_cast<long>(result.exchanges));
    run.lost += result.lost;
    run.corrupt += result.corrupt;
    run.was_vented = run.was_vented || result.state.vented_by_watchdog;
    run.state = result.state;
    return result;
  }
  /// Until `duration_ms` have passed: a heartbeat each 10 ms if wanted, and polls.
  Log run_for(int duration_ms, bool with_heartbeat = true) {
    Log run;
    const std::int64_t end_ns = clock_.now_ns() + std::int64_t{duration_ms} * 1'000'000;
    for (std::int64_t next_ns = clock_.now_ns(); clock_.now_ns() < end_ns;) {
      if (with_heartbeat && clock_.now_ns() >= next_ns) {
        device->heartbeat();
        next_ns = clock_.now_ns() + 10'000'000;
      }
      poll_into(run, 1'000'000);
      // poll() returns with the first byte, so time would stand still here.
      clock_.sleep_until_ns(clock_.now_ns() + 250'000);
    }
    return run;
  }
  /// Takes what is still on its way without letting time pass.
  void drain(Log& run) {
    for (int quiet = 0; quiet < 20;) quiet = poll_into(run, 0).samples > 0 ? 0 : quiet + 1;
  }
  static void expect_sequence(const std::vector<Sample>& samples) {
    for (std::size_t i = 1; i < samples.size(); ++i) {
      ASSERT_EQ(samples[i].sequence, samples[i - 1].sequence + 1) << i;
      ASSERT_GT(samples[i].device_us, samples[i - 1].device_us) << i;
    }
  }
  template <class Call>
  static Fault fault_of(Call&& call) {
    try {
      call();
    } catch (const DeviceError& error) {
      return error.fault();
    }
    ADD_FAILURE() << "no DeviceError";
    return Fault::kProtocol;
  }
  void connect_with_backoff() {
    drivers::Backoff backoff;
    for (;;) {
      clock_.sleep_until_ns(backoff.next_ns());
      try {
        device->connect();
        return;
      } catch (const DeviceError& error) {
        ASSERT_LT(backoff.failed(clock_.now_ns()), 3'000'000'000) << error.what();
        ASSERT_LT(backoff.failures(), 20U) << error.what();
        emulator->service(clock_.now_ns());
      }
    }
  }

  std::string link_;
  clock::VirtualClock clock_{1'000'000'000};
  Backend backend_{clock_};
  std::unique_ptr<sim::TeensyPty> emulator_;
  sim::TeensyPty* emulator = nullptr;
  PumpedStream* stream_ = nullptr;
  std::unique_ptr<Teensy> device;
  std::array<Sample, 512> samples_{};
  std::array<clock::Exchange, 64> exchanges_{};
};

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

TEST_F(TeensyOnPty, ReconnectsAfterAHangUpAndKnowsWhatItMissed) {
  start();
  device->connect();
  Log before = run_for(300);
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
  EXPECT_LT(std::chrono::steady_clock::now() - start_time, std::chrono::seconds(1));
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

TEST_F(TeensyOnPty, SyncEdgesCarryTheDeviceTime) {
  start({.start_us = 1'000});
  device->connect();
  const std::int64_t edge_ns = clock_.now_ns();
  emulator->sync_edge(edge_ns, true);
  run_for(5);
  const auto edge = device->take_sync_edge();
  ASSERT_TRUE(edge);
  EXPECT_EQ(edge->device_us, static_cast<std::uint64_t>(emulator->device_us(edge_ns)));
  EXPECT_EQ(edge->level, 1);
}

TEST(TeensyInRealTime, SamplesFlowBetweenTwoThreads) {
  const clock::RealClock clock;
  const std::string link = testing::TempDir() + "isorig_teensy_rt_" + std::to_string(getpid());
  Backend backend(clock);
  sim::TeensyPty emulator({.link_path = link}, backend, clock.now_ns());
  std::atomic<bool> is_done{false};
  std::thread device_side([&] {
    clock::RealClock own;
    for (std::int64_t next_ns = own.now_ns(); !is_done; next_ns += 500'000) {
      own.sleep_until_ns(next_ns);
      emulator.service(own.now_ns());
    }
  });
  {
    Teensy device({.serial = "1234560"}, std::make_unique<TtyStream>(TtyStream::Options{.path = link}),
                  clock);
    device.connect();
    std::array<Sample, 256> samples;
    std::array<clock::Exchange, 16> exchanges;
    std::uint64_t received = 0;
    std::uint64_t lost = 0;
    std::uint64_t exchanged = 0;
    for (int i = 0; received < 500 && i < 5000; ++i) {
      if (i % 10 == 0) {
        device.heartbeat();
        device.request_time_sync();
      }
      const Poll result = device.poll(samples, exchanges, 10'000'000);
      received += result.samples;
      lost += result.lost;
      exchanged += result.exchanges;
    }
    EXPECT_GE(received, 500U);
    EXPECT_EQ(lost, 0U);
    EXPECT_GT(exchanged, 5U);
  }
  is_done = true;
  device_side.join();
}

}  // namespace
}  // namespace isorig::pressure
