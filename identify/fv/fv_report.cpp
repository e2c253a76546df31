#include "identify/fv/fv_report.hpp"

#include <algorithm>
#include <cmath>
#include <set>

namespace isorig::identify {
namespace {

using report::Figure;
using report::interval_text;
using report::number_text;
using report::Page;

std::string with_error(const Estimate& e) {
  if (!std::isfinite(e.value)) return "-";
  int digits = 4;
  if (e.standard_error > 0.0 && e.value != 0.0)
    digits = std::clamp(static_cast<int>(std::ceil(std::log10(std::abs(e.value) / e.standard_error))) + 2, 2, 7);
  return number_text(e.value, digits) + " ± " + number_text(e.standard_error, 2);
}
std::string with_error(const std::optional<Estimate>& e) {
  return e ? with_error(*e) : "-";
}
std::string text_of(const std::optional<double>& v, int digits = 4) {
  return v ? number_text(*v, digits) : "-";
}

std::string file_name_of(std::string text) {
  for (char& c : text)
    if (!((c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '-')) c = '_';
  return text;
}

void ramps_rows(Page& page, const RecordingResult& r) {
  std::vector<std::vector<std::string>> rows;
  for (const Ramp& p : r.ramps.ramps) {
    std::string flags;
    for (RampFlag f : p.flags) {
      flags += (flags.empty() ? "" : "; ") + std::string(text(f));
      if (f == RampFlag::kOvershot) flags += " by " + number_text(1000.0 * p.overshoot_mm, 3) + " µm";
      if (f == RampFlag::kUnsteadyStart) flags += " (" + with_error(*p.drift_N_s) + " N/s)";
    }
    rows.push_back({number_text(p.move.t_start_s, 7), number_text(p.move.stroke_mm(), 4),
                    with_error(p.move.velocity_mm_s), with_error(p.strain_rate_per_s), with_error(p.start_force_N),
                    with_error(p.drift_N_s), with_error(p.peak_force_N), with_error(p.normalized_force),
                    text_of(p.pressure_change_psi, 2), flags});
  }
  page.table({"start (s)", "stroke (mm)", "velocity (mm/s)", "strain rate (1/s)", "F0 (N)", "drift of F0 (N/s)",
              "force at target (N)", "F/F0", "pressure change (psi)", "remarks"},
             rows, r.path + ": " + std::to_string(rows.size()) + " iso-velocity ramps");
}

void series_table(Page& page, const RecordingResult& r) {
  std::vector<std::vector<std::string>> rows;
  for (const SeriesFit& s : r.series)
    for (std::size_t j = 0; j < s.arms.size(); ++j)
      rows.push_back({j == 0 ? std::to_string(s.arms.size()) + (s.arms.size() == 1 ? " arm" : " arms") : "",
                      j == 0 ? with_error(s.stiffness_N_mm) : "", with_error(s.arms[j].stiffness_N_mm),
                      number_text(s.arms[j].kappa, 4), with_error(s.arms[j].gamma_per_s),
                      j == 0 ? number_text(s.rms_N, 3) : "", j == 0 ? report::r_squared_text(s.r_squared) : "",
                      j == 0 ? number_text(s.residual_correlation, 2) : "", j == 0 ? number_text(s.bic, 7) : ""});
  page.table({"model", "k1 (N/mm)", "k2 (N/mm)", "κ", "γ (1/s)", "rms (N)", "R²", "residual correlation", "BIC"}, rows,
             "Fit to all " + std::to_string(r.samples) + " samples of " + r.path +
                 ". The lower BIC is the better model; a residual correlation far from 0 means that neither "
                 "explains "
                 "the record, and the errors are then too small.");
  std::vector<std::string> statements;
  for (const SeriesFit& s : r.series)
    for (const auto& text : s.statements)
      statements.push_back(std::to_string(s.arms.size()) + (s.arms.size() == 1 ? " arm: " : " arms: ") + text);
  page.list(statements);
}

void parameters_rows(Page& page, const FvAnalysis& analysis) {
  std::vector<std::vector<std::string>> rows;
  for (const Curve& c : analysis.curves) {
    std::vector<std::string> row{c.specimen, text_of(c.nominal_pressure_psi, 3), std::to_string(c.points.size())};
    if (c.result.fit) {
      for (const FittedParameter& p : c.result.fit->parameters) row.push_back(value_text(p));
      row.push_back(report::r_squared_text(c.result.fit->r_squared));
      const auto test = model::FvTest{c.strain_step, c.initial_strain};
      row.push_back(number_text(model::fv_asymptote(c.result.fit->elements, test), 3));
    } else {
      row.push_back(c.result.refusal);
    }
    rows.push_back(std::move(row));
  }
  std::vector<std::string> header{"specimen", "pressure (psi)", "points", "κ [95 %]", "γ (1/s) [95 %]"};
  if (analysis.model == FvModel::kSlse2) {
    header[3] = "κ sheath [95 %]";
    header[4] = "γ sheath (1/s) [95 %]";
    header.push_back("β sheath [95 %]");
  }
  header.push_back("R²");
  header.push_back("asymptote ΔFV(∞)");
  page.table(header, rows,
             "Fitted parameters. Without brackets: not identifiable from these velocities, and this is all "
             "that is known (95 %).");
}

}  // namespace

std::string value_text(const FittedParameter& p) {
  const bool low = std::isfinite(p.low), high = std::isfinite(p.high);
  if (p.identifiable) return interval_text(p.value, p.low, p.high);
  if (low && high) return number_text(p.low, 2) + " .. " + number_text(p.high, 2);
  if (high) return "< " + number_text(p.high, 3);
  if (low) return "> " + number_text(p.low, 3);
  return "undetermined";
}

std::string title_of(const Curve& curve) {
  return curve.specimen +
         (curve.nominal_pressure_psi ? " at " + number_text(*curve.nominal_pressure_psi, 3) + " psi" : "");
}

void add_parameters_table(Page& page, const FvAnalysis& analysis) {
  parameters_rows(page, analysis);
}

void add_ramps_table(Page& page, const RecordingResult& recording) {
  ramps_rows(page, recording);
}

std::string r_squared_of(const FvAnalysis& analysis) {
  double low = 2.0, high = -1e300;
  for (const Curve& c : analysis.curves) {
    if (!c.result.fit || !std::isfinite(c.result.fit->r_squared)) continue;
    low = std::min(low, c.result.fit->r_squared);
    high = std::max(high, c.result.fit->r_squared);
  }
  if (high < low) return {};
  const std::string from = report::r_squared_text(low), to = report::r_squared_text(high);
  return "R² " + (from == to ? from : from + " to " + to);
}

namespace {

void add_lead(Page& page, const FvAnalysis& analysis) {
  std::size_t fitted = 0, open = 0, ramps = 0, usable = 0;
  for (const Curve& c : analysis.curves) {
    if (!c.result.fit) continue;
    ++fitted;
    for (const FittedParameter& p : c.result.fit->parameters) open += p.identifiable ? 0 : 1;
  }
  for (const RecordingResult& r : analysis.recordings)
    for (const Ramp& p : r.ramps.ramps) {
      ++ramps;
      usable += p.usable() ? 1 : 0;
    }
  const auto count = [](std::size_t n, const char* what) {
    return std::to_string(n) + " " + what + (n == 1 ? "" : "s");
  };
  std::string text = count(ramps, "iso-velocity ramp") + ", " + std::to_string(usable) + " of them usable; " +
                     std::to_string(fitted) + " of " + count(analysis.curves.size(), "curve") + " fitted";
  if (const auto r2 = r_squared_of(analysis); !r2.empty()) text += ", " + r2;
  text += ".";
  if (open > 0)
    text += " " + count(open, "number") + " cannot be identified from these velocities: the table says what is known.";
  const bool fine = fitted == analysis.curves.size() && fitted > 0;
  page.lead(fitted == 0         ? report::Mood::kBad
            : fine && open == 0 ? report::Mood::kGood
                                : report::Mood::kWarning,
            fitted == 0 ? "no fit"
            : fine      ? "fitted"
                        : "fitted in part",
            text);
}

void add_curve(Page& page, const FvAnalysis& analysis, const Curve& curve, std::size_t number) {
  page.heading(title_of(curve));
  std::vector<std::string> statements;
  if (!curve.result.fit) statements.push_back(curve.result.refusal);
  if (curve.result.fit)
    for (const auto& s : curve.result.fit->statements) statements.push_back(s);
  for (std::size_t i : curve.recordings)
    for (const auto& s : analysis.recordings[i].ramps.statements)
      statements.push_back(analysis.recordings[i].path + ": " + s);
  page.list(statements);
  const std::string stem = std::to_string(number) + "_" + file_name_of(title_of(curve));
  if (!curve.means.empty()) {
    Figure figure{"curve_" + stem,
                  "Left: force-velocity points and fitted model (" +
                      std::string(analysis.model == FvModel::kSlse1 ? "1-SLSE" : "2-SLSE, control held") +
                      "). Right: force over F0 during and after the ramps, both directions.",
                  {curve_panel(curve), overlay_panel(analysis, curve)},
                  2};
    for (auto& panel : figure.panels) panel.title.clear();
    page.figure(figure);
  }
  for (std::size_t i : curve.recordings) {
    const RecordingResult& r = analysis.recordings[i];
    if (r.history.force_N.empty()) continue;
    if (i != curve.recordings.front()) continue;
    page.figure(history_figure(r.history, "history_" + stem,
                               r.path + ": force, position and pressure over the whole recording. Bands reach from the "
                                        "lowest to the highest reading of each stretch, lines are means."));
  }
  page.begin_more("Profiles, every ramp, and fits to the whole record");
  if (curve.result.fit) {
    Figure profiles{
        "profiles_" + stem,
        "Profile likelihood: the least sum of squares at each value of one parameter, all others refitted. A "
        "curve that does not cross the dashed line leaves that side open.",
        {},
        static_cast<int>(curve.result.fit->parameters.size())};
    for (const auto& p : curve.result.fit->parameters) profiles.panels.push_back(profile_panel(*curve.result.fit, p));
    page.figure(profiles);
  }
  for (std::size_t i : curve.recordings) {
    const RecordingResult& r = analysis.recordings[i];
    if (curve.recordings.size() <= 5 && !r.ramps.ramps.empty()) add_ramps_table(page, r);
    if (!r.series.empty() && i == curve.recordings.front()) series_table(page, r);
    if (!r.series_refusal.empty()) page.paragraph(r.path + ": " + r.series_refusal);
  }
  page.end_more();
}

}  // namespace

void write_fv_report(const FvAnalysis& analysis, const std::filesystem::path& folder, const report::Made& made) {
  std::set<std::string> specimens;
  std::string names;
  for (const Curve& c : analysis.curves)
    if (specimens.insert(c.specimen).second) names += (names.empty() ? "" : ", ") + c.specimen;
  Page page("Force-velocity analysis", names.empty() ? "no curve" : names);
  page.made(made);
  for (const char* table : {"fv.json", "curves.csv", "parameters.csv", "ramps.csv", "moves.csv"})
    page.link(table, table);
  add_lead(page, analysis);
  page.paragraph(
      "Iso-velocity ramps are found in the position signal; F0 is the force before a ramp, F the force where the "
      "position "
      "first reaches its target; strains and rates are relative to the pressurized rest length. Shortening velocity is "
      "the negative of the extension strain rate. ± are standard errors, brackets 95 % profile-likelihood intervals.");
  if (const Figure all = all_curves_figure(analysis, "force_velocity_curves"); !all.panels.empty()) page.figure(all);
  add_parameters_table(page, analysis);
  if (const auto over = parameters_over_pressure(analysis)) page.figure(*over);
  std::size_t number = 0;
  for (const Curve& curve : analysis.curves) add_curve(page, analysis, curve, ++number);
  page.write(folder, "fv-report.html");
}

}  // namespace isorig::identify
