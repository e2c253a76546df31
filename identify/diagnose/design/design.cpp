#include "identify/diagnose/design/design.hpp"

#include <algorithm>
#include <cmath>
#include <functional>
#include <optional>

#include "base/parallel.hpp"
#include "base/toml_reader.hpp"
#include "identify/diagnose/design/candidates.hpp"
#include "identify/diagnose/design/rehearse.hpp"

namespace isorig::identify {
namespace {

constexpr std::size_t kMostRivals = 4;
/// A pair that no candidate experiment moves farther apart than this is one explanation under two names, for this rig.
constexpr double kHopeless = 20.0;

bool holds_all(const Hypothesis& whole, const Hypothesis& part) {
  return std::ranges::all_of(part.effects, [&](const auto* e) { return whole.has(*e); });
}

/// Explanations that are still in the race. One that holds all of the best and something more is no rival
/// unless it is nearly as probable: that some further effect is too small to be excluded is always so.
std::vector<std::size_t> tied_of(const Selection& selection, const DesignOptions& options) {
  std::vector<std::size_t> tied{selection.best};
  double rivals = 0.0;
  for (std::size_t i = 0; i < selection.pool.size(); ++i) {
    const Hypothesis& other = selection.pool[i];
    const double weight = selection.weight[i];
    if (i == selection.best || !other.empirical.empty()) continue;
    if (holds_all(other, selection.chosen()) && weight < 0.2) continue;
    rivals += weight;
    if (weight >= options.least_weight) tied.push_back(i);
  }
  if (tied.size() < 2 || rivals < options.least_rivals || !selection.chosen().empirical.empty()) return {};
  std::ranges::stable_sort(tied, std::greater<>(), [&](std::size_t i) { return selection.weight[i]; });
  if (tied.size() > kMostRivals) tied.resize(kMostRivals);
  return tied;
}

struct Handle {
  std::size_t part, index;
  bool coefficient;
  double step;
};

/// An explanation, what moves in it, and how well the recordings hold that.
struct Rival {
  const Hypothesis* hypothesis = nullptr;
  model::ModelSpec spec;
  std::vector<Handle> handles;
  Eigen::MatrixXd information;
  double chi2 = 0.0;  ///< over the recordings so far
};

std::vector<Handle> handles_of(const model::ModelSpec& spec) {
  std::vector<Handle> out;
  for (std::size_t p = 0; p < spec.parts.size(); ++p) {
    const auto& part = spec.parts[p];
    if (part.fixed) continue;
    for (std::size_t i = 0; i < part.coefficients.size(); ++i)
      out.push_back({p, i, true, 1e-3 * std::max(std::fabs(part.coefficients[i]), 1e-2)});
    for (std::size_t i = 0; i < part.parameters.size(); ++i) {
      const auto& parameter = part.law->parameters[i];
      if (parameter.fixed || parameter.name == "time_s") continue;
      const double scale =
          parameter.logarithmic ? std::fabs(part.parameters[i]) : std::max(std::fabs(part.parameters[i]), 1e-2);
      const bool below = part.parameters[i] + 1e-3 * scale > parameter.upper;
      out.push_back({p, i, false, (below ? -1e-3 : 1e-3) * scale});
    }
  }
  return out;
}

/// Whitened force and its derivatives per step of each handle.
void linearise(const Problem& problem, const Rival& rival, Eigen::VectorXd& force, RowMatrix& slopes) {
  const Eigen::VectorXd at = problem.predict(rival.spec);
  RowMatrix all(at.size(), static_cast<Eigen::Index>(rival.handles.size()));
  for (std::size_t h = 0; h < rival.handles.size(); ++h) {
    model::ModelSpec moved = rival.spec;
    auto& part = moved.parts[rival.handles[h].part];
    (rival.handles[h].coefficient ? part.coefficients : part.parameters)[rival.handles[h].index] +=
        rival.handles[h].step;
    all.col(static_cast<Eigen::Index>(h)) = problem.predict(moved) - at;
  }
  force = at;
  slopes = std::move(all);
}

Eigen::MatrixXd whitened(const Problem& problem, RowMatrix columns) {
  (void)whiten(problem.series(), problem.noise(), columns);
  return columns;
}

/// What an experiment does to the set: the distance of every pair that counts.
struct Score {
  std::vector<double> distance;
  double least(const std::vector<bool>& counts) const {
    double out = HUGE_VAL;
    for (std::size_t i = 0; i < distance.size(); ++i)
      if (counts[i]) out = std::min(out, distance[i]);
    return out;
  }
};

struct Pair {
  std::size_t truth, rival;
};

std::vector<model::ModelSpec> starts_of(const Rival& rival);

class Designer {
 public:
  Designer(const Search& search, const Selection& selection, const std::vector<std::size_t>& tied,
           const DesignOptions& options, unsigned threads)
      : options_(options), threads_(threads), recorded_(search.instrument_problem().series()) {
    noise_ = selection.chosen().fit.noise;
    noise_.white_N = std::max(noise_.white_N, search.instrument().white_N);
    const Problem problem(recorded_, noise_);
    rivals_.resize(tied.size());
    base::parallel_for(tied.size(), threads_, [&](std::size_t i) {
      Rival& rival = rivals_[i];
      rival.hypothesis = &selection.pool[tied[i]];
      const Fit fit = problem.fit(rival.hypothesis->fit.spec, 8);
      rival.spec = fit.spec;
      rival.chi2 = fit.chi2;
      rival.handles = handles_of(rival.spec);
      Eigen::VectorXd force;
      RowMatrix slopes;
      linearise(problem, rival, force, slopes);
      const Eigen::MatrixXd j = whitened(problem, std::move(slopes));
      rival.information = j.transpose() * j;
    });
    // Of a set and a larger one that holds it, the larger explains what the smaller predicts: only the other
    // direction tells them apart.
    for (std::size_t i = 0; i < rivals_.size(); ++i)
      for (std::size_t j = 0; j < rivals_.size(); ++j)
        if (i != j && !holds_all(*rivals_[j].hypothesis, *rivals_[i].hypothesis)) pairs_.push_back({i, j});
    read_limits();
  }

