#include "cli/rig/calibrate_print.hpp"

#include <cstdio>
#include <iostream>

#include "cli/screen/exit_codes.hpp"

namespace isorig::cli {

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

int list_calibrations(const Client& client, bool as_json) {
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

}  // namespace isorig::cli
