#pragma once
#include <array>
#include <cstddef>
#include <span>
#include <vector>

namespace isorig::model {

/// Several quantities identified at the same few pressures, as smooth functions of pressure.
///
/// Between the nodes: monotone cubic Hermite (Fritsch and Butland 1984: harmonic mean of the neighbouring
/// slopes), so that it never leaves the range of the values. Beyond the first and last node: constant, and
/// the end slopes are 0, so that there is no kink at a node, which is where a rig holds the pressure.
class PressureTable {
 public:
  static constexpr std::size_t kMaxChannels = 6;
  using Values = std::array<double, kMaxChannels>;

  PressureTable() = default;
  /// `pressure_psi` strictly increasing, at least one; each channel as long. Throws std::invalid_argument.
  PressureTable(std::span<const double> pressure_psi, const std::vector<std::vector<double>>& channels);

  /// Values of the channels at `pressure_psi`; members beyond the channels are 0.
  void evaluate(double pressure_psi, Values& out) const noexcept;

 private:
  struct Piece {
    double start_psi = 0.0;
    std::array<Values, 4> coefficients{};  // of (p - start_psi)^0..3
  };
  std::vector<Piece> pieces_;  // one per node; the last is constant
  double first_psi_ = 0.0;
  std::size_t channels_ = 0;
};

}  // namespace isorig::model
