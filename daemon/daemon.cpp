#include "daemon/daemon.hpp"

#include <pthread.h>
#include <signal.h>
#include <spdlog/spdlog.h>

#include <chrono>
#include <future>
#include <thread>
#include <vector>

#include "daemon/api.hpp"
#include "daemon/calibrations.hpp"
#include "daemon/core.hpp"
#include "daemon/devices.hpp"
#include "daemon/host.hpp"
#include "daemon/publisher.hpp"
#include "daemon/realtime.hpp"
#include "daemon/service_notifier.hpp"
#include "daemon/services.hpp"

namespace isorig::daemon {
namespace {

constexpr std::int64_t kPressureWaitNs = 2'000'000;
constexpr std::int64_t kInterlockPeriodNs = 5'000'000;
constexpr std::int64_t kInterlockLeastNs = 500'000;
constexpr std::int64_t kRecorderPeriodNs = 20'000'000;
constexpr std::int64_t kPublisherPeriodNs = 10'000'000;
// Below the devices' threads, above everything ordinary: a busy machine must not look like a stalled loop.
constexpr int kWatchdogPriority = 1;
constexpr auto kStatusPeriod = std::chrono::seconds(1);
constexpr auto kFirstTickPatience = std::chrono::seconds(1);

std::int64_t epoch_unix_us(const clock::Clock& clock) {
  const auto wall = std::chrono::duration_cast<std::chrono::microseconds>(
                        std::chrono::system_clock::now().time_since_epoch())
                        .count();
  return wall - clock.now_ns() / 1000;
}

/// What an operator finds in the journal the morning after; single steps are in the recording.
void log_event(const EventRecord& e) {
  const std::string_view code = e.code;
  if (code == "step" || code == "mark") return;
  const auto level = e.severity >= Severity::kProgramStop ? spdlog::level::err
                     : e.severity == Severity::kWarning   ? spdlog::level::warn
                                                          : spdlog::level::info;
  const std::string change = e.from == e.to ? "" : std::string(" [") + to_text(e.from) + " -> " + to_text(e.to) + "]";
  const std::string numbers = e.threshold == 0.0 ? "" : fmt::format(" ({:.3f}, limit {:.3f})", e.value, e.threshold);
  spdlog::log(level, "{}: {}{}{}", code, e.text, numbers, change);
}

/// The line of `systemctl status`.
std::string status_line(const Status& s, const std::string& run) {
  std::string line = to_text(s.control.state);
  if (s.run_loaded) {
    line += fmt::format(": run {}, step {} of {}, {:.0f} %", run, s.control.step + 1, s.steps, 100.0 * double{s.control.progress});
  }
  const std::string why = s.fault[0] != '\0' ? s.fault : s.not_ready;
  return why.empty() ? line : line + ": " + why;
}

sigset_t stop_signals() {
  sigset_t set;
  sigemptyset(&set);
  sigaddset(&set, SIGTERM);
  sigaddset(&set, SIGINT);
  return set;
}

}  // namespace

struct Daemon::Impl {
  Impl(const RigConfig& config, const DaemonOptions& options)
      : rig(with_calibration(config, options.runs_root)),
        devices(open_devices(rig, clock)),
        recorder_streams(std::size_t{1} << 16U),
        publisher_streams(std::size_t{1} << 14U),
        core(rig.core, frame_link, pressure_link, interlock_link, recorder_streams,
             rig.lcm.enabled ? &publisher_streams : nullptr),
        frame_service(*devices.frame, frame_link, rig.services, clock),
        pressure_service(*devices.pressure, pressure_link, interlock_link, rig.services, clock),
        interlock_service(*devices.interlock, interlock_link),
        regulator_service(devices.regulator ? std::make_unique<RegulatorService>(*devices.regulator, pressure_link, rig.services, clock)
                                            : nullptr),
        host(rig, core, recorder_streams, host_options(options)),
        api(host, options.socket, rig.api.mode) {
    if (rig.lcm.enabled) publisher.emplace(rig.lcm.url);
  }

  Host::Options host_options(const DaemonOptions& options) const {
    Host::Options h;
    h.runs_root = options.runs_root;
    h.epoch_unix_us = epoch_unix_us(clock);
    h.on_event = log_event;
    h.seed = rig.sim ? static_cast<std::int64_t>(rig.sim->seed) : 0;
    return h;
  }

  /// Starts a thread that runs `body` after it has its priority; what it could not get is thrown here.
  template <typename Body>
  void spawn(std::vector<std::thread>& into, const char* name, int priority, Body body) {
    std::promise<void> ready;
    auto outcome = ready.get_future();
    into.emplace_back([this, name, priority, &ready, body]() mutable {
      pthread_setname_np(pthread_self(), name);
      try {
        if (priority > 0) enter_realtime(rig.realtime, priority);
        if (priority == rig.realtime.priority) pin(rig.realtime);
      } catch (...) {
        ready.set_exception(std::current_exception());
        return;
      }
      ready.set_value();
      body();
    });
    outcome.get();
  }

  template <typename Turn>
  void every(std::int64_t period_ns, const std::atomic<bool>& stop, Turn turn) {
    std::int64_t deadline_ns = clock.now_ns();
    while (!stop.load(std::memory_order_relaxed)) {
      deadline_ns = std::max(deadline_ns + period_ns, clock.now_ns());
      clock.sleep_until_ns(deadline_ns);
      turn();
    }
  }

  void start_threads();
  void stop_threads();
  void await_first_tick();
  [[nodiscard]] std::string status_text() const { return status_line(core.status(), host.run_id()); }

