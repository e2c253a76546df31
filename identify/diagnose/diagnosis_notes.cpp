#include "identify/diagnose/diagnosis_notes.hpp"

#include <algorithm>
#include <cmath>

#include "base/formatted.hpp"
#include "identify/diagnose/guard/plausible.hpp"
#include "model/words.hpp"

namespace isorig::identify {
namespace {

/// The selection refits each explanation under the noise of its own residual, in few iterations. Where that stopped
/// short and going on would still gain, a note says so: the numbers have not reached their optimum.
void note_unfinished_fit(const Study& study, const Fit& fit, const char* which, Diagnosis& out) {
  constexpr int kIterations = 25;
  constexpr double kMatters = 1.0;  // half a standard deviation of one number, in log-likelihood
  if (fit.stop == Stop::kConverged || fit.stop == Stop::kAtBounds) return;
  const Problem problem(study.series, fit.noise);
  const double before = problem.fit(fit.spec, 0).chi2;
  const Fit further = problem.fit(fit.spec, kIterations);
  const bool done = further.stop == Stop::kConverged || further.stop == Stop::kAtBounds;
  if (done && before - further.chi2 < kMatters) return;
  out.notes.push_back(base::formatted(
      "The fit of the %s stopped before it had converged (%.*s); %d further iterations lowered its whitened "
      "sum of squares by %.3g of %.6g and ended with %.*s. Its numbers may be off by more than their "
      "intervals: two of them may stand for each other.",
      which, static_cast<int>(name_of(fit.stop).size()), name_of(fit.stop).data(), kIterations, before - further.chi2,
      before, static_cast<int>(name_of(further.stop).size()), name_of(further.stop).data()));
}

/// A named effect of a size at which these recordings cannot tell it from its nearest rival (discernible.hpp) gets a
/// note.
void note_what_cannot_be_told(Diagnosis& out) {
  for (const MissingEffect& missing : out.missing) {
    const auto able = std::ranges::find(out.discernible, missing.effect, &Discernible::effect);
    if (able == out.discernible.end() || able->nearest == nullptr || missing.size_N >= able->told_from_N) continue;
    const std::string name = model::effect_words(missing.effect->name);
    const std::string nearest = model::effect_words(able->nearest->name);
    if (std::isfinite(able->told_from_N))
      out.notes.push_back(base::formatted(
          "By their motion and noise alone these recordings tell %s from %s for certain from %.3g N on, and it has "
          "%.3g N: what speaks for the name is how much better it fits.",
          name.c_str(), nearest.c_str(), able->told_from_N, missing.size_N));
    else
      out.notes.push_back(
          base::formatted("These recordings cannot tell %s from %s at any size: their motion moves both alike.",
                          name.c_str(), nearest.c_str()));
  }
}

/// An arm that is not linear beside as many linear ones as the nominal model has (count_arms) is one thing missing.
/// Read otherwise, it is two.
void note_arm_beside_the_arms(Diagnosis& out) {
  const auto linear_arms = [](const model::ModelSpec& spec) {
    return std::ranges::count(spec.parts, std::string_view("maxwell"),
                              [](const model::Part& part) { return part.physics->name; });
  };
  for (const MissingEffect& missing : out.missing) {
    const bool is_an_arm = std::ranges::any_of(out.model.parts, [&](const model::Part& part) {
      return part.physics == missing.effect && part.law->traits.replaces_arm;
    });
    if (!is_an_arm || linear_arms(out.model) < linear_arms(out.nominal)) continue;
    out.notes.push_back(base::formatted(
        "The law of %s stands beside the arms of the nominal model. The same force is that of a nominal arm which "
        "follows this law and of a further relaxation: two things missing in the place of one, which no recording of "
        "this specimen tells apart.",
        model::effect_words(missing.effect->name).c_str()));
  }
}

/// Where a pressure is stated and no gauge was read.
void note_pressure_that_nobody_read(const Study& study, Diagnosis& out) {
  const bool stated = std::ranges::any_of(study.series, [](const Series& each) {
    return each.recording.metadata.nominal_pressure_psi && !each.recording.pressure;
  });
  if (!stated) return;
  out.notes.emplace_back(
      "No pressure was recorded (pressure.csv), so effects of the pressure were not looked for: one of them may stand "
      "under another name.");
}

/// A pressurized actuator whose length under pressure is not stated: at position 0 it is stretched, and by how much is
/// not known.
void note_length_that_nobody_stated(const Study& study, Diagnosis& out) {
  const bool unstated = std::ranges::any_of(study.series, [](const Series& each) {
    const auto& metadata = each.recording.metadata;
    return metadata.rest_length_mm && metadata.nominal_pressure_psi && *metadata.nominal_pressure_psi > 0.0 &&
           !metadata.pressurized_rest_length_mm;
  });
  if (!unstated) return;
  out.warnings.emplace_back(
      "recording.toml states a pressure and no pressurized_rest_length_mm: how far the actuator is stretched at "
      "position 0 is not known, and taken for nothing. Whatever acts in proportion to the elastic force (softening, "
      "stiffening, slack) may stand under another name. Measure the length at which the pressurized actuator bears no "
      "force, and state it.");
}

/// Friction that is wholly in proportion to the load is friction, of which nothing is constant.
void note_what_is_all_refinement(Diagnosis& out) {
  for (const MissingEffect& missing : out.missing) {
    const auto refinement = std::ranges::find_if(
        out.missing, [&](const MissingEffect& other) { return other.effect->traits.refines == missing.effect->name; });
    const auto part = std::ranges::find(out.model.parts, missing.effect, &model::Part::physics);
    if (refinement == out.missing.end() || part == out.model.parts.end()) continue;
    for (const model::Coefficient& known : part->law->coefficients) {
      const auto value = std::ranges::find(missing.parameters, known.name, &NamedValue::name);
      if (value == missing.parameters.end() || value->low > 0.0 || value->high < 0.0) continue;
      out.notes.push_back(base::formatted(
          "All that was found of %s may be %s: its own %.*s is %.3g, and zero lies in its 95 %% interval.",
          model::effect_words(missing.effect->name).c_str(), model::effect_words(refinement->effect->name).c_str(),
          static_cast<int>(known.name.size()), known.name.data(), value->value));
    }
  }
}

void note_substitutes(Diagnosis& out) {
  for (const MissingEffect& missing : out.missing) {
    if (missing.substitute == nullptr) continue;
    out.notes.push_back(base::formatted(
        "These recordings are explained nearly as well with %s in the place of %s, all else the same: of the two, the "
        "one that is named has %.2f of the weight, and is not called surer than that.",
        model::effect_words(missing.substitute->name).c_str(), model::effect_words(missing.effect->name).c_str(),
        missing.weight));
  }
}

void note_walk(Diagnosis& out) {
  if (!out.walk) return;
  constexpr double kOver_s = 100.0;
  const bool is_followed = std::ranges::any_of(
      out.model.parts, [](const model::Part& part) { return model::describes_recording(*part.law); });
  out.notes.push_back(base::formatted(
      "The zero of the force walks at random: it changes by %.3g N rms over %.0f s, at rest as in motion (%.3g N and "
      "%.3g N). %s counts as noise; another recording has another walk, and is predicted without.",
      out.walk->rms_N(kOver_s), kOver_s, std::sqrt(out.walk->rest_rate_N2_s * kOver_s),
      std::sqrt(out.walk->motion_rate_N2_s * kOver_s),
      is_followed ? "Its slow part is in the model of this recording, the rest of it" : "All of it"));
}

/// What belongs to its recording cannot be left out of it (left_out.hpp).
void note_states(Diagnosis& out) {
  if (std::ranges::any_of(out.model.parts, [](const model::Part& part) { return model::is_event(*part.law); }))
    out.notes.emplace_back(
        "An event belongs to its recording: its time and size are taken from all readings, also where readings are "
        "left "
        "out. The left-out errors say nothing of how well they are known; their intervals do.");
}

}  // namespace

std::string NotModelled::text() const {
  std::string list;
  for (const std::string& name : names) list += (list.empty() ? "" : ", ") + model::effect_words(name);
  return "Located, not modelled: " + list + ". model.toml is without it. The reason: " + why + ".";
}

void add_notes(const Study& study, const Fit& nominal_fit, Diagnosis& out) {
  if (!out.decided.empty()) out.warnings.push_back(decided_text(out.decided));
  for (const Inseparable& pair : out.design.inseparable) out.notes.push_back(pair.text);
  note_what_cannot_be_told(out);
  note_arm_beside_the_arms(out);
  note_pressure_that_nobody_read(study, out);
  note_length_that_nobody_stated(study, out);
  note_what_is_all_refinement(out);
  note_substitutes(out);
  note_unfinished_fit(study, nominal_fit, "nominal model", out);
  if (study.selection.best != 0)
    note_unfinished_fit(study, study.selection.chosen().fit, "model with what it lacked", out);
  note_states(out);
  note_walk(out);
  if (!out.not_modelled.why.empty()) out.notes.push_back(out.not_modelled.text());
  if (!out.why_share.empty())
    out.notes.push_back(
        base::formatted("Of what model.toml has beyond the nominal model it predicts %.0f %%. With all of it, %s.",
                        100.0 * out.model_share, out.why_share.c_str()));
  if (out.nominal.has("spring") && out.nominal.has("maxwell"))
    out.notes.emplace_back(
        "A spring in series with the specimen (grips, load cell, frame) turns this model into another of the same "
        "form: no force and crosshead reading can tell its stiffness. It is not looked for, and the stiffnesses "
        "here are those of specimen and load train together.");
  std::vector<std::string> specimens;
  for (const Series& each : study.series) specimens.push_back(each.recording.metadata.specimen);
  if (auto text = several_specimens(specimens); !text.empty()) out.warnings.push_back(std::move(text));
}

}  // namespace isorig::identify
