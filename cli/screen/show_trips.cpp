#include "cli/screen/show_trips.hpp"

#include <algorithm>
#include <cmath>

#include "base/formatted.hpp"
#include "base/printable.hpp"
#include "base/text_file.hpp"

namespace isorig::cli {
namespace {

using Json = nlohmann::ordered_json;

constexpr int kMostTrips = 99;               // as TripEvidence
constexpr std::size_t kMostBytes = 4 << 20;  // some hundred events

std::string text_of(const Json& object, const char* key) {
  const auto found = object.find(key);
  return found != object.end() && found->is_string() ? base::printable(found->get<std::string>()) : std::string();
}

double number_of(const Json& object, const char* key) {
  const auto found = object.find(key);
  return found != object.end() && found->is_number() ? found->get<double>() : std::nan("");
}

/// "4.35"; "?" for what was no number.
std::string words_of(double value, int digits = 2) {
  if (!std::isfinite(value)) return "?";
  return base::formatted("%.*f", digits, value);
}

/// "3 ms", "1.25 s"
std::string span(double s) {
  return std::abs(s) < 1.0 ? words_of(1e3 * s, 0) + " ms" : words_of(s, 2) + " s";
}

std::string with_value(const Json& event) {
  const double value = number_of(event, "value"), threshold = number_of(event, "threshold");
  if (!std::isfinite(threshold) || threshold == 0.0) return {};
  return " (" + words_of(value, 3) + ", limit " + words_of(threshold, 3) + ")";
}

bool is_fault(const Json& event) {
  const auto severity = text_of(event, "severity");
  return severity == "program stop" || severity == "safe state";
}

std::string what_was_done(const Json& trip) {
  const auto state = text_of(trip, "state"), words = text_of(trip, "step_words");
  std::string line = "the rig was " + (state.empty() ? "in no known state" : state);
  if (!words.empty()) line += base::formatted(", step %.0f: ", number_of(trip, "step") + 1.0) + words;
  if (const auto before = trip.find("before"); before != trip.end() && before->is_object()) {
    line += "; at " + words_of(number_of(*before, "position_mm"), 3) + " mm, " +
            words_of(number_of(*before, "force_N")) + " N, " + words_of(number_of(*before, "pressure_psi")) + " psi";
  }
  return line;
}

std::string what_the_daemon_did(const Json& trip, const Json& reaction) {
  std::string line = "the crosshead was told to stop at once";
  const auto valves = text_of(reaction, "valves");
  const auto after = span(number_of(reaction, "valves_s"));
  if (valves == "vent") line += "; the vent valve was told to open " + after + " after the trip";
  if (valves == "shut") line += "; both valves were told to shut " + after + " after the trip";
  if (text_of(trip, "severity") == "program stop" && valves == "vent") line += ", since there was nothing to hold";
  return line;
}

/// "no sample of the frame from 3 ms before the trip to 2.67 s after it"; empty where there was no such time.
std::string silence(const Json& reaction, const char* key, const char* of_what) {
  const auto found = reaction.find(key);
  if (found == reaction.end() || !found->is_array() || found->size() != 2) return {};
  if (!(*found)[0].is_number() || !(*found)[1].is_number()) return {};
  const double from_s = (*found)[0].get<double>(), to_s = (*found)[1].get<double>();
  return std::string("no ") + of_what + " from " +
         (from_s < 0.0    ? span(-from_s) + " before the trip"
          : from_s == 0.0 ? "the trip"
                          : span(from_s) + " after the trip") +
         " to " + span(to_s) + " after it; ";
}

std::string what_the_frame_did(const Json& reaction) {
  const double least_mm = number_of(reaction, "position_min_mm"), most_mm = number_of(reaction, "position_max_mm");
  if (!std::isfinite(least_mm)) return "no sample of the frame came after it";
  const auto silent = silence(reaction, "frame_silent_s", "sample of the frame");
  const double at_mm = number_of(reaction, "position_at_mm"), stood_s = number_of(reaction, "stood_s");
  std::string line = silent;
  if (!std::isfinite(stood_s)) {
    line += "the crosshead was not seen to stand";
  } else if (!silent.empty()) {
    line += "the crosshead was seen to stand from " + span(stood_s) + " on";
  } else {
    line += stood_s <= 0.0 ? "the crosshead stood" : "the crosshead stood after " + span(stood_s);
  }
  line += std::isfinite(at_mm)
              ? ", " + words_of(std::max(most_mm - at_mm, at_mm - least_mm), 3) + " mm from where it was"
              : ", at " + words_of(least_mm, 3) + " to " + words_of(most_mm, 3) + " mm";
  if (std::isfinite(at_mm) && !silent.empty()) line += " seen last before";
  return line + "; force from " + words_of(number_of(reaction, "force_min_N")) + " to " +
         words_of(number_of(reaction, "force_max_N")) + " N";
}

std::string what_the_pressure_did(const Json& reaction) {
  const double most_psi = number_of(reaction, "pressure_max_psi"), vented_s = number_of(reaction, "vented_s");
  if (!std::isfinite(most_psi)) return "no pressure reading came after it";
  const auto silent = silence(reaction, "pressure_silent_s", "pressure reading");
  std::string line = silent + "the pressure ";
  if (!std::isfinite(vented_s)) {
    line += "was " + words_of(number_of(reaction, "pressure_last_psi")) + " psi at the last reading";
  } else if (!silent.empty()) {
    line += "was seen below 1 psi from " + span(vented_s) + " on";
  } else {
    line += vented_s <= 0.0 ? "was below 1 psi" : "was below 1 psi after " + span(vented_s);
  }
  return line + ", at most " + words_of(most_psi) + " psi" + (silent.empty() ? "" : " of what was read");
}

/// " by ann (uid 1000) after 4.35 s, at 2026-11-23T16:40:00Z", as far as it is known.
std::string who_and_when(const Json& event, double t_s) {
  const auto by = text_of(event, "by"), utc = text_of(event, "utc");
  return (by.empty() ? "" : " by " + by) + " after " + span(t_s) + (utc.empty() ? "" : ", at " + utc);
}

std::string how_it_ended(const Json& events) {
  std::string line;
  for (const auto& e : events) {
    const double t_s = number_of(e, "t_s");
    const auto code = text_of(e, "code");
    const bool acts = code == "reset" || code == "resume" || code == "abort" || code == "zero.confirmed" ||
                      code.rfind("run.", 0) == 0;
    if (!(t_s > 0.0) || !acts) continue;
    line += (line.empty() ? "" : ", then ") +
            std::string(code == "reset"            ? "reset"
                        : code == "resume"         ? "resumed"
                        : code == "abort"          ? "vented by an abort"
                        : code == "zero.confirmed" ? "the zero was confirmed"
                        : code == "run.aborted"    ? "the run was aborted"
                        : code == "run.failed"     ? "the run was given up, with nobody there to clear it"
                                                   : text_of(e, "text")) +
            who_and_when(e, t_s);
  }
  return line.empty() ? "it was still latched when the recording ended (a reset after that is in isorigd's log)" : line;
}

}  // namespace

Json read_trips(const std::filesystem::path& run_dir, std::vector<std::string>& complaints) {
  auto all = Json::array();
  std::error_code ignored;
  for (int i = 1; i <= kMostTrips; ++i) {
    const auto path = run_dir / ("trip-" + std::to_string(i) + ".json");
    if (!std::filesystem::exists(path, ignored)) break;
    try {
      auto trip = Json::parse(base::read_text_file(path, kMostBytes));
      if (!trip.is_object() || text_of(trip, "format") != "isorig-trip/1") {
        complaints.push_back(path.string() + ": no evidence of a trip that this program knows: its format is \"" +
                             (trip.is_object() ? text_of(trip, "format") : "") + "\", not \"isorig-trip/1\"");
        continue;
      }
      all.push_back(std::move(trip));
    } catch (const std::exception& e) {
      complaints.push_back(path.string() + ": cannot be read: " + e.what());
    }
  }
  return all;
}

std::string tell_trip(const Json& trip) {
  const auto no_object = Json::object();
  const auto no_list = Json::array();
  const auto reaction_at = trip.find("reaction"), events_at = trip.find("events");
  const Json& reaction = reaction_at != trip.end() && reaction_at->is_object() ? *reaction_at : no_object;
  const Json& events = events_at != trip.end() && events_at->is_array() ? *events_at : no_list;
  std::string all = "trip " + words_of(number_of(trip, "number"), 0) + ": " + text_of(trip, "code") + ", " +
                    text_of(trip, "severity") + "\n";
  const auto line = [&](const char* title, const std::string& text) {
    all += base::formatted("  %-9s", title) + text + "\n";
  };
  line("before", what_was_done(trip));
  line("cause", text_of(trip, "text") + with_value(trip));
  int told = 0;
  for (const auto& e : events) {
    const double t_s = number_of(e, "t_s");
    const bool is_cause = t_s == 0.0 && text_of(e, "code") == text_of(trip, "code");
    // What led to it, and what followed from it, without the steps that were carried out.
    const bool led = t_s <= 0.0 && (is_fault(e) || text_of(e, "severity") == "warning");
    if (is_cause || !(led || (t_s >= 0.0 && is_fault(e)))) continue;
    if (++told > 8) continue;
    line(told == 1 ? "chain" : "", (t_s < 0.0 ? span(-t_s) + " before: " : span(t_s) + " after: ") +
                                       text_of(e, "code") + ": " + text_of(e, "text") + with_value(e));
  }
  if (told > 8) line("", "and " + std::to_string(told - 8) + " more");
  line("daemon", what_the_daemon_did(trip, reaction));
  line("rig", what_the_frame_did(reaction) + "; " + what_the_pressure_did(reaction));
  line("end", how_it_ended(events));
  if (const auto files = trip.find("files"); files != trip.end() && files->is_array()) {
    std::string names;
    for (const auto& f : *files) {
      if (f.is_string()) names += (names.empty() ? "" : ", ") + base::printable(f.get<std::string>());
    }
    line("samples", names.empty() ? "in the recording alone" : names);
  }
  return all;
}

}  // namespace isorig::cli
