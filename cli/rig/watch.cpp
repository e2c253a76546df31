#include "cli/rig/watch.hpp"

#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <csignal>
#include <cstdlib>
#include <iostream>
#include <optional>
#include <thread>

#include "base/formatted.hpp"
#include "base/printable.hpp"
#include "cli/screen/duration.hpp"
#include "cli/screen/exit_codes.hpp"
#include "cli/screen/live_verdicts.hpp"
#include "cli/screen/screen.hpp"
#include "cli/screen/terminal.hpp"
#include "cli/screen/view.hpp"

namespace isorig::cli {
namespace {

using base::formatted;
using nlohmann::json;
constexpr std::size_t kEventsKept = 200;
constexpr std::size_t kForcesKept = 400;
/// Keys and signals are answered between two calls: an isorigd that hangs keeps nobody here for longer. An answer takes
/// milliseconds.
constexpr auto kAnswerPatience = std::chrono::seconds(2);
/// An isorigd that is gone for so long, or for a script one that hangs, is not coming back.
constexpr auto kGivenUp = Client::kPatience;
volatile std::sig_atomic_t watch_interrupted = 0;

/// Says when the run that is waited for has ended, and how. It is the one of --run, else the one that is open at the
/// first look, else the next: the outcome of a run that was over before is nobody's answer.
class Awaited {
 public:
  Awaited(const Client& client, std::string run) : client_(client), run_(std::move(run)), named_(!run_.empty()) {}

  /// Something once worth saying to whoever waits; "" otherwise.
  std::string first_look(const json& status) {
    last_before_ = last_id(status);
    if (run_ == "latest") run_ = status.contains("run") ? status["run"].value("id", "") : last_before_;
    if (named_ || status.contains("run") || status.value("state", "") == "armed") return {};
    return "no run is open: waiting for the next one" +
           (last_before_.empty() ? std::string()
                                 : " (the last, " + last_before_ + ", is " + last_outcome(status) + ")");
  }

  /// The exit code, once it is over.
  [[nodiscard]] std::optional<int> ended(const json& status) {
    const auto state = status.value("state", "");
    const std::string open = status.contains("run") ? status["run"].value("id", "") : std::string();
    if (run_.empty() && !open.empty()) run_ = open;
    if (!open.empty() && open == run_) {
      if (state != "faulted") return std::nullopt;
      said_ = "run " + run_ + " is stopped: isorig status says by what, and whether the rig holds its pressure";
      return kTripped;
    }
    if (state == "armed") was_armed_ = true;
    if (state == "armed" || state == "countdown") return std::nullopt;
    const auto last = last_id(status);
    if (!run_.empty()) {
      return last == run_ ? of_last(status["last_run"]) : ended_before();
    }
    if (last != last_before_) return of_last(status["last_run"]);  // all of it between two looks
    if (was_armed_) return kRefused;                               // nobody gave the second act
    if (state == "faulted") {
      said_ = "the rig is faulted: no run can begin before isorig reset";
      return kTripped;
    }
    return std::nullopt;
  }
  /// Why it is over, where the code alone would be a riddle; "" otherwise. For whoever has left the alternate screen.
  [[nodiscard]] const std::string& said() const { return said_; }

 private:
  int of_last(const json& last_run) {
    const int code = exit_code_of(last_run);
    if (code == kDataLost)
      said_ = "run " + last_run.value("id", "") + " is done, and not all of it is recorded: " + lost_words(last_run) +
              "; isorig show " + last_run.value("id", "");
    return code;
  }

