#include "proof/scoring/score.hpp"

#include <algorithm>
#include <array>
#include <stdexcept>
#include <string_view>

#include "base/quantile.hpp"

namespace isorig::proof {
namespace {

double finite_median(std::vector<double> values) {
  std::erase_if(values, [](double v) { return !std::isfinite(v); });
  return base::median(std::move(values));
}

bool claims(const Outcome& outcome, const std::string& effect) {
  return std::ranges::count(outcome.missing, effect, &Claim::effect) > 0;
}

bool complete(const Outcome& outcome, const Label& label) {
  return std::ranges::all_of(label.effects, [&](const std::string& e) { return claims(outcome, e); });
}

bool sure_of_another(const Outcome& outcome, const Label& label) {
  return std::ranges::any_of(outcome.missing, [&](const Claim& claim) {
    return claim.probability > 0.9 && std::ranges::count(label.effects, claim.effect) == 0;
  });
}

void count_case(Score& s, const Label& label, const Outcome& outcome) {
  s.failed.count(outcome.failed);
  s.wrong_sure.count(sure_of_another(outcome, label));
  const bool alarm = outcome.failed || outcome.verdict != "consistent";
  const bool first =
      !outcome.missing.empty() && !label.effects.empty() && outcome.missing.front().effect == label.effects.front();
  const bool all = !outcome.failed && complete(outcome, label);
  const bool exact = all && outcome.missing.size() == label.effects.size();
  if (label.category == "null") {
    s.false_alarms.count(alarm);
    if (label.trap == "none") s.clean_false_alarms.count(alarm);
  } else if (label.category == "single") {
    s.first_all.count(first);
    s.missed.count(!alarm);
    (label.size > 0.85 ? s.first_full : label.size > 0.4 ? s.first_half : s.first_quarter).count(first);
  } else if (label.category == "background") {
    s.background_first.count(first);
  } else if (label.category == "pair") {
    s.pairs_complete.count(all);
    s.pairs_exact.count(exact);
  } else if (label.category == "confusable") {
    s.confusable_complete.count(all);
    s.confusable_exact.count(exact);
  } else if (label.category == "out_of_catalogue") {
    s.unknown_called.count(outcome.verdict == "unknown_physics");
    s.unknown_wrong_sure.count(sure_of_another(outcome, label));
  } else {
    throw std::invalid_argument(label.name + ": unknown category " + label.category);
  }
}

void calibrate(Score& s, const std::vector<Label>& labels, const std::vector<Outcome>& outcomes) {
  constexpr std::array kEdges{0.0, 0.5, 0.7, 0.8, 0.9, 0.95, 1.0};
  for (std::size_t b = 0; b + 1 < kEdges.size(); ++b) s.reliability.push_back({kEdges[b], kEdges[b + 1]});
  double squares = 0.0;
  std::size_t count = 0;
  for (std::size_t i = 0; i < labels.size(); ++i) {
    for (const Claim& claim : outcomes[i].missing) {
      const bool right = std::ranges::count(labels[i].effects, claim.effect) > 0;
      squares += std::pow(claim.probability - (right ? 1.0 : 0.0), 2);
      ++count;
      std::size_t bin = 0;
      while (bin + 1 < s.reliability.size() && claim.probability >= s.reliability[bin].high) ++bin;
      s.reliability[bin].mean_claimed += claim.probability;
      s.reliability[bin].right += right ? 1.0 : 0.0;
      ++s.reliability[bin].claims;
    }
  }
  if (count == 0) return;
  double error = 0.0;
  for (ReliabilityBin& bin : s.reliability) {
    error += std::abs(bin.mean_claimed - bin.right);
    if (bin.claims == 0) continue;
    bin.mean_claimed /= static_cast<double>(bin.claims);
    bin.right /= static_cast<double>(bin.claims);
  }
  s.brier = squares / static_cast<double>(count);
  s.calibration_error = error / static_cast<double>(count);
}

}  // namespace

double gap_closed(const Outcome& outcome, double noise_N) {
  const auto without_noise = [noise_N](double rmse_N) {
    return std::sqrt(std::fmax(0.0, rmse_N * rmse_N - noise_N * noise_N));
  };
  return 1.0 - without_noise(outcome.model_rmse_N) / without_noise(outcome.nominal_rmse_N);
}

Score score(std::string method, const std::vector<Label>& labels, const std::vector<Outcome>& outcomes,
            bool against_recorded_force) {
  if (labels.size() != outcomes.size()) throw std::invalid_argument("as many outcomes as labels are needed");
  Score s;
  s.method = std::move(method);
  s.cases = labels.size();
  std::vector<double> named, wall_s, cpu_s;
  for (std::size_t i = 0; i < labels.size(); ++i) {
    count_case(s, labels[i], outcomes[i]);
    wall_s.push_back(outcomes[i].wall_s);
    cpu_s.push_back(outcomes[i].cpu_s);
    if (labels[i].category == "null") continue;
    // A method that gave no prediction closed nothing.
    const double gap = gap_closed(outcomes[i], against_recorded_force ? labels[i].noise_N : 0.0);
    s.gaps.push_back(std::isfinite(gap) ? gap : 0.0);
    if (labels[i].category != "out_of_catalogue") named.push_back(s.gaps.back());
  }
  s.median_gap = finite_median(s.gaps);
  s.median_gap_named = finite_median(named);
  s.median_wall_s = finite_median(wall_s);
  s.median_cpu_s = finite_median(cpu_s);
  std::erase_if(wall_s, [](double v) { return !std::isfinite(v); });
  if (!wall_s.empty()) s.most_wall_s = std::ranges::max(wall_s);
  calibrate(s, labels, outcomes);
  return s;
}

}  // namespace isorig::proof
