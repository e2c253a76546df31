// Cost of one tick of the real-time core while a protocol runs on the virtual rig, apart from plant and services.
// Usage: bench_core_tick RIG.toml PROTOCOL.toml [seconds of rig time]
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <vector>

#include "base/quantile.hpp"
#include "daemon/rig/virtual_rig.hpp"
#include "protocol/compile.hpp"

namespace {

using isorig::daemon::Core;
using isorig::daemon::Request;
using isorig::daemon::RunState;
using isorig::daemon::Streams;
using isorig::daemon::VirtualRig;
using Clock = std::chrono::steady_clock;

double ns_since(Clock::time_point start) {
  return std::chrono::duration<double, std::nano>(Clock::now() - start).count();
}

void drain(Streams& streams) {
  const auto all = [](auto& queue, auto record) {
    while (queue.pop(record)) {
    }
  };
  all(streams.frame, isorig::daemon::FrameRecord{});
  all(streams.pressure, isorig::daemon::PressureRecord{});
  all(streams.control, isorig::daemon::ControlRecord{});
  all(streams.events, isorig::daemon::EventRecord{});
  all(streams.exchanges, isorig::daemon::ExchangeRecord{});
}

}  // namespace

int main(int argc, char** argv) try {
  if (argc < 3) {
    std::fprintf(stderr, "usage: %s RIG.toml PROTOCOL.toml [seconds of rig time]\n", argv[0]);
    return 2;
  }
  const double seconds = argc > 3 ? std::atof(argv[3]) : 120.0;
  const auto config = isorig::daemon::load_rig(argv[1]);
  const auto plan = isorig::protocol::compile_file(argv[2], config.limits);
  VirtualRig rig(config);
  const auto until_ready = [&] {
    for (int i = 0; i < 60'000 && rig.core().state() != RunState::kReady; ++i) {
      rig.tick();
      if (i % 10 == 0) drain(rig.streams);
    }
    return rig.core().state() == RunState::kReady;
  };
  if (!until_ready())
    throw std::runtime_error("the rig does not get ready: " + std::string(rig.core().status().not_ready));
  Request start;
  start.verb = Request::Verb::kStart;
  start.plan = &plan;
  rig.core().requests.push(start);

  std::vector<double> core_ns;
  core_ns.reserve(static_cast<std::size_t>(seconds * 1e3) + 1);
  rig.around_core = [&](Core& core, std::int64_t now_ns) {
    const auto begin = Clock::now();
    core.tick(now_ns, 0, 0);
    core_ns.push_back(ns_since(begin));
  };
  double all_ns = 0.0;
  for (int i = 0; i < static_cast<int>(seconds * 1e3); ++i) {
    const auto begin = Clock::now();
    rig.tick();
    all_ns += ns_since(begin);
    if (i % 10 == 0) drain(rig.streams);
  }
  if (rig.core().state() != RunState::kRunning && rig.core().state() != RunState::kReady)
    throw std::runtime_error("the run ended early: " + std::string(rig.core().status().fault));
  std::vector<double> clock_ns(1000);  // what looking at the clock costs is not the core's
  for (double& each : clock_ns) each = ns_since(Clock::now());
  const double clock_median_ns = isorig::base::quantile_in_place(clock_ns, 0.5);
  double sum_ns = 0.0;
  for (double& each : core_ns) sum_ns += each = std::max(0.0, each - clock_median_ns);
  const auto count = static_cast<double>(core_ns.size());
  const double worst_ns = *std::ranges::max_element(core_ns);
  const auto quantile = [&](double share) { return isorig::base::quantile_in_place(core_ns, share); };
  std::printf(
      "{\"ticks\": %.0f, \"mean_ns\": %.0f, \"median_ns\": %.0f, \"p99_ns\": %.0f, \"p999_ns\": %.0f, \"worst_ns\": "
      "%.0f, "
      "\"with_plant_and_devices_ns\": %.0f}\n",
      count, sum_ns / count, quantile(0.5), quantile(0.99), quantile(0.999), worst_ns, all_ns / count);
  return 0;
} catch (const std::exception& e) {
  std::fprintf(stderr, "%s\n", e.what());
  return 1;
}
