#include "cli/screen.hpp"

#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <csignal>
#include <cstdio>
#include <iostream>
#include <thread>

#include "base/formatted.hpp"
#include "base/printable.hpp"
#include "cli/exit_codes.hpp"
#include "cli/protocol_input.hpp"

namespace isorig::cli {
namespace {

using base::formatted;
volatile std::sig_atomic_t interrupted = 0;

std::string link_text(const nlohmann::json& link) {
  if (!link.value("connected", false)) {
    const auto detail = link.value("detail", "");
    return "not connected" + (detail.empty() ? "" : ": " + detail);
  }
  std::string text = "clock is being measured";
  if (link.value("clock_ready", false)) {
    text = link["bound_us"].is_number() ? formatted("clock +-%.0f us (scatter %.0f us)", link["bound_us"].get<double>(),
                                                    link["repeatability_us"].get<double>())
                                        : "clock in doubt: the last exchange contradicts the others";
  }
  text += formatted(", lost %d", link.value("lost", 0));
  if (link.value("corrupt", 0) > 0) text += formatted(", corrupt %d", link.value("corrupt", 0));
  if (link.value("reconnects", 0) > 0) text += formatted(", reconnected %d times", link.value("reconnects", 0));
  return text;
}

/// Nothing for a rig without a sync line.
std::string sync_text(const nlohmann::json& line) {
  const auto count = [&](const char* key) { return line.value(key, 0U); };
  const unsigned missed = count("unseen") + count("unannounced") + count("ambiguous") + count("wrong_polarity");
  if (count("pairs") + missed == 0) return {};
  std::string text = formatted("  sync line %u edges", count("pairs"));
  if (count("pairs") > 0) {
    text +=
        formatted(", clock off by %+.0f us (bound %.0f us), rms %.0f us, worst %.0f us", line.value("error_us", 0.0),
                  line.value("bound_us", 0.0), line.value("rms_us", 0.0), line.value("worst_us", 0.0));
  }
  if (count("outside") > 0) text += formatted(", BEYOND THE BOUND %u times", count("outside"));
  if (missed > 0) text += formatted(", %u not paired", missed);
  if (line.value("inverted", false)) text += ", the line is UPSIDE DOWN: change active_low of [interlock] sync";
  return text + "\n";
}

/// What an operator has to do or to know before the rig moves.
std::string operator_text(const nlohmann::json& s) {
  std::string out;
  const auto state = s.value("state", "");
  const double left_s =
      s.contains("operator_left_s") && s["operator_left_s"].is_number() ? s["operator_left_s"].get<double>() : 0.0;
  if (state == "armed") out += formatted("  armed     isorig go within %.0f s, or isorig pause\n", left_s);
  if (state == "countdown")
    out += formatted("  KEEP CLEAR the rig moves in %.0f s; isorig pause ends the countdown\n", std::ceil(left_s));
  if (state == "setup")
    out += formatted("  setup     isorig jog; left in %.0f s, or with isorig setup --off\n", left_s);
  if (s.value("arming", "") == "none" && !s.value("simulated", true)) {
    out += "  arming    none: a start moves and fills this rig at once\n";
  }
  if (!s.contains("rig_file")) return out;
  const auto& file = s["rig_file"];
  const auto changes = file.value("changes", nlohmann::json::array());
  if (file.value("accepted_by", "").empty()) {
    out += "  rig file  not accepted by anybody yet (isorig accept-rig --operator NAME)\n";
  } else if (!changes.empty()) {
    out += "  rig file  CHANGED since " + file.value("accepted_by", "") + " accepted it on " +
           file.value("accepted_utc", "") + " (isorig accept-rig)\n";
    for (const auto& c : changes) {
      out += "            " + c.value("key", "") + ": " + c.value("before", "") + " -> " + c.value("now", "") + "\n";
    }
  }
  return out;
}

/// Behind a value that is not of now.
std::string age_text(const nlohmann::json& status, const char* key) {
  const double age_s = status.value(key, 0.0);
  if (age_s < 0.0) return "  never read";
  return age_s > 1.0 ? formatted("  STALE, read %.1f s ago", age_s) : std::string();
}

int exit_code_of(const nlohmann::json& status) {
  const auto& last = status.contains("last_run") ? status["last_run"] : nlohmann::json::object();
  const auto outcome = last.value("outcome", "");
  if (outcome == "failed" || status.value("state", "") == "faulted") return kTripped;
  if (status.value("records_dropped", 0) > 0) return kDataLost;
  return outcome == "done" ? kOk : kFailure;
}

}  // namespace

std::string progress_bar(double fraction, int width) {
  const int filled = static_cast<int>(std::lround(std::clamp(fraction, 0.0, 1.0) * width));
  return "[" + std::string(static_cast<std::size_t>(filled), '#') +
         std::string(static_cast<std::size_t>(width - filled), '.') + "] " + formatted("%5.1f %%", 100.0 * fraction);
}

std::string status_text(const nlohmann::json& s) {
  std::string out = "rig " + s.value("rig", "") + ": " + s.value("state", "");
  if (const auto why = s.value("not_ready", ""); !why.empty() && s.value("state", "") == "idle")
    out += " (" + why + ")";
  out += "\n";
  out += operator_text(s);
  // It stays in the status until the next start; only a rig that is faulted can be reset.
  if (const auto fault = s.value("fault", ""); !fault.empty())
    out += (s.value("state", "") == "faulted" ? "  FAULT     " : "  last fault  ") + fault + "\n";
  if (s.contains("faults") && s.at("faults").size() > 1) {
    for (std::size_t i = 1; i < s.at("faults").size(); ++i) {
      const auto& f = s.at("faults").at(i);
      out += "  then      " + f.value("code", "") + ": " + f.value("text", "") + "\n";
    }
  }
  if (s.contains("run")) {
    const auto& r = s["run"];
    out += "  run       " + r.value("id", "") + "\n";
    out += formatted("  step      %d of %d: ", r.value("step", 0) + 1, r.value("steps", 0)) + r.value("step_text", "") +
           "\n";
    if (const auto label = r.value("session_text", ""); !label.empty()) {
      out += formatted("  session   %s (of %d)\n", label.c_str(), r.value("sessions", 0));
    }
    out += "  progress  " + progress_bar(s.value("progress", 0.0)) + "  " + duration_text(s.value("remaining_s", 0.0)) +
           " left\n";
  } else if (s.contains("last_run") && !s["last_run"].value("id", "").empty()) {
    out += "  last run  " + s["last_run"].value("id", "") + ": " + s["last_run"].value("outcome", "") + "\n";
  }
  const auto frame_age = age_text(s, "frame_age_s") + "\n";
  out += formatted("  force     %9.3f N", s.value("force_N", 0.0)) + frame_age;
  out += formatted("  position  %9.4f mm  (target %.4f)", s.value("position_mm", 0.0), s.value("target_mm", 0.0)) +
         frame_age;
  out += formatted("  pressure  %9.3f psi (set-point %.2f, fill %d, vent %d permille)", s.value("pressure_psi", 0.0),
                   s.value("setpoint_psi", 0.0), s.value("fill_permille", 0), s.value("vent_permille", 0)) +
         age_text(s, "pressure_age_s") + "\n";
  const auto& loop = s["loop"];
  out += formatted("  loop      overruns %llu, worst wake-up %.0f us, worst run %.0f us\n",
                   static_cast<unsigned long long>(loop.value("overruns", std::uint64_t{0})),
                   loop.value("worst_wakeup_us", 0.0), loop.value("worst_run_us", 0.0));
  out += "  frame     " + link_text(s["frame"]) + "\n";
  out += "  sensor    " + link_text(s["pressure"]) + "\n";
  const auto& interlock = s["interlock"];
  if (interlock.value("watched", true)) {
    out += std::string("  interlock e-stop chain ") + (interlock.value("estop_closed", false) ? "closed" : "OPEN") +
           ", guard " + (interlock.value("guard_closed", false) ? "closed" : "OPEN") + "\n";
  } else {
    out += "  interlock NOT WATCHED: " + interlock.value("not_watched", "") + "\n";
  }
  out += sync_text(s.value("sync_line", nlohmann::json::object()));
  if (const auto detail = interlock.value("detail", ""); !interlock.value("connected", true) && !detail.empty()) {
    out += "            " + detail + "\n";
  }
  if (s.contains("recorder")) {
    const auto& r = s["recorder"];
    out +=
        formatted("  recorder  %.1f MiB written, %llu MiB free, disk %s", r.value("written_MiB", 0.0),
                  static_cast<unsigned long long>(r.value("free_MiB", std::uint64_t{0})), r.value("disk", "").c_str());
    if (r.value("missing_samples", std::uint64_t{0}) + r.value("dropped_records", std::uint64_t{0}) > 0) {
      out += formatted(", MISSING %llu samples",
                       static_cast<unsigned long long>(r.value("missing_samples", std::uint64_t{0}) +
                                                       r.value("dropped_records", std::uint64_t{0})));
    }
    out += "\n";
  }
  return out;
}

int watch(const Client& client, const WatchOptions& options) {
  const bool in_place = ::isatty(STDOUT_FILENO) != 0 && !options.json;
  std::uint64_t last_event = 0;
  bool first = true;
  int lines = 0;
  bool had_run = false, was_armed = false;
  interrupted = 0;
  const auto previous = std::signal(SIGINT, [](int) { interrupted = 1; });
  int code = kOk;
  while (interrupted == 0) {
    const auto events = client.get("/v1/events?after=" + std::to_string(last_event)).body;
    const auto status = client.get("/v1/status").body;
    if (in_place && lines > 0) std::printf("\x1b[%dA\x1b[J", lines);
    for (const auto& e : events.value("events", nlohmann::json::array())) {
      last_event = e.value("number", last_event);
      const auto event_code = e.value("code", "");
      if (first || event_code == "step") continue;
      if (!options.json) {
        std::cout << "* " << base::printable(event_code) << ": " << base::printable(e.value("text", ""))
                  << (e.value("threshold", 0.0) != 0.0
                          ? formatted(" (%.3f, limit %.3f)", e.value("value", 0.0), e.value("threshold", 0.0))
                          : std::string())
                  << '\n';
      }
    }
    first = false;
    if (options.json) {
      std::cout << status.dump() << '\n';
    } else if (in_place) {
      const auto text = base::printable_lines(status_text(status));
      lines = static_cast<int>(std::count(text.begin(), text.end(), '\n'));
      std::cout << text;
    } else {
      std::cout << status.value("state", "") << "  " << progress_bar(status.value("progress", 0.0), 20)
                << formatted("  %9.3f N  %8.4f mm  %7.3f psi  %s left\n", status.value("force_N", 0.0),
                             status.value("position_mm", 0.0), status.value("pressure_psi", 0.0),
                             duration_text(status.value("remaining_s", 0.0)).c_str());
    }
    std::cout.flush();
    had_run = had_run || status.contains("run");
    const bool armed = status.value("state", "") == "armed";
    was_armed = was_armed || armed;
    if (options.until_done && !armed && (!status.contains("run") || status.value("state", "") == "faulted") &&
        (had_run || status.contains("last_run"))) {
      // Armed, and nobody gave the second act: what the status knows of is the run before.
      code = was_armed && !had_run ? kRefused : exit_code_of(status);
      break;
    }
    std::this_thread::sleep_for(std::chrono::duration<double>(options.interval_s));
  }
  std::signal(SIGINT, previous);
  return code;
}

}  // namespace isorig::cli
