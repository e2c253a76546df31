#include "real.hpp"

#include <fcntl.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <thread>
#include <vector>

#include "base/formatted.hpp"
#include "base/text_file.hpp"
#include "growth.hpp"
#include "messages/run_log.hpp"

namespace isorig::soak {
namespace {

namespace fs = std::filesystem;
using Clock = std::chrono::steady_clock;
using nlohmann::json;

constexpr double kLook_s = 2.0;
/// The daemon's memory is what it needs from its start on; what is allocated once by a run has been after this.
constexpr double kWarmUp_s = 60.0;
/// A day at this rate takes 64 MB: less than a run's own recording in an hour, and nothing to a machine of 1 GB.
constexpr double kMostGrowth_MB_s = 64.0 / 86'400.0;

/// A program with its output in a file; it does not outlive this one.
pid_t start(const std::vector<std::string>& words, const fs::path& log) {
  const pid_t parent = ::getpid();
  const pid_t pid = ::fork();
  if (pid < 0) throw std::runtime_error("no process could be started for " + words.front());
  if (pid > 0) return pid;
  ::prctl(PR_SET_PDEATHSIG, SIGKILL);
  if (::getppid() != parent) ::_exit(126);
  const int fd = ::open(log.c_str(), O_CREAT | O_WRONLY | O_TRUNC | O_CLOEXEC, 0644);
  ::dup2(fd, STDOUT_FILENO);
  ::dup2(fd, STDERR_FILENO);
  std::vector<char*> arguments;
  for (const auto& word : words) arguments.push_back(const_cast<char*>(word.c_str()));
  arguments.push_back(nullptr);
  ::execv(arguments[0], arguments.data());
  ::_exit(127);
}

int wait_for(pid_t pid) {
  int status = 0;
  while (::waitpid(pid, &status, 0) < 0 && errno == EINTR) {
  }
  return WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
}

/// Threads that never wait, one for each processor, and one that writes and syncs; at ordinary priority, as any other
/// program that somebody starts beside the daemon.
class Load {
 public:
  Load(const fs::path& folder, bool wanted) {
    if (!wanted) return;
    for (unsigned i = 0; i < std::max(1U, std::thread::hardware_concurrency()); ++i) {
      threads_.emplace_back([this, i] {
        volatile double x = i;
        while (!done_) x = std::sqrt(x + 1.0);
      });
    }
    threads_.emplace_back([this, file = folder / "load"] { write(file); });
  }
  ~Load() {
    done_ = true;
    for (auto& t : threads_) t.join();
  }
  Load(const Load&) = delete;
  Load& operator=(const Load&) = delete;
  [[nodiscard]] double written_MB() const { return static_cast<double>(written_) / 1048576.0; }

 private:
  void write(const fs::path& file) {
    const std::vector<char> block(std::size_t{1} << 20U, 'x');
    while (!done_) {
      const int fd = ::open(file.c_str(), O_CREAT | O_WRONLY | O_TRUNC | O_CLOEXEC, 0600);
      for (int i = 0; fd >= 0 && i < 256 && !done_; ++i) {
        const auto n = ::write(fd, block.data(), block.size());
        if (n > 0) written_ += static_cast<std::uint64_t>(n);
        if (i % 16 == 15) (void)::fdatasync(fd);
      }
      if (fd >= 0) ::close(fd);
    }
    std::error_code ignored;
    fs::remove(file, ignored);
  }

