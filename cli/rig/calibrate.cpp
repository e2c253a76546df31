#include <algorithm>
#include <cmath>
#include <iostream>
#include <memory>

#include "base/number_text.hpp"
#include "calibration/date.hpp"
#include "calibration/record.hpp"
#include "cli/command.hpp"
#include "cli/rig/calibrate_print.hpp"
#include "cli/rig/calibrate_words.hpp"
#include "cli/rig/rig_at_rest.hpp"

/// isorig calibrate: readings of a running daemon against a reference; the daemon keeps the record and puts it in
/// force.
namespace isorig::cli {
namespace {

using calibration::Channel;
using calibration::Mode;

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

/// What is known before the first point.
calibration::Record begun_record(const CalibrateOptions& o, Channel channel, Mode mode, double factor,
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
bool may_pressurize(const CalibrateOptions& o, const nlohmann::json& limits) {
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
void measure_points(const Client& client, const CalibrateOptions& o, double factor, const nlohmann::json& limits,
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
int keep(const Client& client, const CalibrateOptions& o, const calibration::Record& r) {
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

int calibrate(CalibrateOptions& o) {
  const Client client(o.socket);
  if (o.what == "list") return list_calibrations(client, o.json);
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
  auto o = std::make_shared<CalibrateOptions>();
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
      ->check(within(9.76, 9.84))
      ->capture_default_str();
  sub->add_option("--window-s", o->window_s, "A reading is the mean over this")
      ->check(within(0.5, 10.0))
      ->capture_default_str();
  sub->add_option("--settle-s", o->settle_s, "How long a reading may take to settle")
      ->check(within(0.0, 3600.0))
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

const Registration kCalibrate(21, add_calibrate);

}  // namespace
}  // namespace isorig::cli
