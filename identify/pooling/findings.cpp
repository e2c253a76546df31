#include <algorithm>
#include <cctype>
#include <cmath>
#include <map>

#include "base/formatted.hpp"
#include "identify/pooling/pool.hpp"
#include "identify/report/page.hpp"

namespace isorig::identify::pooling {
namespace {

using base::formatted;
using report::number_text;

std::string capital(std::string text) {
  if (!text.empty()) text[0] = static_cast<char>(std::toupper(static_cast<unsigned char>(text[0])));
  return text;
}

/// "a, b and c"; of many the first, and how many more.
std::string listed(const std::vector<std::string>& items, std::size_t most = 6) {
  std::string out;
  const std::size_t shown = items.size() > most ? most : items.size();
  for (std::size_t i = 0; i < shown; ++i) out += (i == 0 ? "" : i + 1 == items.size() ? " and " : ", ") + items[i];
  if (shown < items.size()) out += formatted(" and %zu more", items.size() - shown);
  return out;
}

/// The quantity without its effect: "friction force at steady sliding".
std::string meaning(const Quantity& one) {
  const auto colon = one.words.find(": ");
  return colon == std::string::npos ? one.words : one.words.substr(colon + 2);
}

std::string growth(const Quantity& one) {
  const Estimate& slope = *one.pooled.slope;
  const double half = 0.5 * (slope.high95 - slope.low95);
  const std::string unit = one.unit.empty()                          ? "per psi"
                           : one.unit.find('/') == std::string::npos ? one.unit + "/psi"
                                                                     : one.unit + " per psi";
  return (slope.value > 0.0 ? "grows with the pressure by " : "falls with the pressure by ") +
         plus_minus(std::abs(slope.value), half) + " " + unit;
}

std::string effect_sentence(const PooledCampaign& c, const EffectPool& effect) {
  const Presence& p = effect.presence;
  std::vector<std::string> with, without;
  double least = 1.0;
  for (std::size_t i = 0; i < c.actuators.size(); ++i) {
    const auto& one = p.actuators[i];
    if (one.judged == 0) continue;  // its probability is what the others say of it
    if (one.probability > 0.5) {
      with.push_back(c.actuators[i]);
      least = std::min(least, one.probability);
    } else {
      without.push_back(c.actuators[i]);
    }
  }
  std::string out = capital(effect.words) + " is in ";
  if (without.empty())
    out += with.size() == 1   ? with.front()
           : with.size() == 2 ? std::string("both actuators")
                              : formatted("all %zu actuators", with.size());
  else if (with.size() == 1)
    out += with.front() + formatted(" alone of %zu actuators", p.judged());
  else if (with.size() <= without.size() && with.size() <= 6)
    out += listed(with) + formatted(", %zu of %zu actuators", with.size(), p.judged());
  else
    out += formatted("%zu of %zu actuators", with.size(), p.judged()) + ", not in " + listed(without);
  out += formatted(with.size() == 1 ? " (probability %.2f)" : " (each with a probability of at least %.2f)", least);
  for (const Quantity& one : c.quantities)
    if (one.effect == effect.name && one.grows) out += "; its " + meaning(one) + " " + growth(one);
  return out + ".";
}

/// Recordings that show an effect in an actuator that by all of its recordings has not got it.
void add_single_recordings(const PooledCampaign& c, const EffectPool& effect, std::vector<std::string>& out) {
  std::vector<std::string> recordings;
  for (std::size_t r = 0; r < c.recordings.size(); ++r)
    if (effect.probability[r] > 0.5 && effect.presence.actuators[c.actuator_of[r]].probability <= 0.5)
      recordings.push_back(name_of(c.recordings[r]) + formatted(" (%.2f)", effect.probability[r]));
  if (!recordings.empty())
    out.push_back(capital(effect.words) +
                  (recordings.size() == 1 ? " shows in one recording alone" : " shows in single recordings") + ": " +
                  listed(recordings) + ".");
}

std::string off(const Quantity& one, const Outlier& of) {
  const std::string unit = one.unit.empty() ? "" : " " + one.unit;
  return one.words + (of.slope ? ", its change with the pressure," : "") +
         formatted(" lies %.1f standard deviations %s what the others let one expect (", std::abs(of.deviations),
                   of.deviations > 0.0 ? "above" : "below") +
         number_text(of.expected + of.difference, 3) + " instead of " + number_text(of.expected, 3) + unit +
         (of.slope ? " per psi" : "") + formatted("; probability %.2f)", of.probability);
}

/// A number of another law may be another number: of the recording's law, where most of the others have a different
/// one.
std::string other_law(const Quantity& one, std::size_t measurement) {
  std::map<std::string, std::size_t> count;
  for (const std::string& law : one.law) ++count[law];
  const auto most = std::ranges::max_element(count, {}, [](const auto& of) { return of.second; });
  const std::string& own = one.law[measurement];
  return own == most->first ? "" : ", where its law is " + own + " and that of most is " + most->first;
}

void add_outliers(const PooledCampaign& c, std::vector<std::string>& out) {
  std::map<std::size_t, std::vector<std::string>> of_actuator, of_recording;
  for (const Quantity& one : c.quantities) {
    for (const Outlier& actuator : one.outliers.actuators) of_actuator[actuator.index].push_back(off(one, actuator));
    for (const Outlier& recording : one.outliers.recordings)
      of_recording[one.recording[recording.index]].push_back(off(one, recording) + other_law(one, recording.index));
  }
  for (const auto& [i, what] : of_actuator)
    out.push_back(c.actuators[i] + " does not belong to the others: " + listed(what, 4) + ".");
  std::size_t left = of_recording.size();
  constexpr std::size_t kShown = 8;
  for (const auto& [r, what] : of_recording) {
    if (of_recording.size() - left == kShown) {
      out.push_back(formatted("%zu more recordings do not belong to their actuators; pooled.json lists them.", left));
      break;
    }
    --left;
    out.push_back("The recording " + name_of(c.recordings[r]) + " does not belong to its actuator: " + listed(what, 3) +
                  ".");
  }
}

void add_nominal_growth(const PooledCampaign& c, std::vector<std::string>& out) {
  for (const Quantity& one : c.quantities)
    if (one.effect.empty() && one.grows) out.push_back(capital(one.words) + " " + growth(one) + ".");
  const bool any_slope =
      std::ranges::any_of(c.quantities, [](const Quantity& q) { return q.pooled.slope.has_value(); });
  if (c.pressures_psi.size() > 1 && !c.quantities.empty() && !any_slope)
    out.emplace_back(
        "Whether anything grows with the pressure they cannot tell: no number is known of one actuator at two "
        "pressures, "
        "and what differs may be the actuators.");
}

void add_what_says_nothing(const PooledCampaign& c, std::vector<std::string>& out) {
  std::size_t unjudged = 0, unknown = 0;
  for (const ReadDiagnosis& one : c.recordings) {
    if (one.verdict == "cannot_judge") ++unjudged;
    if (one.verdict == "unknown_physics") ++unknown;
  }
  if (unknown > 0)
    out.push_back(
        formatted("%zu of %zu recordings show physics that no effect of the catalogue explains; which of the "
                  "others they lack, they do not say.",
                  unknown, c.recordings.size()));
  if (unjudged > 0)
    out.push_back(formatted("%zu of %zu recordings cannot be judged and speak neither for nor against any effect.",
                            unjudged, c.recordings.size()));
}

void add_left_out(const PooledCampaign& c, std::vector<std::string>& out) {
  if (c.left_out.empty()) return;
  const LeftOut& first = c.left_out.front();
  const std::size_t n = c.left_out.size();
  out.push_back(n == 1 ? "In no pool: " + first.name + " " + first.why + "."
                       : formatted("In no pool: %zu recordings; the first, ", n) + first.name + ", " + first.why +
                             ". pooled.json lists them.");
}

bool says_something(const PooledCampaign& c) {
  return std::ranges::any_of(c.recordings, [](const ReadDiagnosis& one) {
    return one.verdict != "cannot_judge" && one.verdict != "unknown_physics";
  });
}

}  // namespace

std::vector<std::string> findings_of(const PooledCampaign& c) {
  std::vector<std::string> out;
  for (const EffectPool& effect : c.effects)
    if (effect.presence.present() > 0) out.push_back(effect_sentence(c, effect));
  if (out.empty() && says_something(c))
    out.push_back(formatted("No effect is in any of the %zu actuators, as far as these %zu recordings tell.",
                            c.actuators.size(), c.recordings.size()));
  add_outliers(c, out);
  for (const EffectPool& effect : c.effects) add_single_recordings(c, effect, out);
  add_nominal_growth(c, out);
  add_what_says_nothing(c, out);
  add_left_out(c, out);
  return out;
}

}  // namespace isorig::identify::pooling
