#include "cli/rig/calibrate_words.hpp"

#include <unistd.h>

#include <functional>
#include <iostream>

#include "base/decimal.hpp"
#include "base/formatted.hpp"
#include "calibration/date.hpp"
#include "cli/rig/rig_at_rest.hpp"

namespace isorig::cli {

using calibration::Channel;
using calibration::Mode;

namespace {

double parse(const std::string& text, const std::string& whose) {
  std::string why;
  if (const auto value = base::decimal(text, why)) return *value;
  throw std::runtime_error(whose + ": " + why +
                           (why.find("behind the number") == std::string::npos ? "" : " (another unit: --unit)"));
}

}  // namespace

double factor_of(const CalibrateOptions& o, Channel channel) {
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

std::optional<double> References::next(const std::string& what) {
  if (!options_.reference_command.empty())
    return factor_ * parse(output_of(options_.reference_command), "the reference command");
  if (!options_.points.empty()) {
    if (used_ == options_.points.size()) return std::nullopt;
    const double value = options_.points[used_++];
    // Each has to be put on the rig: read one after the other they would all be the first.
    if (options_.points.size() > 1 && options_.drive.empty() &&
        !ask("apply " + base::formatted("%.6g", value) + ' ' + unit_ + ", let it settle, press Enter: ")) {
      throw std::runtime_error("point " + std::to_string(used_) + " was not applied: the input ended; nothing is kept");
    }
    return factor_ * value;
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

void complete(CalibrateOptions& o) {
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
  if (!missing.empty())
    throw UsageError("a record says who calibrated against what, until when; still to be named:" + missing);
}

void check_words(const CalibrateOptions& o, Channel channel, Mode mode) {
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
  throw std::runtime_error(base::formatted("reference %.6g %s is outside %s (%.6g to %.6g %s); check its unit (--unit)",
                                           value, unit_of(channel), whose.c_str(), low, high, unit_of(channel)));
}

}  // namespace isorig::cli
