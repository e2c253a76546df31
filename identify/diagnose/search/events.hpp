#pragma once
#include <functional>
#include <span>
#include <vector>

#include "identify/diagnose/fit/fit.hpp"

namespace isorig::identify {

struct EventPlace {
  std::size_t series = 0;
  double time_s = 0.0;
};

/// Candidate places of an event in the recordings of `problem`, best first, at least a second apart. The force
/// makes a step there whose sign the law knows. With r the whitened residual after all columns of `spec`, Q their
/// orthonormal basis and s_k the whitened step from bin k on to the end of its recording, the step takes
///
///     gain(k) = (r . s_k)^2 / (s_k . s_k - |Q' s_k|^2)
///
/// off the sum of squares: exact for the step and the model's coefficients together (added-variable regression, Seber &
/// Lee 2003, 3.7). All sums run from the end, so that every bin is tried. What relaxes after the step is left to the
/// fit.
[[nodiscard]] std::vector<EventPlace> event_places(const Problem& problem, const model::ModelSpec& spec,
                                                   const NoiseModel& noise, double force_step, std::size_t count);

/// A fit whose last part is an event: its time by a pattern search, all else refitted at each step. It stays between
/// the first reading of its recording and the last: what happened before the first is nothing but another zero of the
/// force.
[[nodiscard]] Fit refine_event(const Problem& problem, const Fit& from);

/// A fit whose last part is an event, with further events of the same effect, each where the residual shows it best and
/// by the law that is worth its price most, as long as each gains 2 log n in the log-likelihood, half a log n more than
/// the modified BIC for change points asks for (Zhang & Siegmund 2007), and `may_stay` accepts it. Squares are counted
/// in units of what the fit leaves, if that is more than the noise.
[[nodiscard]] Fit with_further_events(const Problem& problem, const Fit& from,
                                      const std::function<bool(const model::ModelSpec&)>& may_stay);

/// Without those of several events of an effect that are not worth that price any more, now that other physics stands
/// beside them: steps imitate whatever makes the force fall. At least one of each effect stays.
[[nodiscard]] Fit without_idle_events(const Problem& problem, const Fit& from);

/// Of a fit with an event and one with another effect in its place: the other leaves no more than noise does, which is
/// the mean of a chi-square of as many rows and `chance_deviations` standard deviations, and the event more than
/// `leaves_ratio` times that. More events, or better places of them, could then only imitate the other effect.
[[nodiscard]] bool explained_without(const Fit& event, const Fit& other, double leaves_ratio) noexcept;

/// The times of events to the row: bins only say between which of them they were. By the rms over the rows of each
/// event's own recording that `usable`, one list a recording, marks.
void place_events(model::ModelSpec& spec, std::span<const Series> series, const std::vector<std::vector<bool>>& usable);

/// Squares of measured minus predicted force (a model's share of it, model::Seen) over the usable rows of one
/// recording; with their number.
struct RowErrors {
  double squares_N2 = 0.0;
  std::size_t rows = 0;
};
[[nodiscard]] RowErrors row_errors(const model::ModelSpec& spec, const Series& series, const std::vector<bool>& usable);

}  // namespace isorig::identify
