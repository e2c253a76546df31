#include "identify/diagnose/design/design.hpp"

#include <algorithm>
#include <cmath>
#include <functional>
#include <optional>

#include "base/parallel.hpp"
#include "identify/diagnose/deciding/deciding.hpp"
#include "identify/diagnose/design/candidates.hpp"
#include "identify/diagnose/design/designer.hpp"

namespace isorig::identify {
namespace {

/// Explanations that remain possible. One that holds all effects of the best and some more is a rival only if it is
/// nearly as probable, because a further effect that is too small to be excluded can always be added.
std::vector<std::size_t> tied_of(const Selection& selection, const DesignOptions& options) {
  std::vector<std::size_t> tied{selection.best};
  double rivals = 0.0;
  for (std::size_t i = 0; i < selection.pool.size(); ++i) {
    const Hypothesis& other = selection.pool[i];
    const double weight = selection.weight[i];
    if (i == selection.best || !other.empirical.empty()) continue;
    if (holds_all(other, selection.chosen()) && weight < deciding().larger_rival_probability) continue;
    rivals += weight;
    if (weight >= options.least_weight) tied.push_back(i);
  }
  if (tied.size() < 2 || rivals < options.least_rivals || !selection.chosen().empirical.empty()) return {};
  std::ranges::stable_sort(tied, std::greater<>(), [&](std::size_t i) { return selection.weight[i]; });
  if (tied.size() > deciding().most_rivals) tied.resize(deciding().most_rivals);
  return tied;
}

struct Rated {
  CandidateExperiment item;
  Score score;
};

/// The best experiment so far: what it is, and what refitting without approximation says of it.
struct Choice {
  const Rated* rated = nullptr;
  Score proof;
  double least = -1.0;
};

/// Chooses an experiment in stages. First every candidate is scored to first order; then pairs that none of them
/// separates are set aside; the shortest that separates all others is proved by refits; if none does, two in one
/// session; and if that is not enough, what comes nearest.
class Chooser {
 public:
  Chooser(const Designer& designer, const DesignOptions& options, unsigned threads, Design& out)
      : designer_(designer),
        options_(options),
        pairs_(designer.pairs()),
        counts_(designer.pairs().size(), true),
        out_(out) {
    std::vector<CandidateExperiment> items = candidate_experiments(designer.limits());
    std::vector<std::optional<Score>> scores(items.size());
    base::parallel_for(items.size(), threads, [&](std::size_t i) { scores[i] = designer.score(items[i]); });
    for (std::size_t i = 0; i < items.size(); ++i)
      if (scores[i]) rated_.push_back({std::move(items[i]), std::move(*scores[i])});
    out_.considered = rated_.size();
  }

  /// False when no pair is left that an experiment could separate.
  [[nodiscard]] bool choose() {
    set_aside_inseparable();
    prove_singles();
    describe_inseparable(out_);
    if (std::ranges::none_of(counts_, std::identity())) return false;
    if (choice_.least < options_.enough) prove_doubles();
    if (choice_.rated == nullptr) take_nearest();
    return true;
  }
  void state_experiment() const;
  void list_others();

 private:
  using Place = std::vector<Rated>::const_iterator;
  [[nodiscard]] Place best_for(std::size_t pair) const {
    return std::ranges::max_element(rated_, {}, [pair](const Rated& r) { return r.score.distance[pair]; });
  }
  /// By refits, of one pair alone.
  [[nodiscard]] double proven(const CandidateExperiment& item, std::size_t pair) const {
    std::vector<bool> only(pairs_.size(), false);
    only[pair] = true;
    return designer_.prove(item, only).distance[pair];
  }
  /// Of the pairs that count, the one that the chosen experiment separates least.
  [[nodiscard]] std::size_t worst_pair() const {
    std::size_t worst = 0;
    for (std::size_t p = 0; p < choice_.proof.distance.size(); ++p)
      if (counts_[p] && (!counts_[worst] || choice_.proof.distance[p] < choice_.proof.distance[worst])) worst = p;
    return worst;
  }
  void set_aside(std::size_t pair, double distance) {
    counts_[pair] = false;
    out_.inseparable.push_back({pairs_[pair].truth, pairs_[pair].rival, distance, {}});
  }
  void set_aside_inseparable();
  void prove_some(const std::vector<Rated>& rated);
  void prove_singles();
  void prove_doubles();
  void take_nearest();