  ServiceNotifier notifier = ServiceNotifier::from_environment();  // before any thread: it changes the environment
  RigConfig rig;
  clock::RealClock clock;
  Devices devices;
  FrameLink frame_link;
  PressureLink pressure_link;
  InterlockLink interlock_link;
  Streams recorder_streams;
  Streams publisher_streams;
  Core core;
  FrameService frame_service;
  PressureService pressure_service;
  InterlockService interlock_service;
  std::unique_ptr<RegulatorService> regulator_service;  ///< where a regulator sets the pressure
  std::optional<Publisher> publisher;
  Host host;
  Api api;
  WatchdogFeeder feeder{notifier, frame_link.loop_beat};
  std::atomic<bool> stop_loop{false}, stop_io{false}, stop_rest{false};
  std::vector<std::thread> loop, io, rest;
};

void Daemon::Impl::start_threads() {
  const int io_priority = rig.realtime.io_priority;
  try {
    spawn(loop, "isorig-loop", rig.realtime.priority,
          [this] { run_loop(clock, rig.realtime.period_ns, core, stop_loop); });
    spawn(io, "isorig-frame", io_priority, [this] {
      every(rig.services.poll_period_ns, stop_io, [this] { frame_service.run_once(clock.now_ns()); });
    });
    spawn(io, "isorig-pressure", io_priority, [this] {
      // poll() itself waits for data; the pause only bounds a device that is not there.
      every(1'000'000, stop_io, [this] { pressure_service.run_once(clock.now_ns(), kPressureWaitNs); });
    });
    if (regulator_service) {
      spawn(io, "isorig-regul", io_priority, [this] {
        every(rig.regulator_period_ns, stop_io, [this] { regulator_service->run_once(clock.now_ns()); });
      });
    }
    spawn(io, "isorig-chain", io_priority, [this] {
      // Woken by an edge where the device can do that, but no more often than a chattering contact may take of the
      // processor.
      every(kInterlockLeastNs, stop_io, [this] {
        if (!interlock_service.wait(kInterlockPeriodNs)) clock.sleep_until_ns(clock.now_ns() + kInterlockPeriodNs);
        interlock_service.run_once(clock.now_ns());
      });
    });
    spawn(rest, "isorig-recorder", 0, [this] {
      every(kRecorderPeriodNs, stop_rest, [this] { host.turn(clock.now_ns()); });
    });
    if (publisher) {
      spawn(rest, "isorig-publish", 0, [this] {
        every(kPublisherPeriodNs, stop_rest, [this] { publisher->drain(publisher_streams, clock.now_ns()); });
      });
    }
    spawn(rest, "isorig-api", 0, [this] { api.serve(); });
    if (feeder.period_ns() > 0) {
      spawn(rest, "isorig-watchdog", kWatchdogPriority, [this] {
        every(feeder.period_ns(), stop_rest, [this] { feeder.turn(); });
      });
    }
  } catch (...) {
    stop_threads();
    throw;
  }
}

void Daemon::Impl::stop_threads() {
  const auto join = [](std::vector<std::thread>& threads) {
    for (auto& t : threads) t.join();
    threads.clear();
  };
  stop_io = true;
  join(io);
  frame_service.shut_down();
  pressure_service.shut_down();
  if (regulator_service) regulator_service->shut_down();
  interlock_service.shut_down();
  stop_loop = true;
  join(loop);
  stop_rest = true;
  api.stop();
  join(rest);
  host.shut_down();
}

void Daemon::Impl::await_first_tick() {
  const auto deadline = std::chrono::steady_clock::now() + kFirstTickPatience;
  while (frame_link.loop_beat.load(std::memory_order_acquire) == 0) {
    if (std::chrono::steady_clock::now() > deadline) {
      throw std::runtime_error("the real-time loop has not ticked within a second; is another real-time process "
                               "keeping the CPU ([realtime] cpu, priority)?");
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
}

Daemon::Daemon(const RigConfig& rig, const DaemonOptions& options) {
  // Before any thread: they all inherit the mask, and only run() takes these signals.
  const sigset_t set = stop_signals();
  pthread_sigmask(SIG_BLOCK, &set, nullptr);
  ::signal(SIGPIPE, SIG_IGN);
  impl_ = std::make_unique<Impl>(rig, options);
  lock_memory(rig.realtime);
}

Daemon::~Daemon() = default;

void Daemon::run() {
  auto& d = *impl_;
  d.start_threads();
  try {
    d.await_first_tick();
  } catch (...) {
    d.stop_threads();
    throw;
  }
  spdlog::info("rig \"{}\" up{}", d.rig.name, d.rig.realtime.enforce ? "" : " without real-time rights (--no-realtime)");
  d.notifier.ready(d.status_text());
  for (const auto& text : d.host.overdue()) spdlog::warn("{}", text);
  const sigset_t set = stop_signals();
  const timespec between_states{kStatusPeriod.count(), 0};
  int signal_number = 0;
  while ((signal_number = ::sigtimedwait(&set, nullptr, &between_states)) < 0) {
    if (d.notifier.connected()) d.notifier.status(d.status_text());
  }
  spdlog::info("signal {}: stopping", signal_number);
  d.notifier.stopping(d.host.run_open() ? "aborting the run, venting" : "stopping");
  if (d.host.run_open()) {
    d.host.verb(Request::Verb::kAbort);
    const auto patience = std::chrono::duration<double>(d.rig.core.vent_time_max_s + 2.0);
    const auto deadline = std::chrono::steady_clock::now() + patience;
    while (d.host.run_open() && std::chrono::steady_clock::now() < deadline) {
      std::this_thread::sleep_for(std::chrono::milliseconds(20));
    }
  }
  d.stop_threads();
}

}  // namespace isorig::daemon
