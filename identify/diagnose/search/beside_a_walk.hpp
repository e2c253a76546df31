#pragma once
#include <optional>

#include "identify/diagnose/noise/walking_zero.hpp"
#include "identify/diagnose/search/select.hpp"

namespace isorig::identify {

/// A selection beside a zero of the force that walks at random.
struct BesideAWalk {
  WalkingZero walk;
  Search search;  ///< its instrument's noise has the walk
  Selection selection;
};

/// Whether what the likeliest explanations leave is a zero that walks (walking_zero.hpp), and what explains the rest
/// then. No function of time with a few numbers follows a walk, so that it is no law but a noise: the search is made
/// again under it,
///
///     r = white noise + Ornstein-Uhlenbeck noise of correlation T and variance q T / 2,  T ten recordings,
///
/// which over the recording is a walk of rate q with a free level. The effect whose law describes the whole of a
/// recording (the drift of the zero) is withheld, and joins the explanation that is chosen: by that law its slow part
/// is drawn and taken out, and what the law does not follow stays noise.
///
/// Nothing for several recordings (each has another walk), for a noise that forgets by readings (a walk goes on in
/// time), where the search withholds that effect, where the explanation that is chosen beside the walk does not leave a
/// walk itself or leaves more than noise, where a drift by a law is likelier, or where the walk is as small as the
/// error of the other effects' laws (practical_significance.hpp).
[[nodiscard]] std::optional<BesideAWalk> select_beside_a_walk(const Search& search, const Selection& selection,
                                                              const model::ModelSpec& nominal,
                                                              const SelectionOptions& options);

/// Fitted under a walk, the level of the force and a law for the slow part of the walk are taken from the changes of
/// the force, and lie beside it: both by plain least squares, all else kept.
[[nodiscard]] model::ModelSpec levelled(const Search& search, model::ModelSpec spec);

}  // namespace isorig::identify