  /// The status knows the open run and the last one of this isorigd; the runs before that are in the catalogue, also
  /// those of an isorigd before this one.
  std::optional<int> ended_before() {
    const auto answer = client_.get("/v1/runs");
    if (!answer.ok()) {
      said_ = "the runs of this rig cannot be listed: " + answer.text();
      return kFailure;
    }
    const auto runs = answer.body.value("runs", json::array());
    for (const auto& run : runs) {
      if (run.value("id", "") != run_) continue;
      const auto state = run.value("state", "");
      if (state == "running") return std::nullopt;  // opened between the status and this
      const auto fault = run.value("fault", "");
      said_ = "run " + run_ + ": " + state + (state == "done" || fault.empty() ? "" : ", " + fault);
      // Its recorder dropped nothing, or it would have failed; what the devices never sent is in its recording alone.
      if (state == "done") said_ += "; whether samples are missing is not in the list of runs: isorig show " + run_;
      return exit_code_of({{"outcome", state}});
    }
    said_ = "run " + run_ + " is not among the " + std::to_string(runs.size()) + " newest of the " +
            std::to_string(answer.body.value("all", runs.size())) + " runs that isorigd knows; isorig show " + run_ +
            " looks for an older one";
    return kFailure;
  }
  static std::string last_id(const json& status) {
    return status.contains("last_run") ? status["last_run"].value("id", "") : std::string();
  }
  static std::string last_outcome(const json& status) {
    return status.contains("last_run") ? status["last_run"].value("outcome", "") : std::string();
  }
  const Client& client_;
  std::string run_, last_before_, said_;
  bool named_ = false, was_armed_ = false;
};

Tone tone_of(const std::string& severity) {
  return severity == "info" ? Tone::kPlain : severity == "warning" ? Tone::kWarn : Tone::kBad;
}

class Watcher {
 public:
  Watcher(const Client& client, const WatchOptions& options)
      : client_(client.with(kAnswerPatience)), options_(options), awaited_(client_, options.run) {}

  /// On a terminal.
  int on_screen() {
    with_plan_ = true;
    view_.colour = wants_colour();
    view_.utf8 = is_utf8_locale();
    view_.interval_s = options_.interval_s;
    std::optional<int> code;
    {
      const AlternateScreen screen;
      bool leave = false;
      while (!leave && !code) {
        code = next();
        draw(screen);
        const auto until = std::chrono::steady_clock::now() + std::chrono::duration<double>(options_.interval_s);
        while (!leave && !code) {
          const std::chrono::duration<double> left = until - std::chrono::steady_clock::now();
          if (left.count() <= 0.0) break;
          const auto key = screen.wait(left.count());
          leave = key == AlternateScreen::Key::kLeave;
          if (key == AlternateScreen::Key::kResized) draw(screen);
        }
      }
    }
    // On the screen of before, for whoever scrolls back.
    if (code) {
      std::cout << status_text(view_.status);
      say_why();
    } else if (view_.status.is_object() && view_.status.contains("run")) {
      std::cout << "the view is left; run " << base::printable(view_.status["run"].value("id", ""))
                << " goes on: " << ends_text(std::time(nullptr), view_.status.value("remaining_s", 0.0), view_.worst_s)
                << " (isorig watch, isorig pause, isorig abort)\n";
    }
    return code.value_or(left());
  }

  /// Into a file or a pipe: a line for each look.
  int line_by_line() {
    while (watch_interrupted == 0) {
      const auto code = next();
      if (view_.silent_s > 0.0) {
        if (Clock::now() - unanswered_ > kGivenUp) throw NoAnswer(silence_);
      } else if (options_.json) {
        std::cout << view_.status.dump() << '\n';
      } else {
        for (; !view_.events.empty(); view_.events.pop_front()) std::cout << "* " << view_.events.front().text << '\n';
        const auto& s = view_.status;
        std::cout << base::printable(s.value("state", "")) << "  " << progress_bar(s.value("progress", 0.0), 20)
                  << formatted("  %9.3f N  %8.4f mm  %7.3f psi  %s left\n", s.value("force_N", 0.0),
                               s.value("position_mm", 0.0), s.value("pressure_psi", 0.0),
                               duration_text(s.value("remaining_s", 0.0)).c_str());
      }
      std::cout.flush();
      if (code) {
        say_why();
        return *code;
      }
      // In short pieces: sleep_for goes on when a signal has come.
      const auto until = Clock::now() + std::chrono::duration<double>(options_.interval_s);
      while (watch_interrupted == 0 && Clock::now() < until) {
        std::this_thread::sleep_for(
            std::min<std::chrono::duration<double>>(until - Clock::now(), std::chrono::milliseconds(50)));
      }
    }
    return left();
  }

 private:
  using Clock = std::chrono::steady_clock;

  /// The exit code of a view that was left: a script must not take it for that of the run that it waits for.
  int left() const {
    if (!options_.until_done) return kOk;
    std::cerr << "isorig: left before the awaited run has been seen to end (isorig watch, isorig runs)\n";
    return kFailure;
  }

