#include "daemon/host/virtual_run.hpp"

#include <chrono>
#include <memory>

#include "daemon/rig/calibrations.hpp"
#include "daemon/rig/virtual_rig.hpp"

namespace isorig::daemon {
namespace {

constexpr std::int64_t kHostTurnNs = 50'000'000;
constexpr std::int64_t kReadyWithinNs = 30'000'000'000;
// 2026-01-01T00:00:00Z: a recording in virtual time must not know when it was made.
constexpr std::int64_t kEpochUnixUs = 1'767'225'600'000'000;

}  // namespace

VirtualRunResult run_virtual(const RigConfig& rig, const VirtualRunOptions& options) {
  if (!rig.simulated()) {
    throw std::runtime_error("virtual time needs a simulated rig, and " + rig.path.string() +
                             (rig.emulated ? " has devices on the wire, which run in real time" : " has real devices") +
                             "; start isorigd --rig and isorig start");
  }
  RigConfig config = with_calibration(rig, options.runs_root);
  config.core.operating.arming_required = false;  // nothing is there to be hurt, and nobody to be asked
  if (!options.specimen.empty()) {
    config.specimen = options.specimen;
    config.sim->specimen = options.specimen;
  }
  if (options.seed) config.sim->seed = *options.seed;

  const auto wall_start = std::chrono::steady_clock::now();
  const auto wall_s = [&] {
    return std::chrono::duration<double>(std::chrono::steady_clock::now() - wall_start).count();
  };

  auto virtual_rig = std::make_unique<VirtualRig>(config);
  if (options.prepare) options.prepare(virtual_rig->rig());
  if (options.on_tick) {
    virtual_rig->before_core = [&](VirtualRig& r) { options.on_tick(r.rig(), r.core(), r.now_ns()); };
  }
  Host::Options host_options;
  host_options.runs_root = options.runs_root;
  host_options.virtual_time = true;
  host_options.revision = options.revision;
  host_options.epoch_unix_us = [] { return kEpochUnixUs; };
  host_options.seed = static_cast<std::int64_t>(config.sim->seed);
  host_options.breathe = [&] { virtual_rig->tick(); };
  Host host(config, virtual_rig->core(), virtual_rig->streams, host_options);
  const auto tick = [&] {
    virtual_rig->tick();
    if (virtual_rig->now_ns() % kHostTurnNs == 0) host.turn(virtual_rig->now_ns());
  };

  while (virtual_rig->core().state() != RunState::kReady) {
    tick();
    if (virtual_rig->now_ns() > kReadyWithinNs) {
      throw std::runtime_error("the simulated rig did not get ready within 30 s of its time: " +
                               std::string(virtual_rig->core().status().not_ready));
    }
  }
  const auto started = host.start(options.start);
  if (!started.ok) throw std::runtime_error(started.text);

  bool ended = false;  // from here
  double next_progress_s = 0.0;
  const std::int64_t start_ns = virtual_rig->now_ns();
  for (std::uint64_t turn = 0; host.run_open(); ++turn) {
    for (std::int64_t i = 0; i < kHostTurnNs / VirtualRig::kTickNs; ++i) tick();
    if (turn % 64 != 0) continue;
    if (options.on_progress && wall_s() >= next_progress_s) {
      options.on_progress(virtual_rig->core().status(), wall_s());
      next_progress_s = wall_s() + 0.1;
    }
    if (!ended && options.interrupted && options.interrupted()) {
      ended = host.verb(Request::Verb::kAbort).ok;
    }
    // A run that faulted but could go on waits for an operator: there is none here.
    if (virtual_rig->core().state() == RunState::kFaulted && virtual_rig->core().status().run_loaded && !ended) {
      const auto fault_ns = virtual_rig->now_ns();
      while (virtual_rig->now_ns() < fault_ns + Host::kAfterFaultNs) tick();
      ended = host.verb(Request::Verb::kGiveUp).ok;
    }
  }

  VirtualRunResult result;
  result.outcome = host.last_outcome();
  result.fault = host.last_fault();
  result.run_id = host.run_id();
  result.directory = host.run_directory();
  result.status = virtual_rig->core().status();
  result.ticks = result.status.control.ticks;
  result.simulated_s = static_cast<double>(virtual_rig->now_ns() - start_ns) * 1e-9;
  result.recorder = host.recorder_status();
  result.wall_s = wall_s();
  virtual_rig->shut_down();
  return result;
}

}  // namespace isorig::daemon
