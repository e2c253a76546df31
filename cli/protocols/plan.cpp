#include <cmath>
#include <cstdio>
#include <iostream>
#include <memory>
#include <nlohmann/json.hpp>

#include "base/formatted.hpp"
#include "cli/command.hpp"
#include "cli/protocols/protocol_input.hpp"

namespace isorig::cli {
namespace {

struct PlanOptions {
  std::string protocol_path;
  std::string rig_path;
  bool json = false;
};

std::string clock_text(double seconds) {
  const auto tenths = std::llround(seconds * 10.0);
  return base::formatted("%3lld:%02lld:%02lld.%lld", tenths / 36000, tenths / 600 % 60, tenths / 10 % 60, tenths % 10);
}

const char* keep_text(const protocol::Step& step) {
  return step.keep == protocol::Keep::kFull ? "full" : "averaged";
}

void print_table(const protocol::Plan& plan) {
  std::printf("%s: %zu steps, %s expected\n", plan.name.c_str(), plan.steps.size(),
              duration_text(plan.nominal_s).c_str());
  std::printf("%11s  %5s  %9s  %-8s  %s\n", "start", "step", "lasts (s)", "recorded", "what");
  std::uint32_t session = protocol::kNoSession;
  for (const auto& step : plan.steps) {
    if (step.session != session && step.session != protocol::kNoSession) {
      std::printf("-- %s\n", plan.sessions[step.session].label.c_str());
    }
    session = step.session;
    std::printf("%11s  %5u  %9.2f  %-8s  %s\n", clock_text(step.start_s).c_str(), step.index, step.nominal_s,
                keep_text(step), protocol::describe(step).c_str());
  }
  std::printf("%11s  %5s  %9s  %-8s  vented, frame holds\n", clock_text(plan.nominal_s).c_str(), "end", "", "");
}

nlohmann::ordered_json to_json(const protocol::Step& step) {
  using protocol::StepKind;
  nlohmann::ordered_json out{{"index", step.index}, {"do", protocol::name_of(step.kind)}};
  if (step.session != protocol::kNoSession) out["session"] = step.session;
  out.update({{"start_s", step.start_s},
              {"nominal_s", step.nominal_s},
              {"worst_s", step.worst_s},
              {"position_before_mm", step.position_before_mm},
              {"position_after_mm", step.position_after_mm},
              {"pressure_psi", step.pressure_psi},
              {"record", keep_text(step)},
              {"line", step.line},
              {"column", step.column},
              {"text", protocol::describe(step)}});
  switch (step.kind) {
    case StepKind::kPressurize:
      out.update({{"tolerance_psi", step.tolerance_psi},
                  {"rate_psi_s", step.rate_psi_s},
                  {"settled_for_s", step.settled_for_s},
                  {"timeout_s", step.timeout_s}});
      break;
    case StepKind::kSettle:
      out.update({{"force_slope_N_s", step.force_slope_N_s},
                  {"window_s", step.window_s},
                  {"settled_for_s", step.settled_for_s},
                  {"timeout_s", step.timeout_s},
                  {"on_timeout", step.on_timeout == protocol::OnTimeout::kStop ? "stop" : "continue"}});
      break;
    case StepKind::kRamp:
      out.update({{"to_mm", step.target_mm}, {"velocity_mm_s", step.velocity_mm_s}});
      break;
    case StepKind::kHold:
      out["duration_s"] = step.duration_s;
      break;
    case StepKind::kWave:
      out.update({{"shape", step.shape == protocol::WaveShape::kSine ? "sine" : "triangle"},
                  {"amplitude_mm", step.amplitude_mm},
                  {"frequency_hz", step.frequency_hz},
                  {"reached_hz", step.reached_hz},
                  {"peak_velocity_mm_s", step.velocity_mm_s},
                  {"cycles", step.cycles}});
      if (step.shape == protocol::WaveShape::kSine) {
        out.update({{"segments_per_cycle", 4 * step.segments_per_quarter}, {"deviation_mm", step.deviation_mm}});
      }
      break;
    case StepKind::kMark:
      out["label"] = step.label;
      break;
  }
  return out;
}

nlohmann::ordered_json to_json(const protocol::Plan& plan) {
  static constexpr const char* kModes[] = {"round_ramps", "full", "averaged"};
  nlohmann::ordered_json out{{"format", "isorig-plan/1"},
                             {"name", plan.name},
                             {"description", plan.description},
                             {"source", plan.source},
                             {"nominal_s", plan.nominal_s},
                             {"worst_s", plan.worst_s},
                             {"full_rate_s", plan.full_rate_s},
                             {"travel_mm", plan.travel_mm},
                             {"peak_speed_mm_s", plan.peak_speed_mm_s},
                             {"position_min_mm", plan.position_min_mm},
                             {"position_max_mm", plan.position_max_mm},
                             {"pressure_max_psi", plan.pressure_max_psi},
                             {"approach_velocity_mm_s", plan.approach_velocity_mm_s}};
  out["recording"] = {{"policy", kModes[static_cast<std::size_t>(plan.recording.mode)]},
                      {"before_s", plan.recording.before_s},
                      {"after_s", plan.recording.after_s},
                      {"average_interval_s", plan.recording.average_interval_s}};
  out["sessions"] = nlohmann::ordered_json::array();
  for (const auto& session : plan.sessions) {
    out["sessions"].push_back({{"label", session.label},
                               {"repetition", session.repetition},
                               {"pressure_psi", session.pressure_psi},
                               {"position_mm", session.position_mm},
                               {"first_step", session.first_step},
                               {"last_step", session.last_step}});
  }
  out["steps"] = nlohmann::ordered_json::array();
  for (const auto& step : plan.steps) out["steps"].push_back(to_json(step));
  return out;
}

int show_plan(const PlanOptions& options) {
  const auto plan = read_plan(options.protocol_path, options.rig_path);
  if (options.json) {
    std::cout << to_json(plan).dump(1) << '\n';
  } else {
    print_table(plan);
  }
  return kOk;
}

Command add_plan(CLI::App& app) {
  auto options = std::make_shared<PlanOptions>();
  auto* sub = app.add_subcommand("plan", "List a protocol's steps with their expected start times");
  sub->add_option("FILE", options->protocol_path, "Protocol (config/protocols/*.toml)")->required();
  sub->add_option("--rig", options->rig_path, "Rig whose limits it has to keep (config/rigs/*.toml)");
  sub->add_flag("--json", options->json, "For scripts: everything, as JSON");
  return {sub, [options] { return show_plan(*options); }};
}

const Registration kPlan(2, add_plan);

}  // namespace
}  // namespace isorig::cli
