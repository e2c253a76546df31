#include "identify/diagnose/search/hysteresis.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include "base/parallel.hpp"
#include "identify/diagnose/deciding/deciding.hpp"
#include "identify/diagnose/fit/basis.hpp"
#include "identify/diagnose/fit/left_out.hpp"
#include "identify/diagnose/search/discovery.hpp"
#include "identify/diagnose/search/empirical.hpp"
#include "identify/diagnose/search/published.hpp"
#include "model/catalogue.hpp"
#include "model/discovered.hpp"
#include "model/elements.hpp"
#include "model/length_scale.hpp"

namespace isorig::identify {
namespace {

using model::ModelSpec;
using model::Part;

struct Candidate {
  ModelSpec spec;
  std::string function_of;
  double squares = 0.0;
  std::map<std::string, double> inclusion = {};
};

bool is_relay(const Part& part) {
  return part.physics == &model::element::empirical_memory() && part.law->name == "branch";
}

/// Starts of every element with memory beside `base`.
std::vector<Candidate> starts(const ModelSpec& base, double duration_s) {
  std::vector<Candidate> out;
  const auto add = [&](const model::Physics& physics, std::string_view law, std::vector<double> parameters,
                       std::string_view function_of) {
    Candidate candidate{base, std::string(function_of), 0.0};
    candidate.spec.parts.push_back(
        model::make_part(physics, model::law_at(*model::find_law(physics, law), base.length_scale)));
    candidate.spec.parts.back().parameters = std::move(parameters);
    out.push_back(std::move(candidate));
  };
  const model::Physics& memory = model::element::empirical_memory();
  add(memory, "branch", {0.0, 0.0}, "branch (which side the position was last beyond)");
  std::vector<double> arms{1.0};
  for (const Part& part : base.parts)
    if (part.physics == &model::element::maxwell()) arms.push_back(part.parameters[0]);
  for (std::size_t arm = arms.size() > 1 ? 1 : 0; arm < arms.size(); ++arm)
    for (const double recovery_s : {5.0, 20.0, 80.0})
      for (const double travel_mm : {0.5, 3.0})
        add(memory, "structure", {arms[arm], recovery_s, travel_mm * base.length_scale},
            "structure (what motion broke and time has not healed)");
  for (double period_s = 0.12 * duration_s; period_s < 2.1 * duration_s; period_s *= 1.3)
    add(memory, "wave", {period_s}, "time since the start, as a wave");
  for (const double period_s : {0.01, 0.03, 0.06, 0.09, 0.13, 0.2})
    add(model::element::empirical_response(), "second_order", {period_s, 0.1},
        "force before (a second-order response)");
  return out;
}

/// "the force of an arm with the position, friction with the speed".
std::string words_of(const std::vector<std::string_view>& laws) {
  std::string out;
  for (const std::string_view law : laws) {
    const model::ProductWords words = model::product_words(law);
    out += (out.empty() ? "" : ", ") + words.force + (words.by.empty() ? "" : " with ") + words.by;
  }
  return out;
}

/// Products beside each base, refitted.
std::vector<Candidate> products(const Problem& problem, const std::vector<const ModelSpec*>& bases, unsigned threads) {
  std::vector<std::vector<DiscoveredModel>> found(bases.size());
  base::parallel_for(bases.size(), threads, [&](std::size_t i) { found[i] = discover(problem, *bases[i]); });
  std::vector<Candidate> out;
  for (auto& of_base : found)
    for (DiscoveredModel& one : of_base)
      out.push_back({std::move(one.spec), words_of(one.laws), 0.0, std::move(one.inclusion)});
  return out;
}

/// Whitened squares that a candidate saves on the left-out blocks, with the standard error of that sum.
struct Gain {
  const Candidate* candidate = nullptr;
  double sum = 0.0, error = 0.0;
};

/// The greatest gain, or the first product model that is less than a standard error below: `gains` are in the order of
/// the candidates, products last and the fewest of them first.
std::optional<Gain> simplest_of_the_best(const std::vector<Gain>& gains) {
  const auto best = std::ranges::max_element(gains, {}, &Gain::sum);
  if (best == gains.end()) return std::nullopt;
  for (const Gain& one : gains)
    if (!one.candidate->inclusion.empty() && one.sum >= best->sum - deciding().simpler_standard_errors * best->error)
      return one;
  return *best;
}

}  // namespace

bool has_relay(const ModelSpec& spec) {
  return std::ranges::any_of(spec.parts, is_relay);
}

// With r the residual after all columns and Q their basis, a column s gains (r.s)^2 / (s.s - |Q's|^2).
void scan_relay(const Problem& problem, ModelSpec& spec) {
  const auto series = problem.series();
  const auto n = problem.target().size();
  RowMatrix all;
  ModelSpec base = spec;
  std::erase_if(base.parts, is_relay);
  problem.columns(base, all);
  Eigen::VectorXd weight(n);
  double low = 1e300, high = -1e300;
  Eigen::Index row = 0;
  for (const Series& each : series) {
    for (std::size_t k = 0; k < each.nodes.size(); ++k) {
      weight[row++] = std::sqrt(each.count[k]);
      low = std::min(low, each.nodes[k].position_mm);
      high = std::max(high, each.nodes[k].position_mm);
    }
  }
  const Eigen::MatrixXd q = orthonormal_basis(weight.asDiagonal() * all);
  Eigen::VectorXd r = weight.asDiagonal() * problem.target();
  r -= q * (q.transpose() * r);
  const auto gain = [&](double upper, double lower) {
    double rs = 0.0, ss = 0.0;
    Eigen::VectorXd qs = Eigen::VectorXd::Zero(q.cols());
    Eigen::Index i = 0;
    for (const Series& each : series) {
      bool over = each.nodes.front().position_mm > upper;
      for (const auto& node : each.nodes) {
        if (node.position_mm > upper) over = true;
        if (node.position_mm < lower) over = false;
        if (over) {
          rs += weight[i] * r[i];
          ss += weight[i] * weight[i];
          qs += weight[i] * q.row(i).transpose();
        }
        ++i;
      }
    }
    const double rest = ss - qs.squaredNorm();
    return rest > 1e-3 * ss && ss > 0.0 ? rs * rs / rest : 0.0;
  };
  constexpr int kGrid = 24;
  double step = (high - low) / kGrid, best = -1.0, upper = 0.0, lower = 0.0;
  const auto offer = [&](double u, double l) {
    if (u < l) return;
    if (const double g = gain(u, l); g > best) {
      best = g;
      upper = u;
      lower = l;
    }
  };
  for (int i = 1; i < kGrid; ++i)
    for (int j = 1; j <= i; ++j) offer(low + i * step, low + j * step);
  for (int round = 0; round < 3; ++round) {
    const double u = upper, l = lower;
    for (int i = -4; i <= 4; ++i)
      for (int j = -4; j <= 4; ++j) offer(u + 0.25 * i * step, l + 0.25 * j * step);
    step *= 0.25;
  }
  std::ranges::find_if(spec.parts, is_relay)->parameters = {upper, lower};
}

std::optional<HysteresisDescription> describe_hysteresis(const Search& search, const Selection& selection,
                                                         unsigned threads, DescribeBy by) {
  NoiseModel white = search.instrument();
  white.white_N = std::hypot(white.white_N, white.coloured_N);
  white.coloured_N = 0.0;
  const Problem problem(search.instrument_problem().series(), white);
  double duration_s = 0.0;
  for (const Series& each : problem.series())
    duration_s = std::max(duration_s, each.nodes.back().t_s - each.nodes.front().t_s);

  const Hypothesis* named = nullptr;  // the best set of effects without a table
  std::size_t best_named = 0;
  for (std::size_t i = 0; i < selection.pool.size(); ++i)
    if (selection.pool[i].empirical.empty() && selection.weight[i] > selection.weight[best_named]) best_named = i;
  if (best_named != 0) named = &selection.pool[best_named];
  std::vector<const ModelSpec*> bases{&selection.nominal().fit.spec};
  if (named != nullptr) bases.push_back(&named->fit.spec);
  std::erase_if(bases, [](const ModelSpec* base) { return has_table(*base); });
  std::vector<Candidate> all;
  if (by == DescribeBy::kProductsAndMemory) {
    for (const ModelSpec* base : bases) {
      const std::vector<Candidate> more = starts(*base, duration_s);
      all.insert(all.end(), more.begin(), more.end());
    }
  }
  base::parallel_for(all.size(), threads, [&](std::size_t i) {
    if (has_relay(all[i].spec)) scan_relay(problem, all[i].spec);
    const Fit fit = problem.fit(all[i].spec, 4);
    all[i].spec = fit.spec;
    all[i].squares = fit.chi2;
  });
  std::ranges::stable_sort(all, {}, &Candidate::squares);
  constexpr std::size_t kMost = 3;
  std::vector<Candidate> finalists;
  for (const Candidate& one : all) {
    if (finalists.size() == kMost) break;
    if (std::ranges::none_of(finalists, [&](const Candidate& other) {
          return other.function_of == one.function_of && other.spec.parts.size() == one.spec.parts.size();
        }))
      finalists.push_back(one);
  }
  base::parallel_for(finalists.size(), threads, [&](std::size_t i) {
    Fit fit = problem.fit(finalists[i].spec, 30);
    if (has_relay(fit.spec)) {
      // Thresholds once more with the rest settled.
      ModelSpec again = fit.spec;
      scan_relay(problem, again);
      if (Fit second = problem.fit(again, 20); second.chi2 < fit.chi2) fit = std::move(second);
    }
    finalists[i].spec = fit.spec;
  });

  const std::vector<Candidate> laws = products(problem, bases, threads);
  finalists.insert(finalists.end(), laws.begin(), laws.end());

  // Squares of every block in units of the noise.
  const Blocks parted = blocks_of(problem.series());
  const auto squares_by_block = [&](const ModelSpec& spec, const Criterion& criterion) {
    std::vector<double> out;
    for (const Prediction& block : predict_blocks(problem.series(), learn_again(spec, criterion), parted, threads))
      out.push_back(block.squares_N2 / (white.white_N * white.white_N));
    return out;
  };
  const std::vector<double> now = squares_by_block(selection.chosen().fit.spec, criterion_of_chosen(search, selection));
  double lacking = 0.0, rows = 0.0;
  for (const double squares : now) lacking += squares;
  for (const Series& each : problem.series())
    for (const double count : each.count) rows += count > 0.0 ? 1.0 : 0.0;
  lacking = std::max(lacking - selection.noise_scale * rows, 0.0);
  std::vector<Gain> gains;
  for (const Candidate& one : finalists) {
    const std::vector<double> then = squares_by_block(one.spec, {white, false});
    Gain gain{&one};
    double squares = 0.0;
    const auto blocks = static_cast<double>(now.size());
    for (std::size_t b = 0; b < now.size(); ++b) {
      gain.sum += now[b] - then[b];
      squares += (now[b] - then[b]) * (now[b] - then[b]);
    }
    gain.error =
        std::sqrt(std::max(squares - gain.sum * gain.sum / blocks, 0.0) * blocks / std::max(blocks - 1.0, 1.0));
    if (gain.sum > deciding().memory_standard_errors * gain.error &&
        gain.sum >= deciding().memory_least_share * lacking && gain.sum > 0.0)
      gains.push_back(gain);
  }
  const auto best = simplest_of_the_best(gains);
  if (!best) return std::nullopt;
  const Candidate& taken = *best->candidate;
  return HysteresisDescription{taken.spec, taken.function_of, white, taken.inclusion};
}

}  // namespace isorig::identify
