#pragma once
// The driver against the emulator over a real pseudo-terminal, in one thread and virtual time: whenever the
// driver reads, time moves and the emulator is serviced. Only the kernel's own hand-over of bytes is real.
#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <memory>
#include <string>
#include <vector>

#include "bench/teensy_backend.hpp"
#include "drivers/api/backoff.hpp"
#include "drivers/api/error.hpp"
#include "drivers/pressure/teensy.hpp"
#include "drivers/pressure/tty_stream.hpp"
#include "sim/wire/pressure/teensy_pty.hpp"

namespace isorig::pressure {

using drivers::DeviceError;
using drivers::Fault;

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

  void start(const sim::TeensyPty::Options& options = {}, const std::string& serial = "1234560") {
    emulator_ = std::make_unique<sim::TeensyPty>(link_, options, backend_, clock_.now_ns());
    emulator = emulator_.get();
    auto owned = std::make_unique<PumpedStream>(link_, clock_, emulator);
    stream_ = owned.get();
    device = std::make_unique<Teensy>(Teensy::Options{.serial = serial}, std::move(owned), clock_);
    device->set_limits({.pressure_max_psi = 24.0, .fill_allowance_permille = 100, .fill_max_ms = 20'000});
  }
  Poll poll_into(Log& run, std::int64_t timeout_ns) {
    const Poll result = device->poll(samples_, exchanges_, timeout_ns);
    run.samples.insert(run.samples.end(), samples_.begin(), samples_.begin() + static_cast<long>(result.samples));
    run.exchanges.insert(run.exchanges.end(), exchanges_.begin(),
                         exchanges_.begin() + static_cast<long>(result.exchanges));
    run.lost += result.lost;
    run.corrupt += result.corrupt;
    run.was_vented = run.was_vented || result.state.vented_by_itself;
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

}  // namespace isorig::pressure
