#include "identify/diagnose/design/designer.hpp"

#include <algorithm>
#include <atomic>
#include <numeric>

#include "base/parallel.hpp"
#include "base/quantile.hpp"
#include "base/toml_reader.hpp"
#include "model/length_scale.hpp"

namespace isorig::identify {
namespace {

std::vector<FreeNumber> numbers_of(const model::ModelSpec& spec) {
  std::vector<FreeNumber> out = free_coefficients(spec);
  for (const FreeNumber& parameter : free_parameters(spec)) out.push_back(parameter);
  return out;
}

/// Force and its change per difference step of each number.
void linearise(const Problem& problem, const Rival& rival, Eigen::VectorXd& force, RowMatrix& slopes) {
  force = problem.predict(rival.spec);
  slopes = differences(rival.spec, rival.numbers, force,
                       [&](const model::ModelSpec& moved) { return problem.predict(moved); });
}

Eigen::MatrixXd whitened(const Problem& problem, RowMatrix columns) {
  (void)whiten(problem.series(), problem.noise(), columns);
  return columns;
}

/// The rival as it is, and with every other law of its effects in turn: another law may fit the new data better.
std::vector<model::ModelSpec> starts_of(const Rival& rival) {
  std::vector<model::ModelSpec> out{rival.spec};
  for (std::size_t p = 0; p < rival.spec.parts.size(); ++p) {
    const auto& part = rival.spec.parts[p];
    if (std::ranges::find(rival.hypothesis->effects, part.physics) == rival.hypothesis->effects.end()) continue;
    for (const model::Law& known : part.physics->laws) {
      const model::Law& law = model::law_at(known, rival.spec.length_scale);
      const bool given = std::ranges::any_of(law.parameters, &model::Parameter::fixed);
      if (&law == part.law || given || law.traits.replaces_arm || part.law->traits.replaces_arm || !law.make) continue;
      out.push_back(rival.spec);
      out.back().parts[p] = model::make_part(*part.physics, law);
    }
  }
  return out;
}

}  // namespace

bool holds_all(const Hypothesis& whole, const Hypothesis& part) {
  return std::ranges::all_of(part.effects, [&](const auto* e) { return whole.has(*e); });
}

Designer::Designer(const Search& search, const Selection& selection, const std::vector<std::size_t>& tied,
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
    rival.numbers = numbers_of(rival.spec);
    Eigen::VectorXd force;
    RowMatrix slopes;
    linearise(problem, rival, force, slopes);
    const Eigen::MatrixXd j = whitened(problem, std::move(slopes));
    rival.information = j.transpose() * j;
  });
  // If the rival contains all effects of the truth, it can reproduce whatever the truth predicts, and no experiment
  // has a distance. Only the other direction, where the larger set is true, tells the two apart.
  for (std::size_t i = 0; i < rivals_.size(); ++i)
    for (std::size_t j = 0; j < rivals_.size(); ++j)
      if (i != j && !holds_all(*rivals_[j].hypothesis, *rivals_[i].hypothesis)) pairs_.push_back({i, j});
  read_limits();
}

std::optional<CandidateExperiment> Designer::paper_ramps_again() const {
  try {
    return session_of("the paper's ramps once more",
                      paper_ramps(std::min(recorded_stroke_mm_, limits_.stroke_mm), recorded_speed_mm_s_, 0.01),
                      limits_);
  } catch (const base::ConfigError&) {
    return std::nullopt;
  }
}

std::optional<Score> Designer::score(const CandidateExperiment& item) const {
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

Score Designer::prove(const CandidateExperiment& item, const std::vector<bool>& counts, const ToBeat& to_beat) const {
  const Series fresh = rehearse(item.plan, reference_, sampling_);
  Score out;
  out.distance.assign(pairs_.size(), 0.0);
  // The pair that is the other experiment's worst is likely to be this one's: it comes first.
  std::vector<std::size_t> order(pairs_.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  if (to_beat.pair < order.size()) std::swap(order.front(), order[to_beat.pair]);
  std::atomic<bool> beaten = false;
  base::parallel_for(order.size(), threads_, [&](std::size_t at) {
    const std::size_t p = order[at];
    if (!counts[p] || beaten) return;
    std::vector<Series> run{fresh};
    const Eigen::VectorXd force = Problem(run, noise_).predict(rivals_[pairs_[p].truth].spec);
    run[0].force_N.assign(force.data(), force.data() + force.size());
    std::vector<Series> all(recorded_.begin(), recorded_.end());
    all.push_back(std::move(run[0]));
    const Problem joint(all, noise_);
    const Rival& rival = rivals_[pairs_[p].rival];
    double least = HUGE_VAL;
    // Laws of one effect can replace each other: another may fit the new data better.
    for (const model::ModelSpec& start : starts_of(rival)) {
      least = std::min(least, joint.fit(start, 10).chi2);
      if (std::max(least - rival.chi2, 0.0) <= to_beat.least) beaten = true;
      if (beaten) break;
    }
    out.distance[p] = std::max(least - rival.chi2, 0.0);
  });
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
    sampling_.full_s = std::clamp(base::quantile_in_place(gaps_s, 0.05), 1e-4, 1.0);
  }
  reference_ = recorded_[0].excitation.reference;
  if (options_.rig) {
    limits_.rig = *options_.rig;
    // A specimen may show new physics where it was never stretched before: strokes are limited to twice the recorded
    // ones.
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
          limits_.pressure_matters || (pneumatic && effect->traits.pressure != model::PressureNeed::kNone);
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

}  // namespace isorig::identify
