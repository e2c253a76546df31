#pragma once
#include <cmath>
#include <cstddef>
#include <initializer_list>
#include <stdexcept>
#include <string>

#include "base/number_text.hpp"

namespace isorig::c_abi {

/// A column of a caller; null: not given.
struct Column {
  const char* name;
  const double* values;
};

/// Throws std::invalid_argument for what is not finite, and for a time that does not increase.
inline void check_rows(std::size_t rows, const Column& time, std::initializer_list<Column> columns,
                       double before_s = -1e300) {
  const auto wrong = [](std::size_t row, const std::string& what) {
    throw std::invalid_argument("row " + std::to_string(row) + " (counted from 0): " + what);
  };
  for (std::size_t i = 0; i < rows; ++i) {
    if (!std::isfinite(time.values[i])) wrong(i, std::string(time.name) + " is no finite number");
    for (const Column& column : columns)
      if (column.values != nullptr && !std::isfinite(column.values[i]))
        wrong(i, std::string(column.name) + " is no finite number");
    if (!(time.values[i] > before_s))
      wrong(i, std::string(time.name) + " is " + base::number_text(time.values[i], 9) + " s after " +
                   base::number_text(before_s, 9) + " s; time has to increase");
    before_s = time.values[i];
  }
}

}  // namespace isorig::c_abi
