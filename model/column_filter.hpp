#pragma once
#include <algorithm>
#include <array>
#include <cstddef>
#include <span>
#include <utility>

#include "model/process.hpp"

namespace isorig::model {

/// As many columns as a model can have: the states of a filter are kept without allocation.
inline constexpr std::size_t kMostColumns = 32;

/// Where one column of a filter stands at an instant.
struct FilteredColumn {
  double input = 0.0;
  double output = 0.0;
  double rate = 0.0;  ///< of the output, for filters of second order
};

/// A linear filter of the force channel, which acts on each column alike and begins settled on the first instant.
/// `Filter::over(dt_s)` prepares a step of that length, dt_s > 0, and returns what makes it: step(column, input) sets
/// output and rate, from the input at the step's begin (column.input) to the one at its end.
template <class Filter>
class ColumnFilter final : public Process {
 public:
  explicit ColumnFilter(Filter filter) noexcept : filter_(std::move(filter)) {}
  void reset(const Instant&) noexcept override { started_ = false; }
  void shape(const Instant& now, std::span<double> columns, std::span<const double>) noexcept override {
    const std::size_t count = std::min(columns.size(), kMostColumns);
    if (!started_ || now.dt_s <= 0.0) {
      for (std::size_t i = 0; i < count; ++i) columns_[i] = {columns[i], columns[i], 0.0};
      started_ = true;
      return;
    }
    const auto step = filter_.over(now.dt_s);
    for (std::size_t i = 0; i < count; ++i) {
      step(columns_[i], columns[i]);
      columns_[i].input = columns[i];
      columns[i] = columns_[i].output;
    }
  }

 private:
  Filter filter_;
  bool started_ = false;
  std::array<FilteredColumn, kMostColumns> columns_{};
};

}  // namespace isorig::model
