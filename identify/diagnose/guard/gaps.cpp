#include "identify/diagnose/guard/gaps.hpp"

#include <algorithm>

#include "base/quantile.hpp"

namespace isorig::identify {
namespace {

constexpr std::size_t kNeighbours = 5;
constexpr double kGap = 8.0;

double median_spacing(std::span<const double> t_s) {
  std::vector<double> steps;
  for (std::size_t k = 1; k < t_s.size(); ++k) steps.push_back(t_s[k] - t_s[k - 1]);
  return base::quantile(std::move(steps), 0.5);
}

}  // namespace

bool is_gap(std::span<const double> t_s, std::size_t k) {
  const double length_s = t_s[k + 1] - t_s[k];
  const std::size_t before = std::min(kNeighbours, k), after = std::min(kNeighbours, t_s.size() - k - 2);
  if (before + after == 0) return false;
  return (before == 0 || length_s > kGap * median_spacing(t_s.subspan(k - before, before + 1))) &&
         (after == 0 || length_s > kGap * median_spacing(t_s.subspan(k + 1, after + 1)));
}

}  // namespace isorig::identify