  /// A look, and the exit code if it is the last one. When isorigd does not answer, or is gone, what was seen before
  /// stays, and the view says how old it is: a service is started again within seconds.
  std::optional<int> next() {
    if (view_.silent_s == 0.0) unanswered_ = Clock::now();
    try {
      look();
      const auto code = options_.until_done ? awaited_.ended(view_.status) : std::nullopt;
      heard_ = Clock::now();
      view_.silent_s = 0.0;
      gone_.reset();
      return code;
    } catch (const NoDaemon& e) {
      // One that hangs is killed by its supervisor and started again: from then on it is gone.
      if (dynamic_cast<const NoAnswer*>(&e) != nullptr) {
        gone_.reset();
      } else {
        if (!gone_) gone_ = Clock::now();
        if (first_ || Clock::now() - *gone_ > kGivenUp) throw;
      }
      silence_ = e.what();
      view_.silent_s = std::chrono::duration<double>(Clock::now() - heard_).count();
      add_force(std::nan(""));
      return std::nullopt;
    }
  }

  void look() {
    auto status = client_.get("/v1/status").body;
    const auto events = client_.get("/v1/events?after=" + std::to_string(last_event_)).body;
    const auto run = status.contains("run") ? status["run"].value("id", "") : std::string();
    if (with_plan_ && run != planned_run_) {
      plan_ = run.empty() ? json() : client_.get("/v1/plan").body;
      planned_run_ = run;
    }
    view_.status = std::move(status);
    for (const auto& e : events.value("events", json::array())) {
      last_event_ = e.value("number", last_event_);
      if (first_ || e.value("code", "") == "step") continue;
      const auto limit = e.value("threshold", 0.0) == 0.0
                             ? std::string()
                             : formatted(" (%.3f, limit %.3f)", e.value("value", 0.0), e.value("threshold", 0.0));
      view_.events.push_back({base::printable(e.value("code", "") + ": " + e.value("text", "")) + limit,
                              tone_of(e.value("severity", ""))});
      if (view_.events.size() > kEventsKept) view_.events.pop_front();
    }
    const bool fresh = view_.status.value("frame_age_s", -1.0) >= 0.0 && view_.status.value("frame_age_s", 0.0) < 1.0;
    add_force(fresh ? view_.status.value("force_N", 0.0) : std::nan(""));
    if (first_ && options_.until_done) {
      const auto said = awaited_.first_look(view_.status);
      if (!said.empty() && !options_.json) {
        view_.events.push_back({base::printable(said), Tone::kWarn});
      }
    }
    first_ = false;
  }

  void add_force(double force_N) {
    view_.force_N.push_back(force_N);
    if (view_.force_N.size() > kForcesKept) view_.force_N.pop_front();
  }

  void say_why() const {
    if (!awaited_.said().empty()) std::cerr << "isorig watch: " << base::printable(awaited_.said()) << '\n';
  }

  void draw(const AlternateScreen& screen) {
    if (view_.status.is_object()) view_.worst_s = worst_left_s(plan_, view_.status);
    view_.now = std::time(nullptr);
    view_.size = terminal_size(STDOUT_FILENO);
    screen.draw(view_lines(view_));
  }

  const Client client_;
  const WatchOptions& options_;
  Awaited awaited_;
  View view_;
  json plan_;
  std::string planned_run_, silence_;
  Clock::time_point heard_ = Clock::now();  // when the last whole look was over
  Clock::time_point unanswered_;            // when the first look since then began
  std::optional<Clock::time_point> gone_;   // when nobody was there first
  std::uint64_t last_event_ = 0;
  bool first_ = true, with_plan_ = false;
};

}  // namespace

int watch(const Client& client, const WatchOptions& options) {
  Watcher watcher(client, options);
  const char* term = std::getenv("TERM");
  const bool dumb = term != nullptr && std::string_view(term) == "dumb";
  if (::isatty(STDOUT_FILENO) != 0 && !options.json && !dumb) return watcher.on_screen();
  watch_interrupted = 0;
  const auto previous = std::signal(SIGINT, [](int) { watch_interrupted = 1; });
  const int code = watcher.line_by_line();
  std::signal(SIGINT, previous);
  return code;
}

}  // namespace isorig::cli
