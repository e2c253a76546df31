#include "identify/diagnosis_report/diagnosis_report.hpp"

#include <algorithm>
#include <cmath>
#include <string>

#include "identify/diagnosis_report/argument.hpp"
#include "identify/diagnosis_report/lead.hpp"
#include "model/words.hpp"

namespace isorig::identify {
namespace {

using model::effect_words;
using model::explanation_words;
using report::Mood;
using report::number_text;
using report::Page;

/// "between 12.1 and 14.9 s"; no finer than the end is told: a recording whose first row is at 12 us begins at 0.
std::string where_text(const Study& study, const Stretch& stretch) {
  const double finest_s = 1e-4 * std::fmax(std::fabs(stretch.to_s), 1e-9);
  return "between " + number_text(finest_s * std::round(stretch.from_s / finest_s), 4) + " and " +
         number_text(stretch.to_s, 4) + " s" +
         (study.series.size() > 1 ? " of " + study.series[stretch.series].name : std::string());
}

void add_lead(Page& page, const Study& study, const Stretch& stretch) {
  const Diagnosis& d = study.diagnosis;
  const std::string where = "Model and muscle part most " + where_text(study, stretch) + ". ";
  switch (d.verdict) {
    case Verdict::kConsistent:
      page.lead(Mood::kGood, "nothing is missing",
                "The model explains these recordings: what it leaves, " +
                    number_text(d.nominal_errors.train_rmse_N, 3) + " N rms, is what the instruments leave (" +
                    number_text(d.noise_N, 3) + " N). No effect that was tried beside it is credible.");
      return;
    case Verdict::kMissingPhysics:
      page.lead(Mood::kInfo, "physics is missing", lead_text(d, where));
      return;
    case Verdict::kUnknownPhysics:
      page.lead(Mood::kWarning, "unknown physics", lead_text(d, where));
      return;
    case Verdict::kCannotJudge:
      page.lead(Mood::kWarning, "cannot be judged",
                "Whether the model is right cannot be told from these recordings: " + model::in_words(d.unjudged->why) +
                    ". A recording that would allow it: " + model::in_words(d.unjudged->record) + ".");
      return;
  }
}

void add_reassurance(Page& page, const Study& study) {
  const Diagnosis& d = study.diagnosis;
  page.heading("What was looked for, and not found");
  double second = 0.0;
  std::string rival;
  for (const Explanation& e : d.tried)
    if (e.key != "nominal" && e.weight > second) {
      second = e.weight;
      rival = e.key;
    }
  page.paragraph(
      "Effects of the catalogue were fitted beside the model, alone and, where that promised something, in sets: " +
      std::to_string(d.tried.size()) + " explanations were weighed, on " + std::to_string(d.rows) +
      " independent readings. The model alone stands best" +
      (rival.empty() ? std::string(".")
                     : "; the nearest rival is " + explanation_words(rival) + ", at a weight of " +
                           number_text(second, 2) + "."));
  page.paragraph(
      "This holds for the motions that were recorded. An effect that they do not excite leaves no trace in "
      "them: a slow triangle shows no inertia, one pressure no coupling to it.");
}

}  // namespace

void write_diagnosis_report(const Study& study, const std::filesystem::path& folder, const report::Made& made) {
  const Diagnosis& d = study.diagnosis;
  Argument a{study, {}, {}};
  for (std::size_t i = 0; i < study.series.size(); ++i)
    a.forces.push_back(simulate(study.series[i], study.usable.empty() ? std::vector<bool>() : study.usable[i], d));
  a.stretch = stretch_to_show(study, a.forces);

  Page page("Diagnosis", study.series.empty() ? std::string() : study.series[0].recording.metadata.specimen);
  page.made(made);
  page.subtitle(std::to_string(study.series.size()) +
                (study.series.size() == 1 ? " recording" : " recordings together") + ", nominal model " +
                d.nominal.name);
  page.link("diagnosis.json", "diagnosis.json");
  page.link("model.toml", "model.toml");
  page.link("nominal.toml", "nominal.toml");
  if (d.design.experiment) page.link("next_experiment.toml", "next_experiment.toml");
  add_lead(page, study, a.stretch);
  for (const std::string& warning : d.warnings) page.note(model::in_words(warning));
  add_parting(page, a);
  if (d.verdict == Verdict::kConsistent)
    add_reassurance(page, study);
  else
    add_missing(page, a);
  add_residuals(page, a);
  add_predictions(page, a);
  add_rivals(page, a);
  add_reliability(page, a);
  add_evidence(page, a);
  page.write(folder, "diagnosis-report.html");
}

}  // namespace isorig::identify
