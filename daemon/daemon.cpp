#include "daemon/daemon.hpp"

#include <spdlog/spdlog.h>
#include <sys/resource.h>
#include <unistd.h>

#include <chrono>
#include <fstream>
#include <semaphore>
#include <thread>
#include <vector>

#include "base/formatted.hpp"
#include "base/printable.hpp"
#include "daemon/core/core.hpp"
#include "daemon/core/realtime.hpp"
#include "daemon/host/api.hpp"
#include "daemon/host/audit_log.hpp"
#include "daemon/host/callout.hpp"
#include "daemon/host/host.hpp"
#include "daemon/host/logging.hpp"
#include "daemon/host/paths.hpp"
#include "daemon/host/roles.hpp"
#include "daemon/host/run_reporter.hpp"
#include "daemon/host/sample_server.hpp"
#include "daemon/host/service_notifier.hpp"
#include "daemon/io/frame_service.hpp"
#include "daemon/io/interlock_service.hpp"
#include "daemon/io/pressure_service.hpp"
#include "daemon/io/regulator_service.hpp"
#include "daemon/journal.hpp"
#include "daemon/recording/publisher.hpp"
#include "daemon/rig/calibrations.hpp"
#include "daemon/rig/devices.hpp"
#include "daemon/threads.hpp"
#include "drivers/clock/real_clock.hpp"

namespace isorig::daemon {
namespace {

constexpr std::int64_t kPressureWaitNs = 2'000'000;
constexpr std::int64_t kInterlockPeriodNs = 5'000'000;
constexpr std::int64_t kInterlockLeastNs = 500'000;
constexpr std::int64_t kRecorderPeriodNs = 20'000'000;
// Below the devices' threads, above everything ordinary: a busy machine must not look like a stalled loop.
constexpr int kWatchdogPriority = 1;
// Likewise: a busy machine must not delay an abort.
constexpr int kStopPriority = 2;
constexpr auto kStatusPeriod = std::chrono::seconds(1);
constexpr auto kFirstTickPatience = std::chrono::seconds(1);
constexpr auto kSignalPoll = std::chrono::milliseconds(20);
/// How long a catalogue or disk that refuses is asked again on the way out.
constexpr auto kWritePatience = std::chrono::seconds(20);
constexpr rlim_t kDescriptors = 4096;

std::int64_t epoch_unix_us(const clock::Clock& clock) {
  const auto wall =
      std::chrono::duration_cast<std::chrono::microseconds>(std::chrono::system_clock::now().time_since_epoch())
          .count();
  return wall - clock.now_ns() / 1000;
}

/// As many descriptors as we may have: segments and devices must find one whatever clients hold.
void raise_descriptor_limit() {
  rlimit files{};
  if (::getrlimit(RLIMIT_NOFILE, &files) != 0) return;
  files.rlim_cur = std::min<rlim_t>(files.rlim_max, kDescriptors);
  ::setrlimit(RLIMIT_NOFILE, &files);
}

/// Whether compaction may unmap locked pages for a moment (Documentation/admin-guide/sysctl/vm.rst); kernels with
/// PREEMPT_RT forbid it unless told otherwise.
bool locked_pages_may_move() {
  std::ifstream setting("/proc/sys/vm/compact_unevictable_allowed");
  int allowed = 0;
  return setting >> allowed && allowed != 0;
}

bool is_between_runs(const Status& s) {
  return s.control.state == RunState::kIdle || s.control.state == RunState::kReady;
}

/// No pressure is stated that was not read.
std::string why_not_at_rest(const Status& s) {
  const std::string pressure = s.pressure_age_s < 0.0
                                   ? "no pressure was ever read"
                                   : base::formatted("%.2f psi left", double{s.control.pressure_psi});
  return is_between_runs(s) && s.not_ready[0] != '\0' ? s.not_ready + ("; " + pressure) : pressure;
}

}  // namespace

struct Daemon::Impl {
  Impl(const RigConfig& config, const DaemonOptions& options, const StopSignals& stop_signals)
      : signals(stop_signals),
        runs_root(options.runs_root),
        rig(with_calibration(config, options.runs_root)),
        devices(open_devices(rig, clock)),
        recorder_streams(std::size_t{1} << 16U),
        publisher_streams(std::size_t{1} << 14U),
        core(rig.core, frame_link, pressure_link, interlock_link, recorder_streams, &publisher_streams),
        frame_service(*devices.frame, frame_link, rig.services, clock),
        pressure_service(*devices.pressure, pressure_link, interlock_link, rig.services, clock),
        interlock_service(*devices.interlock, interlock_link),
        regulator_service(devices.regulator ? std::make_unique<RegulatorService>(*devices.regulator, pressure_link)
                                            : nullptr),
        callout(rig.notify, [](const std::string& line) { spdlog::warn("{}", line); }),
        reporter(options.reporter, [](const std::string& line) { spdlog::warn("{}", line); }),
        host(rig, core, recorder_streams, host_options(options)),
        roles(roles_of(rig)),
        audit(options.runs_root, [](const std::string& line) { spdlog::error("{}", base::printable(line)); }),
        api(
            host, options.socket, rig.api.mode, [](const std::string& line) { spdlog::info("{}", line); }, roles,
            &audit),
        sample_server(sample_socket_of(options.socket), rig.api.mode, rig.name, epoch_unix_us(clock), {},
                      [this](const Peer& peer) { return roles.may(peer, Role::kSee); }) {
    if (rig.lcm.enabled) publisher.emplace(rig.lcm.url);
  }

