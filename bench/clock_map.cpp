// The device clock map against the simplest ways, over made-up devices whose true time is known.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <vector>

#include "bench/clock_scenario.hpp"
#include "drivers/clock_map/mapping.hpp"
#include "drivers/clock_map/remap.hpp"

namespace isorig::bench {
namespace {

constexpr double kStart_s = 120.0;

struct Tally {
  double sum = 0.0, squares = 0.0, worst = 0.0, bounds = 0.0, widest = 0.0, variances = 0.0;
  long n = 0, outside = 0;
  void add(double error_us, double bound_us = 0.0, double deviation_us = 0.0) {
    sum += error_us;
    squares += error_us * error_us;
    worst = std::max(worst, std::abs(error_us));
    bounds += bound_us;
    widest = std::max(widest, bound_us);
    variances += deviation_us * deviation_us;
    outside += std::abs(error_us) > bound_us ? 1 : 0;
    ++n;
  }
  double rms() const { return std::sqrt(squares / static_cast<double>(n)); }
  void print(const char* name, bool with_bound) const {
    const auto count = static_cast<double>(n);
    std::printf("  %-28s %7.1f %7.0f %+7.1f", name, rms(), worst, sum / count);
    if (with_bound) {
      std::printf(" | %6.1f %6.0f %6.0f %8.3f", std::sqrt(variances / count), bounds / count, widest,
                  100.0 * (1.0 - static_cast<double>(outside) / count));
    }
    std::printf("\n");
  }
};

void run(const char* name, const ClockScenario& scenario, unsigned seeds) {
  Tally arrival, midpoint, start, online, offline;
  for (unsigned seed = 1; seed <= seeds; ++seed) {
    const auto truth = ClockSimulation(scenario, seed).run();
    clock::DeviceClockMap map;
    clock::StreamMapper mapper(map);
    std::vector<clock::DeviceStamp> stamps;
    std::size_t next = 0;
    const auto* last = &truth.exchanges.front();
    for (const auto& stamp : truth.stamps) {
      for (; next < truth.exchanges.size() && truth.exchanges[next].host_recv_ns <= stamp.arrival_ns; ++next) {
        last = &truth.exchanges[next];
        map.add(*last);
      }
      const auto mapped = mapper.map(stamp.device_us, stamp.arrival_ns);
      const double error_us = static_cast<double>(mapped.mono_ns - stamp.true_ns) * 1e-3;
      const bool settled = stamp.true_ns - truth.stamps.front().true_ns > static_cast<std::int64_t>(kStart_s * 1e9);
      (settled ? online : start).add(error_us, mapped.bound_ns * 1e-3, mapped.repeatability_ns * 1e-3);
      stamps.push_back({stamp.device_us, stamp.arrival_ns});
      if (!settled) continue;
      arrival.add(static_cast<double>(stamp.arrival_ns - stamp.true_ns) * 1e-3);
      const double middle_us = 0.5 * static_cast<double>(last->host_recv_ns - last->host_send_ns) * 1e-3;
      midpoint.add(middle_us + stamp.device_us - 0.5 * (last->device_rx_us + last->device_tx_us) -
                   static_cast<double>(stamp.true_ns - last->host_send_ns) * 1e-3);
    }
    const auto again = clock::remap_offline(truth.exchanges, stamps);
    for (std::size_t i = 0; i < again.size(); ++i) {
      offline.add(static_cast<double>(again[i].mono_ns - truth.stamps[i].true_ns) * 1e-3, again[i].bound_ns * 1e-3,
                  again[i].repeatability_ns * 1e-3);
    }
  }
  std::printf("%s, %u x %.0f s, an exchange every %g s; us\n", name, seeds, scenario.duration_s,
              scenario.exchange_period_s);
  std::printf("  %-28s %7s %7s %7s | %6s %6s %6s %8s\n", "", "rms", "worst", "bias", "stated", "bound", "widest",
              "inside %");
  arrival.print("host arrival", false);
  midpoint.print("last midpoint", false);
  start.print("map, first 120 s", true);
  online.print("map, online", true);
  offline.print("map, offline", true);
}

}  // namespace
}  // namespace isorig::bench

int main(int argc, char** argv) {
  using namespace isorig::bench;
  const auto seeds = static_cast<unsigned>(argc > 1 ? std::max(1, std::atoi(argv[1])) : 5);
  const double period_s = argc > 2 ? std::atof(argv[2]) : 1.0;
  for (auto [name, scenario] :
       {std::pair{"A: delays alike", scenario_a()}, std::pair{"B: tails 0.1 / 0.5 ms", scenario_b()},
        std::pair{"C: bases 0.15 / 0.35 ms", scenario_c()}}) {
    scenario.exchange_period_s = period_s > 0.0 ? period_s : 1.0;
    run(name, scenario, seeds);
  }
  return 0;
}
