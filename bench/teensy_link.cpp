// The Teensy's link in real time: the driver in one thread, the emulated device in another, a pseudo-terminal
// between them. Age of a sample when poll() hands it over, round trip of the time exchanges, CPU time of the
// driver's thread. Usage: bench_teensy_link [seconds per case]
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <memory>
#include <thread>
#include <vector>

#include "base/quantile.hpp"
#include "bench/teensy_backend.hpp"
#include "drivers/clock/real_clock.hpp"
#include "drivers/pressure/teensy.hpp"
#include "drivers/pressure/tty_stream.hpp"
#include "sim/wire/pressure/teensy_pty.hpp"

namespace {

using namespace isorig;

struct Case {
  const char* name;
  std::int64_t period_us;
  std::uint8_t batch_samples;
};

double thread_cpu_s() {
  timespec ts{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &ts);
  return static_cast<double>(ts.tv_sec) + 1e-9 * static_cast<double>(ts.tv_nsec);
}

void run(const Case& test, double seconds) {
  const clock::RealClock clock;
  bench::TeensyBackend backend(clock);
  backend.period_us = test.period_us;
  const std::string link = "/tmp/isorig_bench_teensy_" + std::to_string(getpid());
  sim::TeensyPty::Options options;
  options.core.batch_samples = test.batch_samples;
  options.core.sample_rate_mhz = static_cast<std::uint32_t>(1'000'000'000 / test.period_us);
  sim::TeensyPty emulator(link, options, backend, clock.now_ns());
  const double start_us = emulator.device_us(clock.now_ns());
  const std::int64_t start_ns = clock.now_ns();

  std::atomic<bool> is_done{false};
  std::thread device_side([&] {
    clock::RealClock own;
    for (std::int64_t next_ns = own.now_ns(); !is_done;) {
      emulator.service(own.now_ns());
      next_ns = std::max(next_ns + test.period_us * 1000, own.now_ns());
      own.sleep_until_ns(next_ns);
    }
  });
  pressure::Teensy device({.serial = "1234560"},
                          std::make_unique<pressure::TtyStream>(pressure::TtyStream::Options{.path = link}), clock);
  device.set_limits({.pressure_max_psi = 30.0, .fill_allowance_permille = 100, .fill_max_ms = 60'000});
  device.connect();

  std::array<pressure::Sample, 256> samples{};
  std::array<clock::Exchange, 16> exchanges{};
  std::vector<double> ages_us;
  std::vector<double> round_trips_us;
  ages_us.reserve(static_cast<std::size_t>(seconds * 1.1e6 / static_cast<double>(test.period_us)) + 1000);
  std::uint64_t lost = 0;
  std::uint64_t polls = 0;
  const double cpu_start_s = thread_cpu_s();
  const std::int64_t end_ns = clock.now_ns() + static_cast<std::int64_t>(seconds * 1e9);
  std::int64_t next_beat_ns = 0;
  while (clock.now_ns() < end_ns) {
    if (clock.now_ns() >= next_beat_ns) {
      next_beat_ns = clock.now_ns() + 10'000'000;
      device.heartbeat();
      device.command({.fill_permille = 100});
      device.request_time_sync();
    }
    const pressure::Poll result = device.poll(samples, exchanges, 10'000'000);
    const double now_us = start_us + 1e-3 * static_cast<double>(clock.now_ns() - start_ns);
    ++polls;
    lost += result.lost;
    for (std::size_t i = 0; i < result.samples; ++i) {
      ages_us.push_back(now_us - static_cast<double>(samples[i].device_us));
    }
    for (std::size_t i = 0; i < result.exchanges; ++i) {
      round_trips_us.push_back(1e-3 * static_cast<double>(exchanges[i].host_recv_ns - exchanges[i].host_send_ns));
    }
  }
  const double cpu_percent = 100.0 * (thread_cpu_s() - cpu_start_s) / seconds;
  device.disconnect();
  is_done = true;
  device_side.join();
  std::printf("%-22s %8zu %6llu %7.0f %7.0f %7.0f %8.0f %8.0f %7.2f %8.1f\n", test.name, ages_us.size(),
              static_cast<unsigned long long>(lost), base::quantile_in_place(ages_us, 0.5),
              base::quantile_in_place(ages_us, 0.99), base::quantile_in_place(ages_us, 0.999),
              base::quantile_in_place(ages_us, 1.0), base::quantile_in_place(round_trips_us, 0.5), cpu_percent,
              static_cast<double>(polls) / seconds);
}

}  // namespace

int main(int argc, char** argv) try {
  const double seconds = argc > 1 ? std::atof(argv[1]) : 10.0;
  std::printf("%-22s %8s %6s %7s %7s %7s %8s %8s %7s %8s\n", "", "samples", "lost", "age", "99 %", "99.9 %", "max",
              "rtt", "CPU %", "polls/s");
  for (const Case& test : {Case{"1 kHz, 1 per frame", 1000, 1}, Case{"4 kHz, 1 per frame", 250, 1},
                           Case{"4 kHz, 4 per frame", 250, 4}, Case{"4 kHz, 20 per frame", 250, 20}}) {
    run(test, seconds);
  }
  std::printf("ages and round trips in us; CPU of the driver's thread\n");
  return 0;
} catch (const std::exception& error) {
  std::fprintf(stderr, "bench_teensy_link: %s\n", error.what());
  return 1;
}
