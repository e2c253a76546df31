#include <array>
#include <cstdio>
#include <memory>
#include <optional>

#include "base/printable.hpp"
#include "calibration/date.hpp"
#include "cli/command.hpp"
#include "cli/protocols/protocol_input.hpp"
#include "daemon/host/paths.hpp"
#include "daemon/rig/calibrations.hpp"

namespace isorig::cli {
namespace {

struct CheckOptions {
  std::string protocol_path;
  std::string rig_path;
  std::string runs = daemon::default_runs().string();
};

void print_steps(const protocol::Plan& plan) {
  std::array<std::size_t, 6> count{};
  for (const auto& step : plan.steps) ++count[static_cast<std::size_t>(step.kind)];
  std::printf("  steps       %zu:", plan.steps.size());
  const char* joint = " ";
  for (std::size_t kind = 0; kind < count.size(); ++kind) {
    if (count[kind] == 0) continue;
    std::printf("%s%zu %s", joint, count[kind], protocol::name_of(static_cast<protocol::StepKind>(kind)));
    joint = ", ";
  }
  std::printf("\n");
}

/// As the daemon reads it; throws what it would refuse. Nothing: the file has [limits] and does not say that it is a
/// rig.
std::optional<daemon::RigConfig> whole_rig(const std::string& path) {
  if (path.empty()) return std::nullopt;
  const auto document = base::TomlDocument::parse_file(path);
  const auto root = document.root();
  root.ignore_rest();
  if (!root.has("format")) return std::nullopt;
  return daemon::load_rig(path);
}

/// False when the rig would refuse to start.
bool print_calibration(const CheckOptions& options, const std::optional<daemon::RigConfig>& rig) {
  if (!rig) {
    std::printf("  calibration not looked at: %s has the limits of a rig, and is none\n", options.rig_path.c_str());
    return true;
  }
  const auto store = daemon::open_records(*rig, options.runs);
  const auto overdue = store.overdue(calibration::today());
  std::string never;
  for (const auto c : calibration::kChannels) {
    if (store.in_force(c).record == nullptr) never += (never.empty() ? "" : ", ") + std::string(name_of(c));
  }
  for (const auto& text : overdue) {
    std::printf("  calibration %s: %s\n", rig->calibration.refuse_overdue ? "REFUSED" : "WARNING", text.c_str());
  }
  if (!never.empty()) std::printf("  calibration no record of %s in %s\n", never.c_str(), store.directory().c_str());
  if (overdue.empty() && never.empty()) std::printf("  calibration all channels within their dates\n");
  return overdue.empty() || !rig->calibration.refuse_overdue;
}

int check(const CheckOptions& options) {
  const auto plan = read_plan(options.protocol_path, options.rig_path);
  const auto rig = whole_rig(options.rig_path);
  std::printf("%s is well: %s\n", options.protocol_path.c_str(), base::printable(plan.name).c_str());
  if (!plan.description.empty()) std::printf("  %s\n", base::printable(plan.description).c_str());
  std::printf("  duration    %s expected (%.1f s); %s at worst, if every settle and pressurize runs out of time\n",
              duration_text(plan.nominal_s).c_str(), plan.nominal_s, duration_text(plan.worst_s).c_str());
  print_steps(plan);
  std::printf("  sessions    %zu: \"%s\"", plan.sessions.size(), plan.sessions.front().label.c_str());
  if (plan.sessions.size() > 1) std::printf(" to \"%s\"", plan.sessions.back().label.c_str());
  std::printf("\n  travel      %.6g mm, between %+.6g and %+.6g mm of the rest length\n", plan.travel_mm,
              plan.position_min_mm, plan.position_max_mm);
  std::printf("  peak speed  %.6g mm/s\n", plan.peak_speed_mm_s);
  std::printf("  pressure    up to %.6g psi\n", plan.pressure_max_psi);
  std::printf("  recording   full rate for %s, elsewhere a mean, minimum and maximum per %.6g s\n",
              duration_text(plan.full_rate_s).c_str(), plan.recording.average_interval_s);
  if (options.rig_path.empty()) {
    std::printf("  limits      NOT checked; add --rig config/rigs/....toml\n");
  } else {
    std::printf("  limits      within those of %s\n", options.rig_path.c_str());
    for (const auto& text : plan.warnings) std::printf("  WARNING     %s\n", base::printable(text).c_str());
    if (!print_calibration(options, rig)) return kRefused;
  }
  return kOk;
}

Command add_check(CLI::App& app) {
  auto options = std::make_shared<CheckOptions>();
  auto* sub = app.add_subcommand("check", "Compile a protocol; show what it would do, or everything wrong with it");
  sub->add_option("FILE", options->protocol_path, "Protocol (config/protocols/*.toml)")->required();
  sub->add_option("--rig", options->rig_path, "Rig whose limits it has to keep (config/rigs/*.toml)");
  sub->add_option("--runs", options->runs, "Where runs and calibration records are kept")->capture_default_str();
  return {sub, [options] { return check(*options); }};
}

const Registration kCheck(1, add_check);

}  // namespace
}  // namespace isorig::cli
