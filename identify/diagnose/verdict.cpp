#include "identify/diagnose/verdict.hpp"

#include <algorithm>
#include <cmath>

#include "identify/diagnose/deciding/deciding.hpp"

namespace isorig::identify {

std::string_view name_of(Verdict verdict) {
  switch (verdict) {
    case Verdict::kConsistent:
      return "consistent";
    case Verdict::kMissingPhysics:
      return "missing_physics";
    case Verdict::kUnknownPhysics:
      return "unknown_physics";
    case Verdict::kCannotJudge:
      return "cannot_judge";
  }
  return "";
}

std::string_view words_of(Verdict verdict) {
  switch (verdict) {
    case Verdict::kConsistent:
      return "nothing is missing";
    case Verdict::kMissingPhysics:
      return "physics is missing";
    case Verdict::kUnknownPhysics:
      return "unknown physics";
    case Verdict::kCannotJudge:
      return "cannot be judged";
  }
  return "";
}

std::string_view verdict_words(std::string_view name) {
  for (const Verdict one :
       {Verdict::kConsistent, Verdict::kMissingPhysics, Verdict::kUnknownPhysics, Verdict::kCannotJudge})
    if (name_of(one) == name) return words_of(one);
  return name;
}

double unexplained_share(const Explained& explained) {
  if (explained.excess_before <= 0.0) return 0.0;
  const double chance = explained.noise_from_rests
                            ? 0.0
                            : deciding().chance_deviations * std::sqrt(2.0 * static_cast<double>(explained.rows));
  return std::max(explained.excess_left - chance, 0.0) / explained.excess_before;
}

Verdict verdict_of(const Explained& explained) {
  const double left = explained.excess_left;
  const bool structure_left =
      left > deciding().structure_share * static_cast<double>(explained.rows) && left > deciding().structure_squares;
  if (explained.is_described) return Verdict::kUnknownPhysics;
  if (structure_left && !explained.has_named_effect)
    return explained.is_noise_for_all_that_rests_say ? Verdict::kCannotJudge : Verdict::kUnknownPhysics;
  if (structure_left && unexplained_share(explained) > deciding().much_unexplained_share)
    return Verdict::kUnknownPhysics;
  return explained.has_named_effect ? Verdict::kMissingPhysics : Verdict::kConsistent;
}

}  // namespace isorig::identify
