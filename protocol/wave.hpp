#pragma once
#include <cmath>
#include <cstdint>
#include <numbers>

#include "protocol/plan.hpp"

/// A wave as a frame can run it: strokes from one turning point to the next, each with a target (the turning
/// point), each stroke of a sine cut into chords that change only the velocity.
///
/// N cycles are 2N+1 strokes: a quarter to +A, 2N-1 halves, a quarter back to the centre. Every segment of a
/// stroke carries the stroke's own target, and the next stroke starts when the frame has reached it: the
/// frame never stops half-way, the amplitude is exact, and a lag of the frame does not add up.
///
/// x(t) = A sin(2 pi f t). With n equal chords per quarter, h = pi / (2 n), a chord from phase p to p + h
/// leaves the sine by at most A (1 - cos(h/2)), most where it curves most (the turning points).
namespace isorig::protocol::wave {

[[nodiscard]] inline std::uint32_t strokes(const Step& step) noexcept {
  return 2 * step.cycles + 1;
}

[[nodiscard]] inline bool is_quarter(const Step& step, std::uint32_t stroke) noexcept {
  return stroke == 0 || stroke + 1 == strokes(step);
}

[[nodiscard]] inline double target_mm(const Step& step, std::uint32_t stroke) noexcept {
  if (stroke + 1 == strokes(step)) return step.target_mm;
  return step.target_mm + (stroke % 2 == 0 ? step.amplitude_mm : -step.amplitude_mm);
}

[[nodiscard]] inline std::uint32_t chords(const Step& step, std::uint32_t stroke) noexcept {
  if (step.shape == WaveShape::kTriangle) return 1;
  return is_quarter(step, stroke) ? step.segments_per_quarter : 2 * step.segments_per_quarter;
}

[[nodiscard]] inline double stroke_s(const Step& step, std::uint32_t stroke) noexcept {
  return (is_quarter(step, stroke) ? 0.25 : 0.5) / step.frequency_hz;
}

/// Deviation of the best polygon with `per_quarter` chords.
[[nodiscard]] inline double deviation_mm(double amplitude_mm, std::uint32_t per_quarter) noexcept {
  return amplitude_mm * (1.0 - std::cos(std::numbers::pi / (4.0 * per_quarter)));
}

/// Speed of chord `index` of a quarter, counted from the centre (0, fastest) to the turning point.
[[nodiscard]] inline double quarter_speed_mm_s(const Step& step, std::uint32_t index) noexcept {
  const double n = step.segments_per_quarter;
  const double h = std::numbers::pi / (2.0 * n);
  return step.amplitude_mm * (std::sin(h * (index + 1)) - std::sin(h * index)) * 4.0 * n * step.frequency_hz;
}

[[nodiscard]] inline double chord_speed_mm_s(const Step& step, std::uint32_t stroke, std::uint32_t chord) noexcept {
  if (step.shape == WaveShape::kTriangle) return 4.0 * step.amplitude_mm * step.frequency_hz;
  const std::uint32_t n = step.segments_per_quarter;
  if (stroke == 0) return quarter_speed_mm_s(step, chord);
  // A half begins at a turning point, as does the last quarter: inwards first, then outwards.
  return quarter_speed_mm_s(step, chord < n ? n - 1 - chord : chord - n);
}

}  // namespace isorig::protocol::wave
