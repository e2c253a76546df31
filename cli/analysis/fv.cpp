#include <cmath>
#include <cstdio>
#include <iostream>
#include <memory>
#include <optional>

#include "base/lock_file.hpp"
#include "base/printable.hpp"
#include "cli/analysis/analyse_recordings.hpp"
#include "cli/command.hpp"
#include "cli/provenance.hpp"
#include "identify/diagnose/guard/plausible.hpp"
#include "identify/fv/fv_report.hpp"
#include "model/composed.hpp"

namespace isorig::cli {
namespace {

struct FvCommandOptions {
  std::vector<std::string> recordings;
  std::string out;
  std::string model = "slse1";
  std::string control;
  std::string control_specimen;
  bool no_report = false;
};

void print_curve(const identify::Curve& curve) {
  std::printf("%s: %zu points", base::printable(identify::title_of(curve)).c_str(), curve.points.size());
  if (!curve.result.fit) {
    std::printf("\n  %s\n", curve.result.refusal.c_str());
    return;
  }
  if (std::isfinite(curve.result.fit->r_squared)) {
    std::printf(", R² %s\n", identify::report::r_squared_text(curve.result.fit->r_squared).c_str());
  } else {
    std::printf(", no R²: the points have no spread\n");
  }
  for (const auto& p : curve.result.fit->parameters) {
    const auto words = identify::words_of(p.name);
    const std::string unit = words.unit.empty() ? "" : " " + std::string(words.unit);
    const bool bounded = std::isfinite(p.low) || std::isfinite(p.high);
    std::printf("  %s%s%s: %s [%s]\n", identify::value_text(p).c_str(), bounded ? unit.c_str() : "",
                p.identifiable ? "" : " (not identifiable)", std::string(words.words).c_str(), p.name.c_str());
  }
  for (const auto& s : curve.result.fit->statements) std::printf("  %s\n", s.c_str());
}

int fv(const FvCommandOptions& options) {
  const bool two = options.model == "slse2";
  std::vector<identify::ControlFit> controls;
  if (two && options.control.empty()) {
    std::cerr << "isorig fv: --model slse2 needs --control FV.json, the 1-SLSE analysis of the control actuator\n";
    return kUsage;
  }
  if (!two && !options.control.empty()) {
    std::cerr << "isorig fv: --control is for --model slse2 alone; leave it out, or name the model\n";
    return kUsage;
  }
  if (std::error_code error;
      two && std::filesystem::equivalent(options.control, std::filesystem::path(options.out) / "fv.json", error)) {
    std::cerr << options.control << ": is the control's own analysis, and this one would take its place; name another "
              << "folder with --out\n";
    return kFailure;
  }
  if (two) {
    try {
      controls = identify::read_controls(options.control, options.control_specimen);
    } catch (const std::exception& e) {
      std::cerr << e.what() << '\n';
      return kBadInput;
    }
  }
  const auto plausible = [nominal = model::nominal_model("slse1")](const messages::Recording& recording,
                                                                   const std::string& path) {
    identify::refuse_implausible(recording, path, nominal,
                                 identify::channel_quality(recording.frame.t_s, recording.frame.position_mm));
  };
  if (std::error_code error; std::filesystem::exists(std::filesystem::path(options.out) / "recording.toml", error)) {
    std::cerr << options.out << ": is a recording, whose own ramps.csv would be lost; name another folder with --out\n";
    return kFailure;
  }
  const base::FolderLock alone(options.out);
  constexpr double kReadShare = 0.3;
  auto [results, exit_code, left_out] = analyse_recordings("fv", options.recordings, kReadShare, {}, plausible);
  if (exit_code != kOk) return exit_code;
  const auto analysis = identify::analyse_curves(std::move(results),
                                                 two ? identify::FvModel::kSlse2 : identify::FvModel::kSlse1, controls);
  identify::write_fv_tables(analysis, options.out);
  // That of an earlier analysis would be taken for this one's.
  std::filesystem::remove(std::filesystem::path(options.out) / "fv-report.html");
  if (!options.no_report) {
    std::vector<std::pair<std::string, std::string>> inputs;
    for (const auto& r : analysis.recordings) inputs.emplace_back("Recording", r.path);
    if (two) inputs.emplace_back("Control", options.control);
    identify::write_fv_report(analysis, options.out, made_by_this_call(std::move(inputs)));
  }
  bool fitted = false;
  for (const auto& r : analysis.recordings)
    for (const auto& s : r.ramps.statements) std::printf("%s: %s\n", r.path.c_str(), s.c_str());
  for (const auto& curve : analysis.curves) {
    print_curve(curve);
    fitted = fitted || curve.result.fit.has_value();
  }
  std::printf("In square brackets behind a number: its 95 %% interval.\nwritten to %s\n", options.out.c_str());
  return fitted ? kOk : kFailure;
}

Command add_fv(CLI::App& app) {
  auto options = std::make_shared<FvCommandOptions>();
  auto* sub = app.add_subcommand("fv", "Ramps, force-velocity points and their fits, from recordings");
  sub->add_option("RECORDING", options->recordings,
                  "Recording folders; those of one specimen and pressure are repetitions")
      ->required();
  sub->add_option("--out", options->out, "Folder for fv.json, tables and fv-report.html")->required();
  sub->add_option("--model", options->model, "slse1: a control; slse2: a sheath on a control whose parameters are held")
      ->check(CLI::IsMember({"slse1", "slse2"}));
  sub->add_option("--control", options->control, "fv.json of the control actuator (for slse2)");
  sub->add_option("--control-specimen", options->control_specimen, "which specimen of that file, if it has several");
  sub->add_flag("--no-report", options->no_report, "Tables only");
  sub->add_flag_callback("--undated", leave_the_time_out,
                         "No time on the page: the same recordings give the same bytes");
  return {sub, [options] { return fv(*options); }};
}

const Registration kFv(32, add_fv);

}  // namespace
}  // namespace isorig::cli
