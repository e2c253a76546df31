#include "proof/generator/motion.hpp"

#include <cmath>
#include <numbers>

namespace isorig::proof {

void Motion::rest(double duration_s) {
  pieces_.push_back({end_s_, duration_s, position_mm_, 0.0, 0.0, 0.0});
  end_s_ += duration_s;
}

void Motion::move_to(double position_mm, double velocity_mm_s) {
  const double distance_mm = position_mm - position_mm_;
  const double duration_s = std::abs(distance_mm) / velocity_mm_s;
  pieces_.push_back({end_s_, duration_s, position_mm_, std::copysign(velocity_mm_s, distance_mm), 0.0, 0.0});
  end_s_ += duration_s;
  position_mm_ = position_mm;
}

void Motion::sine(double amplitude_mm, double frequency_Hz, int cycles) {
  const double duration_s = cycles / frequency_Hz;
  pieces_.push_back({end_s_, duration_s, position_mm_, 0.0, amplitude_mm, frequency_Hz});
  end_s_ += duration_s;
}

Motion::Point Motion::at(double t_s, std::size_t& cursor) const noexcept {
  while (cursor + 1 < pieces_.size() && t_s >= pieces_[cursor + 1].t_s) ++cursor;
  const Piece& piece = pieces_[cursor];
  const double since_s = std::fmin(t_s - piece.t_s, piece.duration_s);
  const double omega = 2.0 * std::numbers::pi * piece.frequency_Hz;
  return {piece.from_mm + piece.velocity_mm_s * since_s + piece.amplitude_mm * std::sin(omega * since_s),
          piece.velocity_mm_s + piece.amplitude_mm * omega * std::cos(omega * since_s)};
}

namespace {

constexpr double kBeforeRamp_s = 0.8;
constexpr double kAfterRampStart_s = 4.0;

void ramps(Motion& motion, const std::vector<double>& velocities_mm_s, double stroke_mm, double hold_s,
           double return_mm_s) {
  for (const double velocity_mm_s : velocities_mm_s) {
    for (const double side : {1.0, -1.0}) {
      motion.dense(motion.end_s() - kBeforeRamp_s, motion.end_s() + kAfterRampStart_s);
      motion.move_to(side * stroke_mm, velocity_mm_s);
      motion.rest(hold_s);
      motion.move_to(0.0, return_mm_s);
    }
  }
}

}  // namespace

Motion paper_motion(const PaperProtocol& p) {
  Motion motion;
  motion.rest(40.0);
  motion.move_to(p.triangle_mm, p.slow_mm_s);
  motion.move_to(-p.triangle_mm, p.slow_mm_s);
  motion.move_to(0.0, p.slow_mm_s);
  ramps(motion, p.velocities_mm_s, p.stroke_mm, p.hold_s, p.slow_mm_s);
  motion.rest(0.5);
  return motion;
}

Motion heldout_motion(const HeldoutProtocol& p) {
  Motion motion;
  motion.rest(40.0);
  ramps(motion, p.velocities_mm_s, p.stroke_mm, 45.0, 0.02);
  constexpr double kWide_mm_s = 0.05;
  motion.move_to(p.wide_mm, kWide_mm_s);
  motion.move_to(-p.wide_mm, kWide_mm_s);
  motion.move_to(0.0, kWide_mm_s);
  motion.rest(20.0);
  const auto densely = [&motion](auto&& moves) {
    const double start_s = motion.end_s();
    moves();
    motion.dense(start_s - kBeforeRamp_s, motion.end_s() + 2.0);
    motion.rest(20.0);
  };
  densely([&] {
    for (int cycle = 0; cycle < 3; ++cycle) {
      motion.move_to(p.fast_triangle_mm, p.fast_triangle_mm_s);
      motion.move_to(-p.fast_triangle_mm, p.fast_triangle_mm_s);
    }
    motion.move_to(0.0, p.fast_triangle_mm_s);
  });
  for (const double frequency_Hz : p.sine_Hz)
    densely([&] { motion.sine(p.sine_mm, frequency_Hz, frequency_Hz < 0.5 ? 4 : 10); });
  return motion;
}

}  // namespace isorig::proof
