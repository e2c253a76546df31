#include <unistd.h>

#include <cmath>
#include <cstdio>
#include <functional>
#include <iostream>
#include <memory>

#include "base/decimal.hpp"
#include "base/number_text.hpp"
#include "base/toml_reader.hpp"
#include "calibration/date.hpp"
#include "calibration/record.hpp"
#include "cli/command.hpp"
#include "cli/rig_at_rest.hpp"
#include "daemon/host/paths.hpp"

/// isorig calibrate: readings of a running daemon against a reference; the daemon keeps the record and puts it in
/// force.
namespace isorig::cli {
namespace {

using calibration::Channel;
using calibration::Mode;

constexpr double kStandardGravity_m_s2 = 9.80665;

struct Options {
  std::string what;
  std::string mode = "adjust";
  std::vector<double> points;
  std::vector<double> drive;
  std::string reference_command;
  std::string operator_name, reference, certificate, reference_due, due, note;
  double reference_uncertainty = -1.0;
  int interval_days = 365;
  std::string unit;
  double gravity_m_s2 = kStandardGravity_m_s2;
  double window_s = 2.0, settle_s = 30.0, drift_max = -1.0;
  bool yes = false, dry_run = false, json = false, allow_expired = false;
  std::string socket = daemon::default_socket().string();
};

/// Wrong words on the command line: nothing was read, nothing moved.
struct UsageError : std::runtime_error {
  using std::runtime_error::runtime_error;
};

double default_drift(Channel channel) {
  // Some steps of the reading: well below what is asked of the channel, well above what noise does to a mean.
  switch (channel) {
    case Channel::kPressure:
      return 0.01;  // psi: four counts
    case Channel::kForce:
      return 0.02;  // N
    case Channel::kPosition:
      return 0.002;  // mm
  }
  return 0.0;
}

/// To the channel's unit.
double factor_of(const Options& o, Channel channel) {
  const std::string unit = o.unit.empty() ? unit_of(channel) : o.unit;
  if (unit == unit_of(channel)) return 1.0;
  if (channel == Channel::kForce && unit == "kg") return o.gravity_m_s2;
  if (channel == Channel::kForce && unit == "g") return o.gravity_m_s2 * 1e-3;
  if (channel == Channel::kPressure && unit == "kPa") return 1.0 / 6.894757293168361;
  if (channel == Channel::kPressure && unit == "bar") return 100.0 / 6.894757293168361;
  throw UsageError("--unit " + unit + " does not go with " + name_of(channel) + "; " +
                   (channel == Channel::kForce      ? "N, kg, g"
                    : channel == Channel::kPressure ? "psi, kPa, bar"
                                                    : "mm"));
}

/// Where the reference's values come from: --point in their order, a command's output, or the operator.
class References {
 public:
  References(const Options& options, double factor, const char* unit)
      : options_(options), factor_(factor), unit_(unit) {}

  /// In the channel's unit; nothing: no more points. `what` says what the operator should do.
  std::optional<double> next(const std::string& what) {
    if (!options_.reference_command.empty())
      return factor_ * parse(output_of(options_.reference_command), "the reference command");
    if (!options_.points.empty()) {
      if (used_ == options_.points.size()) return std::nullopt;
      return factor_ * options_.points[used_++];
    }
    for (;;) {
      const auto line = ask(what + " [" + unit_ + "]: ");
      if (!line || line->empty()) return std::nullopt;
      try {
        return factor_ * parse(*line, "the answer");
      } catch (const std::runtime_error& e) {
        std::cerr << e.what() << '\n';
      }
    }
  }

 private:
  static double parse(const std::string& text, const std::string& whose) {
    std::string why;
    if (const auto value = base::decimal(text, why)) return *value;
    throw std::runtime_error(whose + ": " + why +
                             (why.find("behind the number") == std::string::npos ? "" : " (another unit: --unit)"));
  }

