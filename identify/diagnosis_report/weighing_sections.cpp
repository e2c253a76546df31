#include <algorithm>
#include <cmath>

#include "identify/diagnosis_report/argument.hpp"
#include "model/catalogue.hpp"
#include "model/words.hpp"

namespace isorig::identify {
namespace {

using model::effect_words;
using model::explanation_words;
using model::in_words;
using report::Figure;
using report::Mark;
using report::number_text;
using report::Page;
using report::Panel;

std::string weight_text(double weight) {
  return weight < 0.001 ? std::string("< 0.001") : number_text(weight, 3);
}

/// What each effect leaves, fitted alone beside the model, and the chosen set: in noises, which is a number also where
/// no more is left than the noise.
Figure rivals_figure(const Diagnosis& d) {
  constexpr std::size_t kShown = 8;
  std::vector<const Explanation*> shown;
  const Explanation* nominal = nullptr;
  for (const Explanation& e : d.tried) {
    if (e.key == "nominal")
      nominal = &e;
    else if (e.key.find('+') == std::string::npos)
      shown.push_back(&e);
  }
  std::ranges::stable_sort(shown, {}, &Explanation::left);
  if (shown.size() > kShown) shown.resize(kShown);
  if (&d.tried.front() != nominal && std::ranges::find(shown, &d.tried.front()) == shown.end())
    shown.insert(shown.begin(), &d.tried.front());
  if (nominal != nullptr) shown.push_back(nominal);
  const bool upper_limit = d.noise_source != NoiseSource::kRests;
  Panel panel{.y_label = "what is left, rms (noises)"};
  report::Series bars;
  bars.mark = Mark::kBars;
  bars.color = 0;
  for (const Explanation* e : shown) {
    bars.x.push_back(static_cast<double>(panel.categories.size()));
    bars.y.push_back(e->left);
    panel.categories.push_back(explanation_words(e->key));
  }
  panel.series = {bars};
  // With the line of the noise in it, where no bar reaches that.
  panel.y_range = {0.0, 1.05 * std::max(1.0, std::ranges::max(bars.y))};
  panel.horizontals = {{1.0, upper_limit ? "noise at most" : "noise"}};
  panel.aspect = 0.42;
  return {
      "rivals_left",
      std::string("What each effect leaves when it is fitted alone beside the model; where the chosen explanation is "
                  "a set of several, it stands first, and the model alone last. Bars that end at the line leave no "
                  "more than ") +
          (upper_limit ? "the noise may be at most; those below it, less." : "the noise of the force channel."),
      {panel}};
}

std::string number_words_of(const NamedValue& value) {
  return model::number_words(value.key(), model::unit_of(*value.law, value.name));
}

void add_untellable(Page& page, const Diagnosis& d) {
  std::vector<std::string> items;
  for (const MissingEffect& missing : d.missing)
    for (const NamedValue& value : missing.parameters)
      if (!std::isfinite(value.low) || !std::isfinite(value.high))
        items.push_back(effect_words(missing.effect->name) + ": " + number_words_of(value) +
                        " is known to one side only, or not at all.");
  for (const std::string& note : d.notes) items.push_back(in_words(note));
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
  for (const auto& rival : design.tied)
    rows.push_back({explanation_words(rival.key), number_text(rival.probability, 3)});
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
      rows.push_back({explanation_words(design.tied[d.truth].key), explanation_words(design.tied[d.rival].key),
                      number_text(d.expected, 3)});
    page.table({"if this is true", "this, refitted to everything", "leaves"}, rows, "What it is expected to show");
    rows.clear();
    for (const Runner& r : design.others)
      rows.push_back({r.text, number_text(r.duration_s, 3), number_text(r.distance, 3)});
    if (!rows.empty())
      page.table({"experiment", "s", "smallest distance"}, rows, "What else was considered, to first order");
  }
  for (const Inseparable& pair : design.inseparable) page.note(in_words(pair.text));
}

void add_next(Page& page, const Diagnosis& d) {
  if (!d.design.tied.empty()) {
    add_design(page, d.design);
    return;
  }
  page.heading("What to run next");
  if (d.unjudged) {
    page.paragraph("A recording that would allow a judgement: " + in_words(d.unjudged->record) + ".");
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
    page.figure(rivals_figure(d));
    std::vector<std::vector<std::string>> rows;
    rows.reserve(shown.size());
    for (const Explanation* e : shown)
      rows.push_back({explanation_words(e->key), weight_text(e->weight), number_text(e->log_evidence, 6),
                      number_text(e->left, 3), excess > 0.0 ? number_text(100.0 * e->excess / excess, 3) : "-",
                      e->at_bound ? "a number at its bound" : ""});
    page.table({"explanation", "weight", "log evidence", "left, rms (noises)", "left of what is missed (%)", "caveat"},
               rows,
               std::to_string(d.tried.size()) + " explanations were weighed; these are the most probable" +
                   (excess > 0.0 ? ""
                                 : ". No explanation leaves more than the noise is taken to be, the nominal model "
                                   "neither: there is no share of what is missed"));
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
                      number_text(place.nominal_rmse_N, 3), number_text(place.model_rmse_N, 3), in_words(place.text)});
    page.table({"variable", "from (s)", "to (s)", "share of the excess (%) [95 %]", "nominal there, rms (N)",
                "with what it lacked", "in words"},
               rows, "The errors are those where half of the excess stands, or in the stretch.");
  }
  page.heading("Data");
  std::vector<std::string> items;
  for (const DataFault& fault : d.faults) items.push_back(in_words(fault.kind) + ": " + in_words(fault.text));
  if (d.faults.empty())
    items.emplace_back("No fault of the data was found: no outliers, gaps, frozen or clipped readings.");
  items.push_back("Force noise: white " + number_text(d.instrument.white_N) + " N" +
                  (d.instrument.coloured_N > 0.0 ? ", coloured " + number_text(d.instrument.coloured_N) + " N over " +
                                                       correlation_words(d.instrument.correlation_s, d.noise_reading_s)
                                                 : std::string()) +
                  ", from " + std::string(name_of(d.noise_source)) +
                  (d.noise_source == NoiseSource::kRests ? "." : " (there are no rests)."));
  items.push_back(std::to_string(d.rows) + " independent readings (bins) carry the fits.");
  page.list(items);
}

}  // namespace isorig::identify
