#pragma once
#include <optional>
#include <string>
#include <string_view>
#include <vector>

/// The arithmetic of a calibration: readings of a channel against a reference.
///
///   calibrated = scale * raw + offset                (raw: as the device sent it, in the channel's unit)
///
/// Uncertainty after the GUM (JCGM 100:2008), all contributions independent, stated with coverage factor 2:
///
///   U = 2 sqrt( (U_ref / 2)^2 + s^2 + h^2 / 12 + q^2 / 12 + e^2 + d^2 / 12 )
///
///   U_ref  of the reference instrument (k = 2, from its certificate)     s  scatter about the straight line
///   h      hysteresis: full width between up and down                    q  one step of the reading
///   e      standard error of a reading's mean                            d  drift of a reading while it was taken
namespace isorig::calibration {

enum class Channel { kPressure, kForce, kPosition };
inline constexpr Channel kChannels[] = {Channel::kPressure, Channel::kForce, Channel::kPosition};
[[nodiscard]] const char* name_of(Channel channel) noexcept;  ///< "pressure", "force", "position"
[[nodiscard]] const char* unit_of(Channel channel) noexcept;  ///< "psi", "N", "mm"
[[nodiscard]] std::optional<Channel> channel_of(std::string_view name) noexcept;

/// kAdjust: zero and span from several points (position: span alone, its zero belongs to the specimen). kZero: the zero
/// alone, the span stays. kCheck: nothing is adjusted, what was found is recorded.
enum class Mode { kAdjust, kZero, kCheck };
[[nodiscard]] const char* name_of(Mode mode) noexcept;
[[nodiscard]] std::optional<Mode> mode_of(std::string_view name) noexcept;

struct Correction {
  double scale = 1.0;
  double offset = 0.0;
  [[nodiscard]] double apply(double raw) const noexcept { return scale * raw + offset; }
};

struct Point {
  double reference = 0.0;
  double raw = 0.0;             ///< mean of a window
  double standard_error = 0.0;  ///< of that mean
  double drift = 0.0;           ///< of the reading over its window
};

/// Limits of what is believed, by channel.
struct ChannelFacts {
  double quantum = 0.0;           ///< one step of the reading
  double error_band = 0.0;        ///< the sensor's own specification over its whole range; 0: none is known
  double implausible = 0.0;       ///< an error beyond this is a mistake, not a calibration
  double scale_change_max = 0.0;  ///< the same for the span
};
[[nodiscard]] ChannelFacts facts_of(Channel channel) noexcept;

/// Metrological indicators in the manner of ISO 7500-1, relative to the applied force, worst over all levels but zero.
/// Class limits (error, repeatability, reversibility, zero, resolution; %): 0.5: 0.5, 0.5, 0.75, 0.05, 0.25; 1: 1,
/// 1, 1.5, 0.1, 0.5; 2: 2, 2, 3, 0.2, 1; 3: 3, 3, 4.5, 0.3, 1.5. "In the manner": the standard wants three series of at
/// least five forces with a class 1 reference; `series` and `levels` say what there was.
struct ForceClass {
  double error_percent = 0.0;
  std::optional<double> repeatability_percent;  ///< two rising series or more
  std::optional<double> reversibility_percent;  ///< a falling series
  std::optional<double> zero_percent;           ///< of the largest force; a point at zero
  double resolution_percent = 0.0;
  int series = 0;
  int levels = 0;
  std::string text;  ///< "0.5", "1", "2", "3", "none"
};

struct Result {
  Correction correction;
  std::vector<double>
      as_found;  ///< calibrated as before, minus reference, per point; position: both from the first point
  std::vector<double> as_left;  ///< the same with the new correction
  double as_found_max = 0.0;    ///< largest magnitude
  double as_left_max = 0.0;
  double scatter = 0.0;              ///< s
  std::optional<double> hysteresis;  ///< h; there were points on the way up and on the way down
  double uncertainty = 0.0;          ///< U, k = 2
  bool found_in_band = true;         ///< as found within the sensor's own specification
  std::optional<ForceClass> class_found, class_left;
};

/// Throws std::runtime_error with what is wrong and what to do: too few points, all at one level, an implausible
/// result.
[[nodiscard]] Result calibrate(Channel channel, Mode mode, const std::vector<Point>& points, Correction before,
                               double reference_uncertainty);

}  // namespace isorig::calibration
