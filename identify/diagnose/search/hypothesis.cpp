#include "identify/diagnose/search/hypothesis.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>

#include "base/parallel.hpp"
#include "identify/diagnose/fit/basis.hpp"
#include "identify/diagnose/fit/free_parameters.hpp"
#include "model/catalogue.hpp"
#include "model/effects/effects.hpp"
#include "model/elements.hpp"

namespace isorig::identify {
namespace {

using model::ModelSpec;
using model::Part;

/// Refinements of friction; tried only beside friction, given or found.
bool is_refinement(const model::Physics& physics) {
  return &physics == &model::effect::friction_asymmetry() || &physics == &model::effect::friction_with_pressure();
}

bool needs_wide_pressure(const model::Physics& physics) {
  return &physics == &model::effect::friction_with_pressure() || &physics == &model::effect::pressure_threshold();
}

/// By enough to tell what grows with the pressure itself from what is there at any pressure.
bool pressure_varies(std::span<const Series> series) {
  double low = 1e300, high = -1e300;
  for (const Series& each : series) {
    for (const double p : each.excitation.pressure_psi) {
      low = std::min(low, p);
      high = std::max(high, p);
    }
  }
  return high - low > 0.2 * std::max(std::fabs(high), std::fabs(low));
}

/// Smaller than what the instruments could show: such a play or slip stands in for noise in the position
/// reading, such a lag for jitter of the time stamps, whatever the likelihood says.
bool below_resolution(const ModelSpec& spec, std::span<const Series> series) {
  double noise_mm = 0.0, interval_s = 1e9;
  for (const Series& each : series) {
    noise_mm = std::max({noise_mm, each.excitation.motion.noise_mm, each.excitation.motion.quantisation_mm});
    std::vector<double> steps;
    for (const auto& now : each.excitation.instants)
      if (now.dt_s > 0.0) steps.push_back(now.dt_s);
    std::ranges::nth_element(steps, steps.begin() + static_cast<std::ptrdiff_t>(steps.size() / 10));
    interval_s = std::min(interval_s, steps[steps.size() / 10]);
  }
  for (const Part& part : spec.parts) {
    for (std::size_t i = 0; i < part.parameters.size(); ++i) {
      const std::string_view name = part.law->parameters[i].name;
      const double value = part.parameters[i];
      if (name == "gap_mm" && value < 8.0 * noise_mm) return true;
      if (name == "slip_mm" && value < 4.0 * noise_mm) return true;
      if (name == "delay_s" && value < 0.1 * interval_s) return true;
      if (part.physics == &model::effect::force_lag() && value < 0.1 * interval_s) return true;
      // A flow that hardly depends on the rate is dry friction, and stands under that name.
      if (part.law->name == "power_dashpot" && value <= 1.001 * part.law->parameters[i].lower) return true;
    }
  }
  return false;
}

}  // namespace

bool Hypothesis::has(const model::Physics& effect) const {
  return std::ranges::find(effects, &effect) != effects.end();
}

std::string Hypothesis::key() const {
  std::string key;
  for (const auto* effect : effects) key += (key.empty() ? "" : "+") + std::string(effect->name);
  if (!empirical.empty()) key += (key.empty() ? "" : "+") + ("table of " + empirical);
  return key.empty() ? "nominal" : key;
}

Search::Search(std::span<const Series> series, const NoiseModel& instrument, unsigned threads)
    : series_(series), instrument_problem_(series, instrument), threads_(threads) {}

Fit Search::fit_from(const ModelSpec& spec, int iterations) const {
  return instrument_problem_.fit(spec, iterations);
}

Hypothesis Search::nominal(const ModelSpec& nominal) const {
  std::vector<std::size_t> arms;
  for (std::size_t i = 0; i < nominal.parts.size(); ++i)
    if (nominal.parts[i].physics == &model::element::maxwell() && !nominal.parts[i].fixed) arms.push_back(i);
  const std::array starts{0.04, 0.4, 4.0, 40.0};
  std::vector<ModelSpec> specs{nominal};
  if (arms.size() == 1) {
    for (const double tau : starts) {
      specs.push_back(nominal);
      specs.back().parts[arms[0]].parameters[0] = tau;
    }
  } else if (arms.size() >= 2) {
    for (std::size_t i = 0; i < starts.size(); ++i) {
      for (std::size_t j = i + 1; j < starts.size(); ++j) {
        specs.push_back(nominal);
        specs.back().parts[arms[0]].parameters[0] = starts[i];
        specs.back().parts[arms[1]].parameters[0] = starts[j];
      }
    }
  }
  std::vector<Fit> fits(specs.size());
  base::parallel_for(specs.size(), threads_, [&](std::size_t i) { fits[i] = instrument_problem_.fit(specs[i], 20); });
  Hypothesis best;
  best.fit = *std::ranges::min_element(fits, {}, &Fit::chi2);
  settle(best, false);
  return best;
}

std::vector<Search::Trial> Search::trials(const Hypothesis& base) const {
  std::vector<Trial> out;
  const ModelSpec& spec = base.fit.spec;
  const bool with_pressure =
      std::ranges::any_of(series_, [](const Series& s) { return !s.excitation.pressure_psi.empty(); });
  for (const model::Physics* effect : model::effects()) {
    if (base.has(*effect)) continue;
    if (is_refinement(*effect) && !spec.has("coulomb_friction")) continue;
    // What has no elastic part has nothing that could relax.
    if (effect == &model::effect::second_relaxation() && !spec.has("spring") && !spec.has("maxwell")) continue;
    // A nominal model that has it does not lack it.
    if (spec.has(effect->name) && effect != &model::effect::second_relaxation()) continue;
    const bool of_pressure = effect == &model::effect::pressure_coupling() || needs_wide_pressure(*effect);
    if (of_pressure && !with_pressure) continue;
    if (needs_wide_pressure(*effect) && !pressure_varies(series_)) continue;
    for (const model::Law& law : effect->laws) {
      // Every arm of the nominal model may be the one whose dashpot is not linear.
      std::vector<std::size_t> replaced{spec.parts.size()};
      if (law.replaces_arm) {
        replaced.clear();
        for (std::size_t i = 0; i < spec.parts.size(); ++i)
          if (spec.parts[i].physics == &model::element::maxwell()) replaced.push_back(i);
      }
      std::size_t starts = 1;
      for (const auto& parameter : law.parameters) starts = std::max(starts, parameter.starts.size());
      for (const std::size_t arm : replaced) {
        for (std::size_t k = 0; k < starts; ++k) {
          Trial trial{effect, &law, spec, {}};
          Part part = model::make_part(*effect, law);
          for (std::size_t i = 0; i < law.parameters.size(); ++i) {
            const auto& parameter = law.parameters[i];
            if (parameter.name == "duration_s")
              part.parameters[i] = series_[0].excitation.reference.duration_s;
            else if (!parameter.starts.empty())
              part.parameters[i] = parameter.starts[std::min(k, parameter.starts.size() - 1)];
          }
          if (law.replaces_arm) {
            part.parameters[0] = spec.parts[arm].parameters[0];
            trial.spec.parts.erase(trial.spec.parts.begin() + static_cast<std::ptrdiff_t>(arm));
          }
          trial.spec.parts.push_back(std::move(part));
          out.push_back(std::move(trial));
        }
      }
    }
  }
  return out;
}

std::vector<double> Search::slip_times(const ModelSpec& spec, const NoiseModel& noise, std::size_t count) const {
  // The force drops by a step when a grip slips. Exact scan: with r the whitened residual after all columns
  // and Q their basis, a step at bin k gains (r.s)^2 / (s.s - |Q's|^2); all sums run from the end. The
  // relaxation that follows the step is left to the fit.
  RowMatrix a;
  instrument_problem_.columns(spec, a);
  a.conservativeResize(Eigen::NoChange, a.cols() + 1);
  a.col(a.cols() - 1) = instrument_problem_.target();
  NoiseModel white = noise;
  white.coloured_N = 0.0;
  whiten(series_, white, a);
  const Eigen::Index m = a.cols() - 1;
  const Eigen::MatrixXd q = orthonormal_basis(a.leftCols(m));
  Eigen::VectorXd r = a.col(m);
  r -= q * (q.transpose() * r);
  std::vector<std::pair<double, double>> gains;  // gain, time
  const Series& series = series_[0];
  Eigen::VectorXd qs = Eigen::VectorXd::Zero(q.cols());
  double rs = 0.0, ss = 0.0;
  for (std::size_t k = series.nodes.size(); k-- > 1;) {
    const auto row = static_cast<Eigen::Index>(k);
    const double w = std::sqrt(series.count[k]) / white.white_N;
    rs += w * r[row];
    ss += w * w;
    qs += w * q.row(row).transpose();
    const double rest = ss - qs.squaredNorm();
    // A slip lengthens the specimen: its step is down.
    if (rest > 1e-6 * ss && rs < 0.0)
      gains.emplace_back(rs * rs / rest, 0.5 * (series.nodes[k].t_s + series.nodes[k - 1].t_s));
  }
  std::ranges::sort(gains, std::greater<>());
  std::vector<double> times;
  for (const auto& [gain, time] : gains) {
    if (times.size() >= count) break;
    if (std::ranges::all_of(times, [t = time](double other) { return std::fabs(other - t) > 1.0; }))
      times.push_back(time);
  }
  return times;
}

void Search::refine_slip(Trial& trial) const {
  Part& part = trial.spec.parts.back();
  // What no refit of the other numbers would make good is not refitted; and a time that hardly matters is not
  // followed through the recording.
  constexpr double kHopeless = 10.0, kWorth = 0.05;
  double step_s = 4.0;
  Fit best = trial.fit;
  Eigen::VectorXd ignored;
  while (step_s > 0.004) {
    bool moved = false;
    for (const double sign : {1.0, -1.0}) {
      ModelSpec spec = best.spec;
      spec.parts.back().parameters[0] += sign * step_s;
      ModelSpec moved_alone = spec;
      if (instrument_problem_.solve(moved_alone, ignored) > best.chi2 + kHopeless) continue;
      Fit fit = instrument_problem_.fit(spec, 3);
      if (fit.chi2 < best.chi2 * (1.0 - 1e-6) - kWorth) {
        best = std::move(fit);
        moved = true;
        break;
      }
    }
    if (!moved) step_s *= 0.4;
  }
  trial.fit = instrument_problem_.fit(best.spec, 15);
  part.parameters = trial.fit.spec.parts.back().parameters;
}

std::vector<Hypothesis> Search::extend(const Hypothesis& base, std::size_t keep, bool thorough) const {
  std::vector<Trial> all = trials(base);
  std::erase_if(all, [](const Trial& t) { return t.effect == &model::effect::grip_slip(); });
  if (!base.has(model::effect::grip_slip())) {
    const auto& slip = model::effect::grip_slip();
    for (const double time : slip_times(base.fit.spec, instrument_problem_.noise(), 3)) {
      Trial trial{&slip, &slip.laws.front(), base.fit.spec, {}};
      trial.spec.parts.push_back(model::make_part(slip, slip.laws.front()));
      trial.spec.parts.back().parameters[0] = time;
      trial.spec.parts.back().parameters[2] = series_[0].excitation.reference.duration_s;
      all.push_back(std::move(trial));
    }
  }
  // A few steps from every start, then all the way from the best of each effect.
  base::parallel_for(all.size(), threads_,
                     [&](std::size_t i) { all[i].fit = instrument_problem_.fit(all[i].spec, 4); });
  std::ranges::stable_sort(all, {}, [](const Trial& t) { return t.fit.chi2; });
  std::vector<Trial> chosen;
  std::map<const model::Physics*, int> per_effect;
  for (Trial& trial : all) {
    int& taken = per_effect[trial.effect];
    // Three laws of each of the most promising effects, one of the rest.
    const int most = per_effect.size() <= keep ? 3 : thorough ? 1 : 0;
    if (taken >= most) continue;
    ++taken;
    chosen.push_back(std::move(trial));
  }
  base::parallel_for(chosen.size(), threads_, [&](std::size_t i) {
    Trial& trial = chosen[i];
    trial.fit = instrument_problem_.fit(trial.fit.spec, 30);
    if (trial.effect == &model::effect::grip_slip()) refine_slip(trial);
  });
  std::vector<Hypothesis> out(chosen.size());
  base::parallel_for(chosen.size(), threads_, [&](std::size_t i) {
    Hypothesis& hypothesis = out[i];
    hypothesis.effects = base.effects;
    hypothesis.effects.push_back(chosen[i].effect);
    std::ranges::sort(hypothesis.effects, {}, [](const model::Physics* p) {
      return std::ranges::find(model::effects(), p) - model::effects().begin();
    });
    hypothesis.fit = std::move(chosen[i].fit);
    settle(hypothesis, i < 3 * keep);
  });
  // Of each effect the law with the best evidence.
  std::ranges::stable_sort(out, std::greater<>(), &Hypothesis::evidence);
  std::vector<Hypothesis> best;
  for (Hypothesis& hypothesis : out) {
    if (below_resolution(hypothesis.fit.spec, series_)) continue;
    if (std::ranges::none_of(best, [&](const Hypothesis& other) { return other.effects == hypothesis.effects; }))
      best.push_back(std::move(hypothesis));
  }
  return best;
}

Hypothesis Search::without(const Hypothesis& whole, const model::Physics& effect) const {
  Hypothesis out;
  out.effects = whole.effects;
  std::erase(out.effects, &effect);
  out.empirical = whole.empirical;
  out.fit.spec = whole.fit.spec;
  auto& parts = out.fit.spec.parts;
  for (Part& part : parts) {
    if (part.physics != &effect || !part.law->replaces_arm) continue;
    // The linear arm that it stood for.
    Part arm = model::make_part(model::element::maxwell(), model::element::maxwell().laws.front());
    arm.parameters[0] = part.parameters[0];
    arm.coefficients[0] = part.coefficients[0];
    part = std::move(arm);
  }
  std::erase_if(parts, [&](const Part& part) { return part.physics == &effect; });
  out.fit = instrument_problem_.fit(out.fit.spec, 25);
  settle(out, true);
  return out;
}

void Search::settle(Hypothesis& hypothesis, bool restart_arms) const {
  if (restart_arms) {
    std::vector<std::size_t> arms;
    for (std::size_t i = 0; i < hypothesis.fit.spec.parts.size(); ++i)
      if (hypothesis.fit.spec.parts[i].physics == &model::element::maxwell()) arms.push_back(i);
    Fit best = hypothesis.fit;
    if (best.chi2 <= 0.0 && best.rows == 0) best = instrument_problem_.fit(hypothesis.fit.spec, 10);
    const std::array pairs{std::array{0.08, 0.8}, std::array{0.5, 5.0}, std::array{0.15, 15.0}};
    if (arms.size() >= 2) {
      for (const auto& start : pairs) {
        ModelSpec spec = hypothesis.fit.spec;
        spec.parts[arms[0]].parameters[0] = start[0];
        spec.parts[arms[1]].parameters[0] = start[1];
        Fit fit = instrument_problem_.fit(spec, 20);
        if (fit.chi2 < best.chi2) best = std::move(fit);
      }
    }
    hypothesis.fit = std::move(best);
  }
  hypothesis.ls_chi2 = hypothesis.fit.chi2;
  NoiseModel noise = instrument_problem_.estimate_noise(hypothesis.fit.spec);
  for (int round = 0; round < 2; ++round) {
    if (noise.coloured_N == 0.0 && round > 0) break;
    const Problem problem(series_, noise);
    Fit fit = problem.fit(hypothesis.fit.spec, 8);
    noise = problem.estimate_noise(fit.spec);
    hypothesis.fit = std::move(fit);
  }
  const Problem problem(series_, noise);
  hypothesis.fit.noise = noise;
  hypothesis.fit.log_likelihood = problem.log_likelihood(hypothesis.fit.spec, noise);
  const double numbers = static_cast<double>(counted_numbers(hypothesis.fit.spec));
  hypothesis.evidence =
      hypothesis.fit.log_likelihood - 0.5 * numbers * std::log(static_cast<double>(hypothesis.fit.rows));
}

}  // namespace isorig::identify