  std::atomic<bool> done_{false};
  std::atomic<std::uint64_t> written_{0};
  std::vector<std::thread> threads_;
};

/// Recorded samples by their devices' own numbers.
struct Numbers : messages::RunVisitor {
  struct Stream {
    std::int64_t first = -1, last = -1;
    std::uint64_t samples = 0;
    void take(std::int64_t number, std::uint64_t count) {
      if (first < 0) first = number;
      last = std::max(last, number);
      samples += count;
    }
    [[nodiscard]] std::int64_t missing() const {
      return first < 0 ? 0 : last - first + 1 - static_cast<std::int64_t>(samples);
    }
  };
  void frame(const isorig_msgs::frame_batch_t& m) override {
    for (int i = 0; i < m.count; ++i) frames.take(m.sequence + m.sequence_offset[i], 1);
  }
  void pressure(const isorig_msgs::pressure_batch_t& m) override {
    for (int i = 0; i < m.count; ++i) pressures.take(m.sequence + m.sequence_offset[i], 1);
  }
  void control(const isorig_msgs::control_batch_t& m) override {
    for (const auto& c : m.samples) {
      worst_wakeup_us = std::max(worst_wakeup_us, 1e-3 * c.worst_wakeup_ns);
      overruns = std::max(overruns, c.overruns);
    }
  }
  Stream frames, pressures;
  double worst_wakeup_us = 0.0;
  std::int64_t overruns = 0;
};

/// Strokes, every sample in full, for as long as asked.
std::string protocol(double seconds) {
  constexpr double kCycle_s = 4.0;  // 4 times 2 mm at 2 mm/s
  return base::formatted(
      "format = \"isorig-protocol/1\"\nname = \"soak\"\nrecording.policy = \"full\"\nsteps = [\n"
      "{ do = \"pressurize\", pressure_psi = 10, rate_psi_s = 5, settled_for_s = 1, timeout_s = 30 },\n"
      "{ do = \"wave\", shape = \"triangle\", amplitude_mm = 2, velocity_mm_s = 2, cycles = %d },\n]\n",
      std::max(1, static_cast<int>(seconds / kCycle_s)));
}

struct Looks {
  std::vector<double> time_s, resident_MB;
  std::vector<int> descriptors;
};

bool look(pid_t pid, double now_s, Looks& looks) {
  std::ifstream in("/proc/" + std::to_string(pid) + "/statm");
  double all = 0.0, resident = 0.0;
  if (!(in >> all >> resident)) return false;
  int open = 0;
  std::error_code error;
  for (fs::directory_iterator at("/proc/" + std::to_string(pid) + "/fd", error), end; !error && at != end;
       at.increment(error))
    ++open;
  looks.time_s.push_back(now_s);
  looks.resident_MB.push_back(resident * static_cast<double>(::sysconf(_SC_PAGESIZE)) / 1048576.0);
  looks.descriptors.push_back(open);
  return true;
}

std::string state_of(const RealOptions& o, const std::string& socket) {
  const auto log = o.out / "status.json";
  if (wait_for(start({(o.programs / "isorig").string(), "status", "--json", "--socket", socket}, log)) != 0) return {};
  const auto said = json::parse(base::read_text_file(log), nullptr, false);
  return said.is_object() ? said.value("state", "") : std::string();
}

bool reach(const RealOptions& o, const std::string& socket, const std::string& wanted, double seconds) {
  const auto until = Clock::now() + std::chrono::duration<double>(seconds);
  while (Clock::now() < until) {
    if (state_of(o, socket) == wanted) return true;
    std::this_thread::sleep_for(std::chrono::milliseconds(200));
  }
  return false;
}

/// What is wrong with it, a line each.
std::vector<std::string> judge(const fs::path& runs, const Looks& looks, double seconds) {
  std::vector<std::string> findings;
  fs::path run;
  for (const auto& entry : fs::directory_iterator(runs))
    if (fs::exists(entry.path() / "run.toml")) run = entry.path();
  if (run.empty()) return {"nothing was recorded"};
  Numbers numbers;
  const auto report = messages::read_run(run, numbers);
  for (const auto& each : report.complaints()) findings.push_back("the recording: " + each);
  std::printf(
      "frame    %llu samples recorded, %lld missing by the device's own numbers\n"
      "pressure %llu samples recorded, %lld missing\n"
      "loop     worst wake-up %.0f us, %lld ticks skipped\n",
      static_cast<unsigned long long>(numbers.frames.samples), static_cast<long long>(numbers.frames.missing()),
      static_cast<unsigned long long>(numbers.pressures.samples), static_cast<long long>(numbers.pressures.missing()),
      numbers.worst_wakeup_us, static_cast<long long>(numbers.overruns));
  for (const auto& [name, stream] : {std::pair{"frame", numbers.frames}, {"pressure", numbers.pressures}}) {
    if (stream.missing() != 0)
      findings.push_back(
          base::formatted("%s: %lld samples are missing", name, static_cast<long long>(stream.missing())));
    // At 1 kHz, from the start of the run to its end.
    if (static_cast<double>(stream.samples) < 990.0 * seconds)
      findings.push_back(base::formatted("%s: %llu samples of %.0f s", name,
                                         static_cast<unsigned long long>(stream.samples), seconds));
  }
  const auto warm = static_cast<std::size_t>(
      std::lower_bound(looks.time_s.begin(), looks.time_s.end(), std::min(kWarmUp_s, 0.25 * seconds)) -
      looks.time_s.begin());
  const std::vector<double> time(looks.time_s.begin() + static_cast<std::ptrdiff_t>(warm), looks.time_s.end());
  const std::vector<double> memory(looks.resident_MB.begin() + static_cast<std::ptrdiff_t>(warm),
                                   looks.resident_MB.end());
  const auto growth = growth_of(time, memory);
  std::printf("memory   %.1f MB at first, %.1f MB at last; slope %.3g +- %.2g MB/h, allowed %.3g\n",
              looks.resident_MB.front(), looks.resident_MB.back(), 3600.0 * growth.slope, 3600.0 * growth.error,
              3600.0 * kMostGrowth_MB_s);
  if (growth.surely_above(kMostGrowth_MB_s)) findings.emplace_back("memory grows");
  const auto [low, high] =
      std::minmax_element(looks.descriptors.begin() + static_cast<std::ptrdiff_t>(warm), looks.descriptors.end());
  std::printf("open     %d to %d descriptors\n", *low, *high);
  // Of one that is open for a moment, a status call or a file that changes, the least of each half knows nothing.
  const auto middle = looks.descriptors.begin() + static_cast<std::ptrdiff_t>((warm + looks.descriptors.size()) / 2);
  const int before = *std::min_element(looks.descriptors.begin() + static_cast<std::ptrdiff_t>(warm), middle);
  const int after = *std::min_element(middle, looks.descriptors.end());
  if (after > before) findings.push_back(base::formatted("descriptors grow: %d, then %d", before, after));
  return findings;
}

}  // namespace

int soak_in_real_time(const RealOptions& o) {
  const auto runs = o.out / "runs";
  fs::remove_all(o.out);
  fs::create_directories(runs);
  const auto file = o.out / "soak.toml";
  std::ofstream(file) << protocol(o.seconds);
  // Unix sockets have to fit 107 characters.
  std::string folder = (fs::temp_directory_path() / "soak-XXXXXX").string();
  if (::mkdtemp(folder.data()) == nullptr) throw std::runtime_error("no temporary folder");
  const auto socket = folder + "/s";
  std::vector<std::string> words{
      (o.programs / "isorigd").string(), "--rig", o.rig, "--runs", runs.string(), "--socket", socket};
  if (!o.real_time) words.emplace_back("--no-realtime");
  const pid_t daemon = start(words, o.out / "isorigd.log");
  std::vector<std::string> findings;
  Looks looks;
  if (!reach(o, socket, "ready", 60.0)) {
    findings.push_back("isorigd did not become ready; see " + (o.out / "isorigd.log").string());
  } else {
    const Load load(o.out, o.load);
    const int started = wait_for(start(
        {(o.programs / "isorig").string(), "start", file.string(), "--operator", "soak", "--yes", "--socket", socket},
        o.out / "start.log"));
    if (started != 0) findings.push_back("the run was not started: " + base::read_text_file(o.out / "start.log"));
    const auto began = Clock::now();
    const auto now_s = [&] { return std::chrono::duration<double>(Clock::now() - began).count(); };
    std::string state = "running";
    while (started == 0 && look(daemon, now_s(), looks)) {
      std::this_thread::sleep_for(std::chrono::duration<double>(kLook_s));
      state = state_of(o, socket);
      if (state != "running" && now_s() > 10.0) break;
    }
    std::printf("%.0f s at 1 kHz%s, %s; the disk was given %.0f MB besides; the rig is %s at the end\n", now_s(),
                o.real_time ? "" : " without real-time priority",
                o.load ? "every processor and the disk busy" : "without load", load.written_MB(), state.c_str());
    if (state == "faulted") findings.push_back("the run was stopped; see " + (o.out / "status.json").string());
  }
  // It leaves in order: the end of the recording is on the disk then.
  if (findings.empty()) (void)reach(o, socket, "ready", 60.0);
  ::kill(daemon, SIGTERM);
  if (const int code = wait_for(daemon); code != 0) findings.push_back("isorigd ended with " + std::to_string(code));
  fs::remove_all(folder);
  if (!looks.time_s.empty()) {
    for (auto& each : judge(runs, looks, std::min(o.seconds, looks.time_s.back()))) findings.push_back(std::move(each));
  }
  for (const auto& each : findings) std::printf("finding: %s\n", each.c_str());
  std::printf("%zu findings\n", findings.size());
  return findings.empty() ? 0 : 1;
}

}  // namespace isorig::soak
