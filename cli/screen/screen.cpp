#include "cli/screen/screen.hpp"

#include <algorithm>
#include <cmath>

#include "base/formatted.hpp"
#include "base/printable.hpp"
#include "cli/screen/duration.hpp"

namespace isorig::cli {
namespace {

using base::formatted;

/// Collects lines; what comes from outside is made printable here, once.
class Lines {
 public:
  void add(const std::string& text, Tone tone = Tone::kPlain) { lines.push_back({base::printable(text), tone}); }
  std::vector<Said> lines;
};

/// Nothing for a rig without a sync line.
void sync_lines(Lines& out, const nlohmann::json& line) {
  const auto count = [&](const char* key) { return line.value(key, 0U); };
  const unsigned missed = count("unseen") + count("unannounced") + count("ambiguous") + count("wrong_polarity");
  if (count("pairs") + missed == 0) return;
  Tone tone = Tone::kGood;
  std::string text = formatted("  sync line %u edges", count("pairs"));
  if (count("pairs") > 0) {
    text +=
        formatted(", clock off by %+.0f us (bound %.0f us), rms %.0f us, worst %.0f us", line.value("error_us", 0.0),
                  line.value("bound_us", 0.0), line.value("rms_us", 0.0), line.value("worst_us", 0.0));
  }
  if (missed > 0) {
    text += formatted(", %u not paired", missed);
    tone = Tone::kWarn;
  }
  if (count("outside") > 0) {
    text += formatted(", BEYOND THE BOUND %u times", count("outside"));
    tone = Tone::kBad;
  }
  if (line.value("inverted", false)) text += ", the line is UPSIDE DOWN: change active_low of [interlock] sync";
  out.add(text, tone);
}

/// What an operator has to do or to know before the rig moves.
void operator_lines(Lines& out, const nlohmann::json& s) {
  const auto state = s.value("state", "");
  const double left_s =
      s.contains("operator_left_s") && s["operator_left_s"].is_number() ? s["operator_left_s"].get<double>() : 0.0;
  if (state == "armed") out.add(formatted("  armed     isorig go within %.0f s, or isorig pause", left_s), Tone::kWarn);
  if (state == "countdown") {
    out.add(formatted("  KEEP CLEAR the rig moves in %.0f s; isorig pause ends the countdown", std::ceil(left_s)),
            Tone::kBad);
  }
  if (state == "setup") {
    out.add(formatted("  setup     isorig jog; left in %.0f s, or with isorig setup --off", left_s), Tone::kWarn);
  }
  if (s.value("arming", "") == "none" && !s.value("simulated", true)) {
    out.add("  arming    none: a start moves and fills this rig at once", Tone::kWarn);
  }
  if (!s.contains("rig_file")) return;
  const auto& file = s["rig_file"];
  const auto changes = file.value("changes", nlohmann::json::array());
  if (file.value("accepted_by", "").empty()) {
    out.add("  rig file  not accepted by anybody yet (isorig accept-rig --operator NAME)", Tone::kWarn);
  } else if (!changes.empty()) {
    out.add("  rig file  CHANGED since " + file.value("accepted_by", "") + " accepted it on " +
                file.value("accepted_utc", "") + " (isorig accept-rig)",
            Tone::kWarn);
    for (const auto& c : changes) {
      out.add("            " + c.value("key", "") + ": " + c.value("before", "") + " -> " + c.value("now", ""),
              Tone::kWarn);
    }
  }
}

void fault_lines(Lines& out, const nlohmann::json& s) {
  // It stays in the status until the next start; only a rig that is faulted can be reset.
  const bool faulted = s.value("state", "") == "faulted";
  const Tone tone = faulted ? Tone::kBad : Tone::kDim;
  if (const auto fault = s.value("fault", ""); !fault.empty()) {
    out.add((faulted ? "  FAULT     " : "  last fault  ") + fault, tone);
  }
  const auto faults = s.value("faults", nlohmann::json::array());
  for (std::size_t i = 1; i < faults.size(); ++i) {
    out.add("  then      " + faults[i].value("code", "") + ": " + faults[i].value("text", ""), tone);
  }
}

void run_lines(Lines& out, const nlohmann::json& s, const StatusContext& context) {
  if (!s.contains("run")) {
    if (s.contains("last_run") && !s["last_run"].value("id", "").empty()) {
      out.add("  last run  " + s["last_run"].value("id", "") + ": " + s["last_run"].value("outcome", ""));
    }
    return;
  }
  const auto& r = s["run"];
  out.add("  run       " + r.value("id", ""));
  out.add(formatted("  step      %d of %d: ", r.value("step", 0) + 1, r.value("steps", 0)) + r.value("step_text", ""));
  if (const auto label = r.value("session_text", ""); !label.empty()) {
    out.add("  session   " + label + formatted(" (of %d)", r.value("sessions", 0)));
  }
  out.add("  progress  " + progress_bar(s.value("progress", 0.0), context.bar_width) + "  " +
          duration_text(s.value("remaining_s", 0.0)) + " left" + (context.ends.empty() ? "" : ", " + context.ends));
}

/// Behind a value that is not of now.
std::string age_text(const nlohmann::json& status, const char* key) {
  const double age_s = status.value(key, 0.0);
  if (age_s < 0.0) return "  never read";
  return age_s > 1.0 ? formatted("  STALE, read %.1f s ago", age_s) : std::string();
}

void value_lines(Lines& out, const nlohmann::json& s, const StatusContext& context) {
  const auto frame_age = age_text(s, "frame_age_s"), pressure_age = age_text(s, "pressure_age_s");
  const auto tone = [](const std::string& age) { return age.empty() ? Tone::kPlain : Tone::kBad; };
  out.add(formatted("  force     %9.3f N", s.value("force_N", 0.0)) +
              (context.force.empty() ? "" : "    " + context.force) + frame_age,
          tone(frame_age));
  out.add(formatted("  position  %9.4f mm  (target %.4f)", s.value("position_mm", 0.0), s.value("target_mm", 0.0)) +
              frame_age,
          tone(frame_age));
  const double pressure_psi = s.value("pressure_psi", 0.0), setpoint_psi = s.value("setpoint_psi", 0.0);
  const auto path = s.value("sealed", false) ? formatted("(SEALED, both valves shut; was %.2f)", setpoint_psi)
                                             : formatted("(set-point %.2f, fill %d, vent %d permille)", setpoint_psi,
                                                         s.value("fill_permille", 0), s.value("vent_permille", 0));
  out.add(formatted("  pressure  %9.3f psi ", pressure_psi) + path + pressure_age, tone(pressure_age));
}

void interlock_lines(Lines& out, const nlohmann::json& interlock) {
  if (!interlock.value("watched", true)) {
    out.add("  interlock NOT WATCHED: " + interlock.value("not_watched", ""), Tone::kWarn);
    return;
  }
  const bool estop = interlock.value("estop_closed", false), guard = interlock.value("guard_closed", false);
  out.add(
      std::string("  interlock e-stop chain ") + (estop ? "closed" : "OPEN") + ", guard " + (guard ? "closed" : "OPEN"),
      estop && guard ? Tone::kGood : Tone::kBad);
}

void recorder_lines(Lines& out, const nlohmann::json& r) {
  const auto missing = r.value("missing_samples", std::uint64_t{0}) + r.value("dropped_records", std::uint64_t{0});
  const auto disk = r.value("disk", "");
  std::string text = formatted("  recorder  %.1f MiB written, %llu MiB free, disk ", r.value("written_MiB", 0.0),
                               static_cast<unsigned long long>(r.value("free_MiB", std::uint64_t{0}))) +
                     disk;
  if (missing > 0) text += formatted(", MISSING %llu samples", static_cast<unsigned long long>(missing));
  out.add(text, missing > 0 ? Tone::kBad : Tone::kPlain);
}

}  // namespace

std::string progress_bar(double fraction, int width) {
  const int filled = static_cast<int>(std::lround(std::clamp(fraction, 0.0, 1.0) * width));
  return "[" + std::string(static_cast<std::size_t>(filled), '#') +
         std::string(static_cast<std::size_t>(width - filled), '.') + "] " + formatted("%5.1f %%", 100.0 * fraction);
}

std::vector<Said> status_lines(const nlohmann::json& s, const StatusContext& context) {
  Lines out;
  const auto why = s.value("not_ready", "");
  out.add("rig " + s.value("rig", "") + ": " + s.value("state", "") +
          (!why.empty() && s.value("state", "") == "idle" ? " (" + why + ")" : ""));
  operator_lines(out, s);
  if (const auto control = s.find("control"); control != s.end() && control->is_object())
    out.add("  control   " + control->value("text", "") + " since " + control->value("since_utc", ""));
  fault_lines(out, s);
  run_lines(out, s, context);
  value_lines(out, s, context);
  const auto judged = [&](const char* name, const Said& said) { out.add(name + said.text, said.tone); };
  judged("  loop      ", judge_loop(s.at("loop")));
  judged("  frame     ", judge_device(s.at("frame")));
  judged("  sensor    ", judge_device(s.at("pressure")));
  const auto interlock = s.value("interlock", nlohmann::json::object());
  interlock_lines(out, interlock);
  sync_lines(out, s.value("sync_line", nlohmann::json::object()));
  if (const auto detail = interlock.value("detail", ""); !interlock.value("connected", true) && !detail.empty()) {
    out.add("            " + detail, Tone::kBad);
  }
  if (s.contains("recorder")) recorder_lines(out, s["recorder"]);
  return out.lines;
}

std::string status_text(const nlohmann::json& status) {
  std::string out;
  for (const auto& line : status_lines(status)) out += line.text + "\n";
  return out;
}

}  // namespace isorig::cli