  const Options& options_;
  double factor_;
  std::string unit_;
  std::size_t used_ = 0;
};

/// Who, against what: asked for at a terminal, so that `isorig calibrate pressure` is enough; in a script all that is
/// missing is said at once.
void complete(Options& o) {
  struct Word {
    const char* option;
    const char* what;
    bool missing;
    std::function<bool(const std::string&, std::string&)> take;  ///< false, and why, when the answer is none
  };
  const auto text = [](std::string& to) {
    return [&to](const std::string& answer, std::string&) {
      to = answer;
      return true;
    };
  };
  const Word words[] = {
      {"--operator", "who calibrates", o.operator_name.empty(), text(o.operator_name)},
      {"--reference", "id of the reference instrument", o.reference.empty(), text(o.reference)},
      {"--reference-due", "until when the reference's own certificate holds, such as 2027-05-31",
       o.reference_due.empty(),
       [&](const std::string& answer, std::string& why) {
         why = "a date is written 2027-05-31";
         o.reference_due = answer;
         return calibration::days_of(answer).has_value();
       }},
      {"--reference-uncertainty", "the reference's uncertainty, k = 2, from its certificate, in the unit of the points",
       o.reference_uncertainty < 0.0,
       [&](const std::string& answer, std::string& why) {
         const auto value = base::decimal(answer, why);
         if (value && *value < 0.0) why = "an uncertainty is not negative";
         o.reference_uncertainty = value.value_or(-1.0);
         return o.reference_uncertainty >= 0.0;
       }},
  };
  std::string missing;
  for (const auto& word : words) {
    if (!word.missing) continue;
    if (::isatty(STDIN_FILENO) == 0) {
      missing += std::string("\n  ") + word.option + ": " + word.what;
      continue;
    }
    for (;;) {
      const auto answer = ask(std::string(word.what) + " (" + word.option + "): ");
      if (!answer || answer->empty())
        throw UsageError(std::string(word.option) + ": " + word.what +
                         "; without it a calibration is nobody's evidence");
      std::string why;
      if (word.take(*answer, why)) break;
      std::cerr << why << '\n';
    }
  }
  if (!missing.empty()) throw UsageError("a calibration is somebody's, against something; add" + missing);
}

void check_words(const Options& o, Channel channel, Mode mode) {
  if (!calibration::days_of(o.reference_due))
    throw UsageError("--reference-due: until when the reference's own certificate holds, such as 2027-05-31");
  if (!(o.reference_uncertainty >= 0.0))
    throw UsageError("--reference-uncertainty: the reference's, k = 2, from its certificate");
  if (!o.due.empty() && !calibration::days_of(o.due)) throw UsageError("--due: a date is written 2027-05-31");
  if (!o.drive.empty() && channel != Channel::kPressure)
    throw UsageError("--drive is for pressure; weights and gauge blocks are put in by hand");
  if (!o.drive.empty() && o.reference_command.empty() && !o.points.empty() && o.points.size() != o.drive.size()) {
    throw UsageError("--drive and --point have to be as many: " + std::to_string(o.drive.size()) + " and " +
                     std::to_string(o.points.size()));
  }
  if (!o.reference_command.empty() && o.drive.empty() && mode == Mode::kAdjust) {
    throw UsageError(
        "--reference-command needs --drive, or --mode zero or check: it says what the reference shows, not when there "
        "is a new point");
  }
  if (o.reference_command.empty() && o.points.empty() && ::isatty(STDIN_FILENO) == 0) {
    throw UsageError(
        "nobody to ask: give --point VALUE (once for each) or --reference-command, since this is no terminal");
  }
  if (o.reference_due < calibration::today()) {
    const std::string text = "the certificate of reference " + o.reference + " ended on " + o.reference_due;
    if (!o.allow_expired) throw std::runtime_error(text + "; have it calibrated, or add --allow-expired-reference");
    std::cerr << "warning: " << text << '\n';
  }
}

void check_reference(Channel channel, double value, const nlohmann::json& limits) {
  double low = 0.0, high = 0.0;
  std::string whose;
  switch (channel) {
    case Channel::kPressure:
      low = -0.6, high = 30.6;  // 2 % of span beyond 0..30 psi: what messages/elvh.hpp still believes
      whose = "the sensor's range";
      break;
    case Channel::kForce:
      low = limits.value("force_min_N", 0.0), high = limits.value("force_max_N", 0.0);
      whose = "the rig's [limits]";
      break;
    case Channel::kPosition:
      high = limits.value("travel_max_mm", 0.0) - limits.value("travel_min_mm", 0.0);
      low = -high;
      whose = "the rig's travel";
      break;
  }
  if (value >= low && value <= high) return;
  char text[160];
  std::snprintf(text, sizeof text, "reference %.6g %s is outside %s (%.6g to %.6g %s); check its unit (--unit)", value,
                unit_of(channel), whose.c_str(), low, high, unit_of(channel));
  throw std::runtime_error(text);
}

void print_point(std::size_t number, const calibration::Point& p, calibration::Correction before, const char* unit) {
  std::fprintf(stderr, "  point %zu: reference %10.4f %s, reading %10.4f (raw %.4f +- %.4f), error %+.4f\n", number,
               p.reference, unit, before.apply(p.raw), p.raw, p.standard_error, before.apply(p.raw) - p.reference);
}

void print_result(const calibration::Record& r) {
  const auto& x = r.result;
  const char* unit = unit_of(r.channel);
  std::printf("%s, %s: %zu points against %s\n", name_of(r.channel), name_of(r.mode), r.points.size(),
              r.reference.id.c_str());
  std::printf("  before       scale %.6f, offset %+.5f %s\n", r.before.scale, r.before.offset, unit);
  std::printf("  now          scale %.6f, offset %+.5f %s\n", x.correction.scale, x.correction.offset, unit);
  std::printf("  as found     largest error %.4f %s", x.as_found_max, unit);
  const double band = calibration::facts_of(r.channel).error_band;
  if (band > 0.0)
    std::printf(", %s the sensor's total error band of %.2f %s", x.found_in_band ? "within" : "OUTSIDE", band, unit);
  std::printf("\n  as left      largest error %.4f %s (of the same points)\n", x.as_left_max, unit);
  if (x.hysteresis) std::printf("  hysteresis   %.4f %s between up and down\n", *x.hysteresis, unit);
  std::printf("  uncertainty  %.4f %s (k = 2)\n", x.uncertainty, unit);
  const auto print_class = [](const char* when, const calibration::ForceClass& f) {
    std::printf("  %s  class %s in the manner of ISO 7500-1 (%d levels, %d series): error %.2f %%", when,
                f.text.c_str(), f.levels, f.series, f.error_percent);
    if (f.repeatability_percent) std::printf(", repeatability %.2f %%", *f.repeatability_percent);
    if (f.reversibility_percent) std::printf(", reversibility %.2f %%", *f.reversibility_percent);
    if (f.zero_percent) std::printf(", zero %.3f %%", *f.zero_percent);
    std::printf(", resolution %.2f %%\n", f.resolution_percent);
  };
  if (x.class_found && x.class_found->levels > 0) print_class("as found   ", *x.class_found);
  if (x.class_left && x.class_left->levels > 0) print_class("as left    ", *x.class_left);
}

int list(const Client& client, bool as_json) {
  const auto answer = client.get("/v1/calibrations");
  if (as_json || !answer.ok()) {
    std::cout << answer.body.dump(2) << '\n';
    return answer.ok() ? kOk : kFailure;
  }
  const auto& b = answer.body;
  std::printf("rig %s, records in %s\n", b.value("rig", "").c_str(), b.value("directory", "").c_str());
  for (const auto& [channel, c] : b["in_force"].items()) {
    const auto id = c.value("id", "");
    std::printf("  %-8s  scale %.6f, offset %+.5f %s  ", channel.c_str(), c.value("scale", 1.0), c.value("offset", 0.0),
                c.value("unit", "").c_str());
    if (id.empty()) {
      std::printf("never calibrated (the rig file's numbers)\n");
    } else {
      std::printf("%s by %s, due %s%s, +-%.4f (k = 2)\n", id.c_str(), c.value("operator", "").c_str(),
                  c.value("due", "").c_str(), c.value("overdue", false) ? " OVERDUE" : "",
                  c.value("uncertainty_k2", 0.0));
    }
  }
  for (const auto& r : b["records"]) {
    std::printf("  record %s  %-6s  by %s against %s\n", r.value("id", "").c_str(), r.value("mode", "").c_str(),
                r.value("operator", "").c_str(), r.value("reference", "").c_str());
  }
  return kOk;
}

/// What is known before the first point.
calibration::Record begun_record(const Options& o, Channel channel, Mode mode, double factor,
                                 const nlohmann::json& known) {
  const auto& in_force = known["in_force"][name_of(channel)];
  calibration::Record r;
  r.rig = known.value("rig", "");
  r.channel = channel;
  r.mode = mode;
  r.operator_name = o.operator_name;
  r.note = o.note;
  r.supersedes = in_force.value("id", "");
  r.before = {in_force.value("scale", 1.0), in_force.value("offset", 0.0)};
  r.reference = {o.reference, o.certificate, o.reference_due, o.reference_uncertainty * factor};
  return r;
}

void check_at_rest(const Client& client) {
  const auto state = client.get("/v1/status").body.value("state", "");
  if (state != "idle" && state != "ready") {
    throw std::runtime_error("the rig is " + state + "; calibrate when it is at rest (isorig status)");
  }
}

/// Whether the rig may go to the set-points of --drive.
bool may_pressurize(const Options& o, const nlohmann::json& limits) {
  for (const double psi : o.drive) {
    if (psi < 0.0 || psi > limits.value("pressure_max_psi", 0.0)) {
      throw UsageError("--drive " + base::number_text(psi) + " psi is not between 0 and the rig's pressure_max_psi");
    }
  }
  return consent("The rig will pressurize what is connected, up to " +
                     base::number_text(*std::max_element(o.drive.begin(), o.drive.end())) +
                     " psi; the crosshead stands still. Keep hands off the specimen. Go on?",
                 o.yes);
}

/// Reads reference and channel, point by point, into the record. `held`: the rig sets the pressures of --drive.
void measure_points(const Client& client, const Options& o, double factor, const nlohmann::json& limits,
                    HeldPressure* held, calibration::Record& r) {
  const char* unit = unit_of(r.channel);
  const Settling settling{o.window_s, o.settle_s, (o.drift_max > 0.0 ? o.drift_max : default_drift(r.channel))};
  References references(o, factor, o.unit.empty() ? unit : o.unit.c_str());
  for (std::size_t i = 0;; ++i) {
    if (held != nullptr && i == o.drive.size()) break;
    if (held != nullptr) {
      held->go_to(i);
    } else if (i > 0 && !o.reference_command.empty()) {
      break;  // it shows the same point again
    }
    // The reference is read between two readings that agree: then all three are of the same moment.
    std::optional<SettledReading> reading_before;
    if (held != nullptr) reading_before = settled_reading(client, name_of(r.channel), settling);
    const auto value =
        references.next(held != nullptr ? "reference at set-point " + std::to_string(o.drive[i]).substr(0, 6)
                                        : "apply point " + std::to_string(i + 1) +
                                              ", let it settle, type what the reference shows (empty: no more)");
    if (!value) {
      if (held != nullptr) {
        throw std::runtime_error("there is no reference value for set-point " + std::to_string(i + 1));
      }
      break;
    }
    check_reference(r.channel, *value, limits);
    const auto reading = settled_reading(client, name_of(r.channel), settling);
    if (reading_before && std::abs(reading.raw - reading_before->raw) > 2.0 * settling.drift_max) {
      throw std::runtime_error("the reading moved by " + std::to_string(reading.raw - reading_before->raw) + " " +
                               unit + " while the reference was read; let it settle longer (--window-s)");
    }
    r.points.push_back({*value, reading.raw, reading.standard_error, reading.drift});
    r.temperature_C = reading.temperature_C;
    if (!o.json) print_point(i + 1, r.points.back(), r.before, unit);
  }
}

/// Puts the record in force, if it is wanted.
int keep(const Client& client, const Options& o, const calibration::Record& r) {
  const auto text = to_toml(r);
  if (!o.json) print_result(r);
  if (o.dry_run) {
    if (o.json)
      std::cout << nlohmann::json{{"ok", true}, {"record", text}}.dump(2) << '\n';
    else
      std::cout << "dry run: nothing was kept\n";
    return kOk;
  }
  if (!consent("Keep this record and put it in force?", o.yes)) return kRefused;
  // The frame's stop and the vent after driven points take a moment.
  wait_for_rest(client, 30.0);
  const auto answer = client.post("/v1/calibrations", {{"record", text}});
  if (o.json) {
    auto body = answer.body;
    body["record"] = text;
    std::cout << body.dump(2) << '\n';
  } else {
    (answer.ok() ? std::cout : std::cerr) << answer.text() << '\n';
  }
  return answer.ok() ? kOk : answer.status == 400 ? kBadInput : kRefused;
}

int calibrate(Options& o) {
  const Client client(o.socket);
  if (o.what == "list") return list(client, o.json);
  const auto channel = *calibration::channel_of(o.what);
  const auto mode = *calibration::mode_of(o.mode);
  complete(o);
  check_words(o, channel, mode);
  const double factor = factor_of(o, channel);
  const auto known = client.get("/v1/calibrations");
  if (!known.ok()) throw std::runtime_error(known.text());
  auto r = begun_record(o, channel, mode, factor, known.body);
  check_at_rest(client);

  if (o.drive.empty()) {
    measure_points(client, o, factor, known.body["limits"], nullptr, r);
  } else {
    if (!may_pressurize(o, known.body["limits"])) return kRefused;
    HeldPressure held(client, o.drive, o.operator_name);
    measure_points(client, o, factor, known.body["limits"], &held, r);
    r.evidence_run = held.runs();
  }  // vents

  r.made_utc = calibration::now_utc();
  r.id = calibration::record_id(r.made_utc, channel);
  r.due = !o.due.empty() ? o.due : calibration::later(r.made_utc.substr(0, 10), o.interval_days);
  r.result = calibration::calibrate(channel, mode, r.points, r.before, r.reference.uncertainty);
  return keep(client, o, r);
}

Command add_calibrate(CLI::App& app) {
  auto* sub = app.add_subcommand("calibrate",
                                 "Compare a channel with a reference, keep the record, put the correction in force");
  auto o = std::make_shared<Options>();
  sub->add_option("WHAT", o->what, "pressure, force, position; or list: what is in force, and every record")
      ->required()
      ->check(CLI::IsMember({"pressure", "force", "position", "list"}));
  sub->add_option("--mode", o->mode,
                  "adjust: zero and span (position: span); zero: the zero alone; check: adjust nothing")
      ->check(CLI::IsMember({"adjust", "zero", "check"}))
      ->capture_default_str();
  sub->add_option("--point", o->points,
                  "What the reference shows, once for each point, in order; without it you are asked")
      ->take_all();
  sub->add_option("--drive", o->drive,
                  "Pressure: the rig goes to these set-points (psi), in order, e.g. 0 5 10 15 20 15 10 5 0");
  sub->add_option("--reference-command", o->reference_command, "Prints what the reference shows, each time it is run");
  sub->add_option("--operator", o->operator_name, "Who calibrates");
  sub->add_option("--reference", o->reference, "Id of the reference instrument");
  sub->add_option("--reference-due", o->reference_due, "Until when its own certificate holds (2027-05-31)");
  sub->add_option("--reference-uncertainty", o->reference_uncertainty,
                  "Its uncertainty, k = 2, in the unit of the points");
  sub->add_option("--certificate", o->certificate, "Number of its certificate");
  sub->add_flag("--allow-expired-reference", o->allow_expired, "Go on with a reference whose certificate has ended");
  sub->add_option("--interval-days", o->interval_days, "Until this calibration is due again")
      ->check(CLI::Range(1, 3660))
      ->capture_default_str();
  sub->add_option("--due", o->due, "The date it is due, instead of --interval-days");
  sub->add_option("--unit", o->unit, "Of the points: psi, kPa, bar; N, kg, g; mm");
  sub->add_option("--gravity", o->gravity_m_s2, "Local, for --unit kg and g (m/s2)")
      ->check(CLI::Range(9.76, 9.84))
      ->capture_default_str();
  sub->add_option("--window-s", o->window_s, "A reading is the mean over this")
      ->check(CLI::Range(0.5, 10.0))
      ->capture_default_str();
  sub->add_option("--settle-s", o->settle_s, "How long a reading may take to settle")
      ->check(CLI::Range(0.0, 3600.0))
      ->capture_default_str();
  sub->add_option("--drift-max", o->drift_max,
                  "A reading that moves more within its window is not settled (channel's unit)");
  sub->add_option("--note", o->note, "Kept in the record");
  sub->add_flag("--yes", o->yes, "Do not ask whether to pressurize and whether to keep the record");
  sub->add_flag("--dry-run", o->dry_run, "Show the result and keep nothing");
  sub->add_flag("--json", o->json, "For scripts: the daemon's answer and the record");
  sub->add_option("--socket", o->socket, "The daemon's socket")->capture_default_str();
  return {sub, [o] {
            try {
              return calibrate(*o);
            } catch (const UsageError& e) {
              std::cerr << "isorig calibrate: " << e.what() << '\n';
              return static_cast<int>(kUsage);
            } catch (const NoDaemon& e) {
              std::cerr << "isorig: " << e.what() << '\n';
              return static_cast<int>(kNoDaemon);
            } catch (const std::runtime_error& e) {
              std::cerr << "isorig calibrate: " << e.what() << "; nothing was kept\n";
              return static_cast<int>(kRefused);
            }
          }};
}

const Registration kCalibrate(27, add_calibrate);

}  // namespace
}  // namespace isorig::cli
