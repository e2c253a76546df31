#include "model/pressure_table.hpp"

#include <stdexcept>

namespace isorig::model {

PressureTable::PressureTable(std::span<const double> pressure_psi, const std::vector<std::vector<double>>& channels)
    : channels_(channels.size()) {
  const std::size_t n = pressure_psi.size();
  if (n == 0) throw std::invalid_argument("a pressure table needs at least one pressure");
  if (channels_ > kMaxChannels) throw std::invalid_argument("too many channels in a pressure table");
  for (std::size_t i = 1; i < n; ++i) {
    if (!(pressure_psi[i] > pressure_psi[i - 1])) {
      throw std::invalid_argument("the pressures of a table must increase");
    }
  }
  pieces_.resize(n);
  first_psi_ = pressure_psi[0];
  for (std::size_t i = 0; i < n; ++i) pieces_[i].start_psi = pressure_psi[i];
  for (std::size_t c = 0; c < channels_; ++c) {
    const std::vector<double>& y = channels[c];
    if (y.size() != n) throw std::invalid_argument("a channel of a pressure table has another length");
    // Slopes m_i = 2 s_- s_+ / (s_- + s_+), harmonic mean of the secants s on both sides, 0 where they differ in sign
    // (Fritsch & Butland 1984). On a piece of width h and secant s, with d = p - p_i:
    //     y = y_i + m_i d + (3 s - 2 m_i - m_i+1) / h d^2 + (m_i + m_i+1 - 2 s) / h^2 d^3
    std::vector<double> slope(n, 0.0);
    for (std::size_t i = 1; i + 1 < n; ++i) {
      const double before = (y[i] - y[i - 1]) / (pressure_psi[i] - pressure_psi[i - 1]);
      const double after = (y[i + 1] - y[i]) / (pressure_psi[i + 1] - pressure_psi[i]);
      if (before * after > 0.0) slope[i] = 2.0 * before * after / (before + after);
    }
    for (std::size_t i = 0; i < n; ++i) {
      auto& k = pieces_[i].coefficients;
      k[0][c] = y[i];
      if (i + 1 == n) continue;
      const double h = pressure_psi[i + 1] - pressure_psi[i];
      const double secant = (y[i + 1] - y[i]) / h;
      k[1][c] = slope[i];
      k[2][c] = (3.0 * secant - 2.0 * slope[i] - slope[i + 1]) / h;
      k[3][c] = (slope[i] + slope[i + 1] - 2.0 * secant) / (h * h);
    }
  }
}

void PressureTable::evaluate(double pressure_psi, Values& out) const noexcept {
  auto at = pieces_.begin();
  for (const auto last = pieces_.end() - 1; at != last && pressure_psi >= at[1].start_psi;) ++at;
  const Piece& piece = *at;
  const double d = pressure_psi > first_psi_ ? pressure_psi - piece.start_psi : 0.0;
  // Not into `out`, which may be a part of the table as far as the compiler can tell: so it takes two channels at once.
  Values values;
  for (std::size_t c = 0; c < kMaxChannels; ++c) {
    values[c] = piece.coefficients[0][c] +
                d * (piece.coefficients[1][c] + d * (piece.coefficients[2][c] + d * piece.coefficients[3][c]));
  }
  out = values;
}

}  // namespace isorig::model
