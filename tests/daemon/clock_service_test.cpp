// Device clocks that step and time exchanges that are wrong, through the services that own the devices: samples go on,
// no stamp is outside its bound, and the step is over within a few polls.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <span>
#include <string>
#include <string_view>
#include <utility>

#include "daemon/core/core.hpp"
#include "daemon/core/streams.hpp"
#include "daemon/io/frame_service.hpp"
#include "daemon/io/pressure_service.hpp"

namespace isorig::daemon {
namespace {

constexpr std::int64_t kStart_ns = 1'000'000'000'000;
constexpr std::int64_t kPoll_ns = 5'000'000;

/// 1000 samples a second, dated by a clock 20 ppm fast that `steps_us` has been added to.
struct Device {
  double step_us = 0.0;
  double next_exchange_wrong_us = 0.0;
  std::uint32_t taken = 0;

  [[nodiscard]] double us(std::int64_t mono_ns) const {
    return 1e-3 * static_cast<double>(mono_ns - kStart_ns) * (1.0 + 20e-6) + 5e6 + step_us;
  }
  clock::Exchange exchange(std::int64_t now_ns) {
    const double us_now = std::floor(us(now_ns - 60'000)) + std::exchange(next_exchange_wrong_us, 0.0);
    return {now_ns - 150'000, now_ns, us_now, us_now};
  }
  static std::int64_t true_ns(std::uint32_t sequence) { return kStart_ns + std::int64_t{sequence} * 1'000'000; }
  template <typename Sample>
  std::size_t take(std::span<Sample> out, std::int64_t now_ns) {
    std::size_t n = 0;
    while (n < out.size() && true_ns(taken + 1) < now_ns - 200'000) {
      ++taken;
      out[n] = {};
      out[n].sequence = taken;
      out[n++].device_us = static_cast<std::int64_t>(std::floor(us(true_ns(taken))));
    }
    return n;
  }
};

class Frame final : public frame::Device {
 public:
  explicit Frame(clock::Clock& clock) : clock_(clock) {}
  frame::Identity connect() override { return {"isorig", "test", "1", "1", 1000.0, 1}; }
  void disconnect() noexcept override {}
  frame::Poll poll(std::span<frame::Sample> out) override {
    frame::Poll p;
    p.samples = device.take(out, clock_.now_ns());
    p.has_exchange = true;
    p.exchange = device.exchange(clock_.now_ns());
    return p;
  }
  void start_segment(const frame::Segment&) override {}
  void stop() override {}
  void heartbeat(std::uint16_t) override {}
  daemon::Device device;

 private:
  clock::Clock& clock_;
};

class Teensy final : public pressure::Device {
 public:
  void set_limits(const pressure::FillLimits&) override {}
  explicit Teensy(clock::Clock& clock) : clock_(clock) {}
  pressure::Identity connect() override { return {"isorig", "1", "1", 1, 1000.0}; }
  void disconnect() noexcept override {}
  pressure::Poll poll(std::span<pressure::Sample> samples, std::span<clock::Exchange> exchanges,
                      std::int64_t) override {
    pressure::Poll p;
    p.samples = device.take(samples, clock_.now_ns());
    if (std::exchange(asked_, false)) exchanges[p.exchanges++] = device.exchange(clock_.now_ns());
    return p;
  }
  void command(const pressure::Command&) override {}
  void heartbeat() override {}
  void request_time_sync() override { asked_ = true; }
  daemon::Device device;

 private:
  clock::Clock& clock_;
  bool asked_ = false;
};

/// What came out of a link.
struct Seen {
  int samples = 0, outside = 0, backwards = 0, in_doubt = 0;
  double worst_us = 0.0;
  std::int64_t longest_gap_ns = 0, last_arrival_ns = 0, last_ns = 0;
  LinkHealth health;

  template <typename Item>
  void add(const Item& s, std::int64_t now_ns) {
    const auto error_ns = static_cast<double>(s.mono_ns - Device::true_ns(s.sample.sequence));
    ++samples;
    if (std::abs(error_ns) > double{s.bound_ns}) ++outside;
    if (s.bound_ns > 2e6F) ++in_doubt;
    if (s.mono_ns <= last_ns) ++backwards;
    worst_us = std::max(worst_us, 1e-3 * std::abs(error_ns));
    last_ns = s.mono_ns;
    if (last_arrival_ns > 0) longest_gap_ns = std::max(longest_gap_ns, now_ns - last_arrival_ns);
    last_arrival_ns = now_ns;
  }
};

class ClockService : public ::testing::TestWithParam<bool> {
 protected:
  clock::VirtualClock clock_{kStart_ns};
  Frame frame_{clock_};
  Teensy teensy_{clock_};
  FrameLink frame_link_;
  PressureLink pressure_link_;
  InterlockLink line_;
  ServiceConfig config_;
  FrameService frame_service_{frame_, frame_link_, config_, clock_};
  PressureService pressure_service_{teensy_, pressure_link_, line_, config_, clock_};
  Seen seen_;

  [[nodiscard]] bool is_frame() const { return GetParam(); }
  Device& device() { return is_frame() ? frame_.device : teensy_.device; }
  template <typename Queue, typename Item>
  void drain(Queue& queue, Item item) {
    while (queue.pop(item)) seen_.add(item, clock_.now_ns());
  }
  void run_for(double seconds) {
    const std::int64_t until_ns = clock_.now_ns() + static_cast<std::int64_t>(1e9 * seconds);
    while (clock_.now_ns() < until_ns) {
      clock_.sleep_until_ns(clock_.now_ns() + kPoll_ns);
      if (is_frame()) {
        frame_service_.run_once(clock_.now_ns());
        drain(frame_link_.samples, Stamped<frame::Sample>{});
        while (frame_link_.health.pop(seen_.health)) {
        }
        FrameReport report;
        while (frame_link_.reports.pop(report)) {
        }
        clock::Exchange exchange;
        while (frame_link_.exchanges.pop(exchange)) {
        }
      } else {
        pressure_service_.run_once(clock_.now_ns(), 0);
        drain(pressure_link_.samples, Stamped<pressure::Sample>{});
        while (pressure_link_.health.pop(seen_.health)) {
        }
        pressure::State state;
        while (pressure_link_.states.pop(state)) {
        }
        clock::Exchange exchange;
        while (pressure_link_.exchanges.pop(exchange)) {
        }
      }
    }
  }
  void settle() {
    run_for(5.3);
    ASSERT_EQ(seen_.health.clock_epoch, 1U);
    seen_ = {};
  }
};

INSTANTIATE_TEST_SUITE_P(Devices, ClockService, ::testing::Bool(),
                         [](const auto& is_frame) { return is_frame.param ? "Frame" : "Teensy"; });

TEST_P(ClockService, OneWrongExchangeWithholdsNothing) {
  ASSERT_NO_FATAL_FAILURE(settle());
  device().next_exchange_wrong_us = 100e3;
  run_for(3.0);
  EXPECT_GT(seen_.samples, 2900);
  EXPECT_LE(seen_.longest_gap_ns, 2 * kPoll_ns);
  EXPECT_EQ(seen_.outside + seen_.backwards, 0);
  EXPECT_LT(seen_.in_doubt, 40);
  EXPECT_LT(seen_.worst_us, 200.0);
  EXPECT_EQ(seen_.health.clock_epoch, 1U);
  EXPECT_EQ(seen_.health.clock_rejected, 1U);
}

TEST_P(ClockService, AClockThatStepsIsFollowedWithinABound) {
  for (const double step_us : {-50e3, 50e3, -4e6, 30e6}) {
    ASSERT_NO_FATAL_FAILURE(run_for(5.3));
    const auto epoch = seen_.health.clock_epoch;
    seen_ = {};
    device().step_us += step_us;
    run_for(3.0);
    EXPECT_GT(seen_.samples, 2900);
    EXPECT_LE(seen_.longest_gap_ns, 2 * kPoll_ns);
    EXPECT_EQ(seen_.outside, 0) << step_us;
    EXPECT_EQ(seen_.backwards, 0) << step_us;
    EXPECT_LT(seen_.in_doubt, 60) << step_us;
    EXPECT_LT(seen_.worst_us, 6000.0) << step_us;
    EXPECT_EQ(seen_.health.clock_epoch, epoch + 1);
    std::printf("  %9.0f us: %d samples, worst %.0f us, %d with a bound above 2 ms\n", step_us, seen_.samples,
                seen_.worst_us, seen_.in_doubt);
  }
}

TEST(ClockEvents, AClockThatWasSetAndAWrongExchangeAreSaid) {
  FrameLink frame;
  PressureLink pressure;
  InterlockLink interlock;
  Streams streams(std::size_t{1} << 14U);
  Core core(CoreConfig{}, frame, pressure, interlock, streams, nullptr);
  std::int64_t now_ns = kStart_ns;
  const auto events = [&](std::uint32_t epoch, std::uint32_t rejected) {
    LinkHealth health;
    health.connected = true;
    health.clock_epoch = epoch;
    health.clock_rejected = rejected;
    frame.health.push(health);
    pressure.health.push(health);
    for (int i = 0; i < 200; ++i) core.tick(now_ns += 1'000'000, 0, 0);
    std::string all;
    EventRecord e;
    while (core.host_events.pop(e)) {
      if (std::string_view(e.code).starts_with("clock.")) all += std::string(e.code) + ": " + e.text + "\n";
    }
    return all;
  };
  EXPECT_EQ(events(1, 0), "") << "the first life of a clock is no event";
  EXPECT_EQ(events(1, 1),
            "clock.rejected: a time exchange with the frame contradicts its clock and was left out\n"
            "clock.rejected: a time exchange with the Teensy contradicts its clock and was left out\n");
  EXPECT_EQ(events(2, 1),
            "clock.restarted: the frame's clock was set or restarted; its stamps begin anew\n"
            "clock.restarted: the Teensy's clock was set or restarted; its stamps begin anew\n");
  EXPECT_EQ(events(2, 1), "");
}

}  // namespace
}  // namespace isorig::daemon
