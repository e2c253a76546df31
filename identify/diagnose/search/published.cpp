#include "identify/diagnose/search/published.hpp"

#include "identify/diagnose/fit/many_starts.hpp"

namespace isorig::identify {

Fit published_nominal(const Search& search, const Selection& selection, std::span<const std::vector<bool>> usable,
                      unsigned threads) {
  constexpr double kSame = 1.005;  // of the squares: a quarter of a percent of the rms
  constexpr int kIterations = 15;
  const Fit& weighed = selection.nominal().fit;
  const auto series = search.instrument_problem().series();
  const NoiseModel noise = plain(search.instrument());
  // Bins, to be quick, from everywhere; then rows, since that is what a prediction is measured by.
  const Fit near = fit_from_many_starts(Problem(series, noise), weighed.spec, threads);
  std::vector<Series> rows;
  for (std::size_t i = 0; i < series.size(); ++i)
    rows.push_back(by_rows(series[i], i < usable.size() ? usable[i] : std::vector<bool>{}));
  const Problem by_row(rows, noise);
  const Fit least = by_row.fit(near.spec, kIterations);
  if (squares_of(by_row, weighed.spec) <= kSame * least.chi2) return weighed;
  Fit out = near;
  out.spec = least.spec;
  out.stop = least.stop;
  return out;
}

bool errs_more_than_noise(const Hypothesis& hypothesis) {
  return hypothesis.ls_chi2 > kErrorRules * static_cast<double>(hypothesis.fit.rows);
}

}  // namespace isorig::identify
