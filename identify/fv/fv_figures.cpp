#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <set>

#include "identify/fv/fv_report.hpp"

namespace isorig::identify {
namespace {

using report::Figure;
using report::Mark;
using report::number_text;
using report::Panel;
using report::Series;

/// "kappa" as it is written in formulas, with its unit.
std::string symbol_of(std::string_view parameter) {
  const ParameterWords words = words_of(parameter);
  return std::string(words.symbol) + (words.unit.empty() ? "" : " (" + std::string(words.unit) + ")");
}

}  // namespace

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

}  // namespace isorig::identify
