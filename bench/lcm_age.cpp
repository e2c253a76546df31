// How old a sample is when a subscriber has it. `daemon`: of the frame samples that a running daemon publishes, against
// the stamp of each. `pair`: a bare LCM publisher and subscriber in two processes, a message a sample, stamped before
// publish(). `wakeups`: how late the daemon's loop woke. ISORIG_STATE has the worst wake-up of each ten ticks; the 99 %
// quantile of the worst of ten is the 99.9 % quantile of all (0.999^10 = 0.990).
// Usage: bench_lcm_age daemon|wakeups URL SECONDS | bench_lcm_age pair URL SECONDS HZ
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include <algorithm>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <lcm/lcm-cpp.hpp>
#include <string>
#include <vector>

#include "base/quantile.hpp"
#include "isorig_msgs/control_batch_t.hpp"
#include "isorig_msgs/frame_batch_t.hpp"
#include "messages/channels.hpp"

namespace {

std::int64_t mono_ns() {
  timespec t{};
  clock_gettime(CLOCK_MONOTONIC, &t);
  return std::int64_t{1'000'000'000} * t.tv_sec + t.tv_nsec;
}

struct Ages {
  std::vector<double> ms;
  std::int64_t first_ns = 0, next = -1, missed = 0;

  void on_batch(const lcm::ReceiveBuffer*, const std::string&, const isorig_msgs::frame_batch_t* m) {
    const std::int64_t now = mono_ns();
    if (first_ns == 0) first_ns = now;
    if (next >= 0 && m->number > next) missed += m->number - next;
    next = m->number + 1;
    for (int i = 0; i < m->count; ++i)
      ms.push_back(1e-6 * static_cast<double>(now - m->mono_ns - m->mono_offset_ns[i]));
  }
};

struct Wakeups {
  std::vector<double> us;

  void on_batch(const lcm::ReceiveBuffer*, const std::string&, const isorig_msgs::control_batch_t* m) {
    for (const auto& each : m->samples) us.push_back(1e-3 * each.worst_wakeup_ns);
  }
};

/// Publishes for `seconds` at `hz`, each message a frame batch of one sample, then a last one that says the count.
[[noreturn]] void publish(const std::string& url, double seconds, double hz) {
  lcm::LCM lcm(url);
  isorig_msgs::frame_batch_t m{};
  m.count = 1;
  m.mono_offset_ns = {0};
  m.device_offset_us = {0};
  m.sequence_offset = {0};
  m.bound_ns = m.repeatability_ns = m.raw_position_mm = m.raw_force_N = {0.0F};
  m.position_mm = m.force_N = {0.0};
  usleep(300'000);  // the subscriber's socket
  const auto period_ns = static_cast<std::int64_t>(1e9 / hz);
  const auto count = static_cast<std::int64_t>(seconds * hz);
  std::int64_t due = mono_ns();
  for (m.number = 0; m.number < count; ++m.number) {
    due += period_ns;
    const timespec at{due / 1'000'000'000, due % 1'000'000'000};
    clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &at, nullptr);
    m.mono_ns = mono_ns();
    lcm.publish("BENCH_AGE", &m);
  }
  _exit(0);
}

int report(Ages& ages) {
  const auto quantile = [&](double share) { return isorig::base::quantile_in_place(ages.ms, share); };
  std::printf(
      "{\"samples\": %zu, \"median_ms\": %.4g, \"p99_ms\": %.4g, \"worst_ms\": %.4g, \"missed_messages\": %lld, "
      "\"first_mono_ns\": %lld}\n",
      ages.ms.size(), quantile(0.5), quantile(0.99), quantile(1.0), static_cast<long long>(ages.missed),
      static_cast<long long>(ages.first_ns));
  return 0;
}

int report(Wakeups& wakeups) {
  const auto quantile = [&](double share) { return isorig::base::quantile_in_place(wakeups.us, share); };
  std::printf("{\"tens_of_ticks\": %zu, \"p999_us\": %.4g, \"worst_us\": %.4g}\n", wakeups.us.size(), quantile(0.99),
              quantile(1.0));
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  const std::string mode = argc > 1 ? argv[1] : "";
  const bool pair = mode == "pair" && argc == 5;
  if (!pair && !((mode == "daemon" || mode == "wakeups") && argc == 4)) {
    std::fprintf(stderr, "usage: %s daemon|wakeups URL SECONDS | %s pair URL SECONDS HZ\n", argv[0], argv[0]);
    return 2;
  }
  const double seconds = std::atof(argv[3]);
  pid_t publisher = 0;
  if (pair && (publisher = fork()) == 0) publish(argv[2], seconds, std::atof(argv[4]));
  lcm::LCM lcm(argv[2]);
  if (!lcm.good()) {
    std::fprintf(stderr, "LCM cannot open %s\n", argv[2]);
    return 1;
  }
  using isorig::messages::Channel;
  using isorig::messages::name_of;
  Ages ages;
  Wakeups wakeups;
  ages.ms.reserve(static_cast<std::size_t>(seconds * 2e4));
  if (mode == "wakeups") {
    lcm.subscribe(std::string(name_of(Channel::kState)), &Wakeups::on_batch, &wakeups)->setQueueCapacity(0);
  } else {
    const std::string channel(pair ? "BENCH_AGE" : name_of(Channel::kFrame));
    lcm.subscribe(channel, &Ages::on_batch, &ages)->setQueueCapacity(0);
  }
  const std::int64_t until_ns = mono_ns() + static_cast<std::int64_t>(1e9 * (seconds + (pair ? 1.0 : 0.0)));
  while (mono_ns() < until_ns) lcm.handleTimeout(100);
  if (publisher > 0) waitpid(publisher, nullptr, 0);
  if (ages.ms.empty() && wakeups.us.empty()) {
    std::fprintf(stderr, "nothing came: is the daemon up, and is this its URL?\n");
    return 1;
  }
  return mode == "wakeups" ? report(wakeups) : report(ages);
}
