#include "daemon/export/table.hpp"

#include <algorithm>
#include <array>
#include <cctype>
#include <cmath>
#include <stdexcept>

namespace isorig::daemon {
namespace {

constexpr int kMostDecimals = 12;
constexpr std::array<double, kMostDecimals + 1> kPowers{1e0, 1e1, 1e2, 1e3,  1e4,  1e5, 1e6,
                                                        1e7, 1e8, 1e9, 1e10, 1e11, 1e12};
constexpr double kExact = 9'007'199'254'740'992.0;  // 2^53

}  // namespace

std::string attribute_name(std::string key) {
  std::replace_if(
      key.begin(), key.end(), [](char c) { return std::isalnum(static_cast<unsigned char>(c)) == 0; }, '_');
  return key;
}

double rounded(double value, int decimals) noexcept {
  const double power = kPowers[static_cast<std::size_t>(std::clamp(decimals, 0, kMostDecimals))];
  const double units = value * power;
  if (!(std::abs(units) < kExact)) return value;  // NaN and infinity too
  return std::nearbyint(units) / power;
}

int decimals_for(double resolution) noexcept {
  constexpr int kUnknown = 9;
  if (!(resolution > 0.0)) return kUnknown;
  // What is stored in 32 bits has its step to a few parts in 100.
  return std::clamp(static_cast<int>(std::ceil(-std::log10(0.105 * resolution))), 0, kUnknown);
}

Table& Table::real(double value) {
  cells_.at(at_).real.push_back(rounded(value, schema_.columns[at_].decimals));
  ++at_;
  return *this;
}

Table& Table::whole(std::int64_t value) {
  cells_.at(at_++).whole.push_back(value);
  return *this;
}

Table& Table::text(std::string value) {
  cells_.at(at_++).text.push_back(std::move(value));
  return *this;
}

void Table::end_row() {
  if (at_ != cells_.size()) {
    throw std::logic_error("table " + schema_.name + ": a row of " + std::to_string(at_) + " cells");
  }
  at_ = 0;
  ++rows_;
}

void Table::clear() {
  for (auto& c : cells_) {
    c.real.clear();
    c.whole.clear();
    c.text.clear();
  }
  rows_ = at_ = 0;
}

}  // namespace isorig::daemon
