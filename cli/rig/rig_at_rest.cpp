#include "cli/rig/rig_at_rest.hpp"

#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <csignal>
#include <cstdio>
#include <iostream>
#include <stdexcept>
#include <thread>
#include <utility>

#include "base/formatted.hpp"
#include "cli/rig/acts.hpp"

namespace isorig::cli {
namespace {

using std::chrono::steady_clock;
constexpr double kRate_psi_s = 4.0;  // where the rig allows it
constexpr auto kLook = std::chrono::milliseconds(50);

volatile std::sig_atomic_t interrupted = 0;

void stop_if_interrupted() {
  if (interrupted != 0) throw Interrupted();
}

void post(const Client& client, const std::string& path) {
  const auto answer = client.post(path);
  if (!answer.ok()) throw std::runtime_error(answer.text());
}

}  // namespace

std::optional<std::string> ask(const std::string& question) {
  std::cerr << question << std::flush;
  std::string line;
  if (!std::getline(std::cin, line)) return std::nullopt;
  return line;
}

void pause_for(double seconds) {
  const auto end = steady_clock::now() + std::chrono::duration<double>(seconds);
  for (stop_if_interrupted(); steady_clock::now() < end; stop_if_interrupted()) std::this_thread::sleep_for(kLook);
}

bool consent(const std::string& question, bool yes) {
  if (yes) return true;
  if (::isatty(STDIN_FILENO) == 0) {
    throw std::runtime_error("\"" + question + "\" needs an answer, and this is no terminal; add --yes");
  }
  const auto line = ask(question + " [y/N] ");
  return line && (*line == "y" || *line == "Y" || *line == "yes");
}

std::string output_of(const std::string& command) {
  std::FILE* pipe = ::popen(command.c_str(), "r");
  if (pipe == nullptr) throw std::runtime_error("cannot run `" + command + "`");
  std::array<char, 256> line{};
  const bool any = std::fgets(line.data(), static_cast<int>(line.size()), pipe) != nullptr;
  std::array<char, 256> rest{};
  while (std::fgets(rest.data(), static_cast<int>(rest.size()), pipe) != nullptr) {
  }
  const int status = ::pclose(pipe);
  if (!any || !WIFEXITED(status) || WEXITSTATUS(status) != 0) {
    throw std::runtime_error("`" + command + "` " + (any ? "failed" : "printed nothing"));
  }
  return line.data();
}

SettledReading settled_reading(const Client& client, const std::string& channel, const Settling& s) {
  const auto begin = steady_clock::now();
  const std::int64_t since_ns = client.get_or_throw("/v1/status").value("mono_ns", std::int64_t{0});
  const std::string path = base::formatted("/v1/readings?window_s=%.3f", s.window_s);
  double drift = 0.0;
  for (bool first = true;; first = false) {
    stop_if_interrupted();
    std::this_thread::sleep_for(
        first ? std::chrono::duration_cast<std::chrono::milliseconds>(std::chrono::duration<double>(s.window_s))
              : kLook);
    const auto all = client.get_or_throw(path);
    const auto& r = all[channel];
    const double waited_s = std::chrono::duration<double>(steady_clock::now() - begin).count();
    const auto from_ns = r.value("from_mono_ns", std::int64_t{0});
    const auto to_ns = r.value("to_mono_ns", std::int64_t{0});
    const bool whole =
        r.value("samples", 0) > 20 && from_ns >= since_ns && static_cast<double>(to_ns - from_ns) > 0.9e9 * s.window_s;
    drift = r.value("drift", 0.0);
    if (whole && std::abs(drift) <= s.drift_max) {
      return {r.value("raw", 0.0),
              r.value("calibrated", 0.0),
              r.value("standard_error", 0.0),
              r.value("sd", 0.0),
              drift,
              all["temperature"].value("raw", 0.0)};
    }
    if (waited_s < s.window_s + 1.0 + s.settle_s) continue;
    if (!whole) throw std::runtime_error("there are no " + channel + " readings; see isorig status");
    throw std::runtime_error(base::formatted(
        "the %s reading has not settled: it moves by %+.4g %s within %.1f s, more than %.4g (--drift-max)",
        channel.c_str(), drift, r.value("unit", "").c_str(), s.window_s, s.drift_max));
  }
}

HeldPressure::HeldPressure(const Client& client, std::vector<double> pressures_psi, const std::string& operator_name)
    : client_(client), pressures_psi_(std::move(pressures_psi)), operator_name_(operator_name) {
  const auto known = client.get_or_throw("/v1/calibrations");
  rate_psi_s_ = std::min(kRate_psi_s, known["limits"].value("pressure_rate_max_psi_s", kRate_psi_s));
  interrupted = 0;
  std::signal(SIGINT, [](int) { interrupted = 1; });
  std::signal(SIGTERM, [](int) { interrupted = 1; });
}

HeldPressure::~HeldPressure() {
  vent();
  std::signal(SIGINT, SIG_DFL);
  std::signal(SIGTERM, SIG_DFL);
}

void HeldPressure::vent() noexcept {
  if (!std::exchange(open_, false)) return;
  try {
    (void)client_.post("/v1/abort");
  } catch (const std::exception&) {
    // No daemon any more: the devices vent when the heartbeat stops.
  }
}

void HeldPressure::start(std::size_t index) {
  std::string protocol = "format = \"isorig-protocol/1\"\nname = \"held-pressure\"\napproach = false\nsteps = [\n";
  for (std::size_t i = index; i < pressures_psi_.size() && pressures_psi_[i] > 0.0; ++i) {
    protocol += base::formatted(
        "  { do = \"pressurize\", pressure_psi = %.4f, rate_psi_s = %.4f, settled_for_s = 1, timeout_s = %.0f },\n"
        "  { do = \"hold\", duration_s = 5 },\n",
        pressures_psi_[i], rate_psi_s_, time_out_s(i));
  }
  const auto answer = client_.post(
      "/v1/start",
      {{"protocol", protocol + "]\n"}, {"protocol_name", "held-pressure.toml"}, {"operator", operator_name_}});
  if (!answer.ok()) throw std::runtime_error(answer.text());
  open_ = true;
  first_ = index;
  const auto armed = confirm();
  runs_ += (runs_.empty() ? "" : ", ") + (armed ? *armed : answer).body.value("run", "");
}

/// Twice as long as the set-point's way from empty, and a minute.
double HeldPressure::time_out_s(std::size_t index) const {
  return 60.0 + 2.0 * pressures_psi_[index] / rate_psi_s_;
}

/// On a rig that has to be armed the person at the terminal says go, each time air is let in.
std::optional<Answer> HeldPressure::confirm() {
  auto answer = second_act(client_);
  if (answer && !answer->ok()) throw std::runtime_error(answer->text());
  return answer;
}

void HeldPressure::go_to(std::size_t index) {
  if (pressures_psi_[index] <= 0.0) {
    vent();
    wait_for_rest(client_, 60.0);
    return;
  }
  if (!open_) {
    start(index);
  } else {
    post(client_, "/v1/resume");
    (void)confirm();
  }
  const std::size_t hold_step = 2 * (index - first_) + 1;
  const auto deadline = steady_clock::now() + std::chrono::duration<double>(60.0 + time_out_s(index));
  for (;;) {
    stop_if_interrupted();
    const auto s = client_.get_or_throw("/v1/status");
    const auto state = s.value("state", "");
    if (state == "faulted" || !s.contains("run")) {
      throw std::runtime_error(
          base::formatted("the rig did not get to %.2f psi, it is %s: ", pressures_psi_[index], state.c_str()) +
          s.value("fault", ""));
    }
    const auto step = s["run"].value("step", std::size_t{0});
    if (state == "running" && step == hold_step) {
      post(client_, "/v1/pause");
      return;
    }
    if (step > hold_step || steady_clock::now() > deadline)
      throw std::runtime_error("the set-point was not held; see isorig status");
    std::this_thread::sleep_for(kLook);
  }
}

void wait_for_rest(const Client& client, double seconds) {
  const auto deadline = steady_clock::now() + std::chrono::duration<double>(seconds);
  while (steady_clock::now() < deadline) {
    const auto state = client.get_or_throw("/v1/status");
    const auto text = state.value("state", "");
    // The run's files are closed a moment after the rig is at rest.
    if ((text == "idle" || text == "ready") && !state.contains("run")) return;
    std::this_thread::sleep_for(kLook);
  }
  throw std::runtime_error("the rig did not come to rest; see isorig status");
}

}  // namespace isorig::cli
