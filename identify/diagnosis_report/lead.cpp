#include "identify/diagnosis_report/lead.hpp"

#include <cmath>
#include <vector>

#include "identify/diagnose/explain/discovered.hpp"
#include "identify/report/page.hpp"
#include "model/words.hpp"

namespace isorig::identify {
namespace {

using model::effect_words;
using report::number_text;

constexpr double kLikelierThanNot = 0.5;

std::string in_a_row(const std::vector<std::string>& words) {
  std::string out;
  for (std::size_t i = 0; i < words.size(); ++i)
    out += (i == 0 ? "" : i + 1 < words.size() ? ", " : " and ") + words[i];
  return out;
}

/// "dry friction (or else play) and a lag"
std::string lacking(const Diagnosis& d) {
  std::vector<std::string> words;
  for (const MissingEffect& one : d.missing) {
    if (one.probability < kLikelierThanNot) continue;
    words.push_back(effect_words(one.effect->name));
    if (one.substitute != nullptr) words.back() += " (or else " + effect_words(one.substitute->name) + ")";
  }
  return in_a_row(words);
}

/// "slack (0.21)"
std::string possible(const Diagnosis& d) {
  std::vector<std::string> words;
  for (const MissingEffect& one : d.missing)
    if (one.probability < kLikelierThanNot)
      words.push_back(effect_words(one.effect->name) + " (" + number_text(one.probability, 2) + ")");
  return in_a_row(words);
}

std::string residuals(const Diagnosis& d) {
  const double nominal_N = d.nominal_errors.train_rmse_N, model_N = d.model_errors.train_rmse_N;
  const bool upper_limit = d.noise_source != NoiseSource::kRests && d.noise_N > model_N;
  // Left-out readings bear a part of it (publish.hpp); the note of the page says which of them speaks against the rest.
  const std::string share = d.model_share < 1.0 ? number_text(100.0 * d.model_share, 2) + " % of " : "";
  return "The residual of the nominal model is " + number_text(nominal_N, 3) + " N rms, " +
         (d.not_modelled.why.empty() || model_N != nominal_N
              ? "with " + share + "what it lacks " + number_text(model_N, 3) + " N; "
              : "and nothing of what it lacks is modelled; ") +
         (upper_limit ? "without rests the force channel's noise is only known to be at most "
                      : "the force channel's own noise is ") +
         number_text(d.noise_N, 3) + " N.";
}

std::string unexplained(const Diagnosis& d) {
  // The share has no meaning where the limit of the noise exceeds every residual.
  if (d.noise_N > d.nominal_errors.train_rmse_N) return {};
  const std::string by = d.discovered.empty() ? "" : " by effects of the catalogue";
  if (d.unexplained >= 1.0) return " Nothing of what the nominal model misses is explained" + by + ".";
  return (d.unexplained < 0.01 ? std::string(" Less than 1")
                               : " " + number_text(std::round(100.0 * d.unexplained), 3)) +
         " % of what the nominal model misses stays unexplained" + by + ".";
}

}  // namespace

std::string lead_text(const Diagnosis& d, const std::string& where) {
  const std::string sure = lacking(d), doubted = possible(d);
  const bool unknown = d.verdict == Verdict::kUnknownPhysics;
  std::string out =
      !sure.empty() ? "The model lacks " + sure + (unknown ? ", and something that the catalogue does not know" : "")
      : unknown     ? "Something is left that no effect of the catalogue explains"
                    : "The model lacks something, and no name for it is likelier than not";
  if (!doubted.empty()) out += sure.empty() ? "; the nearest is " + doubted : "; perhaps " + doubted + " as well";
  if (const std::string described = described_in_words(d.discovered, d.described_by); unknown && !described.empty())
    out += "; " + described;
  return out + ". " + where + residuals(d) + unexplained(d);
}

}  // namespace isorig::identify
