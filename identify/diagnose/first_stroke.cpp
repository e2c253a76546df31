#include "identify/diagnose/first_stroke.hpp"

#include <algorithm>

#include "base/formatted.hpp"
#include "identify/diagnose/search/calibration.hpp"
#include "model/words.hpp"

namespace isorig::identify {
namespace {

/// When the motion turns round for the first time, by a twentieth of its range from its farthest position; the end of
/// the series where it never does.
double first_reversal_s(const Series& series) {
  constexpr double kTurned = 0.05;
  if (series.nodes.empty()) return 0.0;
  const auto [low, high] = std::ranges::minmax_element(series.nodes, {}, &model::Instant::position_mm);
  const double turned_mm = kTurned * (high->position_mm - low->position_mm);
  double lowest_mm = series.nodes.front().position_mm, highest_mm = lowest_mm;
  for (const model::Instant& node : series.nodes) {
    lowest_mm = std::min(lowest_mm, node.position_mm);
    highest_mm = std::max(highest_mm, node.position_mm);
    const bool has_moved = highest_mm - lowest_mm > turned_mm;
    if (has_moved && std::min(node.position_mm - lowest_mm, highest_mm - node.position_mm) > turned_mm) return node.t_s;
  }
  return series.nodes.back().t_s;
}

bool has_memory(const MissingEffect& missing) {
  const auto& of = missing.effect->traits.depends_on;
  return std::ranges::find(of, "direction") != of.end() || std::ranges::find(of, "history") != of.end();
}

/// All parts of the effect are events, and none is later.
bool happens_before(const model::ModelSpec& model, const model::Physics& effect, double before_s) {
  bool any = false;
  for (const model::Part& part : model.parts) {
    if (part.physics != &effect) continue;
    if (!model::is_event(*part.law) || part.parameters[model::event_parameter(*part.law)] > before_s) return false;
    any = true;
  }
  return any;
}

}  // namespace

void doubt_events_of_the_first_stroke(const Study& study, Diagnosis& out) {
  if (study.series.size() != 1) return;  // each begins in a state of its own, and an event is in one of them
  const double before_s = first_reversal_s(study.series.front());
  for (MissingEffect& missing : out.missing) {
    if (!happens_before(out.model, *missing.effect, before_s)) continue;
    const auto other = std::ranges::find_if(
        out.missing, [&](const MissingEffect& m) { return m.effect != missing.effect && has_memory(m); });
    if (other == out.missing.end()) continue;
    missing.weight = missing.probability = stated_if_refused(missing.weight);
    out.notes.push_back(base::formatted(
        "All of what is called %s lies before the motion turns round for the first time (%.3g s): it may as well be "
        "the "
        "state that %s began in.",
        model::effect_words(missing.effect->name).c_str(), before_s, model::effect_words(other->effect->name).c_str()));
  }
}

}  // namespace isorig::identify
