#include "identify/fv/fv_report.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <set>

namespace isorig::identify {
namespace {

using report::Figure;
using report::interval_text;
using report::Mark;
using report::number_text;
using report::Page;
using report::Panel;
using report::Series;

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

/// "kappa" as it is written in formulas, with its unit.
std::string symbol_of(std::string_view parameter) {
  if (parameter == "kappa") return "κ";
  if (parameter == "gamma_per_s") return "γ (1/s)";
  if (parameter == "beta") return "β";
  return std::string(parameter);
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

double fastest_per_s(const Curve& curve) {
  double fastest = 0.0;
  for (const CurvePoint& p : curve.means) fastest = std::max(fastest, std::abs(p.strain_rate_per_s));
  return fastest;
}

report::Series measured_points(const Curve& curve) {
  Series points;
  points.mark = Mark::kLinePoints;
  for (auto it = curve.means.rbegin(); it != curve.means.rend(); ++it) {
    const double v = -it->strain_rate_per_s;
    if (!points.x.empty() && points.x.back() < 0.0 && v > 0.0) {
      points.x.push_back(0.0);
      points.y.push_back(std::nan(""));
      points.error.push_back(std::nan(""));
    }
    points.x.push_back(v);
    points.y.push_back(it->normalized_force);
    points.error.push_back(it->repetitions > 1 ? it->normalized_force_sd : it->standard_error);
  }
  return points;
}

report::Series fitted_line(const Curve& curve, std::span<const model::FvElement> elements) {
  const model::FvTest test{curve.strain_step, curve.initial_strain};
  const double widest = fastest_per_s(curve);
  Series s;
  for (int i = -120; i <= 120; ++i) {
    if (i == 0) {  // the curve jumps there
      s.x.push_back(0.0);
      s.y.push_back(std::nan(""));
    }
    // Dense near zero, where the curve bends.
    const double u = (i == 0 ? 1e-5 : i / 120.0);
    const double v = 1.08 * widest * u * std::abs(u);
    s.x.push_back(v);
    s.y.push_back(model::force_velocity(elements, test, -v));
  }
  return s;
}

report::Panel curve_panel(const Curve& curve) {
  Panel panel;
  panel.title = title_of(curve);
  panel.x_label = "shortening velocity (1/s)";
  panel.y_label = "F/F0";
  Series points = measured_points(curve);
  points.color = 0;
  const bool repeated =
      std::any_of(curve.means.begin(), curve.means.end(), [](const CurvePoint& p) { return p.repetitions > 1; });
  points.label = repeated ? "measured, mean ± 1 SD" : "measured ± 1 SE";
  panel.series.push_back(std::move(points));
  if (curve.result.fit && fastest_per_s(curve) > 0.0) {
    Series fit = fitted_line(curve, curve.result.fit->elements);
    fit.color = 1;
    fit.label = "fit";
    panel.series.push_back(std::move(fit));
    if (curve.control) {
      Series control = fitted_line(curve, std::vector<model::FvElement>{*curve.control});
      control.mark = Mark::kDashes;
      control.color = 6;
      control.label = "control (1-SLSE)";
      panel.series.push_back(std::move(control));
    }
  }
  return panel;
}

report::Panel overlay_panel(const FvAnalysis& analysis, const Curve& curve) {
  Panel panel;
  panel.title = title_of(curve) + ", ramps overlaid";
  panel.x_label = "time from start of ramp (s)";
  panel.y_label = "F/F0";
  double longest = 0.0;
  for (std::size_t i : curve.recordings)
    for (const RampTrace& t : analysis.recordings[i].traces) {
      Series s;
      s.x = t.t_s;
      s.y = t.force;
      s.width = 0.9;
      panel.series.push_back(std::move(s));
      longest = std::max(longest, t.t_s.empty() ? 0.0 : t.t_s.back());
    }
  // Colours by speed, once all speeds are known.
  // To two digits, as in the key: 0.01 mm/s and 0.5 mm/s are two colours, 1.998 and 2.001 one.
  const auto speed_of = [](const RampTrace& t) {
    return std::strtod(number_text(std::abs(t.velocity_mm_s), 2).c_str(), nullptr);
  };
  std::set<double> speeds;
  for (std::size_t i : curve.recordings)
    for (const RampTrace& t : analysis.recordings[i].traces) speeds.insert(speed_of(t));
  std::size_t k = 0;
  std::set<double> shown;
  for (std::size_t i : curve.recordings)
    for (const RampTrace& t : analysis.recordings[i].traces) {
      const double speed = speed_of(t);
      panel.series[k].color = static_cast<int>(std::distance(speeds.begin(), speeds.find(speed))) % 6;
      if (shown.insert(speed).second) panel.series[k].label = number_text(speed, 2) + " mm/s";
      ++k;
    }
  panel.x_range = {{-0.5, std::min(longest, 4.0)}};
  return panel;
}

report::Panel profile_panel(const FvFit& fit, const FittedParameter& parameter) {
  Panel panel;
  panel.x_label = symbol_of(parameter.name);
  panel.y_label = "sum of squares / least";
  panel.log_x = parameter.profile.back().value > 5.0 * parameter.profile.front().value;
  Series s;
  s.mark = Mark::kLine;
  double least = fit.profile_limit;
  for (const ProfilePoint& p : parameter.profile) least = std::min(least, p.sum_of_squares);
  if (!(least > 0.0)) least = fit.profile_limit;
  const double limit = fit.profile_limit / least;
  for (const ProfilePoint& p : parameter.profile) {
    s.x.push_back(p.value);
    s.y.push_back(std::min(p.sum_of_squares / least, 3.0 * limit));
  }
  Series level{{s.x.front(), s.x.back()}, {limit, limit}, "95 % limit", Mark::kDashes};
  level.color = 7;
  panel.series = {s, level};
  panel.y_range = {{1.0 - 0.05 * (limit - 1.0), 1.0 + 2.0 * (limit - 1.0)}};
  panel.x_range = {{s.x.front(), s.x.back()}};
  panel.verticals = {{parameter.value, ""}};
  return panel;
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

report::Figure all_curves_figure(const FvAnalysis& analysis, const std::string& name) {
  Figure figure{
      name,
      "Force over F0 against shortening velocity, all pressures together: points are measured (mean ± 1 SD over "
      "repetitions, or ± 1 SE of one ramp), lines are the fits (" +
          std::string(analysis.model == FvModel::kSlse1 ? "1-SLSE" : "2-SLSE, the control's numbers held") +
          "). Nothing joins shortening and lengthening: the curve jumps at zero.",
      {}};
  std::vector<double> pressures;
  std::vector<std::string> specimens;
  for (const Curve& c : analysis.curves) {
    if (c.nominal_pressure_psi && std::ranges::find(pressures, *c.nominal_pressure_psi) == pressures.end())
      pressures.push_back(*c.nominal_pressure_psi);
    if (std::ranges::find(specimens, c.specimen) == specimens.end()) specimens.push_back(c.specimen);
  }
  std::ranges::sort(pressures);
  for (const std::string& specimen : specimens) {
    Panel panel;
    if (specimens.size() > 1) panel.title = specimen;
    panel.x_label = "shortening velocity (1/s)";
    panel.y_label = "F/F0";
    for (const Curve& c : analysis.curves) {
      if (c.specimen != specimen || c.means.empty()) continue;
      const auto at =
          c.nominal_pressure_psi ? std::ranges::find(pressures, *c.nominal_pressure_psi) - pressures.begin() : 0;
      Series points = measured_points(c);
      points.mark = Mark::kPoints;
      points.color = static_cast<int>(at % 8);
      points.label = c.nominal_pressure_psi ? number_text(*c.nominal_pressure_psi, 3) + " psi" : "measured";
      panel.series.push_back(points);
      if (!c.result.fit || !(fastest_per_s(c) > 0.0)) continue;
      Series fit = fitted_line(c, c.result.fit->elements);
      fit.color = points.color;
      fit.label = points.label;
      panel.series.push_back(std::move(fit));
    }
    if (!panel.series.empty()) figure.panels.push_back(std::move(panel));
  }
  figure.columns = figure.panels.size() > 1 ? 2 : 1;
  if (figure.panels.size() == 1) figure.panels.front().aspect = 0.46;
  return figure;
}

std::optional<report::Figure> parameters_over_pressure(const FvAnalysis& analysis) {
  Figure figure{"parameters_over_pressure",
                "The fitted numbers against the nominal pressure, with 95 % profile-likelihood intervals (drawn "
                "symmetrical to the wider side). Numbers that these velocities do not identify are left out.",
                {}};
  const std::vector<std::string> names = analysis.model == FvModel::kSlse1
                                             ? std::vector<std::string>{"kappa", "gamma_per_s"}
                                             : std::vector<std::string>{"kappa", "gamma_per_s", "beta"};
  bool enough = false;
  for (const std::string& name : names) {
    Panel panel;
    panel.x_label = "nominal pressure (psi)";
    panel.y_label = symbol_of(name);
    for (const Curve& c : analysis.curves) {
      if (!c.result.fit || !c.nominal_pressure_psi) continue;
      const FittedParameter& p = c.result.fit->parameter(name);
      if (!p.identifiable) continue;
      auto known = std::ranges::find(panel.series, c.specimen, &Series::label);
      if (known == panel.series.end()) {
        Series s;
        s.label = c.specimen;
        s.mark = Mark::kLinePoints;
        panel.series.push_back(std::move(s));
        known = std::prev(panel.series.end());
      }
      known->x.push_back(*c.nominal_pressure_psi);
      known->y.push_back(p.value);
      known->error.push_back(std::max(p.high - p.value, p.value - p.low));
      enough = enough || known->x.size() > 1;
    }
    figure.panels.push_back(std::move(panel));
  }
  figure.columns = static_cast<int>(figure.panels.size());
  return enough ? std::optional(std::move(figure)) : std::nullopt;
}

report::Figure history_figure(const History& history, const std::string& name, const std::string& caption) {
  Figure figure{name, caption, {}};
  figure.linked = true;
  const auto panel = [&](const std::vector<Series>& series, const char* label) {
    if (series.empty()) return;
    Panel p;
    p.y_label = label;
    p.series = series;
    p.aspect = 0.2;
    figure.panels.push_back(std::move(p));
  };
  panel(history.force_N, "force (N)");
  panel(history.position_mm, "position (mm)");
  panel(history.pressure_psi, "pressure (psi)");
  if (!figure.panels.empty()) {
    figure.panels.back().x_label = "time (s)";
    figure.panels.back().aspect = 0.23;
  }
  return figure;
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
