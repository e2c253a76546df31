#include <algorithm>
#include <cmath>
#include <set>

#include "identify/diagnosis_report/argument.hpp"
#include "model/catalogue.hpp"
#include "model/words.hpp"

namespace isorig::identify {
namespace {

using model::effect_words;
using model::explanation_words;
using report::Figure;
using report::Mark;
using report::number_text;
using report::Page;
using report::Panel;

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

/// Rms of both models for each kind of motion that was left out.
Figure left_out_figure(const Diagnosis& d) {
  Panel panel{.y_label = "rms error of the prediction (N)"};
  report::Series nominal, model;
  nominal.label = "nominal model";
  model.label = "with what it lacked";
  nominal.mark = model.mark = Mark::kBars;
  nominal.color = 0;
  model.color = 1;
  const auto add = [&](const std::string& name, const LeftOut& one) {
    const auto at = static_cast<double>(panel.categories.size());
    panel.categories.push_back(name);
    nominal.x.push_back(at);
    nominal.y.push_back(one.nominal_rmse_N);
    model.x.push_back(at);
    model.y.push_back(one.model_rmse_N);
  };
  if (d.heldout.all) add("a quarter of the " + blocks_text(d.heldout.blocks), *d.heldout.all);
  for (const LeftOut& one : d.heldout.left_out) add(one.value.empty() ? one.by : one.value, one);
  panel.series = {nominal, model};
  panel.horizontals = {{d.noise_N, "noise"}};
  panel.aspect = 0.4;
  return {"left_out", "Motions left out of the fit, one kind at a time, and predicted by both models.", {panel}};
}

struct Moved {
  std::string part, number;
  double nominal = 0.0, model = 0.0;
};

/// Numbers that the nominal model and the one with what it lacked have in common.
std::vector<Moved> moved_numbers(const Diagnosis& d) {
  std::vector<Moved> out;
  std::set<std::size_t> taken;
  for (const auto& before : d.nominal.parts) {
    for (std::size_t i = 0; i < d.model.parts.size(); ++i) {
      const auto& after = d.model.parts[i];
      if (after.physics != before.physics || after.law != before.law || !taken.insert(i).second) continue;
      for (std::size_t k = 0; k < before.parameters.size(); ++k)
        if (!before.law->parameters[k].fixed)
          out.push_back({std::string(before.physics->name), std::string(before.law->parameters[k].name),
                         before.parameters[k], after.parameters[k]});
      for (std::size_t k = 0; k < before.coefficients.size(); ++k)
        out.push_back({std::string(before.physics->name), std::string(before.law->coefficients[k].name),
                       before.coefficients[k], after.coefficients[k]});
      break;
    }
  }
  return out;
}

void add_moved(Page& page, const Diagnosis& d) {
  const auto moved = moved_numbers(d);
  if (moved.empty() || d.model.parts.size() == d.nominal.parts.size()) return;
  std::vector<std::vector<std::string>> rows;
  for (const Moved& m : moved) {
    const double change = m.nominal != 0.0 ? 100.0 * (m.model - m.nominal) / std::abs(m.nominal) : std::nan("");
    rows.push_back({effect_words(m.part), m.number, number_text(m.nominal, 4), number_text(m.model, 4),
                    std::isfinite(change) ? number_text(change, 3) : "-"});
  }
  page.subheading("How the model's own numbers moved");
  page.paragraph(
      "What a model lacks, its other numbers take over as well as they can. With the missing part beside "
      "them they go to where they belong.");
  page.table({"part", "number", "nominal model alone", "with what it lacked", "change (%)"}, rows);
}

std::string weight_text(double weight) {
  return weight < 0.001 ? std::string("< 0.001") : number_text(weight, 3);
}

/// Share of the nominal model's excess that each effect leaves, fitted alone beside the model, and the chosen set.
Figure rivals_figure(const Diagnosis& d, double nominal_excess) {
  constexpr std::size_t kShown = 8;
  std::vector<const Explanation*> shown;
  for (const Explanation& e : d.tried)
    if (e.key == "nominal" || e.key.find('+') == std::string::npos) shown.push_back(&e);
  std::ranges::stable_sort(shown, {}, [](const Explanation* e) { return e->excess; });
  if (shown.size() > kShown) shown.resize(kShown);
  if (!d.tried.empty() && std::ranges::find(shown, &d.tried.front()) == shown.end())
    shown.insert(shown.begin(), &d.tried.front());
  Panel panel{.y_label = "left of what is missed (%)"};
  report::Series bars;
  bars.mark = Mark::kBars;
  bars.color = 0;
  for (const Explanation* e : shown) {
    bars.x.push_back(static_cast<double>(panel.categories.size()));
    bars.y.push_back(100.0 * std::max(0.0, e->excess) / nominal_excess);
    panel.categories.push_back(explanation_words(e->key));
  }
  panel.series = {bars};
  panel.aspect = 0.42;
  return {
      "rivals",
      "What each effect leaves of what the nominal model misses when it is fitted alone beside it; where the chosen "
      "explanation is a set of several, it stands first.",
      {panel}};
}

void add_untellable(Page& page, const Diagnosis& d) {
  std::vector<std::string> items;
  for (const MissingEffect& missing : d.missing)
    for (const NamedValue& value : missing.parameters)
      if (!std::isfinite(value.low) || !std::isfinite(value.high))
        items.push_back(effect_words(missing.effect->name) + ": " + value.key() +
                        " is known to one side only, or not at all.");
  for (const std::string& note : d.notes) items.push_back(note);
  if (!d.heldout.all)
    items.emplace_back(
        "How well the models predict what they have not seen: there is too little in these recordings "
        "to leave anything out of the fit.");
  if (d.noise_source == NoiseSource::kDifferences)
    items.emplace_back(
        "How noisy the force channel is: nothing rests or repeats, so the noise is a guess, and every "
        "probability here rests on it.");
  items.emplace_back(
      "What motions do that were not recorded: beyond the recorded ranges model.toml fades to the "
      "nominal model, and `isorig predict` says where.");
  page.heading("What these recordings cannot tell");
  page.list(items);
}

/// What is tied, the experiment that settles it, what it is expected to show, and what else was considered.
void add_design(Page& page, const Design& design) {
  page.heading("What would settle it");
  std::vector<std::vector<std::string>> rows;
  for (const auto& rival : design.tied) rows.push_back({rival.key, number_text(rival.probability, 3)});
  page.table({"explanation", "probability"}, rows, "Still tied");
  if (design.experiment) {
    const Experiment& e = *design.experiment;
    page.paragraph("next_experiment.toml, " + number_text(e.duration_s, 3) + " s: " + e.text + ". It is the " +
                   (e.enough
                        ? "shortest of " + std::to_string(design.considered) +
                              " within the limits that separates every two of them by " + number_text(design.enough, 3)
                        : "one of " + std::to_string(design.considered) +
                              " within the limits that comes nearest to separating them by " +
                              number_text(design.enough, 3)) +
                   " (squares over the noise).");
    rows.clear();
    for (const Distance& d : e.distances)
      rows.push_back({design.tied[d.truth].key, design.tied[d.rival].key, number_text(d.expected, 3)});
    page.table({"if this is true", "this, refitted to everything", "leaves"}, rows, "What it is expected to show");
    rows.clear();
    for (const Runner& r : design.others)
      rows.push_back({r.text, number_text(r.duration_s, 3), number_text(r.distance, 3)});
    if (!rows.empty())
      page.table({"experiment", "s", "smallest distance"}, rows, "What else was considered, to first order");
  }
  for (const Inseparable& pair : design.inseparable) page.note(pair.text);
}

void add_next(Page& page, const Diagnosis& d) {
  if (!d.design.tied.empty()) {
    add_design(page, d.design);
    return;
  }
  page.heading("What to run next");
  if (d.unjudged) {
    page.paragraph("A recording that would allow a judgement: " + d.unjudged->record + ".");
  } else if (d.missing.empty()) {
    page.paragraph(
        d.verdict == Verdict::kConsistent
            ? "Nothing needs to be settled. To test the model harder: a pressure, an amplitude or a velocity "
              "that is not among these recordings, diagnosed together with them."
            : "Repeat a part of these motions at another velocity and amplitude: what follows one of them "
              "alone shows in which variable the unknown lies.");
  } else {
    page.paragraph("One explanation stands out. To see it by itself: " +
                   std::string(d.missing.front().effect->reveals));
  }
}

}  // namespace

void add_predictions(Page& page, const Argument& a) {
  const Diagnosis& d = a.study.diagnosis;
  page.heading("What was left out of the fit, predicted");
  std::vector<std::vector<std::string>> errors{
      {"nominal model, all recordings", number_text(d.nominal_errors.train_rmse_N)},
      {"with what it lacked, all recordings", number_text(d.model_errors.train_rmse_N)}};
  if (d.heldout.all) {
    const std::string blocks = blocks_text(d.heldout.blocks);
    errors.push_back({"nominal model, a quarter of the " + blocks + " left out in turn",
                      number_text(d.heldout.all->nominal_rmse_N)});
    errors.push_back({"with what it lacked, the same", number_text(d.heldout.all->model_rmse_N)});
  }
  errors.push_back({"noise of the force channel", number_text(d.noise_N)});
  page.table({"", "rms (N)"}, errors, "Measured minus simulated force");
  if (d.heldout.all || !d.heldout.left_out.empty()) page.figure(left_out_figure(d));
  if (!d.heldout.left_out.empty()) {
    std::vector<std::vector<std::string>> rows;
    for (const LeftOut& one : d.heldout.left_out)
      rows.push_back({one.by, one.value, number_text(one.nominal_rmse_N), number_text(one.model_rmse_N)});
    page.begin_more("In numbers");
    page.table({"left out", "", "nominal model, rms (N)", "with it, rms (N)"}, rows);
    rows.clear();
    for (const Stability& one : d.heldout.stability)
      rows.push_back({one.parameter, number_text(one.value), number_text(one.lowest), number_text(one.highest)});
    if (!rows.empty())
      page.table({"number of the model", "from everything", "lowest", "highest"}, rows,
                 "The model's numbers over these fits: what hangs on one motion is no property of the specimen");
    page.end_more();
  }
  add_moved(page, d);
}

void add_rivals(Page& page, const Argument& a) {
  const Diagnosis& d = a.study.diagnosis;
  constexpr std::size_t kShown = 8;
  std::vector<const Explanation*> shown;
  const Explanation* nominal = nullptr;
  for (const Explanation& e : d.tried) {
    if (e.key == "nominal") nominal = &e;
    if (shown.size() < kShown) shown.push_back(&e);
  }
  if (!shown.empty()) {
    page.heading("Rivals");
    if (nominal != nullptr && std::ranges::find(shown, nominal) == shown.end()) shown.push_back(nominal);
    const double excess = nominal == nullptr ? 0.0 : nominal->excess;
    if (d.verdict != Verdict::kConsistent && excess > 0.0) page.figure(rivals_figure(d, excess));
    std::vector<std::vector<std::string>> rows;
    rows.reserve(shown.size());
    for (const Explanation* e : shown)
      rows.push_back({explanation_words(e->key), weight_text(e->weight), number_text(e->log_evidence, 6),
                      excess > 0.0 ? number_text(100.0 * std::max(0.0, e->excess) / excess, 3) : "-",
                      e->at_bound ? "a number at its bound" : ""});
    page.table({"explanation", "weight", "log evidence", "left (%)", "caveat"}, rows,
               std::to_string(d.tried.size()) + " explanations were weighed; these are the most probable" +
                   (excess > 0.0 ? ""
                                 : ". The noise is only known to be at most as large as the strokes differ, which "
                                   "is more than any residual: what each explanation leaves has no share."));
  }
  if (!d.alternatives.empty()) {
    std::vector<std::vector<std::string>> rows;
    for (const Alternative& alternative : d.alternatives) {
      std::string key;
      for (const std::string& name : alternative.effects) key += (key.empty() ? "" : "+") + name;
      rows.push_back({explanation_words(key), number_text(alternative.probability, 3)});
    }
    page.table({"what else it could be", "probability"}, rows);
  }
  add_untellable(page, d);
  add_next(page, d);
}

void add_evidence(Page& page, const Argument& a) {
  const Diagnosis& d = a.study.diagnosis;
  if (!d.where.empty()) {
    page.heading("Where the nominal model misses");
    std::vector<std::vector<std::string>> rows;
    for (const Place& place : d.where)
      rows.push_back({place.covariate, number_text(place.t_start_s, 6), number_text(place.t_end_s, 6),
                      report::interval_text(100.0 * place.share, 100.0 * place.share_low, 100.0 * place.share_high),
                      number_text(place.nominal_rmse_N, 3), number_text(place.model_rmse_N, 3), place.text});
    page.table({"variable", "from (s)", "to (s)", "share of the excess (%) [95 %]", "nominal there, rms (N)",
                "with what it lacked", "in words"},
               rows, "The errors are those where half of the excess stands, or in the stretch.");
  }
  page.heading("Data");
  std::vector<std::string> items;
  for (const DataFault& fault : d.faults) items.push_back(fault.kind + ": " + fault.text);
  if (d.faults.empty())
    items.emplace_back("No fault of the data was found: no outliers, gaps, frozen or clipped readings.");
  items.push_back("Force noise: white " + number_text(d.instrument.white_N) + " N" +
                  (d.instrument.coloured_N > 0.0 ? ", coloured " + number_text(d.instrument.coloured_N) + " N over " +
                                                       number_text(d.instrument.correlation_s) + " s"
                                                 : std::string()) +
                  ", from " + std::string(name_of(d.noise_source)) +
                  (d.noise_source == NoiseSource::kRests ? "." : " (there are no rests)."));
  items.push_back(std::to_string(d.rows) + " independent readings (bins) carry the fits.");
  page.list(items);
}

}  // namespace isorig::identify
