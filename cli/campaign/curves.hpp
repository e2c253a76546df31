#pragma once
#include <cstddef>
#include <map>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <vector>

#include "identify/report/figure.hpp"

namespace isorig::cli::pieces {

/// Force-velocity curves of a campaign of `isorig fv`, a panel a specimen, for its page. Of bounded size.
class Curves {
 public:
  /// A row with a "fit".
  void add(const nlohmann::ordered_json& row);
  /// Nothing where no recording has a curve.
  [[nodiscard]] std::optional<identify::report::Figure> figure() const;

  /// How many fits there are, and mean and standard deviation of their R² (Welford 1962).
  [[nodiscard]] std::size_t fits() const { return fits_; }
  [[nodiscard]] double r_squared_mean() const { return mean_; }
  [[nodiscard]] double r_squared_sd() const;

 private:
  struct Points {
    std::vector<double> rate_per_s, force;
  };
  std::map<std::string, std::map<double, Points>> of_;  ///< specimen, pressure
  bool all_ = true;
  std::size_t fits_ = 0;
  double mean_ = 0.0, squares_ = 0.0;
};

}  // namespace isorig::cli::pieces
