#pragma once
#include <cstddef>
#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "identify/report/figure.hpp"

namespace isorig::identify::report {

/// A signal of unknown length for a figure, taken in as it is read: lowest, highest and mean of equal stretches of x,
/// which double whenever there are too many. No reading is skipped, and memory does not grow with the signal.
class LongSignal {
 public:
  /// `finest`: width of a stretch to begin with, in the unit of x.
  explicit LongSignal(double finest, std::size_t most_stretches = 1500) : width_(finest), most_(most_stretches) {}

  void add(double x, double y) { add(x, y, y, y, 1.0); }
  /// An interval by its middle: what was read in it, and how many readings that stands for. What is not finite is left
  /// out. x need not increase.
  void add(double x, double low, double high, double mean, double readings);

  [[nodiscard]] bool empty() const noexcept { return stretches_.empty(); }
  /// Lowest to highest as a band and the mean as a line; no band where no stretch holds two values. A gap of more than
  /// `gap` of x, and of more than three stretches, is left open. x is multiplied by `scale`.
  [[nodiscard]] std::vector<Series> series(const std::string& label, int color, double gap, double scale = 1.0) const;

 private:
  struct Stretch {
    double low = 0.0, high = 0.0, sum = 0.0, readings = 0.0;
    void take(const Stretch& other);
  };
  void halve();

  double width_;
  std::size_t most_;
  std::map<std::int64_t, Stretch> stretches_;  // by floor(x / width_)
};

}  // namespace isorig::identify::report