  const Designer& designer_;
  const DesignOptions& options_;
  const std::vector<Pair>& pairs_;
  std::vector<bool> counts_;  ///< the pairs that an experiment is designed for
  std::vector<Rated> rated_, doubles_;
  Choice choice_;
  Design& out_;
};

void Chooser::set_aside_inseparable() {
  for (std::size_t p = 0; p < pairs_.size(); ++p) {
    double distance = 0.0;
    const auto best = best_for(p);
    if (best != rated_.end()) {
      distance = best->score.distance[p];
      // Signs and bounds, which the first order ignores, can still separate them.
      if (distance < deciding().hopeless_squares) distance = std::min(proven(best->item, p), 1e12);
    }
    if (distance < deciding().hopeless_squares) set_aside(p, distance);
  }
}

/// Those that separate every pair to first order, shortest first, proved until one holds.
void Chooser::prove_some(const std::vector<Rated>& rated) {
  constexpr std::size_t kProofs = 6;
  std::vector<const Rated*> order;
  for (const Rated& each : rated)
    if (each.score.least(counts_) >= options_.enough) order.push_back(&each);
  std::ranges::stable_sort(order, {}, [](const Rated* r) { return r->item.duration_s; });
  if (order.size() > kProofs) order.resize(kProofs);
  for (const Rated* each : order) {
    Choice trial{each, designer_.prove(each->item, counts_, {choice_.least, worst_pair()}), 0.0};
    trial.least = trial.proof.least(counts_);
    if (trial.least > choice_.least) choice_ = std::move(trial);
    if (choice_.least >= options_.enough) return;
  }
}

void Chooser::prove_singles() {
  while (std::ranges::any_of(counts_, std::identity())) {
    choice_ = {};
    prove_some(rated_);
    if (choice_.rated == nullptr || choice_.least >= options_.enough) return;
    // To first order every pair was separated; refitted, the rival's other numbers make up for it in the worst one. If
    // the experiment that is best for that pair alone does no better, no experiment separates it: set it aside and
    // choose for the others.
    const std::size_t worst = worst_pair();
    if (choice_.proof.distance[worst] >= deciding().hopeless_squares) return;
    const double distance = std::max(proven(best_for(worst)->item, worst), choice_.proof.distance[worst]);
    if (distance >= deciding().hopeless_squares) return;
    set_aside(worst, distance);
  }
}

/// Two candidates in one session: the best for each pair, the shortest that is enough for it, and the best for the
/// worst pair, each with each.
void Chooser::prove_doubles() {
  std::vector<const Rated*> parts;
  const auto take = [&](const Rated& r) {
    if (std::ranges::find(parts, &r) == parts.end()) parts.push_back(&r);
  };
  for (std::size_t p = 0; p < pairs_.size(); ++p) {
    if (!counts_[p]) continue;
    take(*best_for(p));
    const auto quick =
        std::ranges::find_if(rated_, [&](const Rated& r) { return r.score.distance[p] >= options_.enough; });
    if (quick != rated_.end()) take(*quick);  // they are sorted by duration
  }
  take(*std::ranges::max_element(rated_, {}, [&](const Rated& r) { return r.score.least(counts_); }));
  for (std::size_t i = 0; i < parts.size(); ++i) {
    for (std::size_t j = i; j < parts.size(); ++j) {
      if (parts[i]->item.duration_s + parts[j]->item.duration_s > options_.longest_s) continue;
      CandidateExperiment item = joined(parts[i]->item, parts[j]->item, designer_.limits());
      if (auto score = designer_.score(item)) doubles_.push_back({std::move(item), std::move(*score)});
    }
  }
  prove_some(doubles_);
}

/// Nothing is expected to be enough: then what comes nearest.
void Chooser::take_nearest() {
  for (const auto* list : {&rated_, &doubles_})
    for (const Rated& each : *list)
      if (!choice_.rated || each.score.least(counts_) > choice_.rated->score.least(counts_)) choice_.rated = &each;
  choice_.proof = designer_.prove(choice_.rated->item, counts_);
  choice_.least = choice_.proof.least(counts_);
}

std::string protocol_name(const Design& design) {
  std::string name = "settle-" + design.tied.front().key;
  std::ranges::replace(name, '+', '-');
  return name.substr(0, 60);
}

void Chooser::state_experiment() const {
  Experiment experiment;
  experiment.name = protocol_name(out_);
  experiment.text = choice_.rated->item.name;
  experiment.duration_s = choice_.rated->item.duration_s;
  experiment.distance = choice_.least;
  experiment.enough = choice_.least >= options_.enough;
  for (std::size_t p = 0; p < pairs_.size(); ++p)
    if (counts_[p]) experiment.distances.push_back({pairs_[p].truth, pairs_[p].rival, choice_.proof.distance[p]});
  experiment.protocol =
      protocol_text(choice_.rated->item, designer_.limits(), experiment.name, "Separates " + out_.separates());
  out_.experiment = std::move(experiment);
}

/// What else was considered, by distance per second; the paper's ramps last. Sorts, so that choice_ is stale after it.
void Chooser::list_others() {
  constexpr std::size_t kMost = 4;
  std::ranges::stable_sort(rated_, std::greater<>(), [&](const Rated& r) {
    return std::min(r.score.least(counts_), 10.0 * options_.enough) / r.item.duration_s;
  });
  for (const Rated& each : rated_) {
    if (each.item.name == out_.experiment->text) continue;
    if (out_.others.size() >= kMost) break;
    out_.others.push_back({each.item.name, each.item.duration_s, each.score.least(counts_)});
  }
  if (auto again = designer_.paper_ramps_again())
    if (const auto score = designer_.score(*again))
      out_.others.push_back({again->name, again->duration_s, score->least(counts_)});
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
  Chooser chooser(designer, options, threads, out);
  if (!chooser.choose()) return out;
  chooser.state_experiment();
  chooser.list_others();
  return out;
}

}  // namespace isorig::identify
