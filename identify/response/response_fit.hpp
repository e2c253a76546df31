#pragma once
#include <Eigen/Dense>
#include <string>
#include <vector>

#include "identify/response/response_model.hpp"

namespace isorig::identify::response {

/// Which parts a fit has.
struct Structure {
  std::size_t times = 1;
  bool play = false;  ///< on every input
  bool drift = false;
  bool exponent = false;  ///< without inputs, one time
  [[nodiscard]] bool operator==(const Structure&) const = default;
};

struct FittedNumber {
  std::string name;  ///< with its unit
  double value = 0.0, low95 = 0.0, high95 = 0.0;
  std::string unit{};  ///< for people: "mm/psi"; empty of a ratio
};

struct ResponseFit {
  Structure structure;
  ResponseModel model;
  std::vector<FittedNumber> numbers;
  double rms = 0.0;                       ///< of the rows that were fitted
  Eigen::VectorXd nonlinear;              ///< where the search ended: a start for others
  double log_evidence = 0.0;              ///< -BIC / 2 with the rows that are independent
  bool at_bound = false;                  ///< a time or an exponent stands at the end of its range
  std::vector<Eigen::VectorXd> residual;  ///< measured minus fitted, of each recording, left-out rows too
};

/// Least squares over the rows with `used` (empty: all), separable: for each set of times, widths and exponent the
/// linear numbers follow by signed least squares (Golub & Pereyra 1973). The times begin at a logarithmic grid from
/// three rows to three times the recording, so that no start has to be guessed. Of each recording the beginning y0 and,
/// with inputs, what each unit still had to go at its first row are free and belong to it.
/// `from`: a fit of the same structure, from which the search goes on, or of one time fewer; without it all fits with
/// fewer times are made first. Searches see at most 5000 rows of a recording, evenly spread. Throws std::domain_error
/// where no start gives finite numbers. The outputs were measured (measure_outputs()).
[[nodiscard]] ResponseFit fit_response(const std::vector<Data>& data, const Structure& structure,
                                       const std::vector<std::vector<bool>>& used = {},
                                       const ResponseFit* from = nullptr);

/// Rows that are independent of each other, by the residual's autocorrelation of one row: n (1 - r) / (1 + r), pooled.
[[nodiscard]] double independent_rows(const std::vector<Eigen::VectorXd>& residual);

}  // namespace isorig::identify::response
