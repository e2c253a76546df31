#include <unistd.h>

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <filesystem>
#include <string>

#include "daemon/core/streams.hpp"
#include "daemon/recording/recorder.hpp"
#include "messages/run_log.hpp"

/// What the recorder costs per millisecond of rig time (one sample of frame and pressure each), and how many
/// bytes a second of rig time takes: the figures behind estimate_bytes().
namespace {

using namespace isorig::daemon;

double cpu_s() {
  timespec t{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return static_cast<double>(t.tv_sec) + static_cast<double>(t.tv_nsec) * 1e-9;
}

struct Cost {
  double ns_per_pair;
  double bytes_per_s;
};

Cost measure(Keep keep, std::int64_t milliseconds) {
  std::string pattern = "/tmp/isorig-bench-XXXXXX";
  const std::filesystem::path dir = ::mkdtemp(pattern.data());
  RecorderOptions options;
  options.run_dir = dir;
  options.before_s = 3.0;
  options.sync_interval_s = 600.0;
  options.min_free_bytes = 0;
  options.reserve_bytes = 0;
  Streams streams;
  Recorder recorder(options, {});
  double spent_s = 0.0;
  constexpr std::int64_t kChunk = 1'000;
  for (std::int64_t from = 0; from < milliseconds; from += kChunk) {
    for (std::int64_t i = from; i < from + kChunk; ++i) {
      FrameRecord f;
      f.mono_ns = i * 1'000'000;
      f.device_us = i * 1000;
      f.sequence = static_cast<std::uint32_t>(i);
      f.position_mm = static_cast<double>(i % 1024) * 1e-3;
      f.force_N = static_cast<double>(i % 777) * 1e-2;
      f.keep = keep;
      streams.frame.push(f);
      PressureRecord p;
      p.mono_ns = i * 1'000'000 + 400'000;
      p.device_us = i * 1000;
      p.sequence = static_cast<std::uint32_t>(i);
      p.pressure_psi = static_cast<double>(i % 333) * 1e-2;
      p.keep = keep;
      streams.pressure.push(p);
      if (i % 10 == 0) {
        ControlRecord c;
        c.mono_ns = i * 1'000'000;
        streams.control.push(c);
      }
      if (i % 500 == 0) {
        ExchangeRecord x;
        x.exchange.host_recv_ns = i * 1'000'000;
        streams.exchanges.push(x);
        streams.exchanges.push(x);
      }
    }
    const double before_s = cpu_s();
    recorder.drain(streams, (from + kChunk) * 1'000'000);
    spent_s += cpu_s() - before_s;
  }
  recorder.finish(streams, true);
  const auto bytes = recorder.status().written_bytes;
  std::filesystem::remove_all(dir);
  const auto n = static_cast<double>(milliseconds);
  return {spent_s * 1e9 / n, static_cast<double>(bytes) / (n * 1e-3)};
}

}  // namespace

int main() {
  const auto averaged = measure(Keep::kAveraged, 5'000'000);
  const auto full = measure(Keep::kFull, 1'000'000);
  const auto print = [](const char* keep, const Cost& cost) {
    std::printf("{\"keep\": \"%s\", \"ns_per_pair\": %.4g, \"bytes_per_s\": %.6g}\n", keep, cost.ns_per_pair,
                cost.bytes_per_s);
  };
  print("averaged", averaged);
  print("full", full);
  return 0;
}
