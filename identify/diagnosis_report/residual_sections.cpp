#include <algorithm>
#include <cmath>

#include "identify/diagnosis_report/argument.hpp"
#include "identify/diagnosis_report/colors.hpp"
#include "model/catalogue.hpp"

namespace isorig::identify {
namespace {

using report::Figure;
using report::Mark;
using report::Page;
using report::Panel;

bool found_something(const Diagnosis& d) {
  return d.model.parts.size() != d.nominal.parts.size() || !d.missing.empty();
}

void add(Panel& panel, const std::vector<double>& x, const std::vector<double>& y, const char* label, int color,
         std::size_t stretches = 700) {
  for (auto& series : report::enveloped(x, y, label, color, stretches)) panel.series.push_back(std::move(series));
}

/// Two standard deviations of a reading to either side.
void add_noise(Panel& panel, double from, double to, double noise_N) {
  if (!(noise_N > 0.0)) return;
  report::Series band;
  band.label = "noise, ± 2 σ";
  band.mark = Mark::kBand;
  band.color = kNoise;
  band.x = {from, to};
  band.y = {-2.0 * noise_N, -2.0 * noise_N};
  band.y2 = {2.0 * noise_N, 2.0 * noise_N};
  panel.series.insert(panel.series.begin(), std::move(band));
}

/// The same ordinate for before and after: else the smaller residual looks as large.
std::pair<double, double> common_range(const std::vector<double>& a, const std::vector<double>& b, double noise_N) {
  double most = 2.5 * noise_N;
  for (const auto* values : {&a, &b})
    for (const double v : *values)
      if (std::isfinite(v)) most = std::max(most, std::abs(v));
  return {-1.05 * most, 1.05 * most};
}

void shade_places(Panel& panel, const Study& study, const Series& series) {
  for (const Place& place : study.diagnosis.where)
    if (!place.recording.empty() && place.recording == series.name)
      panel.shaded.emplace_back(place.t_start_s, place.t_end_s);
}

void name_events(Panel& panel, const Diagnosis& d) {
  for (const MissingEffect& missing : d.missing) {
    for (const NamedValue& value : missing.parameters)
      if (model::is_event(*value.law) && value.name == value.law->parameters[model::event_parameter(*value.law)].name)
        panel.verticals.emplace_back(value.value, missing.effect->traits.event_name);
  }
}

Figure residual_figure(const Argument& a, std::size_t i) {
  const Study& study = a.study;
  const Diagnosis& d = study.diagnosis;
  const SimulatedForce& f = a.forces[i];
  const bool found = found_something(d);
  const auto before = f.nominal_residual_N(), after = f.model_residual_N();
  const auto range = common_range(before, after, d.noise_N);
  Figure figure{"residual-" + std::to_string(i),
                "Measured minus simulated force" +
                    (study.series.size() > 1 ? " of " + study.series[i].name : std::string()) +
                    (found ? ", before and after, on one scale. " : ". ") +
                    "Bands reach from the lowest to the highest of each stretch, lines are means; green is the noise "
                    "of the force channel. Shaded: where most of the excess stands.",
                {}};
  figure.linked = true;
  const auto panel = [&](const std::vector<double>& y, const char* label, int color) {
    Panel p{.y_label = "residual (N)"};
    add(p, f.t_s, y, label, color);
    if (!f.t_s.empty()) add_noise(p, f.t_s.front(), f.t_s.back(), d.noise_N);
    p.y_range = range;
    shade_places(p, study, study.series[i]);
    name_events(p, d);
    p.aspect = 0.22;
    figure.panels.push_back(std::move(p));
  };
  panel(before, "nominal model", kNominal);
  if (found) panel(after, "with what it lacked", kModel);
  figure.panels.back().x_label = "time (s)";
  figure.panels.back().aspect = 0.25;
  return figure;
}

Figure loop_figure(const Argument& a) {
  const SimulatedForce& f = a.forces[a.stretch.series];
  const bool found = found_something(a.study.diagnosis);
  Panel loop{.x_label = "position (mm)", .y_label = "force (N)"};
  loop.series = {path(f.t_s, f.position_mm, f.force_N, "measured", kMeasured),
                 path(f.t_s, f.position_mm, f.nominal_N, "nominal model", kNominal)};
  if (found) loop.series.push_back(path(f.t_s, f.position_mm, f.model_N, "with what it lacked", kModel));
  Panel error{.x_label = "position (mm)", .y_label = "residual (N)"};
  error.series = {path(f.t_s, f.position_mm, f.nominal_residual_N(), "nominal model", kNominal)};
  if (found) error.series.push_back(path(f.t_s, f.position_mm, f.model_residual_N(), "with what it lacked", kModel));
  if (!f.position_mm.empty()) {
    const auto [low, high] = std::ranges::minmax(f.position_mm);
    add_noise(error, low, high, a.study.diagnosis.noise_N);
  }
  return {
      "loop", "Force over position, as a path of means in the order of time; right what is left.", {loop, error}, 2};
}

}  // namespace

void add_parting(Page& page, const Argument& a) {
  if (a.forces.empty()) return;
  const Diagnosis& d = a.study.diagnosis;
  const double margin = 0.5 * (a.stretch.to_s - a.stretch.from_s);
  const SimulatedForce near = a.forces[a.stretch.series].between(a.stretch.from_s - margin, a.stretch.to_s + margin);
  if (near.t_s.size() < 2) return;
  const bool found = found_something(d), parted = d.verdict != Verdict::kConsistent;
  Panel force{.y_label = "force (N)"};
  add(force, near.t_s, near.force_N, "measured", kMeasured);
  add(force, near.t_s, near.nominal_N, "nominal model", kNominal);
  if (found) add(force, near.t_s, near.model_N, "with what it lacked", kModel);
  if (parted) force.shaded = {{a.stretch.from_s, a.stretch.to_s}};
  force.aspect = 0.32;
  Panel error{.x_label = "time (s)", .y_label = "residual (N)"};
  add(error, near.t_s, near.nominal_residual_N(), "nominal model", kNominal);
  if (found) add(error, near.t_s, near.model_residual_N(), "with what it lacked", kModel);
  add_noise(error, near.t_s.front(), near.t_s.back(), d.noise_N);
  error.shaded = force.shaded;
  error.aspect = 0.25;
  Figure figure{"parting",
                parted ? "Where model and muscle part: the stretch that holds most of what the nominal model misses "
                         "(shaded). Above the force, below measured minus simulated, with the noise of the force "
                         "channel in green."
                       : "The fastest motion: the force, and measured minus simulated within the noise of the force "
                         "channel (green).",
                {force, error}};
  figure.linked = true;
  page.figure(figure);
}

void add_residuals(Page& page, const Argument& a) {
  const Diagnosis& d = a.study.diagnosis;
  page.heading(found_something(d) ? "Before and after" : "What is left");
  if (!a.forces.empty()) page.figure(loop_figure(a));
  constexpr std::size_t kInSight = 3;
  bool folded = false;
  for (std::size_t i = 0; i < a.forces.size(); ++i) {
    if (a.forces[i].t_s.size() < 2) continue;
    if (i >= kInSight && !folded) {
      page.begin_more("The other recordings");
      folded = true;
    }
    page.figure(residual_figure(a, i));
  }
  if (folded) page.end_more();
}

}  // namespace isorig::identify
