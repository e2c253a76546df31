#include "proof/scoring/score.hpp"

#include <algorithm>
#include <array>
#include <limits>
#include <stdexcept>
#include <string_view>

#include "base/quantile.hpp"

namespace isorig::proof {
namespace {

double finite_median(std::vector<double> values) {
  std::erase_if(values, [](double v) { return !std::isfinite(v); });
  return base::median(std::move(values));
}

constexpr double kSure = 0.9;

bool complete(const Outcome& outcome, const Label& label) {
  for (std::size_t i = 0; i < label.effects.size(); ++i)
    if (std::ranges::none_of(outcome.missing, [&](const Claim& c) { return names_effect(label, i, c.effect); }))
      return false;
  return true;
}

bool sure_of_another(const Outcome& outcome, const Label& label) {
  return std::ranges::any_of(outcome.missing, [&](const Claim& claim) {
    return claim.probability > kSure && !right_name(label, claim.effect);
  });
}

/// Worse than the nominal model by more than a recording with this noise could show in its rms: a twentieth of it. Who
/// gives no prediction, or none that is a number, is worse.
bool predicts_worse(const Outcome& outcome, const Label& label) {
  return outcome.failed || !(outcome.model_rmse_N <= outcome.nominal_rmse_N + 0.05 * label.noise_N);
}

void count_case(Score& s, const Label& label, const Outcome& outcome) {
  s.failed.count(outcome.failed);
  s.wrong_sure.count(sure_of_another(outcome, label));
  // "cannot_judge" claims nothing is missing, and nothing that it is not.
  const bool abstained = outcome.verdict == "cannot_judge";
  const bool alarm = outcome.failed || (outcome.verdict != "consistent" && !abstained);
  s.unjudged.count(abstained);
  for (const Claim& claim : outcome.missing)
    if (claim.probability > kSure) s.sure_right.count(right_name(label, claim.effect));
  s.worse.count(predicts_worse(outcome, label));
  const bool first = !outcome.failed && !outcome.missing.empty() && !label.effects.empty() &&
                     names_effect(label, 0, outcome.missing.front().effect);
  const bool all = !outcome.failed && complete(outcome, label);
  const bool exact = all && outcome.missing.size() == label.effects.size();
  if (label.category == "null") {
    s.false_alarms.count(alarm);
    if (label.trap == "none") s.clean_false_alarms.count(alarm);
  } else if (label.category == "single") {
    s.first_all.count(first);
    s.missed.count(!alarm && !abstained);
    (label.size > 0.85 ? s.first_full : label.size > 0.4 ? s.first_half : s.first_quarter).count(first);
  } else if (label.category == "background") {
    s.background_first.count(first);
  } else if (label.category == "pair") {
    s.pairs_complete.count(all);
    s.pairs_exact.count(exact);
  } else if (label.category == "triple") {
    s.triples_complete.count(all);
    s.triples_exact.count(exact);
  } else if (label.category == "confusable") {
    s.confusable_complete.count(all);
    s.confusable_exact.count(exact);
  } else if (label.category == "out_of_catalogue") {
    const bool unknown = outcome.verdict == "unknown_physics";
    s.unknown_called.count(unknown);
    const bool half = !outcome.missing.empty() && std::ranges::all_of(outcome.missing, [&](const Claim& claim) {
      return right_name(label, claim.effect);
    });
    s.unknown_or_half.count(unknown || half);
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
      const bool right = right_name(labels[i], claim.effect);
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

Interval wilson(const Share& share) {
  if (share.of == 0) return {};
  constexpr double kNormal = 1.959964;  // 97.5 % point of the normal distribution
  const double n = static_cast<double>(share.of), p = static_cast<double>(share.hits) / n;
  const double z2 = kNormal * kNormal / n;
  const double middle = (p + 0.5 * z2) / (1.0 + z2);
  const double half = kNormal * std::sqrt(p * (1.0 - p) / n + 0.25 * z2 / n) / (1.0 + z2);
  return {std::fmax(0.0, middle - half), std::fmin(1.0, middle + half)};
}

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
    // A method that gave no prediction closed nothing. One that errs where the nominal model does not, or without
    // bound, has opened a gap of any size: minus infinity has its place in the median.
    const double gap = gap_closed(outcomes[i], against_recorded_force ? labels[i].noise_N : 0.0);
    s.gaps.push_back(std::isnan(gap) ? 0.0 : gap);
    if (labels[i].category != "out_of_catalogue") named.push_back(s.gaps.back());
  }
  s.median_gap = base::median(s.gaps);
  s.median_gap_named = base::median(named);
  s.median_wall_s = finite_median(wall_s);
  s.median_cpu_s = finite_median(cpu_s);
  const auto most = [](std::vector<double>& values) {
    std::erase_if(values, [](double v) { return !std::isfinite(v); });
    return values.empty() ? std::numeric_limits<double>::quiet_NaN() : std::ranges::max(values);
  };
  s.most_wall_s = most(wall_s);
  s.most_cpu_s = most(cpu_s);
  calibrate(s, labels, outcomes);
  return s;
}

}  // namespace isorig::proof