  Host::Options host_options(const DaemonOptions& options) {
    Host::Options h;
    h.runs_root = options.runs_root;
    if (!options.diagnoses_root.empty()) h.diagnoses = {options.diagnoses_root};
    h.revision = options.revision;
    h.epoch_unix_us = [this] { return epoch_unix_us(clock); };
    h.on_event = [this](const EventRecord& event) {
      log_event(event);
      callout.on_event(event, host.run_id());
    };
    h.on_parted = [this](const std::string& run, const std::string& text, const std::string& then) {
      spdlog::warn("{}", base::printable(text));
      callout.on_parted(run, text, then, core.status().control.state);
    };
    h.on_closed = [this](const std::filesystem::path& run) { reporter.on_closed(run); };
    h.on_trouble = [](const std::string& text) { spdlog::error("recorder: {}", text); };
    h.seed = rig.sim ? static_cast<std::int64_t>(rig.sim->seed) : 0;
    return h;
  }

  void start_threads();
  void publish();
  void stop_devices();
  bool stop_threads();
  void await_first_tick();
  [[nodiscard]] std::string scheduling();
  void end();
  void leave_without_writing();
  [[noreturn]] void leave(int code);
  [[nodiscard]] bool at_rest() const;
  [[nodiscard]] std::chrono::duration<double> rest_patience() const;
  [[nodiscard]] std::string status_text() const { return status_line(core.status(), host.run_id()); }