  /// What the recordings did, once more: the paper's ramps at their stroke and speed.
  [[nodiscard]] std::optional<CandidateExperiment> paper_ramps_again() const {
    try {
      return session_of("the paper's ramps once more",
                        paper_ramps(std::min(recorded_stroke_mm_, limits_.stroke_mm), recorded_speed_mm_s_, 0.01),
                        limits_);
    } catch (const base::ConfigError&) {
      return std::nullopt;
    }
  }

  [[nodiscard]] const CandidateLimits& limits() const { return limits_; }
  [[nodiscard]] const std::vector<Pair>& pairs() const { return pairs_; }

  /// To first order. Empty when a tied explanation expects forces beyond the limits.
  [[nodiscard]] std::optional<Score> score(const CandidateExperiment& item) const {
    const std::vector<Series> run{rehearse(item.plan, reference_, sampling_)};
    const Problem problem(run, noise_);
    const auto n = static_cast<Eigen::Index>(run[0].nodes.size()), k = static_cast<Eigen::Index>(rivals_.size());
    RowMatrix forces(n, k);
    std::vector<Eigen::MatrixXd> slopes(rivals_.size());
    for (std::size_t i = 0; i < rivals_.size(); ++i) {
      Eigen::VectorXd force;
      RowMatrix columns;
      linearise(problem, rivals_[i], force, columns);
      if (!bearable(run[0], force)) return std::nullopt;
      forces.col(static_cast<Eigen::Index>(i)) = force;
      slopes[i] = whitened(problem, std::move(columns));
    }
    const Eigen::MatrixXd f = whitened(problem, forces);
    Score out;
    for (const Pair& pair : pairs_) {
      const auto& j = slopes[pair.rival];
      const Eigen::VectorXd apart =
          f.col(static_cast<Eigen::Index>(pair.truth)) - f.col(static_cast<Eigen::Index>(pair.rival));
      Eigen::MatrixXd a = j.transpose() * j + rivals_[pair.rival].information;
      a.diagonal() *= 1.0 + 1e-9;
      a.diagonal().array() += 1e-9;
      const Eigen::VectorXd right = j.transpose() * apart;
      out.distance.push_back(std::max(apart.squaredNorm() - right.dot(a.ldlt().solve(right)), 0.0));
    }
    return out;
  }

  /// Without approximation: each rival refitted to the recordings and what the truth says of the new one.
  [[nodiscard]] Score prove(const CandidateExperiment& item, const std::vector<bool>& counts) const {
    const Series fresh = rehearse(item.plan, reference_, sampling_);
    Score out;
    out.distance.assign(pairs_.size(), 0.0);
    base::parallel_for(pairs_.size(), threads_, [&](std::size_t p) {
      if (!counts[p]) return;
      std::vector<Series> run{fresh};
      const Eigen::VectorXd force = Problem(run, noise_).predict(rivals_[pairs_[p].truth].spec);
      run[0].force_N.assign(force.data(), force.data() + force.size());
      std::vector<Series> all(recorded_.begin(), recorded_.end());
      all.push_back(std::move(run[0]));
      const Problem joint(all, noise_);
      const Rival& rival = rivals_[pairs_[p].rival];
      double least = HUGE_VAL;
      // Laws of one effect stand in for each other: the new data may suit another better.
      for (const model::ModelSpec& start : starts_of(rival)) least = std::min(least, joint.fit(start, 10).chi2);
      out.distance[p] = std::max(least - rival.chi2, 0.0);
    });
    return out;
  }

