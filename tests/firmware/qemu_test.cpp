// The firmware's image on an emulated Cortex-M4 against the host's real driver over a real tty. The emulator
// shares the machine with everything else, so nothing here judges microseconds: the tests in virtual time do.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <memory>
#include <optional>

#include "drivers/api/clock.hpp"
#include "drivers/clock/real_clock.hpp"
#include "drivers/pressure/teensy.hpp"
#include "drivers/pressure/tty_stream.hpp"
#include "messages/elvh.hpp"
#include "qemu_machine.hpp"

namespace isorig::firmware {
namespace {

using pressure::Sample;
using pressure::Teensy;

constexpr std::int64_t kMs = 1'000'000;
constexpr std::int64_t kPatience = 20'000 * kMs;

class Qemu : public testing::Test {
 protected:
  void SetUp() override {
    ASSERT_TRUE(machine.is_up()) << "qemu-system-arm did not start";
    connect();
  }
  void connect() {
    device = std::make_unique<Teensy>(
        Teensy::Options{.serial = "QEMU0", .connect_timeout_ns = kPatience},
        std::make_unique<pressure::TtyStream>(pressure::TtyStream::Options{.path = machine.link()}), clock);
    // The simulated sensor has no noise: at the supply's pressure its count stands, so no cap here.
    device->set_limits({.pressure_max_psi = 30.0});
    const pressure::Identity identity = device->connect();
    EXPECT_EQ(identity.model, "isorig-teensy36");
  }
  /// Polls, with heartbeats, until `is_done` or patience ends; then false.
  bool run_until(const std::function<bool()>& is_done, bool with_heartbeat = true, std::int64_t limit_ns = kPatience) {
    const std::int64_t end_ns = clock.now_ns() + limit_ns;
    while (!is_done()) {
      const std::int64_t now_ns = clock.now_ns();
      if (now_ns > end_ns) return false;
      if (with_heartbeat && now_ns >= next_beat_ns) {
        device->heartbeat();
        if (next_beat_ns > 0) longest_silence_ns = std::max(longest_silence_ns, now_ns - next_beat_ns + 10 * kMs);
        next_beat_ns = now_ns + 10 * kMs;
      }
      const pressure::Poll poll = device->poll(buffer, exchange_buffer, kMs);
      samples.insert(samples.end(), buffer.begin(), buffer.begin() + static_cast<std::ptrdiff_t>(poll.samples));
      exchanges.insert(exchanges.end(), exchange_buffer.begin(),
                       exchange_buffer.begin() + static_cast<std::ptrdiff_t>(poll.exchanges));
      lost += poll.lost;
      corrupt += poll.corrupt;
      state = poll.state;
      was_vented = was_vented || poll.state.vented_by_itself;
      while (const auto edge = device->take_sync_edge()) edges.push_back(*edge);
    }
    return true;
  }
  void run_ms(std::int64_t ms, bool with_heartbeat = true) {
    const std::int64_t end_ns = clock.now_ns() + ms * kMs;
    run_until([&] { return clock.now_ns() >= end_ns; }, with_heartbeat);
  }
  [[nodiscard]] double pressure_psi() const {
    return messages::elvh_pressure_psi(messages::unpack_elvh(samples.back().raw_word).pressure_raw);
  }
  /// Asks again and again, as the daemon does, until the sensor shows it. A device that vented because this thread was
  /// not there waits until somebody agrees.
  bool command_until_psi(pressure::Command command, double from_psi, double to_psi) {
    return run_until([&] {
      if (clock.now_ns() >= next_command_ns) {
        device->command(state.vented_by_itself ? pressure::Command{.vent_permille = 1000} : command);
        next_command_ns = clock.now_ns() + 10 * kMs;
      }
      return !samples.empty() && pressure_psi() >= from_psi && pressure_psi() <= to_psi;
    });
  }
  /// A number that the device says of itself on the test line, without a look at the link.
  std::optional<int> asked(const std::string& what) {
    machine.tell('p');
    for (const std::int64_t end_ns = clock.now_ns() + kPatience; clock.now_ns() < end_ns;) {
      for (const std::string& line : machine.heard())
        if (line.starts_with(what + " ")) return std::stoi(line.substr(what.size() + 1));
      std::this_thread::sleep_for(std::chrono::milliseconds(5));
    }
    return std::nullopt;
  }
  /// Until a word with that property comes.
  bool sees(const std::function<bool(std::uint32_t)>& is_wanted) {
    samples.clear();
    return run_until([&] {
      return std::any_of(samples.begin(), samples.end(), [&](const Sample& s) { return is_wanted(s.raw_word); });
    });
  }

