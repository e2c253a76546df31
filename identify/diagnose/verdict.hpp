#pragma once
#include <cstddef>
#include <string_view>

namespace isorig::identify {

/// kCannotJudge: nothing speaks against the model, and the recordings could not show it if something did
/// (judgeable.hpp); or what speaks against it may be noise.
enum class Verdict { kConsistent, kMissingPhysics, kUnknownPhysics, kCannotJudge };
[[nodiscard]] std::string_view name_of(Verdict verdict);
/// For people: "physics is missing".
[[nodiscard]] std::string_view words_of(Verdict verdict);
/// The same from the name that diagnosis.json has; any other name as it is.
[[nodiscard]] std::string_view verdict_words(std::string_view name);

/// What the verdict rests on.
struct Explained {
  double excess_before = 0.0;  ///< of the nominal model: whitened squares beyond those of noise
  double excess_left = 0.0;    ///< of the chosen model
  std::size_t rows = 0;        ///< bins of the fits
  /// Otherwise the noise level is a fit's own, and may lie below the true level by chance.
  bool noise_from_rests = true;
  bool has_named_effect = false;
  bool is_described = false;                     ///< by a table: the residual has a shape, and no effect has that shape
  bool is_noise_for_all_that_rests_say = false;  ///< the rests do not rule out that what is left is noise
};

/// The part of the nominal model's excess that the chosen model fails to explain, from 0 on. The sum of n squares of
/// unit noise has a standard deviation of sqrt(2 n); two of them do not count where the noise is not from rests.
[[nodiscard]] double unexplained_share(const Explained& explained);

/// Unknown physics: a table describes the residual; or the excess left is above 400 and above a fifth of the rows (a
/// force of two noises in 100 bins), and nothing is named or more than 12 % stays unexplained. If nothing is named and
/// that excess may be noise, nothing can be judged. Missing physics: an effect is named otherwise.
[[nodiscard]] Verdict verdict_of(const Explained& explained);

}  // namespace isorig::identify
