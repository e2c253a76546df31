#include "cli/screen/live_verdicts.hpp"

#include <algorithm>

#include "base/formatted.hpp"
#include "cli/screen/exit_codes.hpp"

namespace isorig::cli {
namespace {

using base::formatted;

Tone tone_of(double value, const double (&limits)[2]) {
  return !(value <= limits[1]) ? Tone::kBad : value > limits[0] ? Tone::kWarn : Tone::kGood;
}

const char* word_of(Tone tone) {
  return tone == Tone::kBad ? "bad" : tone == Tone::kWarn ? "fair" : "good";
}

double number(const nlohmann::json& j, const char* key) {
  const auto found = j.find(key);
  return found != j.end() && found->is_number() ? found->get<double>() : 0.0;
}

}  // namespace

std::string microseconds_text(double us) {
  return us < 1000.0 ? formatted("%.0f us", us)
         : us < 1e6  ? formatted("%.1f ms", us * 1e-3)
                     : formatted("%.1f s", us * 1e-6);
}

Said judge_loop(const nlohmann::json& loop) {
  const double ticks = number(loop, "ticks"), skipped = number(loop, "overruns");
  const double wakeup_us = number(loop, "worst_wakeup_us"), run_us = number(loop, "worst_run_us");
  const Tone share = tone_of(skipped / std::max(1.0, ticks), kLateShare);
  const Tone tone = std::max({tone_of(wakeup_us, kLate_us), tone_of(run_us, kLate_us), share});
  // The verdict and where to read on stand before what a terminal of 80 columns cuts off.
  // The loop counts it in 32 bits of nanoseconds.
  constexpr double kMostCounted_us = 4'294'967.0;
  std::string text =
      formatted("worst wake-up %s%s: %s", wakeup_us >= kMostCounted_us ? "more than " : "",
                microseconds_text(wakeup_us >= kMostCounted_us ? 4.2e6 : wakeup_us).c_str(), word_of(tone));
  if (tone != Tone::kGood) text += ", see docs/threads.md";
  if (skipped > 0.0) text += formatted("; %.0f of %.0f ticks skipped", skipped, ticks);
  // The tick's own time is worth a word only where it is what is late.
  if (run_us > kLate_us[0]) text += formatted("; worst tick took %s", microseconds_text(run_us).c_str());
  return {text, tone};
}

Said judge_device(const nlohmann::json& link) {
  if (!link.value("connected", false)) {
    const auto detail = link.value("detail", "");
    return {"not connected" + (detail.empty() ? "" : ": " + detail), Tone::kBad};
  }
  Said said{"clock is being measured", Tone::kWarn};
  if (link.value("clock_ready", false)) {
    if (const auto bound = link.find("bound_us"); bound != link.end() && bound->is_number()) {
      said.tone = tone_of(bound->get<double>(), kLate_us);
      said.text = formatted("clock within %s (scatter %s): %s", microseconds_text(bound->get<double>()).c_str(),
                            microseconds_text(number(link, "repeatability_us")).c_str(), word_of(said.tone));
      if (said.tone != Tone::kGood) said.text += ", see docs/clock.md";
    } else {
      said = {"clock in doubt: the last exchange contradicts the others", Tone::kBad};
    }
  }
  const auto count = [&](const char* key) { return static_cast<long long>(number(link, key)); };
  if (count("lost") > 0) said.tone = std::max(said.tone, Tone::kWarn);
  said.text += count("lost") > 0 ? formatted("; LOST %lld", count("lost")) : "; none lost";
  if (count("corrupt") > 0) said.text += formatted(", corrupt %lld", count("corrupt"));
  if (count("reconnects") > 0) said.text += formatted(", reconnected %lld times", count("reconnects"));
  return said;
}

std::string lost_words(const nlohmann::json& last_run) {
  std::string out;
  for (const auto& [count, words] :
       {std::pair{"missing_samples", "samples never came"}, std::pair{"lost_messages", "messages were lost"},
        std::pair{"dropped_records", "records were dropped"}}) {
    if (number(last_run, count) > 0.0)
      out += (out.empty() ? "" : ", ") + formatted("%.0f %s", number(last_run, count), words);
  }
  return out;
}

int exit_code_of(const nlohmann::json& last_run) {
  const auto outcome = last_run.value("outcome", "");
  if (outcome == "failed") return kTripped;
  if (outcome != "done") return kFailure;
  return lost_words(last_run).empty() ? kOk : kDataLost;
}

}  // namespace isorig::cli