  clock::RealClock clock;
  QemuMachine machine;
  std::unique_ptr<Teensy> device;
  std::array<Sample, 512> buffer{};
  std::array<clock::Exchange, 16> exchange_buffer{};
  std::vector<Sample> samples;
  std::vector<clock::Exchange> exchanges;
  std::vector<pressure::SyncEdge> edges;
  std::uint64_t lost = 0;
  std::uint64_t corrupt = 0;
  pressure::State state;
  bool was_vented = false;
  std::int64_t next_beat_ns = 0;
  std::int64_t longest_silence_ns = 0;
  std::int64_t next_command_ns = 0;
};

TEST_F(Qemu, StreamsAtMoreThanOneKilohertzAndAnswersTimeSync) {
  run_ms(300);
  samples.clear();
  lost = 0;
  const std::int64_t start_ns = clock.now_ns();
  // One exchange at a time, and another where its answer was among what the device dropped.
  for (std::size_t i = 1; i <= 20; ++i) {
    std::int64_t again_ns = 0;
    ASSERT_TRUE(run_until([&] {
      if (clock.now_ns() >= again_ns) {
        device->request_time_sync();
        again_ns = clock.now_ns() + 2'000 * kMs;
      }
      return exchanges.size() >= i && samples.size() > 60 * i;
    })) << i;
    run_ms(50);
  }
  const double seconds = 1e-9 * static_cast<double>(clock.now_ns() - start_ns);
  RecordProperty("samples_per_s", static_cast<int>(static_cast<double>(samples.size()) / seconds));
  RecordProperty("lost", static_cast<int>(lost));
  // Every conversion has a number, also those that an emulator without a processor of its own missed.
  const std::uint32_t numbered = samples.back().sequence - samples.front().sequence + 1;
  EXPECT_GT(numbered / seconds, 1'000.0);
  EXPECT_GE(samples.size() + lost, numbered);
  EXPECT_GT(samples.size(), 1'000U);
  for (std::size_t i = 1; i < samples.size(); ++i) ASSERT_GT(samples[i].device_us, samples[i - 1].device_us);
  EXPECT_EQ(corrupt, 0U);

  ASSERT_GE(exchanges.size(), 20U);
  double best_ms = 1e9;
  for (const clock::Exchange& exchange : exchanges) {
    EXPECT_LE(exchange.device_rx_us, exchange.device_tx_us);
    best_ms = std::min(best_ms, 1e-6 * static_cast<double>(exchange.host_recv_ns - exchange.host_send_ns));
  }
  // The device clock runs at the rate of the host's.
  const clock::Exchange& first = exchanges.front();
  const clock::Exchange& last = exchanges.back();
  const double host_us = 1e-3 * static_cast<double>(last.host_send_ns - first.host_send_ns);
  const double uncertain_us =
      1e-3 * static_cast<double>(first.host_recv_ns - first.host_send_ns + last.host_recv_ns - last.host_send_ns);
  EXPECT_NEAR((last.device_rx_us - first.device_rx_us) / host_us, 1.0, 0.02 + uncertain_us / host_us);
  RecordProperty("best_round_trip_us", static_cast<int>(1e3 * best_ms));
}

TEST_F(Qemu, FillsHoldsAndVents) {
  run_ms(50);
  EXPECT_TRUE(command_until_psi({.fill_permille = 1000}, 20.0, 26.0));
  EXPECT_TRUE(command_until_psi({.vent_permille = 1000}, -1.0, 0.5));
  EXPECT_TRUE(!was_vented || longest_silence_ns > 100 * kMs) << "vented by itself, with heartbeats every 10 ms";
  const auto heard = machine.heard();
  EXPECT_NE(std::find(heard.begin(), heard.end(), "coils 1000 1000"), heard.end());
}

TEST_F(Qemu, VentsByItselfWhenHeartbeatsStop) {
  run_ms(50);
  ASSERT_TRUE(command_until_psi({.fill_permille = 1000}, 10.0, 26.0));
  EXPECT_TRUE(run_until([&] { return was_vented; }, false));
  EXPECT_TRUE(run_until([&] { return pressure_psi() < 0.5; }, false)) << "by the sensor, not by its word";
  EXPECT_EQ(state.fill_permille, 0);
  EXPECT_EQ(state.vent_permille, 1000);
}

TEST_F(Qemu, VentsByItselfAboveTheGreatestPressureWhateverItsHostSays) {
  device->set_limits({.pressure_max_psi = 12.0});
  device->connect();
  // Commands to fill and heartbeats go on; nobody agrees to the vent.
  std::int64_t next_ns = 0;
  double highest_psi = 0.0;
  EXPECT_TRUE(run_until([&] {
    if (clock.now_ns() >= next_ns) {
      device->command({.fill_permille = 100});
      next_ns = clock.now_ns() + 10 * kMs;
    }
    // A bus that did not answer in time is a word of ones: no pressure, though it would read 33.7 psi.
    if (!samples.empty() && messages::unpack_elvh(samples.back().raw_word).status == messages::ElvhStatus::kCurrent)
      highest_psi = std::max(highest_psi, pressure_psi());
    return was_vented && pressure_psi() < 0.5;
  }));
  EXPECT_TRUE(state.vented_by_itself) << "latched";
  EXPECT_TRUE(state.cause == pressure::VentCause::kPressureHigh || longest_silence_ns > 100 * kMs);
  EXPECT_LT(highest_psi, 14.0);
}

TEST_F(Qemu, CountsWhatAStalledHostMakesItDrop) {
  run_ms(100);
  const std::uint32_t before = state.dropped;
  // Nobody reads the link until the device itself says, on its test line, that it dropped enough.
  const std::int64_t end_ns = clock.now_ns() + kPatience;
  int dropped = 0;
  while (dropped < static_cast<int>(before) + 100 && clock.now_ns() < end_ns) {
    dropped = asked("dropped").value_or(0);
  }
  ASSERT_GE(dropped, static_cast<int>(before) + 100);
  EXPECT_TRUE(run_until([&] { return state.dropped >= before + 100; }));
  run_ms(300);
  EXPECT_GE(lost, state.dropped - before) << "what it says it dropped is what is missing";
  EXPECT_EQ(corrupt, 0U) << "whole frames or none";
}

TEST_F(Qemu, RaisesTheSyncLineAndSaysWhen) {
  EXPECT_TRUE(run_until([&] { return edges.size() >= 4; }));
  for (std::size_t i = 1; i < edges.size(); ++i) {
    EXPECT_NE(edges[i].rising, edges[i - 1].rising);
    EXPECT_NEAR(static_cast<double>(edges[i].device_us - edges[i - 1].device_us), 500e3, 400e3);
  }
  const auto heard = machine.heard();
  EXPECT_GE(std::count(heard.begin(), heard.end(), "sync 1"), 2);
}

TEST_F(Qemu, ShowsEachFaultOfTheSensorAsItsRawWord) {
  using messages::ElvhStatus;
  const auto is = [](ElvhStatus status) {
    return [status](std::uint32_t word) { return messages::unpack_elvh(word).status == status; };
  };
  machine.tell('a');
  EXPECT_TRUE(sees([](std::uint32_t word) { return word == 0xFFFFFFFFU; }));
  machine.tell('l');
  EXPECT_TRUE(sees([](std::uint32_t word) { return word == 0; }));
  machine.tell('s');
  EXPECT_TRUE(sees(is(ElvhStatus::kStale)));
  machine.tell('d');
  EXPECT_TRUE(sees(is(ElvhStatus::kFault)));
  machine.tell('0');
  run_ms(50);
  EXPECT_TRUE(sees(is(ElvhStatus::kCurrent)));
}

TEST_F(Qemu, AHungLoopIsResetByTheWatchdogAndVents) {
  run_ms(1'600);  // the driver knows a new start by a clock that went back by more than a second
  ASSERT_TRUE(command_until_psi({.fill_permille = 1000}, 10.0, 26.0));
  machine.heard();
  machine.tell('h');
  // A device whose clock starts anew is another one to the driver.
  bool is_disconnected = false;
  try {
    run_until([] { return false; });
  } catch (const drivers::DeviceError& error) {
    is_disconnected = error.fault() == drivers::Fault::kDisconnected;
  }
  EXPECT_TRUE(is_disconnected);
  const auto heard = machine.heard();
  const auto ready = std::find(heard.begin(), heard.end(), "ready");
  ASSERT_GT(heard.end() - ready, 2);
  EXPECT_TRUE(ready[1] == "coils 0 0" || ready[2] == "coils 0 0") << "vented before anything else";
  device.reset();
  connect();
  run_ms(50);
  EXPECT_LT(pressure_psi(), 1.0);
}

TEST_F(Qemu, SendsNothingToAClosedPort) {
  run_ms(50);
  machine.tell('-');
  run_ms(200, false);
  samples.clear();
  run_ms(200, false);
  EXPECT_TRUE(samples.empty());
  const std::uint32_t dropped = state.dropped;
  machine.tell('+');
  EXPECT_TRUE(run_until([&] { return samples.size() > 100; }));
  EXPECT_EQ(state.dropped, dropped);
}

TEST_F(Qemu, UsesLittleStackAndEndsWithZero) {
  run_ms(500);
  const std::optional<int> stack = asked("stack");
  ASSERT_TRUE(stack);
  RecordProperty("stack_bytes", *stack);
  EXPECT_LT(*stack, 4'096) << "of 8 KiB";
  EXPECT_GT(*stack, 200);
  machine.tell('q');
  EXPECT_EQ(machine.wait_for_exit(10), 0);
}

TEST_F(Qemu, AFaultEndsTheEmulatorWithItsOwnCode) {
  machine.tell('f');
  EXPECT_EQ(machine.wait_for_exit(10), 70);
}

}  // namespace
}  // namespace isorig::firmware
