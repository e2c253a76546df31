#pragma once
#include <span>
#include <vector>

#include "identify/pooling/mixed_model.hpp"

namespace isorig::identify::pooling {

/// An actuator, or one recording, whose number does not belong to the others.
struct Outlier {
  std::size_t index = 0;     ///< of the actuator, or of the measurement
  double probability = 0.0;  ///< that it does not belong
  bool slope = false;        ///< an actuator: it is the change with the pressure that stands out, not the level
  double expected = 0.0;     ///< by the pool of the rest
  double difference = 0.0;   ///< measured minus expected, in the unit of the quantity (slope: per psi)
  double deviations = 0.0;   ///< difference over the standard deviation of what the rest lets one expect
};

struct Outliers {
  std::vector<Outlier> actuators;   ///< probability above one half, most probable first
  std::vector<Outlier> recordings;  ///< likewise
};

struct OutlierOptions {
  /// How many actuators and recordings are looked at in all, over all quantities. Before any data it is as likely as
  /// not that none of them stands out: each has the prior probability 1 - (1/2)^(1/looks) (Westfall, Johnson & Utts
  /// 1997).
  std::size_t actuator_looks = 1;
  std::size_t recording_looks = 1;
};

/// Variance inflation (Box & Tiao 1968; Verdinelli & Wasserman 1991): what does not belong has a level or a slope of
/// its own, five robust spreads wide. The evidence of each set of outliers is integrated over the spreads, so that an
/// outlier widens the pool it is judged by only where it is believed to belong. Two that hide each other are found
/// because pairs of the furthest are weighed before any single one is settled on. Fewer than four actuators name none
/// of them.
[[nodiscard]] Outliers find_outliers(std::span<const Measurement> measurements, const Pooled& pooled,
                                     const OutlierOptions& options);

}  // namespace isorig::identify::pooling
