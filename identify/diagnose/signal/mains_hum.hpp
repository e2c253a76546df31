#pragma once
#include <optional>
#include <span>
#include <vector>

namespace isorig::identify {

/// Hum of the mains in a channel.
struct MainsHum {
  double frequency_Hz = 0.0;    ///< of the fundamental, near 50 or 60 Hz
  double amplitude = 0.0;       ///< root of two times the rms of `reading`, in the channel's unit
  bool steady = true;           ///< one amplitude and phase for the whole recording; else they wander
  std::vector<double> reading;  ///< what the hum adds to each row
};

/// Finds a hum near 50 or 60 Hz, with its second and third harmonic, by the rows' own time stamps: a sampling slower
/// than the mains folds the hum down to any frequency, where it passes for slow noise or for physics, and only uneven
/// stamps tell which. With d a row minus the straight line between its neighbours (motion is smooth over three rows),
/// and the same taken of cos and sin of 2 pi f t, the power that these two explain of d is computed for f within
/// 0.3 Hz of the mains, in steps of a quarter of 1/duration (of 1/600 s in longer ones): over the whole recording, and
/// in windows of 20 s whose powers are added (mains wander by hundredths of a hertz). The hum is there when the power
/// stands out of that of the other frequencies as noise would in one of 1e5 recordings (Lomb 1976, Scargle 1982: powers
/// are exponential); a wandering one when it stands out by eight standard deviations and explains more by the criterion
/// of Schwarz (1978), and its phase is then followed from window to window.
///
/// `single` marks the rows that are one reading: a mean over some has no hum left. Empty when nothing is found, when
/// fewer than 200 rows tell, and when every row is a multiple of a mains period away from its neighbours (a hum is a
/// constant then).
[[nodiscard]] std::optional<MainsHum> find_mains_hum(std::span<const double> t_s, std::span<const double> reading,
                                                     const std::vector<bool>& single);

}  // namespace isorig::identify
