#include "identify/diagnose/search/parsimony.hpp"

#include <algorithm>
#include <cmath>

#include "identify/diagnose/deciding/deciding.hpp"
#include "identify/diagnose/fit/free_parameters.hpp"
#include "identify/diagnose/fit/intervals.hpp"
#include "identify/diagnose/fit/many_starts.hpp"
#include "identify/diagnose/noise/effective_dof.hpp"
#include "identify/diagnose/search/practical_significance.hpp"
#include "identify/diagnose/search/published.hpp"
#include "identify/diagnose/search/without_effect.hpp"
#include "model/catalogue.hpp"
#include "model/length_scale.hpp"

namespace isorig::identify {
namespace {

std::size_t numbers(const model::Law& law) {
  std::size_t count = law.coefficients.size();
  for (const auto& parameter : law.parameters) count += parameter.fixed ? 0 : 1;
  return count;
}

/// A number without which the law is a simpler one, and that the data do not need.
bool idle(const model::Part& part, const std::vector<NamedValue>& values) {
  const model::Law& law = *part.law;
  for (std::size_t i = 0; i < values.size(); ++i) {
    const bool coefficient = i < law.coefficients.size();
    if (coefficient) {
      if (law.coefficients.size() > 1 && (values[i].value == 0.0 || values[i].low * values[i].high <= 0.0)) return true;
      continue;
    }
    const auto found = std::ranges::find(law.parameters, values[i].name, &model::Parameter::name);
    if (found == law.parameters.end() || found->traits.event_time || found->traits.initial_state) continue;
    const double reach = 1e-9 + 1e-6 * std::fabs(values[i].value);
    if (values[i].value <= found->lower + reach || values[i].value >= found->upper - reach) return true;
    // Zero means a simpler law only where zero can be reached.
    if (!found->logarithmic && found->lower == 0.0 && values[i].low <= 0.0) return true;
  }
  return false;
}

constexpr int kLeastSquaresSteps = 30;

/// The noise that a fit leaves behind may wander slowly, and a fit weighed by that noise then follows the differences
/// between readings and leaves the force itself (a friction of 6.5 N fitted as 3.0 N, with 3.5 N rms left and not 0.9).
/// Were the noise right, its p numbers would leave about p / n more squares beyond those of the instrument than least
/// squares do, n the residual's independent values; several times as much is not chance. The instrument's own squares,
/// one a row, hide no such difference: no fit can leave less.
bool follows_differences(const Search& search, const Hypothesis& chosen) {
  if (chosen.ls_spec.parts.empty()) return false;
  const Problem problem(search.instrument_problem().series(), plain(search.instrument()));
  Eigen::VectorXd left;
  model::ModelSpec least = chosen.ls_spec;
  (void)problem.solve(least, left);
  const double independent =
      std::max(effective_degrees_of_freedom(problem.series(), left), SelectionOptions{}.error_degrees);
  const double chance = static_cast<double>(counted_numbers(chosen.fit.spec)) / independent;
  const auto instrument = static_cast<double>(left.size());
  const double least_beyond = std::max(left.squaredNorm() - instrument, deciding().chance_squares);
  return squares_of(problem, chosen.fit.spec) - instrument >
         least_beyond * (1.0 + deciding().plain_fit_chances * chance);
}

/// The sizes that are stated are those of the numbers that are stated.
void size_again(Selection& selection, const Search& search) {
  const bool by_least_squares = least_squares_decide(selection);
  const auto effects = selection.chosen().effects;
  for (const auto* effect : effects) {
    Hypothesis rest = selection.pool[without_effect_and_refinements(selection, search, selection.best, *effect)];
    if (by_least_squares && !rest.ls_spec.parts.empty()) rest.fit.spec = rest.ls_spec;
    selection.size_N[effect] = size_N(search, selection.chosen(), rest);
  }
}

/// A residual far above the noise is the law's own error. Whitening would give its fastest part, at reversals and
/// corners, the most weight; plain least squares lets the bulk of the motion decide the numbers.
void state_by_least_squares(Selection& selection, const Search& search) {
  Hypothesis& chosen = selection.pool[selection.best];
  if (selection.best == 0) return;  // published_nominal
  chosen.plain_numbers = follows_differences(search, chosen);
  if (!least_squares_decide(selection)) return;
  const Problem problem(search.instrument_problem().series(), plain(search.instrument()));
  const NoiseModel noise = chosen.fit.noise;
  Fit least = problem.fit(chosen.fit.spec, kLeastSquaresSteps);
  if (chosen.plain_numbers) {
    Fit other = problem.fit(chosen.ls_spec, kLeastSquaresSteps);
    if (other.chi2 < least.chi2) least = std::move(other);
  }
  chosen.fit = std::move(least);
  chosen.fit.noise = noise;
  size_again(selection, search);
}

}  // namespace

void prefer_simpler_laws(Selection& selection, const Search& search) {
  const double noise_N = std::hypot(search.instrument().white_N, search.instrument().coloured_N);
  for (const auto* effect : selection.chosen().effects) {
    for (int round = 0; round < 2; ++round) {
      const Hypothesis& chosen = selection.chosen();
      const auto at = std::ranges::find(chosen.fit.spec.parts, effect, &model::Part::physics);
      if (at == chosen.fit.spec.parts.end()) break;
      const auto index = static_cast<std::size_t>(at - chosen.fit.spec.parts.begin());
      const bool description = at->coefficients.size() >= deciding().description_coefficients;
      // A slow drift is nothing beside a noise that wanders as slowly: where least squares are stated, they judge.
      const bool plain_numbers = follows_differences(search, chosen);
      const model::ModelSpec& judged = plain_numbers ? chosen.ls_spec : chosen.fit.spec;
      const Problem problem(search.instrument_problem().series(),
                            plain_numbers ? plain(chosen.fit.noise) : chosen.fit.noise);
      const bool gives_way =
          !description && idle(judged.parts[index], intervals(problem, judged, Spread::kNoise)[index]);
      if (!gives_way && !description) break;
      Hypothesis best;
      bool found = false;
      for (const model::Law& known : effect->laws) {
        const model::Law& law = model::law_at(known, chosen.fit.spec.length_scale);
        if (numbers(law) >= numbers(*at->law) || law.traits.replaces_arm != at->law->traits.replaces_arm) continue;
        std::size_t starts = 1;
        for (const auto& parameter : law.parameters) starts = std::max(starts, parameter.starts.size());
        for (std::size_t k = 0; k < starts; ++k) {
          Hypothesis simpler = chosen;
          model::Part part = model::make_part(*effect, law);
          for (std::size_t i = 0; i < law.parameters.size(); ++i) {
            const auto& parameter = law.parameters[i];
            const auto same = std::ranges::find(at->law->parameters, parameter.name, &model::Parameter::name);
            if (k == 0 && same != at->law->parameters.end())
              part.parameters[i] = at->parameters[static_cast<std::size_t>(same - at->law->parameters.begin())];
            else if (!parameter.starts.empty())
              part.parameters[i] = parameter.starts[std::min(k, parameter.starts.size() - 1)];
          }
          simpler.fit.spec.parts[index] = std::move(part);
          simpler.fit = search.fit_from(simpler.fit.spec, 25);
          search.settle(simpler, false);
          if (!found || simpler.evidence > best.evidence) best = std::move(simpler);
          found = true;
        }
      }
      if (!found) break;
      if (description && size_N(search, chosen, best) > deciding().same_force_noises * noise_N) break;
      selection.pool[selection.best] = std::move(best);
    }
  }
  state_by_least_squares(selection, search);
  // Only now: what stands at an end under a noise that wanders may stand inside by least squares, or the other way.
  auto inside = search.inside_ranges(selection.chosen());
  if (!inside) return;
  selection.pool[selection.best] = std::move(*inside);
  state_by_least_squares(selection, search);
  if (!least_squares_decide(selection)) size_again(selection, search);
}

}  // namespace isorig::identify