 private:
  void read_limits();
  [[nodiscard]] bool bearable(const Series& run, const Eigen::VectorXd& force_N) const;

  const DesignOptions& options_;
  unsigned threads_;
  std::span<const Series> recorded_;
  NoiseModel noise_;
  std::vector<Rival> rivals_;
  std::vector<Pair> pairs_;
  model::Reference reference_;
  CandidateLimits limits_;
  Sampling sampling_;
  double recorded_stroke_mm_ = 0.0;
  double recorded_speed_mm_s_ = 0.0;
};

/// The rival as it is, and with every other law of its effects in turn: the new data may suit another better.
std::vector<model::ModelSpec> starts_of(const Rival& rival) {
  std::vector<model::ModelSpec> out{rival.spec};
  for (std::size_t p = 0; p < rival.spec.parts.size(); ++p) {
    const auto& part = rival.spec.parts[p];
    if (std::ranges::find(rival.hypothesis->effects, part.physics) == rival.hypothesis->effects.end()) continue;
    for (const model::Law& law : part.physics->laws) {
      const bool given = std::ranges::any_of(law.parameters, &model::Parameter::fixed);
      if (&law == part.law || given || law.replaces_arm || part.law->replaces_arm || !law.make) continue;
      out.push_back(rival.spec);
      out.back().parts[p] = model::make_part(*part.physics, law);
    }
  }
  return out;
}

void Designer::read_limits() {
  double low = 0.0, high = 0.0, least_N = HUGE_VAL, most_N = -HUGE_VAL, most_psi = 0.0;
  std::vector<double> gaps_s;
  bool pneumatic = false;
  for (const Series& each : recorded_) {
    for (const auto& node : each.nodes) {
      low = std::min(low, node.position_mm);
      high = std::max(high, node.position_mm);
    }
    for (std::size_t k = 0; k < each.nodes.size(); ++k)
      if (each.since_corner_s[k] > 0.0)
        recorded_speed_mm_s_ = std::max(recorded_speed_mm_s_, std::fabs(each.nodes[k].velocity_mm_s));
    for (const double f : each.force_N) {
      least_N = std::min(least_N, f);
      most_N = std::max(most_N, f);
    }
    const auto& t_s = each.recording.frame.t_s;
    for (std::size_t k = 1; k < t_s.size(); ++k) gaps_s.push_back(t_s[k] - t_s[k - 1]);
    pneumatic = pneumatic || !each.excitation.pressure_psi.empty();
    for (const double psi : each.excitation.pressure_psi) most_psi = std::max(most_psi, psi);
  }
  if (recorded_speed_mm_s_ <= 0.0)
    for (const Series& each : recorded_)
      for (const auto& node : each.nodes)
        recorded_speed_mm_s_ = std::max(recorded_speed_mm_s_, std::fabs(node.velocity_mm_s));
  recorded_stroke_mm_ = std::max(high, -low);
  if (!gaps_s.empty()) {
    const auto at = gaps_s.begin() + static_cast<std::ptrdiff_t>(gaps_s.size() / 20);
    std::ranges::nth_element(gaps_s, at);
    sampling_.full_s = std::clamp(*at, 1e-4, 1.0);
  }
  reference_ = recorded_[0].excitation.reference;
  if (options_.rig) {
    limits_.rig = *options_.rig;
    // A specimen that was never stretched that far may do something new there: twice as far is far enough.
    const double travel_mm = std::min(-limits_.rig.travel_min_mm, limits_.rig.travel_max_mm);
    const double overrun_mm = protocol::Limits::travel_room_mm(limits_.rig.speed_max_mm_s);
    const double room_mm = std::max(0.0, std::min(0.95 * travel_mm, travel_mm - overrun_mm));
    limits_.stroke_mm = std::min(room_mm, std::max(2.0 * recorded_stroke_mm_, 0.1));
  } else {
    const double span_N = 0.25 * (most_N - least_N);
    const double overrun_mm = protocol::Limits::travel_room_mm(recorded_speed_mm_s_);
    limits_.rig.travel_min_mm = low - overrun_mm;
    limits_.rig.travel_max_mm = high + overrun_mm;
    limits_.rig.speed_max_mm_s = recorded_speed_mm_s_;
    limits_.rig.speed_min_mm_s = std::min(0.01, 0.1 * recorded_speed_mm_s_);
    limits_.rig.force_min_N = least_N - span_N;
    limits_.rig.force_max_N = most_N + span_N;
    limits_.rig.pressure_max_psi = std::max(most_psi, reference_.nominal_pressure_psi);
    limits_.rig.pressure_rate_max_psi_s = 1.0;
    limits_.rig.segment_interval_min_s = 0.05;
    limits_.stroke_mm = std::min(-low, high) > 0.05 ? std::min(-low, high) : 0.0;
  }
  limits_.nominal_psi = reference_.nominal_pressure_psi;
  limits_.longest_s = options_.longest_s;
  for (const Rival& rival : rivals_)
    for (const auto* effect : rival.hypothesis->effects)
      limits_.pressure_matters =
          limits_.pressure_matters || (pneumatic && effect->name.find("pressure") != std::string_view::npos);
}

bool Designer::bearable(const Series& run, const Eigen::VectorXd& force_N) const {
  constexpr double kMargin = 0.1;
  const auto& rig = limits_.rig;
  const double span_N = rig.force_max_N - rig.force_min_N;
  const double margin_N = std::isfinite(span_N) ? kMargin * span_N : 0.0;
  for (Eigen::Index k = 0; k < force_N.size(); ++k) {
    if (force_N[k] < rig.force_min_N + margin_N || force_N[k] > rig.force_max_N - margin_N) return false;
    const double dt_s = run.nodes[static_cast<std::size_t>(k)].dt_s;
    if (k > 0 && dt_s > 0.0 && std::fabs(force_N[k] - force_N[k - 1]) > (1.0 - kMargin) * rig.force_rate_max_N_s * dt_s)
      return false;
  }
  return true;
}

struct Rated {
  CandidateExperiment item;
  Score score;
};

/// Sorted by duration, those whose worst pair is far enough apart; proves one after the other.
struct Choice {
  const Rated* rated = nullptr;
  Score proof;
  double least = -1.0;
};

void prove_some(const Designer& designer, const std::vector<Rated>& rated, const std::vector<bool>& counts,
                double enough, std::size_t most, Choice& best) {
  std::vector<const Rated*> order;
  for (const Rated& each : rated)
    if (each.score.least(counts) >= enough) order.push_back(&each);
  std::ranges::stable_sort(order, {}, [](const Rated* r) { return r->item.duration_s; });
  for (std::size_t i = 0; i < std::min(most, order.size()); ++i) {
    Choice trial{order[i], designer.prove(order[i]->item, counts), 0.0};
    trial.least = trial.proof.least(counts);
    if (trial.least > best.least) best = std::move(trial);
    if (best.least >= enough) return;
  }
}

std::string protocol_name(const Design& design) {
  std::string name = "settle-" + design.tied.front().key;
  std::ranges::replace(name, '+', '-');
  return name.substr(0, 60);
}

}  // namespace

Design design_experiment(const Search& search, const Selection& selection, const DesignOptions& options,
                         unsigned threads) {
  Design out;
  out.enough = options.enough;
  const std::vector<std::size_t> tied = tied_of(selection, options);
  if (tied.empty()) return out;
  for (const std::size_t i : tied) out.tied.push_back({selection.pool[i].key(), selection.weight[i]});
  const Designer designer(search, selection, tied, options, threads);
  const auto& pairs = designer.pairs();

  std::vector<CandidateExperiment> items = candidate_experiments(designer.limits());
  std::vector<std::optional<Score>> scores(items.size());
  base::parallel_for(items.size(), threads, [&](std::size_t i) { scores[i] = designer.score(items[i]); });
  std::vector<Rated> rated;
  for (std::size_t i = 0; i < items.size(); ++i)
    if (scores[i]) rated.push_back({std::move(items[i]), std::move(*scores[i])});
  out.considered = rated.size();
  const auto best_for = [&](std::size_t p) {
    return std::ranges::max_element(rated, {}, [p](const Rated& r) { return r.score.distance[p]; });
  };

  std::vector<bool> counts(pairs.size(), true);
  for (std::size_t p = 0; p < pairs.size(); ++p) {
    double distance = 0.0;
    const auto best = best_for(p);
    if (best != rated.end()) {
      distance = best->score.distance[p];
      // Signs and bounds, which the first order does not know, can still tell them apart.
      if (distance < kHopeless) {
        std::vector<bool> only(pairs.size(), false);
        only[p] = true;
        distance = std::min(designer.prove(best->item, only).distance[p], 1e12);
      }
    }
    if (distance >= kHopeless) continue;
    counts[p] = false;
    out.inseparable.push_back({pairs[p].truth, pairs[p].rival, distance, {}});
  }
  Choice choice;
  constexpr std::size_t kProofs = 6;
  while (std::ranges::any_of(counts, std::identity())) {
    choice = {};
    prove_some(designer, rated, counts, options.enough, kProofs, choice);
    if (choice.rated == nullptr || choice.least >= options.enough) break;
    // To first order it was enough, and to the rival's other numbers it was nothing: does the experiment that
    // is best for that pair fare better?
    std::size_t worst = 0;
    for (std::size_t p = 0; p < pairs.size(); ++p)
      if (counts[p] && (!counts[worst] || choice.proof.distance[p] < choice.proof.distance[worst])) worst = p;
    if (choice.proof.distance[worst] >= kHopeless) break;
    std::vector<bool> only(pairs.size(), false);
    only[worst] = true;
    const double distance =
        std::max(designer.prove(best_for(worst)->item, only).distance[worst], choice.proof.distance[worst]);
    if (distance >= kHopeless) break;
    counts[worst] = false;
    out.inseparable.push_back({pairs[worst].truth, pairs[worst].rival, distance, {}});
  }
  describe_inseparable(out);
  if (std::ranges::none_of(counts, std::identity())) return out;
  std::vector<Rated> both;
  if (choice.least < options.enough) {
    // Two of them in one session: the best for each pair, and the best for the worst pair.
    std::vector<const Rated*> parts;
    const auto take = [&](const Rated& r) {
      if (std::ranges::find(parts, &r) == parts.end()) parts.push_back(&r);
    };
    for (std::size_t p = 0; p < pairs.size(); ++p) {
      if (!counts[p]) continue;
      take(*best_for(p));
      const auto quick =
          std::ranges::find_if(rated, [&](const Rated& r) { return r.score.distance[p] >= options.enough; });
      if (quick != rated.end()) take(*quick);  // they are sorted by duration
    }
    take(*std::ranges::max_element(rated, {}, [&](const Rated& r) { return r.score.least(counts); }));
    for (std::size_t i = 0; i < parts.size(); ++i) {
      for (std::size_t j = i; j < parts.size(); ++j) {
        if (parts[i]->item.duration_s + parts[j]->item.duration_s > options.longest_s) continue;
        CandidateExperiment item = joined(parts[i]->item, parts[j]->item, designer.limits());
        if (auto score = designer.score(item)) both.push_back({std::move(item), std::move(*score)});
      }
    }
    prove_some(designer, both, counts, options.enough, kProofs, choice);
  }
  if (!choice.rated) {
    // Nothing is expected to be enough: then what comes nearest.
    for (const auto* list : {&rated, &both})
      for (const Rated& each : *list)
        if (!choice.rated || each.score.least(counts) > choice.rated->score.least(counts)) choice.rated = &each;
    choice.proof = designer.prove(choice.rated->item, counts);
    choice.least = choice.proof.least(counts);
  }

  Experiment experiment;
  experiment.name = protocol_name(out);
  experiment.text = choice.rated->item.name;
  experiment.duration_s = choice.rated->item.duration_s;
  experiment.distance = choice.least;
  experiment.enough = choice.least >= options.enough;
  for (std::size_t p = 0; p < pairs.size(); ++p)
    if (counts[p]) experiment.distances.push_back({pairs[p].truth, pairs[p].rival, choice.proof.distance[p]});
  experiment.protocol =
      protocol_text(choice.rated->item, designer.limits(), experiment.name, "Separates " + out.separates());
  out.experiment = std::move(experiment);

  std::ranges::stable_sort(rated, std::greater<>(), [&](const Rated& r) {
    return std::min(r.score.least(counts), 10.0 * options.enough) / r.item.duration_s;
  });
  for (const Rated& each : rated) {
    if (each.item.name == out.experiment->text) continue;
    if (out.others.size() >= 4) break;
    out.others.push_back({each.item.name, each.item.duration_s, each.score.least(counts)});
  }
  if (auto again = designer.paper_ramps_again())
    if (const auto score = designer.score(*again))
      out.others.push_back({again->name, again->duration_s, score->least(counts)});
  return out;
}

}  // namespace isorig::identify
