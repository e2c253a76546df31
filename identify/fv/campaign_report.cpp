#include <algorithm>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>

#include "base/formatted.hpp"
#include "base/whole_file.hpp"
#include "identify/fv/campaign.hpp"
#include "identify/fv/fv_report.hpp"

namespace isorig::identify {
namespace {

using base::formatted;
using model::FvElement;
using model::FvTest;
using report::Figure;
using report::Mark;
using report::number_text;
using report::Page;
using report::Panel;
using report::Series;

/// Delta FV against shortening velocity, dense round zero.
Series height_line(const std::vector<FvElement>& elements, const FvTest& test, double widest, std::string label) {
  Series s;
  s.label = std::move(label);
  for (int i = -120; i <= 120; ++i) {
    const double u = i / 120.0;
    const double v = widest * u * std::abs(u);
    s.x.push_back(v);
    s.y.push_back(model::fv_height(elements, test, -v));
  }
  return s;
}

/// F/F0 over shortening velocity for one curve: points with SD, fit, optionally the control's fit.
void add_curve(Panel& panel, const Curve& curve, int color, const std::string& label, bool with_control) {
  Series points = measured_points(curve);
  points.color = color;
  points.label = label;
  const double widest = fastest_per_s(curve);
  panel.series.push_back(std::move(points));
  // Symmetrical, and the same step in all panels: they are compared side by side.
  if (!panel.x_range || panel.x_range->second < 1.1 * widest) panel.x_range = {{-1.1 * widest, 1.1 * widest}};
  if (!curve.result.fit) return;
  Series fit = fitted_line(curve, curve.result.fit->elements);
  fit.color = color;
  fit.label = label;
  panel.series.push_back(std::move(fit));
  if (!with_control || !curve.control) return;
  Series control = fitted_line(curve, std::vector<FvElement>{*curve.control});
  control.mark = Mark::kDashes;
  control.color = 6;
  control.label = "control (1-SLSE)";
  panel.series.push_back(std::move(control));
}

std::vector<const Curve*> curves_of(const Campaign& c, const std::string& specimen) {
  std::vector<const Curve*> out;
  for (const FvAnalysis* a : {&c.controls, &c.sheaths})
    for (const Curve& curve : a->curves)
      if (curve.specimen == specimen && !curve.points.empty()) out.push_back(&curve);
  std::sort(out.begin(), out.end(), [](const Curve* a, const Curve* b) {
    return a->nominal_pressure_psi.value_or(0) < b->nominal_pressure_psi.value_or(0);
  });
  return out;
}

std::vector<std::string> specimens_of(const Campaign& c) {
  std::vector<std::string> names;
  for (const FvAnalysis* a : {&c.controls, &c.sheaths})
    for (const Curve& curve : a->curves)
      if (std::find(names.begin(), names.end(), curve.specimen) == names.end()) names.push_back(curve.specimen);
  // Rows are meshes, columns materials in the paper's order.
  auto rank = [](const std::string& name) {
    const SpecimenName n = parse_specimen(name);
    const std::vector<std::string> order{"Control", "Urethane", "Ecoflex", "Carbopol"};
    return std::make_pair(n.number, std::find(order.begin(), order.end(), n.material) - order.begin());
  };
  std::sort(names.begin(), names.end(), [&](const std::string& a, const std::string& b) { return rank(a) < rank(b); });
  return names;
}

Figure all_curves(const Campaign& c) {
  Figure f{"force_velocity_curves",
           "Force-velocity curves (the paper's figure 5): mean ± 1 SD over the repetitions, dashed; model "
           "fit, solid: "
           "1-SLSE for the controls, 2-SLSE with the control held for the others. One colour a pressure. "
           "Abscissa: "
           "shortening velocity; one row a mesh, one column a sheath.",
           {},
           4};
  std::map<std::string, int> per_row;
  const auto names = specimens_of(c);
  for (const auto& name : names) ++per_row[parse_specimen(name).number];
  int widest = 1;
  for (const auto& [number, n] : per_row) widest = std::max(widest, n);
  f.columns = widest;
  for (const auto& name : names) {
    Panel panel;
    panel.title = name;
    panel.x_label = "shortening velocity (1/s)";
    panel.y_label = "F/F0";
    const auto list = curves_of(c, name);
    for (std::size_t i = 0; i < list.size(); ++i)
      add_curve(panel, *list[i], static_cast<int>(i % 6),
                number_text(list[i]->nominal_pressure_psi.value_or(0.0), 3) + " psi", false);
    f.panels.push_back(std::move(panel));
  }
  return f;
}

Figure comparison(const Campaign& c, const std::string& specimen, const std::string& file) {
  Figure f{file,
           "1-SLSE against 2-SLSE (the paper's figure 6): " + specimen +
               ", measured (points), its 2-SLSE fit (solid) and the 1-SLSE fit of its control on the same strains "
               "(black, dashed).",
           {},
           4};
  const auto list = curves_of(c, specimen);
  for (std::size_t i = 0; i < list.size(); ++i) {
    Panel panel;
    panel.title = title_of(*list[i]);
    panel.x_label = "shortening velocity (1/s)";
    panel.y_label = "F/F0";
    add_curve(panel, *list[i], static_cast<int>(i % 6), {}, true);
    f.panels.push_back(std::move(panel));
  }
  f.columns = std::max(1, static_cast<int>(f.panels.size()));
  return f;
}

Figure ramps_figure(const Campaign& c) {
  const Curve* chosen = &c.controls.curves.front();
  for (const Curve& curve : c.controls.curves)
    if (curve.specimen == "Control1" && curve.nominal_pressure_psi.value_or(0) == 10.0) chosen = &curve;
  Panel force = overlay_panel(c.controls, *chosen);
  Panel position;
  position.title = "position at the end of the extension ramps";
  position.x_label = "time from start of ramp (s)";
  position.y_label = "position (mm)";
  double target = 0.0;
  int color = 0;
  const auto& first = c.controls.recordings[chosen->recordings.front()];
  for (const RampTrace& t : first.traces) {
    if (t.velocity_mm_s < 0.0) continue;
    Series s{t.t_s, t.position_mm, number_text(t.velocity_mm_s, 2) + " mm/s"};
    s.color = color++ % 6;
    position.series.push_back(std::move(s));
    target = std::max(target, t.position_mm.empty() ? 0.0 : t.position_mm.back());
  }
  position.x_range = {{0.0, 1.4}};
  position.y_range = {{0.9 * target, 1.06 * target}};
  return {"ramps_overlaid",
          "Ramps of one pressure over each other (the paper's figure 4): force over F0 of all repetitions, "
          "and how the "
          "position reaches its target. The peak is read where the target is first reached, before the "
          "overshoot.",
          {force, position},
          2};
}

void parameter_rows(const FvAnalysis& a, std::vector<std::vector<std::string>>& rows) {
  for (const Curve& c : a.curves) {
    std::vector<std::string> row{c.specimen, c.nominal_pressure_psi ? number_text(*c.nominal_pressure_psi, 3) : "-",
                                 std::to_string(c.points.size())};
    if (!c.result.fit) {
      row.push_back(c.result.refusal);
      rows.push_back(std::move(row));
      continue;
    }
    for (const FittedParameter& p : c.result.fit->parameters) row.push_back(value_text(p));
    while (row.size() < 6) row.push_back("");
    row.push_back(report::r_squared_text(c.result.fit->r_squared));
    rows.push_back(std::move(row));
  }
}

nlohmann::ordered_json json_of(const Campaign& c, const std::string& simulated) {
  nlohmann::ordered_json trends = nlohmann::ordered_json::array();
  for (const Trend& t : c.trends)
    trends.push_back({{"claim", t.claim}, {"holds", t.holds}, {"of", t.of}, {"measured", t.measured}});
  nlohmann::ordered_json left_out = nlohmann::ordered_json::array();
  for (const LeftOutRecording& one : c.left_out) left_out.push_back({{"recording", one.path}, {"why", one.why}});
  return {{"format", "isorig-campaign/1"},
          {"simulated", simulated},
          {"fits", c.fits},
          {"r_squared", {{"mean", c.r_squared_mean}, {"sd", c.r_squared_sd}}},
          {"trends", trends},
          {"left_out", left_out}};
}

}  // namespace

report::Figure parameter_sweeps() {
  // The paper prints neither deps nor eps0 for its sweeps: a 2 mm stroke of an 80 mm actuator at 15 % strain.
  const FvTest test{0.025, 0.15};
  const double widest = 3.0;
  Figure f{"parameter_sweeps",
           "Heights of the force-velocity curve from the closed forms (the paper's figure 3; deps 0.025, "
           "eps0 0.15). (a) "
           "1-SLSE, kappa 10: gamma sets the slope. (b) 1-SLSE, gamma 50 1/s: kappa sets the height. (c), "
           "(d) 2-SLSE with "
           "kappa_1 10, gamma_1 50 1/s: the second arm's gamma and kappa; beta 0.2, 1, 5, thicker with beta. "
           "(e) four "
           "classes of "
           "material beside that element at beta 1.",
           {},
           3};
  auto panel = [](std::string title) {
    Panel p;
    p.title = std::move(title);
    p.x_label = "shortening velocity (1/s)";
    p.y_label = "height ΔFV";
    return p;
  };
  Panel a = panel("(a) 1-SLSE, kappa = 10");
  for (double gamma : {1.0, 10.0, 50.0, 200.0})
    a.series.push_back(height_line({{10, gamma, 1}}, test, widest, "gamma " + number_text(gamma, 3)));
  Panel b = panel("(b) 1-SLSE, gamma = 50");
  for (double kappa : {2.0, 5.0, 10.0, 20.0})
    b.series.push_back(height_line({{kappa, 50, 1}}, test, widest, "kappa " + number_text(kappa, 3)));
  const FvElement fixed{10, 50, 1};
  Panel c = panel("(c) 2-SLSE, kappa_2 = 10");
  Panel d = panel("(d) 2-SLSE, gamma_2 = 50");
  const double betas[] = {0.2, 1.0, 5.0};
  int color = 0;
  for (double value : {5.0, 500.0}) {
    for (std::size_t i = 0; i < 3; ++i) {
      Series s =
          height_line({fixed, {10, value, betas[i]}}, test, widest, i == 0 ? "gamma_2 = " + number_text(value, 3) : "");
      s.color = color;
      s.width = 0.9 + 0.7 * static_cast<double>(i);
      c.series.push_back(std::move(s));
    }
    ++color;
  }
  color = 0;
  for (double value : {2.0, 20.0}) {
    for (std::size_t i = 0; i < 3; ++i) {
      Series s =
          height_line({fixed, {value, 50, betas[i]}}, test, widest, i == 0 ? "kappa_2 = " + number_text(value, 3) : "");
      s.color = color;
      s.width = 0.9 + 0.7 * static_cast<double>(i);
      d.series.push_back(std::move(s));
    }
    ++color;
  }
  Panel e = panel("(e) material classes");
  Series alone = height_line({fixed}, test, widest, "element alone");
  alone.color = 6;
  alone.mark = Mark::kDashes;
  e.series.push_back(std::move(alone));
  const std::vector<std::pair<const char*, FvElement>> classes{{"viscous, long", {20, 5, 1}},
                                                               {"viscous, short", {20, 500, 1}},
                                                               {"elastic, long", {1, 5, 1}},
                                                               {"elastic, short", {1, 500, 1}}};
  for (const auto& [name, element] : classes) e.series.push_back(height_line({fixed, element}, test, widest, name));
  f.panels = {a, b, c, d, e};
  return f;
}

void write_campaign_report(const Campaign& campaign, const std::filesystem::path& folder, const std::string& simulated,
                           const report::Made& made) {
  Page page("Campaign", "The iso-velocity campaign");
  page.made(made);
  if (!simulated.empty()) page.note(simulated, report::Mood::kInfo);
  std::size_t ramps = 0, recordings = 0;
  for (const FvAnalysis* a : {&campaign.controls, &campaign.sheaths})
    for (const auto& r : a->recordings) {
      ramps += r.ramps.ramps.size();
      ++recordings;
    }
  page.paragraph(
      formatted("%zu recordings, %zu iso-velocity ramps, %zu fits. R² of the fits: %.3f ± %.3f (mean ± SD); the "
                "paper reports 0.94 ± 0.05 for its measurements.",
                recordings, ramps, campaign.fits, campaign.r_squared_mean, campaign.r_squared_sd));
  if (!campaign.left_out.empty()) {
    page.note(formatted("%zu %s cannot be read and %s in none of this:", campaign.left_out.size(),
                        campaign.left_out.size() == 1 ? "recording" : "recordings",
                        campaign.left_out.size() == 1 ? "is" : "are"));
    std::vector<std::string> which;
    for (const LeftOutRecording& one : campaign.left_out) which.push_back(one.why);
    page.list(which);
  }
  page.heading("What the paper's text reports, and what is found here");
  std::vector<std::vector<std::string>> rows;
  for (const Trend& t : campaign.trends)
    rows.push_back({t.claim,
                    t.of == 0            ? "not testable"
                    : t.holds == t.of    ? "holds"
                    : 2 * t.holds > t.of ? "holds mostly"
                                         : "does not hold",
                    t.measured});
  page.table({"trend", "here", "found in (specimen and pressure)"}, rows);
  page.heading("Model: parameter sweeps");
  page.figure(parameter_sweeps());
  page.heading("Ramps");
  page.figure(ramps_figure(campaign));
  page.heading("Force-velocity curves");
  page.figure(all_curves(campaign));
  page.heading("1-SLSE against 2-SLSE");
  bool compared = false;
  for (const auto& [name, file] :
       {std::pair{"Urethane1", "comparison_urethane1"}, std::pair{"Ecoflex2", "comparison_ecoflex2"}})
    if (!curves_of(campaign, name).empty()) {
      page.figure(comparison(campaign, name, file));
      compared = true;
    }
  if (!compared) page.paragraph("Neither Urethane1 nor Ecoflex2, which the paper shows, is among these recordings.");
  page.heading("Parameters");
  rows.clear();
  parameter_rows(campaign.controls, rows);
  parameter_rows(campaign.sheaths, rows);
  page.table({"specimen", "pressure (psi)", "points", "κ [95 %]", "γ (1/s) [95 %]", "β [95 %]", "R²"}, rows,
             "Controls: κ_c, γ_c. Others: κ_s, γ_s, β_s with the control's held. Without "
             "brackets: "
             "not identifiable from these velocities, and this is all that is known (95 %).");
  page.write(folder, "campaign-report.html");
  base::write_whole_file(folder / "campaign.json", json_of(campaign, simulated).dump(1) + "\n");
  write_fv_tables(campaign.controls, folder / "fv-controls");
  if (!campaign.sheaths.recordings.empty()) write_fv_tables(campaign.sheaths, folder / "fv-sheaths");
}

}  // namespace isorig::identify
