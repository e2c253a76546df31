#include "identify/diagnose/diagnosis.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <map>
#include <stdexcept>

#include "identify/diagnose/deciding/deciding.hpp"
#include "identify/diagnose/diagnosis_notes.hpp"
#include "identify/diagnose/first_stroke.hpp"
#include "identify/diagnose/force_zeros.hpp"
#include "identify/diagnose/forecast.hpp"
#include "identify/diagnose/guard/plausible.hpp"
#include "identify/diagnose/judgeable.hpp"
#include "identify/diagnose/prepare.hpp"
#include "identify/diagnose/publish.hpp"
#include "identify/diagnose/search/beside_a_walk.hpp"
#include "identify/diagnose/search/calibration.hpp"
#include "identify/diagnose/search/empirical.hpp"
#include "identify/diagnose/search/events.hpp"
#include "identify/diagnose/search/hysteresis.hpp"
#include "identify/diagnose/search/parsimony.hpp"
#include "identify/diagnose/search/published.hpp"
#include "identify/diagnose/search/substitutes.hpp"
#include "model/catalogue.hpp"
#include "model/elements.hpp"
#include "model/length_scale.hpp"
#include "model/one_recording.hpp"

namespace isorig::identify {
namespace {

/// rms of measured minus simulated force over all usable rows.
double rmse_N(const model::ModelSpec& spec, const Study& study) {
  double squares = 0.0;
  std::size_t count = 0;
  for (std::size_t i = 0; i < study.series.size(); ++i) {
    const RowErrors errors = row_errors(spec, study.series[i], study.usable[i]);
    squares += errors.squares_N2;
    count += errors.rows;
  }
  return count > 0 ? std::sqrt(squares / static_cast<double>(count)) : 0.0;
}

/// Bounds on the scale of the noise, by its source.
SelectionOptions options_for(const InstrumentNoise& noise, SelectionOptions options) {
  const bool from_rests = noise.source == NoiseSource::kRests;
  if (noise.measured()) options.most_noise_scale = deciding().most_noise_scale;
  // A level measured in motion is a mean over fast and slow stretches. The quiet half of a residual is below it, and a
  // scale taken from that half would count the rest as excess: the scale stays at one or above.
  if (noise.measured() && !from_rests) options.least_noise_scale = 1.0;
  options.count_independent_errors = !from_rests;
  options.reading_noise_N = std::hypot(noise.noise.white_N, noise.noise.coloured_N);
  return options;
}

/// The noise that intervals of the chosen model are stated under.
NoiseModel stated_noise(const Study& study) {
  // Bins average coloured noise, so that less of it is left in them than in the readings; the rests show all of it.
  NoiseModel stated = study.selection.chosen().fit.noise;
  if (study.noise.noise.coloured_N > stated.coloured_N) {
    stated.coloured_N = study.noise.noise.coloured_N;
    stated.correlation_s = study.noise.noise.correlation_s;
  }
  return stated;
}

void name_missing_effects(const Search& search, Study& study) {
  const Selection& selection = study.selection;
  Diagnosis& out = study.diagnosis;
  const Problem stated(study.series, stated_noise(study));
  const NoiseModel fitted_under = criterion_of_chosen(search, selection).noise;
  const auto values = intervals(stated, out.model, Spread::kMoves, fitted_under);
  for (const auto* effect : selection.chosen().effects) {
    MissingEffect missing;
    missing.effect = effect;
    const Substitute substitute = best_substitute(selection, *effect);
    missing.weight = missing.probability = std::min(selection.probability.at(effect), substitute.share);
    if (missing.weight == substitute.share && substitute.share < deciding().tied_share)
      missing.substitute = substitute.effect;
    missing.size_N = selection.size_N.at(effect);
    int parts = 0;
    std::vector<std::string_view> laws;
    for (std::size_t p = 0; p < out.model.parts.size(); ++p) {
      if (out.model.parts[p].physics != effect) continue;
      const model::Law& law = *out.model.parts[p].law;
      ++parts;
      if (std::ranges::find(laws, law.name) == laws.end()) {
        laws.push_back(law.name);
        missing.law += (missing.law.empty() ? "" : " + ") + std::string(law.name);
      }
      for (NamedValue value : values[p]) {
        value.part = parts;
        missing.parameters.push_back(std::move(value));
      }
      missing.formula += (parts > 1 ? "; " : "") + formula_text(law, values[p]);
    }
    missing.shape = shape_of(stated, out.model, *effect, fitted_under);
    out.missing.push_back(std::move(missing));
  }
  std::ranges::stable_sort(out.missing, std::greater<>(), &MissingEffect::size_N);
}

void list_alternatives(const Selection& selection, Diagnosis& out) {
  constexpr double kLeastWeight = 0.005;
  constexpr std::size_t kMost = 8;
  for (std::size_t i = 0; i < selection.pool.size(); ++i) {
    const Hypothesis& h = selection.pool[i];
    const double noise = selection.noise_scale * static_cast<double>(h.fit.rows);
    out.tried.push_back({h.key(), selection.weight[i], h.evidence, selection.excess[i],
                         noise > 0.0 ? std::sqrt(h.ls_chi2 / noise) : 0.0,
                         std::ranges::count(h.fit.at_bound, true) > 0});
    if (i == selection.best || selection.weight[i] < kLeastWeight) continue;
    Alternative alternative;
    for (const auto* effect : h.effects) alternative.effects.emplace_back(effect->name);
    alternative.probability = selection.weight[i];
    out.alternatives.push_back(std::move(alternative));
  }
  std::ranges::stable_sort(out.alternatives, std::greater<>(), &Alternative::probability);
  if (out.alternatives.size() > kMost) out.alternatives.resize(kMost);
  std::ranges::stable_sort(out.tried, std::greater<>(), &Explanation::weight);
}

/// Of an error of the position that begins at a corner of the motion and stays: an arm gives way to it as to any step.
double stiffness_N_mm(const model::ModelSpec& model, double since_corner_s) {
  double out = 0.0;
  for (const model::Part& part : model.parts) {
    if (part.physics == &model::element::spring()) out += part.coefficients[0];
    if (part.physics == &model::element::maxwell())
      out += part.coefficients[0] * std::exp(-since_corner_s / part.parameters[0]);
  }
  return out;
}

/// Whitened squares that the position's own uncertainty leaves in the residual of a right model: a bin's force is off
/// by the stiffness times the error of its position, all of its readings alike. Each straight piece of the motion
/// leaves as many squares as it has numbers (a hold one, a ramp two), times the square of position noise times
/// stiffness over the force's noise.
double squares_of_position(const Study& study, const model::ModelSpec& model) {
  const NoiseModel& noise = study.noise.weighing;
  double squares = 0.0;
  for (const Series& series : study.series) {
    const std::vector<double>& variance_mm2 = series.excitation.motion.position_variance_mm2;
    if (variance_mm2.size() != series.excitation.instants.size()) continue;
    for (std::size_t i = 0; i < series.count.size(); ++i) {
      const std::size_t first = series.first_row[i], end = series.first_row[i + 1];
      double sum_mm2 = 0.0;
      for (std::size_t k = first; k < end; ++k) sum_mm2 += variance_mm2[k];
      const double bin_N2 = noise.white_N * noise.white_N / series.count[i] + noise.coloured_N * noise.coloured_N;
      const double k_N_mm = stiffness_N_mm(model, series.since_corner_s[i]);
      squares += k_N_mm * k_N_mm * sum_mm2 / static_cast<double>(end - first) / bin_N2;
    }
  }
  return squares;
}

void decide_verdict(const Study& study, Diagnosis& out) {
  const Selection& selection = study.selection;
  out.rows = selection.chosen().fit.rows;
  out.noise_scale = selection.noise_scale;
  out.described_by = selection.chosen().empirical;
  const double of_position = squares_of_position(study, out.model) / selection.noise_scale;
  Explained explained{.excess_before = selection.excess[0],
                      .excess_left = std::max(selection.excess[selection.best] - of_position, 0.0),
                      .rows = out.rows,
                      .noise_from_rests = study.noise.source == NoiseSource::kRests,
                      .has_named_effect = !out.missing.empty(),
                      .is_described = !out.described_by.empty()};
  out.unexplained = unexplained_share(explained);
  out.verdict = verdict_of(explained);
  if (out.verdict != Verdict::kUnknownPhysics || explained.has_named_effect || explained.is_described) return;
  if ((out.unjudged = noise_beyond_the_rests(study, likeliest_noise(study)))) {
    explained.is_noise_for_all_that_rests_say = true;
    out.verdict = verdict_of(explained);
  }
}

/// Products or an element with memory in place of what a table describes. If the table already explains more than 88 %
/// of the excess, only products may replace it: memories fit so small a remainder well and do not generalise
/// (development seed 20261121: gap closed on heldout motions fell from 72 % to 6 %). Returns what speaks for each
/// product that was weighed.
std::map<std::string, double> describe_what_is_left(const Search& search, const Study& study, unsigned threads,
                                                    const Diagnosis& out, Candidate& whole) {
  if (out.verdict != Verdict::kUnknownPhysics) return {};
  const DescribeBy by =
      out.unexplained > deciding().much_unexplained_share ? DescribeBy::kProductsAndMemory : DescribeBy::kProducts;
  auto described = describe_hysteresis(search, study.selection, threads, by);
  if (!described) return {};
  whole.spec = std::move(described->spec);
  whole.described_by = described->function_of;
  whole.criterion = {described->noise, false};
  whole.effects.clear();
  for (const auto* effect : study.selection.chosen().effects)
    if (whole.spec.has(effect->name)) whole.effects.push_back(effect);
  return std::move(described->inclusion);
}

/// Seen::zero_elsewhere_N of a model with a part that describes its recording alone. Without that part the constant
/// would be what was fitted beside it: a zero that swung by 4.6 N left another recording 0.8 N off, and the nominal
/// model 0.1.
double zero_elsewhere_N(const Problem& problem, std::span<const Series> series, const model::ModelSpec& nominal,
                        model::ModelSpec spec) {
  for (model::Part& part : spec.parts)
    if (model::of_one_recording(part)) std::ranges::fill(part.coefficients, 0.0);
  const Eigen::VectorXd differ_N = problem.predict(nominal) - problem.predict(spec);
  double sum_N = 0.0, readings = 0.0;
  Eigen::Index row = 0;
  for (const Series& each : series) {
    for (const double count : each.count) {
      sum_N += count * differ_N[row++];
      readings += count;
    }
  }
  return sum_N / readings;
}

/// [seen] of a model that was fitted to `series`, for predictions (forecast.hpp).
void remember_what_was_seen(std::span<const Series> series, const Criterion& criterion, double error_N,
                            const model::ModelSpec& nominal, model::ModelSpec& spec, double share = 1.0) {
  const Problem problem(series, criterion.noise);
  model::Seen seen = ranges_of(series);
  if (std::ranges::any_of(spec.parts, [](const model::Part& part) {
        return model::of_one_recording(part) || part.physics == &model::element::force_zero();
      }))
    for (const Series& each : series) seen.recordings.push_back(each.excitation.reference.recording_id);
  if (std::ranges::any_of(spec.parts, &model::of_one_recording))
    seen.zero_elsewhere_N = zero_elsewhere_N(problem, series, nominal, spec);
  seen.error_N = error_N;
  seen.share = share;
  // The time constant of an arm without stiffness has no influence on the force: its variance is unbounded, and no
  // prediction depends on it.
  seen.covariance = lower_triangle(
      covariance(problem, spec, Spread::kMoves).unaryExpr([](double v) { return std::isfinite(v) ? v : 0.0; }));
  seen.nominal = nominal.parts;
  spec.seen = std::move(seen);
}

/// Left-out errors are those of bins; the model's error within a bin shows in the rows alone.
double error_of_a_reading_N(const Errors& errors) {
  return std::max(errors.heldout_rmse_N.value_or(0.0), errors.train_rmse_N);
}

/// Gives the models of the stretches that are to be drawn what their bands rest on: nothing of what was left out.
void remember_what_the_others_showed(const Study& study, const Criterion& nominal, const Criterion& model,
                                     HeldoutStudy& heldout) {
  for (LeftOutStretch& stretch : heldout.to_draw) {
    const std::vector<Series> kept = without(study.series, stretch.out);
    const model::ModelSpec plain{stretch.nominal.name, stretch.nominal.parts, {}, stretch.nominal.length_scale};
    // Where the kept bins would not have shown the effects, the nominal model was learnt in their place.
    const bool has_effects = stretch.model.seen.has_value();
    const model::ModelSpec fades_to =
        has_effects ? model::ModelSpec{plain.name, stretch.model.seen->nominal, {}, plain.length_scale} : plain;
    remember_what_was_seen(kept, has_effects ? model : nominal, stretch.model_error_N, fades_to, stretch.model,
                           has_effects ? stretch.model.seen->share : 1.0);
    remember_what_was_seen(kept, nominal, stretch.nominal_error_N, plain, stretch.nominal);
  }
}

/// Settles which model is handed out (publish.hpp), and what the two are wrong by.
void publish_model(const Search& search, const Study& study, const PublishedNominal& nominal, const Candidate& whole,
                   unsigned threads, Diagnosis& out) {
  const LeaveOut leave_out(study.series, study.noise.noise.white_N, learn_again(out.nominal, nominal.criterion),
                           threads);
  std::vector<const model::Physics*> doubted;
  for (const MissingEffect& missing : out.missing)
    if (missing.probability < deciding().doubted_probability) doubted.push_back(missing.effect);
  Publication publication = publish(search, study.selection, leave_out, whole, {out.nominal, nominal.criterion, {}, {}},
                                    out.noise_N, doubted);
  out.model = std::move(publication.model.spec);
  if (!publication.why.empty()) place_events(out.model, study.series, study.usable);
  out.described_by = std::move(publication.model.described_by);
  out.model_share = publication.share;
  out.why_share = std::move(publication.why_share);
  out.heldout = std::move(publication.heldout);
  out.not_modelled = {std::move(publication.located_only), std::move(publication.why),
                      std::move(publication.decided_by)};
  out.nominal_errors = {rmse_N(out.nominal, study), {}};
  model::ModelSpec predicts = out.model;
  if (out.model_share < 1.0) {
    predicts.seen = ranges_of(study.series);
    predicts.seen->share = out.model_share;
    predicts.seen->nominal = out.nominal.parts;
  }
  out.model_errors = {rmse_N(predicts, study), {}};
  if (out.heldout.all) {
    out.nominal_errors.heldout_rmse_N = out.heldout.all->nominal_rmse_N;
    out.model_errors.heldout_rmse_N = out.heldout.all->model_rmse_N;
  }
  out.nominal_numbers = intervals(Problem(study.series, nominal.criterion.noise), out.nominal, Spread::kMoves);
  out.model_numbers = intervals(Problem(study.series, stated_noise(study)), out.model, Spread::kMoves,
                                publication.model.criterion.noise);
  remember_what_the_others_showed(study, nominal.criterion, publication.model.criterion, out.heldout);
  const model::ModelSpec plain_nominal = out.nominal;
  remember_what_was_seen(study.series, nominal.criterion, error_of_a_reading_N(out.nominal_errors), plain_nominal,
                         out.nominal);
  remember_what_was_seen(study.series, publication.model.criterion, error_of_a_reading_N(out.model_errors),
                         plain_nominal, out.model, out.model_share);
}

/// Takes the nominal model back where rows are too few to leave some out and check a name by them; why, if something
/// spoke for more than that model. From thirty rows of pure noise zero_drift was once named with 0.92, at half the
/// smallest size that they could show.
std::optional<Unjudged> nothing_named_of_few_rows(Study& study) {
  std::size_t rows = 0;
  for (const Series& each : study.series) rows += each.recording.frame.size();
  if (rows >= deciding().fewest_rows_to_name || study.selection.best == 0) return std::nullopt;
  const std::string found = study.selection.chosen().key();
  study.selection.best = 0;
  return Unjudged{
      "something speaks for " + found + ", and " + std::to_string(rows) + " rows leave nothing to check it by",
      "the same motion with at least " + std::to_string(deciding().fewest_rows_to_name) + " rows, or a few of them"};
}

/// A verdict that rests on numbers that are not finite is an error.
void refuse_unless_finite(const Diagnosis& d) {
  bool finite = true;
  for (const double value :
       {d.noise_N, d.noise_scale, d.unexplained, d.nominal_errors.train_rmse_N, d.model_errors.train_rmse_N,
        d.nominal_errors.heldout_rmse_N.value_or(0.0), d.model_errors.heldout_rmse_N.value_or(0.0)}) {
    finite = finite && std::isfinite(value);
  }
  for (const MissingEffect& missing : d.missing) {
    finite = finite && std::isfinite(missing.probability);
    for (const NamedValue& value : missing.parameters) finite = finite && std::isfinite(value.value);
  }
  if (!finite) {
    throw std::domain_error(
        "the diagnosis did not come out in finite numbers, so there is no verdict; look at the recordings' forces and "
        "positions for values that cannot be meant");
  }
}

}  // namespace

Study diagnose(std::vector<messages::Recording> recordings, std::vector<std::string> names,
               const model::ModelSpec& given, const DiagnosisOptions& options) {
  const auto now = [&](double fraction, const char* doing) {
    if (options.on_progress) options.on_progress(fraction, doing);
  };
  refuse_repeated(recordings, names);
  refuse_several_pressures(recordings, names, given);
  now(0.0, "measuring the noise");
  Study study;
  model::ModelSpec nominal = given;
  prepare(study, std::move(recordings), std::move(names), nominal);
  model::set_length_scale_if_in_range(nominal, model::length_scale_of_stroke(stroke_mm(study.series)));
  Search search(study.series, study.noise.weighing, options.threads, options.withheld);
  constexpr const char* kWeighing = "weighing what may be missing";
  now(0.03, kWeighing);
  SelectionOptions selecting = options_for(study.noise, options.selection);
  selecting.on_progress = [&](double fraction) { now(0.03 + 0.82 * fraction, kWeighing); };
  study.selection = select_effects(search, nominal, selecting);
  now(0.85, "looking for simpler laws");
  prefer_simpler_laws(study.selection, search);
  selecting.on_progress = [&](double) { now(0.85, "weighing again beside a zero that walks"); };
  if (auto beside = select_beside_a_walk(search, study.selection, nominal, selecting)) {
    search = std::move(beside->search);
    study.selection = std::move(beside->selection);
    study.noise.weighing = search.instrument();
    study.diagnosis.walk = beside->walk;
  }
  const std::optional<Unjudged> few = nothing_named_of_few_rows(study);
  if (few) study.diagnosis.walk.reset();

  Diagnosis& out = study.diagnosis;
  out.faults = study.faults;
  out.decided = decided();
  out.instrument = study.noise.noise;
  out.noise_reading_s = study.noise.reading_s;
  out.noise_source = study.noise.source;
  out.noise_N = std::hypot(study.noise.noise.white_N, study.noise.noise.coloured_N);
  const PublishedNominal nominal_published = published_nominal(search, study.selection, study.usable, options.threads);
  out.nominal = nominal_published.fit.spec;
  const Hypothesis& chosen = study.selection.chosen();
  // The nominal model and a table that no other recording has: what is predicted of others is the nominal model.
  const bool only_tabulates = chosen.effects.empty() && tabulates_one_recording(chosen.fit.spec);
  out.model = study.selection.best == 0 ? out.nominal : chosen.fit.spec;
  if (only_tabulates)
    out.model = with_table_like(search.instrument_problem(), out.nominal, chosen.fit.spec.parts.back());
  place_events(out.model, study.series, study.usable);
  name_missing_effects(search, study);
  list_alternatives(study.selection, out);
  now(0.87, "what these recordings can show");
  out.discernible = discernible(search, study.selection.nominal(), options.threads);
  decide_verdict(study, out);
  if (few) {
    out.verdict = Verdict::kCannotJudge;
    out.unjudged = few;
  }
  const bool as_nominal = study.selection.best == 0 || only_tabulates;
  Candidate whole{out.model, as_nominal ? nominal_published.criterion : criterion_of_chosen(search, study.selection),
                  chosen.effects, chosen.empirical};
  now(0.9, "what is left");
  const std::map<std::string, double> inclusion = describe_what_is_left(search, study, options.threads, out, whole);
  doubt_events_of_the_first_stroke(study, out);
  for (MissingEffect& missing : out.missing)
    missing.probability = calibrated(missing.probability, out.unexplained, out.verdict == Verdict::kUnknownPhysics);
  now(0.93, "predicting what was left out");
  publish_model(search, study, nominal_published, whole, options.threads, out);
  for (DataFault& zero : different_zeros(study.series, out.model, out.model_numbers, out.noise_N))
    out.faults.push_back(std::move(zero));
  out.discovered = discovered_laws(out.model, out.model_numbers, inclusion);
  for (MissingEffect& missing : out.missing)
    if (std::ranges::find(out.not_modelled.names, missing.effect->name) != out.not_modelled.names.end())
      missing.probability = stated_if_refused(missing.probability);
  out.nominal.name = out.model.name = nominal.name;
  out.nominal.pressure_from_psi = out.model.pressure_from_psi = nominal.pressure_from_psi;
  if (out.verdict == Verdict::kConsistent && (out.unjudged = unjudged(study, out.nominal_errors.train_rmse_N)))
    out.verdict = Verdict::kCannotJudge;
  if (out.verdict != Verdict::kConsistent)
    out.where = locate(search.instrument_problem(), out.nominal, out.model, study.selection.noise_scale);
  now(0.97, "designing the next experiment");
  out.design = design_experiment(search, study.selection, options.design, options.threads);
  add_notes(study, nominal_published.fit, out);
  refuse_unless_finite(out);
  return study;
}

}  // namespace isorig::identify