  const StopSignals& signals;
  const std::filesystem::path runs_root;
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
  Callout callout;
  RunReporter reporter;
  Host host;
  const Roles roles;
  AuditLog audit;
  Api api;
  SampleServer sample_server;
  WatchdogFeeder feeder{notifier, frame_link.loop_beat};
  std::atomic<bool> stop_loop{false}, stop_io{false}, stop_rest{false};
  std::atomic<bool> devices_down{false}, ended{false}, all_written{true};
  std::binary_semaphore end_wanted{0};
  std::vector<std::thread> loop, io, rest, auditing, ending;
};

void Daemon::Impl::start_threads() {
  const int io_priority = rig.realtime.io_priority;
  try {
    spawn(loop, "isorig-loop", rig.realtime.priority, rig.realtime,
          [this] { run_loop(clock, rig.realtime.period_ns, core, stop_loop); });
    spawn(io, "isorig-frame", io_priority, rig.realtime, [this] {
      every(clock, "frame", rig.services.poll_period_ns, stop_io, [this] { frame_service.run_once(clock.now_ns()); });
    });
    spawn(io, "isorig-pressure", io_priority, rig.realtime, [this] {
      // poll() itself waits for data; the pause only bounds a device that is not there.
      every(clock, "pressure", 1'000'000, stop_io,
            [this] { pressure_service.run_once(clock.now_ns(), kPressureWaitNs); });
    });
    if (regulator_service) {
      spawn(io, "isorig-regul", io_priority, rig.realtime, [this] {
        every(clock, "regulator", rig.regulator_period_ns, stop_io,
              [this] { regulator_service->run_once(clock.now_ns()); });
      });
    }
    spawn(io, "isorig-chain", io_priority, rig.realtime, [this] {
      // Woken by an edge where the device can do that, but no more often than a chattering contact may take of the
      // processor.
      every(clock, "interlock", kInterlockLeastNs, stop_io, [this] {
        if (!interlock_service.wait(kInterlockPeriodNs)) clock.sleep_until_ns(clock.now_ns() + kInterlockPeriodNs);
        interlock_service.run_once(clock.now_ns());
      });
    });
    spawn(rest, "isorig-recorder", 0, rig.realtime,
          [this] { every(clock, "recorder", kRecorderPeriodNs, stop_rest, [this] { host.turn(clock.now_ns()); }); });
    spawn(rest, "isorig-publish", 0, rig.realtime,
          [this] { every(clock, "publisher", rig.lcm.period_ns, stop_rest, [this] { publish(); }); });
    spawn(rest, "isorig-samples", 0, rig.realtime, [this] { sample_server.run(); });
    spawn(rest, "isorig-api", 0, rig.realtime, [this] { api.serve(); });
    spawn(rest, "isorig-stop", kStopPriority, rig.realtime, [this] { api.serve_stops(); });
    spawn(rest, "isorig-work", 0, rig.realtime, [this] { api.work(); });
    spawn(auditing, "isorig-audit", 0, rig.realtime, [this] { audit.run(); });
    if (!rig.notify.command.empty()) spawn(rest, "isorig-notify", 0, rig.realtime, [this] { callout.run(); });
    if (reporter.enabled()) {
      spawn(rest, "isorig-report", 0, rig.realtime, [this] {
        reporter.catch_up(runs_root);
        reporter.run();
      });
    }
    // Made now: on the way out there may be no thread to be had.
    spawn(ending, "isorig-end", 0, rig.realtime, [this] {
      end_wanted.acquire();
      end();
    });
    if (feeder.period_ns() > 0) {
      spawn(rest, "isorig-watchdog", kWatchdogPriority, rig.realtime,
            [this] { every(clock, "watchdog", feeder.period_ns(), stop_rest, [this] { feeder.turn(); }); });
    }
  } catch (...) {
    stop_threads();
    for (auto& t : ending) t.join();
    ending.clear();
    throw;
  }
}

void Daemon::Impl::publish() {
  // The socket first: an LCM publish may take tens of milliseconds.
  if (publisher) return drain_live(publisher_streams, clock.now_ns(), {&sample_server, &*publisher});
  drain_live(publisher_streams, clock.now_ns(), {&sample_server});
}

/// Frame stopped, vented, loop gone. Needs no disk.
void Daemon::Impl::stop_devices() {
  const auto join = [](std::vector<std::thread>& threads) {
    for (auto& t : threads) t.join();
    threads.clear();
  };
  stop_io = true;
  join(io);
  pressure_service.shut_down();  // first: seeing the crosshead stand takes a moment
  if (regulator_service) regulator_service->shut_down();
  if (!frame_service.shut_down()) {
    spdlog::error("frame: the crosshead was not seen to stand; its own watchdog has to stop it now. Look at it");
  }
  interlock_service.shut_down();
  stop_loop = true;
  join(loop);
  devices_down = true;
}

/// False when something could not be written.
bool Daemon::Impl::stop_threads() {
  if (!devices_down) stop_devices();
  stop_rest = true;
  api.stop();
  sample_server.stop();
  callout.stop();
  reporter.stop();
  for (auto& t : rest) t.join();
  rest.clear();
  const auto deadline = std::chrono::steady_clock::now() + kWritePatience;
  const bool written = host.shut_down([&] { return std::chrono::steady_clock::now() > deadline; });
  // Last: a name service that hangs keeps no run open. All who add to it are gone.
  audit.stop();
  for (auto& t : auditing) t.join();
  auditing.clear();
  audit.finish();
  end_wanted.release();  // nobody waits for it on this way; end() does nothing then
  return written;
}

bool Daemon::Impl::at_rest() const {
  return devices_down || core.status().stopped;
}

/// Between runs nothing is on its way to rest: what is not seen then, such as a frame that is switched off, is not
/// waited for.
std::chrono::duration<double> Daemon::Impl::rest_patience() const {
  constexpr double kAnswer_s = 2.0;
  return std::chrono::duration<double>(is_between_runs(core.status()) ? kAnswer_s
                                                                      : rig.core.vent_time_max_s + kAnswer_s);
}

/// The orderly way out, on a thread of its own: signals are listened to meanwhile.
void Daemon::Impl::end() {
  if (devices_down) return;
  // One control record later the status shows the abort; until then "ready" is of before.
  std::this_thread::sleep_for(2 * std::chrono::nanoseconds(rig.core.control_period_ns));
  const auto patience = rest_patience();
  const auto deadline = std::chrono::steady_clock::now() + patience;
  while (!at_rest() && std::chrono::steady_clock::now() < deadline)
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  // For whoever reads the journal: the API answers nobody from here on, and writing may take as long as the disk likes.
  const auto last = core.status();
  if (last.stopped) {
    spdlog::info("at rest: the crosshead stands, {:.2f} psi left; writing what was measured",
                 last.control.pressure_psi);
  } else {
    spdlog::error("not seen at rest within {} s ({}): the devices' own watchdogs have to act. Look at the rig",
                  patience.count(), why_not_at_rest(last));
  }
  all_written = stop_threads();
  ended = true;
}

/// The second signal: the rig comes to rest, then we are gone, whatever the disk does. The run stands as interrupted.
void Daemon::Impl::leave_without_writing() {
  const auto deadline = std::chrono::steady_clock::now() + rest_patience();
  while (!at_rest() && !ended && std::chrono::steady_clock::now() < deadline) {
    if (signals.wait(kSignalPoll) != 0) break;  // the third: the devices' watchdogs see to the rest
  }
  if (!ended) leave(1);
}

void Daemon::Impl::leave(int code) {
  api.unlink();
  sample_server.unlink();
  ::_exit(code);
}

void Daemon::Impl::await_first_tick() {
  const auto deadline = std::chrono::steady_clock::now() + kFirstTickPatience;
  while (frame_link.loop_beat.load(std::memory_order_acquire) == 0) {
    if (std::chrono::steady_clock::now() > deadline) {
      throw std::runtime_error(
          "the real-time loop has not ticked within a second; is another real-time process "
          "keeping the CPU ([realtime] cpu, priority)?");
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
}

/// Of the loop, as the kernel has it: with --no-realtime it may have got the priority all the same.
std::string Daemon::Impl::scheduling() {
  int policy = SCHED_OTHER;
  sched_param param{};
  if (rig.realtime.enforce || ::pthread_getschedparam(loop.front().native_handle(), &policy, &param) != 0) return {};
  return policy == SCHED_FIFO ? " with real-time priority " + std::to_string(param.sched_priority) +
                                    ", which --no-realtime does not insist on"
                              : " without real-time rights (--no-realtime)";
}

Daemon::Daemon(const RigConfig& rig, const DaemonOptions& options, const StopSignals& signals) {
  raise_descriptor_limit();
  impl_ = std::make_unique<Impl>(rig, options, signals);
  lock_memory(rig.realtime);
}

Daemon::~Daemon() = default;

bool Daemon::run() {
  auto& d = *impl_;
  d.start_threads();
  try {
    d.await_first_tick();
  } catch (...) {
    d.stop_threads();
    for (auto& t : d.ending) t.join();
    d.ending.clear();
    throw;
  }
  spdlog::info("rig \"{}\" up{}", d.rig.name, d.scheduling());
  d.notifier.ready(d.status_text());
  if (d.rig.realtime.enforce && locked_pages_may_move()) {
    spdlog::warn(
        "vm.compact_unevictable_allowed is 1: the kernel may move locked pages, and the loop waits when it touches one "
        "meanwhile; sysctl vm.compact_unevictable_allowed=0 forbids it");
  }
  if (const auto& why = d.rig.unwatched_chain; !why.empty()) {
    spdlog::warn("the emergency-stop chain is NOT WATCHED by this daemon: {}", base::printable(why));
  }
  for (const auto& text : d.host.overdue()) spdlog::warn("{}", text);
  if (!d.rig.core.operating.arming_required && !d.rig.simulated()) {
    spdlog::warn("[operator] arming = \"none\": a start moves and fills this rig at once");
  }
  if (const auto changes = d.host.rig_changes(); !changes.empty()) spdlog::warn("{}", changes);
  int signal_number = 0;
  std::size_t lines_lost = 0;
  PublishWatch publish_watch;
  while ((signal_number = d.signals.wait(kStatusPeriod)) == 0) {
    if (d.notifier.connected()) d.notifier.status(d.status_text());
    d.callout.watch(d.core.status(), d.host.run_id(), d.host.longest_s());
    if (const auto lost = Logging::lost(); lost > lines_lost) {
      spdlog::warn("{} lines of this log are lost: nobody took them", lost - lines_lost);
      lines_lost = lost;
    }
    if (d.publisher) {
      const auto said = publish_watch.look(d.publisher->failed(), d.publisher->failed_errno());
      if (!said.empty()) spdlog::warn("{}", said);
    }
  }
  d.host.refuse_starts();
  d.core.request_abort();  // without waiting for anything
  d.end_wanted.release();
  spdlog::info("signal {}: stopping", signal_number);
  d.notifier.stopping("aborting the run, venting, writing");
  while (!d.ended) {
    if (d.signals.wait(kSignalPoll) != 0) d.leave_without_writing();
  }
  for (auto& t : d.ending) t.join();
  d.ending.clear();
  // What is left is to close the catalogue, which writes nothing that is needed, and waits for a disk that hangs.
  if (!d.host.disk_answers(d.clock.now_ns())) d.leave(d.all_written ? 0 : 1);
  return d.all_written;
}

}  // namespace isorig::daemon
