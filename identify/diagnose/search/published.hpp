#pragma once
#include "identify/diagnose/fit/left_out.hpp"
#include "identify/diagnose/search/select.hpp"

namespace isorig::identify {

/// What the numbers of a published model minimise.
struct Criterion {
  NoiseModel noise;         ///< that the fit was weighed by
  bool rows_alike = false;  ///< every usable row counts as one, whatever it is the mean of
};

/// The nominal model as it is handed out.
struct PublishedNominal {
  Fit fit;
  Criterion criterion;
};

/// The search compares explanations by likelihood, each under a noise estimated from its own residual. The residual of
/// a model that lacks much wanders slowly, and generalised least squares under such a noise fit the differences between
/// neighbouring readings at the expense of the force itself. That is right for weighing explanations and wrong for
/// predictions. Published numbers are therefore the ordinary least squares of the usable rows, from many starts,
/// wherever their residual is clearly smaller; under noise alone both fits agree.
[[nodiscard]] PublishedNominal published_nominal(const Search& search, const Selection& selection,
                                                 std::span<const std::vector<bool>> usable, unsigned threads);

/// The laws' own error, not the noise, makes most of what an explanation leaves (kErrorRules).
[[nodiscard]] bool errs_more_than_noise(const Hypothesis& hypothesis);

/// Numbers of the chosen explanation by plain least squares instead of under its noise: its laws err by far more than
/// noise, or its fit under that noise leaves far more than least squares (prefer_simpler_laws).
[[nodiscard]] bool least_squares_decide(const Selection& selection);

/// What the chosen explanation's numbers minimise. A table is learnt under the instrument's noise (describe_unknown).
[[nodiscard]] Criterion criterion_of_chosen(const Search& search, const Selection& selection);

/// Learns a published model anew from what is kept of the recordings, from the numbers that it has from all of them:
/// its free numbers by its criterion, its table (smoothness and all) and the thresholds of its relay from the kept
/// bins alone. The times of events stay: an event is one in its recording, and is not there to be learnt where its
/// stretch is left out.
[[nodiscard]] Learner learn_again(model::ModelSpec spec, Criterion criterion);

/// The same for what a search found: as the search would, it keeps what it found only if the kept bins show it. With Q
/// and Q0 the squares that the model and the nominal one leave in them in units of the noise, k the numbers that the
/// model has more, n the bins, and the terms of weigh() (select.hpp),
///
///     min( (Q0 - Q)/2 - k/2 ln n,  d/2 ln(1 + (Q0 - Q) / (max(Q - n, 0) + 40)) ) > prior cost
///
/// else the nominal model is what is learnt. A dead time cannot be fitted to motions so slow that it makes no
/// difference; the value that a fit gives it there says nothing about the model. What is learnt says which ranges it
/// has seen.
[[nodiscard]] Learner learn_again_if_shown(model::ModelSpec spec, Criterion criterion, const model::ModelSpec& nominal,
                                           Criterion nominal_criterion);

}  // namespace isorig::identify
