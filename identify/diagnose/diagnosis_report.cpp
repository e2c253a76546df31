#include "identify/diagnose/diagnosis_report.hpp"

#include <algorithm>
#include <cmath>
#include <string>

#include "identify/report/page.hpp"
#include "model/catalogue.hpp"

namespace isorig::identify {
namespace {

using report::number_text;

struct Residuals {
  std::vector<double> t_s, position_mm, force_N, nominal_N,
      model_N;  // the last two: measured minus simulated
};

Residuals residuals(const Series& series, const std::vector<bool>& usable, const Diagnosis& d) {
  model::RunningModel nominal(d.nominal, series.excitation.reference), full(d.model, series.excitation.reference);
  const auto& instants = series.excitation.instants;
  nominal.reset(instants.front());
  full.reset(instants.front());
  Residuals out;
  for (std::size_t k = 0; k < instants.size(); ++k) {
    const double without = nominal.step(instants[k]), with = full.step(instants[k]);
    if (!usable.empty() && !usable[k]) continue;
    out.t_s.push_back(instants[k].t_s);
    out.position_mm.push_back(instants[k].position_mm);
    out.force_N.push_back(series.recording.frame.force_N[k]);
    out.nominal_N.push_back(series.recording.frame.force_N[k] - without);
    out.model_N.push_back(series.recording.frame.force_N[k] - with);
  }
  return out;
}

std::string verdict_text(const Diagnosis& d) {
  switch (d.verdict) {
    case Verdict::kConsistent:
      return "The model is consistent with the recording: what is left is what the instruments would leave.";
    case Verdict::kMissingPhysics:
      return "The model lacks physics that the catalogue knows.";
    case Verdict::kUnknownPhysics:
      return d.described_by.empty()
                 ? "Something is left that neither the catalogue nor a table of one variable explains."
                 : "Something is left that no effect of the catalogue explains. It is described as a "
                   "function of " +
                       d.described_by + ".";
    case Verdict::kCannotJudge:
      return "Whether the model is right cannot be judged: " + d.unjudged->why +
             ". A recording that would allow it: " + d.unjudged->record + ".";
  }
  return "";
}

constexpr std::string_view kNothingLeftOut =
    "There is too little in these recordings to leave anything out of the fit: how well the models predict what they "
    "have not seen is not known.";

std::string blocks_text(BlockKind kind) {
  switch (kind) {
    case BlockKind::kNone:
      break;
    case BlockKind::kMoves:
      return "moves";
    case BlockKind::kStrokes:
      return "strokes";
    case BlockKind::kPressureStrokes:
      return "rises and falls of the pressure";
    case BlockKind::kStretches:
      return "stretches of time";
  }
  return "";
}

/// Measured and simulated force over the stretch that holds most of the excess, and the difference.
report::Figure stretch_figure(const Residuals& r, const Place& stretch, const std::string& name) {
  std::vector<double> t, measured, nominal, model, nominal_error, model_error;
  for (std::size_t k = 0; k < r.t_s.size(); ++k) {
    if (r.t_s[k] < stretch.t_start_s || r.t_s[k] > stretch.t_end_s) continue;
    t.push_back(r.t_s[k]);
    measured.push_back(r.force_N[k]);
    nominal.push_back(r.force_N[k] - r.nominal_N[k]);
    model.push_back(r.force_N[k] - r.model_N[k]);
    nominal_error.push_back(r.nominal_N[k]);
    model_error.push_back(r.model_N[k]);
  }
  report::Figure figure;
  figure.name = name;
  figure.caption = "The stretch where the nominal model misses most: force, and measured minus simulated.";
  figure.panel_width_px = 860;
  report::Panel force{.x_label = "time, s", .y_label = "force, N", .key = "above left horizontal"};
  force.series.push_back(report::thinned({t, measured, "measured", report::Mark::kPoints, {}, {}, 7}));
  force.series.push_back(report::thinned({t, nominal, "nominal", report::Mark::kLine, {}, {}, 0}));
  force.series.push_back(report::thinned({t, model, "with what it lacked", report::Mark::kLine, {}, {}, 1}));
  force.x_range = std::pair{stretch.t_start_s, stretch.t_end_s};
  report::Panel error{.x_label = "time, s", .y_label = "residual, N", .key = ""};
  error.series.push_back(report::thinned({t, nominal_error, "", report::Mark::kPoints, {}, {}, 0}));
  error.series.push_back(report::thinned({t, model_error, "", report::Mark::kPoints, {}, {}, 1}));
  error.x_range = force.x_range;
  figure.panels = {std::move(force), std::move(error)};
  return figure;
}

}  // namespace

void write_diagnosis_report(const Study& study, const std::filesystem::path& folder) {
  const Diagnosis& d = study.diagnosis;
  report::Page page("Diagnosis of " +
                    (study.series.empty() ? std::string() : study.series[0].recording.metadata.specimen));
  for (const std::string& warning : d.warnings) page.note(warning);
  page.paragraph(verdict_text(d));
  if (!d.missing.empty()) {
    std::vector<std::vector<std::string>> rows;
    for (const MissingEffect& missing : d.missing) {
      std::string numbers;
      for (const NamedValue& value : missing.parameters)
        numbers += (numbers.empty() ? "" : "; ") + value.name + " " +
                   report::interval_text(value.value, value.low, value.high);
      rows.push_back({std::string(missing.effect->name), std::string(model::side_of(missing.effect->stage)),
                      number_text(missing.probability, 3), missing.law, numbers});
    }
    page.table({"effect", "side", "probability", "law", "parameters [95 %]"}, rows,
               "What is missing, most important first");
    for (const MissingEffect& missing : d.missing)
      page.paragraph(std::string(missing.effect->what) +
                     " What would show it: " + std::string(missing.effect->reveals));
  }
  std::vector<std::vector<std::string>> errors{{"nominal model", number_text(d.nominal_errors.train_rmse_N)},
                                               {"model with it", number_text(d.model_errors.train_rmse_N)}};
  if (d.heldout.all) {
    const std::string blocks = blocks_text(d.heldout.blocks);
    errors.push_back({"nominal model, a quarter of the " + blocks + " left out in turn",
                      number_text(d.heldout.all->nominal_rmse_N)});
    errors.push_back({"model with it, the same", number_text(d.heldout.all->model_rmse_N)});
  }
  errors.push_back({"noise of the force channel", number_text(d.noise_N)});
  page.table({"", "rms, N"}, errors, "Measured minus simulated force");
  if (!d.not_modelled.why.empty()) page.paragraph(d.not_modelled.text());
  if (!d.heldout.all) page.paragraph(std::string(kNothingLeftOut));
  if (!d.heldout.left_out.empty()) {
    std::vector<std::vector<std::string>> rows;
    for (const LeftOut& one : d.heldout.left_out)
      rows.push_back({one.by, one.value, number_text(one.nominal_rmse_N), number_text(one.model_rmse_N)});
    page.table({"left out", "", "nominal model, rms N", "model with it, rms N"}, rows,
               "Motions left out of the fit in turn, and predicted");
    rows.clear();
    for (const Stability& one : d.heldout.stability)
      rows.push_back({one.parameter, number_text(one.value), number_text(one.lowest), number_text(one.highest)});
    page.table({"number of the model", "from everything", "lowest", "highest"}, rows,
               "The model's numbers over these fits");
  }
  const auto strongest = std::ranges::find_if(d.where, [](const Place& p) { return !p.recording.empty(); });
  for (std::size_t i = 0; i < study.series.size(); ++i) {
    const Series& series = study.series[i];
    const Residuals r = residuals(series, study.usable[i], d);
    report::Figure figure;
    figure.name = "residual-" + std::to_string(i);
    figure.caption = "Measured minus simulated force" +
                     (study.series.size() > 1 ? " of " + series.name : std::string()) +
                     ", over time and over position. Shaded: where most of the excess stands.";
    figure.panel_width_px = 860;
    const auto panel = [&](const std::vector<double>& x, const char* label) {
      report::Panel p;
      p.x_label = label;
      p.y_label = "residual, N";
      p.key = "above left horizontal";
      p.series.push_back(report::thinned({x, r.nominal_N, "nominal", report::Mark::kPoints}));
      p.series.push_back(report::thinned({x, r.model_N, "with what it lacked", report::Mark::kPoints}));
      return p;
    };
    figure.panels.push_back(panel(r.t_s, "time, s"));
    figure.panels.push_back(panel(r.position_mm, "position, mm"));
    for (const Place& place : d.where)
      if (place.recording == series.name && !place.recording.empty())
        figure.panels[0].shaded.emplace_back(place.t_start_s, place.t_end_s);
    for (const MissingEffect& missing : d.missing) {
      const model::Law* law = model::find_law(*missing.effect, missing.law);
      if (law == nullptr || !model::is_event(*law)) continue;
      const std::string_view time = law->parameters[model::event_parameter(*law)].name;
      for (const NamedValue& value : missing.parameters)
        if (value.name == time) figure.panels[0].verticals.emplace_back(value.value, missing.effect->traits.event_name);
    }
    page.figure(std::move(figure));
    if (strongest != d.where.end() && strongest->recording == series.name)
      page.figure(stretch_figure(r, *strongest, "stretch-" + std::to_string(i)));
  }
  if (!d.where.empty()) {
    page.heading("Where the nominal model misses");
    std::vector<std::vector<std::string>> rows;
    for (const Place& place : d.where)
      rows.push_back({place.covariate, number_text(place.t_start_s, 6), number_text(place.t_end_s, 6),
                      number_text(place.share, 3) + " [" + number_text(place.share_low, 3) + ", " +
                          number_text(place.share_high, 3) + "]",
                      number_text(place.nominal_rmse_N, 3), number_text(place.model_rmse_N, 3), place.text});
    page.table({"variable", "from, s", "to, s", "share of the excess [95 %]", "nominal there, rms N",
                "with what it lacked", ""},
               rows, "The errors are those where half of the excess stands, or in the stretch.");
  }
  if (!d.alternatives.empty()) {
    page.heading("What else it could be");
    std::vector<std::vector<std::string>> rows;
    for (const Alternative& alternative : d.alternatives) {
      std::string names;
      for (const std::string& name : alternative.effects) names += (names.empty() ? "" : ", ") + name;
      rows.push_back({names.empty() ? "nothing is missing" : names, number_text(alternative.probability, 3)});
    }
    page.table({"explanation", "probability"}, rows);
  }
  write_design(d.design, page);
  page.heading("Data");
  std::vector<std::string> items;
  for (const DataFault& fault : d.faults) items.push_back(fault.kind + ": " + fault.text);
  items.push_back("Force noise: white " + number_text(d.instrument.white_N) + " N" +
                  (d.instrument.coloured_N > 0.0 ? ", coloured " + number_text(d.instrument.coloured_N) + " N over " +
                                                       number_text(d.instrument.correlation_s) + " s"
                                                 : std::string()) +
                  ", from " + std::string(name_of(d.noise_source)) +
                  (d.noise_source == NoiseSource::kRests ? "." : " (there are no rests)."));
  items.push_back(
      "Share of the nominal model's excess that stays unexplained: " + number_text(100.0 * d.unexplained, 3) + " %.");
  page.list(items);
  for (const std::string& note : d.notes) page.note(note);
  page.write(folder, {.png = false}, "diagnosis-report.html");
}

}  // namespace isorig::identify
