#include "identify/diagnose/reliability/reliability.hpp"

#include <algorithm>
#include <cmath>
#include <mutex>
#include <numeric>
#include <random>
#include <stdexcept>

#include "base/formatted.hpp"
#include "base/parallel.hpp"
#include "identify/diagnose/deciding/deciding.hpp"
#include "identify/diagnose/reliability/replicate.hpp"
#include "identify/diagnose/reliability/sureness.hpp"
#include "identify/diagnose/search/calibration.hpp"
#include "messages/recording_id.hpp"

namespace isorig::identify {
namespace {

/// Positions in the pool: the most probable explanations by weight, then by evidence (most weights are zero to
/// rounding), and the nominal model.
std::vector<std::size_t> truths_of(const Selection& selection) {
  std::vector<std::size_t> order(selection.pool.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::ranges::stable_sort(order, [&](std::size_t a, std::size_t b) {
    return std::pair(selection.weight[a], selection.pool[a].evidence) >
           std::pair(selection.weight[b], selection.pool[b].evidence);
  });
  order.resize(std::min(order.size(), deciding().rehearsed_explanations));
  if (std::ranges::find(order, std::size_t{0}) == order.end()) order.back() = 0;
  return order;
}

/// Withheld from every so-manieth recording, spread evenly.
bool withholds(std::size_t rehearsal) {
  const double share = deciding().withheld_share;
  return std::floor(static_cast<double>(rehearsal + 1) * share) > std::floor(static_cast<double>(rehearsal) * share);
}

std::vector<Claim> claims_of(const Diagnosis& diagnosis, const Hypothesis& truth) {
  std::vector<Claim> out;
  for (const MissingEffect& missing : diagnosis.missing) {
    const auto& refused = diagnosis.not_modelled.names;
    out.push_back({std::string(missing.effect->name), promised(missing.weight, diagnosis.unexplained),
                   truth.has(*missing.effect), std::ranges::find(refused, missing.effect->name) != refused.end()});
  }
  return out;
}

std::optional<Sureness> sureness_among(const Reliability& reliability, bool beside_unknown) {
  std::size_t made = 0, made_withheld = 0;
  for (const Rehearsal& one : reliability.rehearsals) {
    if (!one.failed.empty()) continue;
    ++made;
    if (!one.withheld.empty()) ++made_withheld;
  }
  const double outside = made_withheld > 0 ? deciding().outside_catalogue_share : 0.0;
  const auto all = static_cast<double>(made), withheld = static_cast<double>(made_withheld);
  std::vector<CountedClaim> claims;
  for (const Rehearsal& one : reliability.rehearsals) {
    if (!one.failed.empty() || (one.verdict == Verdict::kUnknownPhysics) != beside_unknown) continue;
    const double counts =
        one.withheld.empty() ? (1.0 - outside) * all / std::max(all - withheld, 1.0) : outside * all / withheld;
    for (const Claim& claim : one.claims)
      if (!claim.refused) claims.push_back({claim.promised, claim.right, counts});
  }
  if (claims.size() < deciding().fewest_claims_to_calibrate) return std::nullopt;
  return sureness_of(claims);
}

}  // namespace

Reliability measure_reliability(const Study& study, std::span<const messages::Recording> originals,
                                std::span<const std::string> names, const model::ModelSpec& given,
                                const ReliabilityOptions& options) {
  const Replicator replicator(study, originals);
  const std::vector<std::size_t> truths = truths_of(study.selection);
  std::uint64_t seed = 0;
  for (const messages::Recording& recording : originals) seed = seed * 31 + messages::fingerprint(recording);

  Reliability out{options.known, {}, {}};
  const std::size_t known = std::min(out.rehearsals.size(), options.rehearsals);
  out.rehearsals.resize(options.rehearsals);
  std::mutex mutex;
  std::size_t done = known;
  base::parallel_for(options.rehearsals - known, options.threads, [&](std::size_t further) {
    const std::size_t i = known + further;
    Rehearsal& one = out.rehearsals[i];
    const std::size_t at = truths[i % truths.size()];
    const Hypothesis& truth = study.selection.pool[at];
    one.truth = truth.key();
    std::seed_seq seeds{static_cast<std::uint32_t>(seed), static_cast<std::uint32_t>(seed >> 32U),
                        static_cast<std::uint32_t>(i)};
    std::mt19937_64 random(seeds);
    DiagnosisOptions again;
    again.threads = 1;
    if (withholds(i) && !truth.effects.empty()) {
      again.withheld = {truth.effects[random() % truth.effects.size()]};
      one.withheld = again.withheld.front()->name;
    }
    try {
      const Study result =
          diagnose(replicator.draw(at, random), std::vector<std::string>(names.begin(), names.end()), given, again);
      one.verdict = result.diagnosis.verdict;
      one.claims = claims_of(result.diagnosis, truth);
    } catch (const std::invalid_argument& e) {  // what diagnose() refuses a recording by
      one.failed = e.what();
    } catch (const std::domain_error& e) {
      one.failed = e.what();
    }
    const std::lock_guard lock(mutex);
    ++done;
    if (options.on_progress) options.on_progress(static_cast<double>(done) / static_cast<double>(options.rehearsals));
  });
  out.beside_nothing = sureness_among(out, false);
  out.beside_unknown = sureness_among(out, true);
  return out;
}

void restate(Diagnosis& diagnosis, Reliability reliability) {
  const bool unknown = diagnosis.verdict == Verdict::kUnknownPhysics;
  if (const auto& sureness = unknown ? reliability.beside_unknown : reliability.beside_nothing) {
    for (MissingEffect& missing : diagnosis.missing) {
      missing.probability = promised(missing.weight, diagnosis.unexplained) * sureness->value;
      const auto& refused = diagnosis.not_modelled.names;
      if (std::ranges::find(refused, missing.effect->name) != refused.end())
        missing.probability = stated_if_refused(missing.probability);
    }
  }
  diagnosis.reliability = std::move(reliability);
}

std::vector<std::string> reliability_text(const Reliability& reliability) {
  std::vector<std::string> out;
  std::size_t failed = 0, hidden = 0, told_unknown = 0, named_wrong = 0, nothing_missing = 0, false_alarms = 0;
  for (const Rehearsal& one : reliability.rehearsals) {
    if (!one.failed.empty()) {
      ++failed;
      continue;
    }
    const bool wrong = std::ranges::any_of(one.claims, [](const Claim& c) { return !c.right && c.promised >= 0.5; });
    if (!one.withheld.empty()) {
      ++hidden;
      if (one.verdict == Verdict::kUnknownPhysics) ++told_unknown;
      if (wrong) ++named_wrong;
    } else if (one.truth == "nominal") {
      ++nothing_missing;
      if (wrong || one.verdict == Verdict::kUnknownPhysics) ++false_alarms;
    }
  }
  const auto told = [&](const std::optional<Sureness>& sureness, const char* where, double stated) {
    if (sureness)
      out.push_back(base::formatted(
          "names %s: %zu, of which %zu were right: a name with all of the weight is stated "
          "with %.2f [%.2f, %.2f]",
          where, sureness->claims, sureness->right, sureness->value, sureness->low95, sureness->high95));
    else
      out.push_back(
          base::formatted("names %s: fewer than %zu, so that a name with all of the weight is stated with "
                          "%.3g as measured on other recordings",
                          where, deciding().fewest_claims_to_calibrate, stated));
  };
  told(reliability.beside_nothing, "where nothing unknown was told", deciding().surest_probability);
  told(reliability.beside_unknown, "beside unknown physics", deciding().surest_beside_unknown_probability);
  if (nothing_missing > 0)
    out.push_back(
        base::formatted("recordings that lacked nothing: %zu, of which %zu got a name or unknown physics all "
                        "the same",
                        nothing_missing, false_alarms));
  if (hidden > 0)
    out.push_back(
        base::formatted("recordings with an effect that the search was not given: %zu, of which %zu were "
                        "told to hold unknown physics and %zu got another name with 0.5 or more",
                        hidden, told_unknown, named_wrong));
  if (failed > 0) out.push_back(base::formatted("recordings that could not be diagnosed: %zu", failed));
  return out;
}

}  // namespace isorig::identify
