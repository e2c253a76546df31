// Cost of one 1 ms tick of the virtual rig: all physics, noise and devices, polled at 1 kHz as the daemon
// does. Usage: bench_plant_tick RIG.toml [ticks]
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <vector>

#include "sim/rig.hpp"

int main(int argc, char** argv) try {
  if (argc < 2) {
    std::fprintf(stderr, "usage: %s RIG.toml [ticks]\n", argv[0]);
    return 2;
  }
  const long ticks = argc > 2 ? std::atol(argv[2]) : 20'000'000;
  isorig::sim::Rig rig(isorig::sim::load_sim(argv[1]));
  auto& frame = rig.frame();
  auto& pressure = rig.pressure();
  frame.connect();
  pressure.connect();
  rig.interlock().connect();
  rig.interlock().hold_pressure(true);
  std::vector<isorig::frame::Sample> frame_samples(64);
  std::vector<isorig::pressure::Sample> pressure_samples(64);
  std::vector<isorig::clock::Exchange> exchanges(16);
  std::uint64_t polled = 0;
  double sum = 0.0;
  const std::clock_t cpu_start = std::clock();
  const auto start = std::chrono::steady_clock::now();
  for (long i = 1; i <= ticks; ++i) {
    const std::int64_t now_ns = i * isorig::sim::Rig::kStep_ns;
    rig.advance(now_ns);
    if (i % 100 == 1) {
      frame.heartbeat(static_cast<std::uint16_t>(i / 100));
      pressure.heartbeat();
    }
    if (i % 1000 == 2) pressure.request_time_sync();
    if (i % 10 == 3) {
      // A crude loop round 15 psi keeps the valves and the flows busy.
      const double error_psi = 15.0 - rig.truth().pressure_psi;
      const double duty = 20.0 + 400.0 * (error_psi < 0.0 ? -error_psi : error_psi);
      const auto permille = static_cast<std::uint16_t>(duty > 1000.0 ? 1000.0 : duty);
      pressure.command(error_psi > 0.0 ? isorig::pressure::Command{permille, 0, 0.0F}
                                       : isorig::pressure::Command{0, permille, 0.0F});
    }
    if (i % 4000 == 1) frame.start_segment({static_cast<std::uint16_t>(i / 4000), i % 8000 == 1 ? 2.0F : 0.0F, 2.0F});
    const auto f = frame.poll(frame_samples);
    const auto p = pressure.poll(pressure_samples, exchanges, 0);
    polled += f.samples + p.samples;
    if (f.samples > 0) sum += static_cast<double>(frame_samples[0].force_N);
  }
  const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  const double cpu_s = static_cast<double>(std::clock() - cpu_start) / CLOCKS_PER_SEC;
  std::printf("%ld ticks: %.1f ns of CPU time each (%.1f ns elapsed); %llu samples polled, mean force %.3f N\n", ticks,
              1e9 * cpu_s / static_cast<double>(ticks), 1e9 * seconds / static_cast<double>(ticks),
              static_cast<unsigned long long>(polled), sum / static_cast<double>(ticks));
  return 0;
} catch (const std::exception& e) {
  std::fprintf(stderr, "%s\n", e.what());
  return 1;
}
