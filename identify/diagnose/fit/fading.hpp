#pragma once
#include <array>
#include <span>
#include <string>
#include <vector>

#include "identify/diagnose/fit/series.hpp"
#include "model/composed.hpp"

namespace isorig::identify {

/// The ranges of what a model is fitted to: bins with readings. Error, covariance and nominal model are left empty.
[[nodiscard]] model::Seen ranges_of(std::span<const Series> series);

/// What the readings scatter by that a model is driven with.
struct ReadingNoise {
  double position_mm = 0.0;
  bool has_pressure = false;
  double pressure_psi = 0.0;
};
[[nodiscard]] ReadingNoise noise_of(const Excitation& excitation);

/// The weight, instant by instant, of the parts that a model has beyond its nominal one, when it predicts outside of
/// the ranges that it was fitted to. With d the distance beyond what it has seen in widths of that range (0 inside),
/// the largest over position, velocity, pressure (where a part reads it), travel and duration (where a part counts
/// them, model::Counts), and F0 the nominal model's force,
///
///     F_predicted = F0 + s w (F - F0)
///     w = 1 up to d = 1.5, 0 from d = 4 on, straight between them    laws
///     w = 1 at d = 0, 0 from d = 0.5 on                              with a table or a memory, which is no law
///
/// with s the share that left-out readings bear (model::Seen::share, mostly 1). The weight here is s w.
///
/// Laws may be extrapolated further than tables: friction at twice the velocity is still friction. Less than five
/// noises of position and pressure, 5 % of the velocity (what two reconstructions of one motion differ by at its
/// corners) and 1 % of travel and time are not outside.
class Fading {
 public:
  /// Of a model that says what it has seen.
  Fading(const model::ModelSpec& spec, double nominal_pressure_psi, const ReadingNoise& noise);

  struct Belief {
    double distance = 0.0;
    double weight = 1.0;
  };
  [[nodiscard]] Belief next(const model::Instant& now);
  /// Travel and time are counted from here.
  void begin(const model::Instant& first) noexcept {
    start_s_ = first.t_s;
    travelled_mm_ = 0.0;
  }

  /// What left its range so far, by how much, with the range; for people.
  [[nodiscard]] std::vector<std::string> notes() const;

 private:
  struct Watched {
    const char* name;
    const char* unit;
    double low, high;
    double tolerance;
    bool used;
    double least = 1e300, most = -1e300;
    std::size_t rows = 0;
    [[nodiscard]] double distance(double value);
  };
  std::array<Watched, 5> watched_;
  double share_;
  double holds_, gone_;  ///< distances up to which the weight is one, and from which it is zero
  double nominal_psi_, start_s_ = 0.0, travelled_mm_ = 0.0;
  std::size_t rows_ = 0;
};

/// The force of a model on the bins of a series, faded where it leaves what it has seen; as it stands without [seen].
[[nodiscard]] std::vector<double> faded_force(const model::ModelSpec& spec, const Series& series);

}  // namespace isorig::identify
