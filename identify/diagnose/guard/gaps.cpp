#include "identify/diagnose/guard/gaps.hpp"

#include <algorithm>

#include "base/quantile.hpp"
#include "identify/diagnose/deciding/deciding.hpp"

namespace isorig::identify {
namespace {

double median_spacing(std::span<const double> t_s) {
  std::vector<double> steps;
  for (std::size_t k = 1; k < t_s.size(); ++k) steps.push_back(t_s[k] - t_s[k - 1]);
  return base::quantile(std::move(steps), 0.5);
}

}  // namespace

bool is_gap(std::span<const double> t_s, std::size_t k) {
  const double length_s = t_s[k + 1] - t_s[k];
  const std::size_t beside = deciding().gap_neighbours;
  const std::size_t before = std::min(beside, k), after = std::min(beside, t_s.size() - k - 2);
  if (before + after == 0) return false;
  return (before == 0 || length_s > deciding().gap_ratio * median_spacing(t_s.subspan(k - before, before + 1))) &&
         (after == 0 || length_s > deciding().gap_ratio * median_spacing(t_s.subspan(k + 1, after + 1)));
}

}  // namespace isorig::identify
