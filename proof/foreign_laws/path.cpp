#include "proof/foreign_laws/path.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

namespace isorig::proof::foreign {
namespace {

constexpr double kTwoPi = 2.0 * std::numbers::pi;
/// Slower than this a motion is quasi-static to a recorder: it is neither recorded nor integrated finely.
constexpr double kSlow_mm_s = 0.1;

struct Swell {
  double value = 1.0, rate = 0.0, second = 0.0;
};
/// Smooth step of the fifth degree and its derivatives: from 0 to 1 as share goes from 0 to 1.
Swell swell(double share, double duration_s) noexcept {
  const double s = std::clamp(share, 0.0, 1.0);
  return {s * s * s * (10.0 + s * (-15.0 + 6.0 * s)), 30.0 * s * s * (1.0 - s) * (1.0 - s) / duration_s,
          60.0 * s * (1.0 - s) * (1.0 - 2.0 * s) / (duration_s * duration_s)};
}

}  // namespace

void Path::add(Piece piece) {
  if (piece.duration_s <= 0.0) return;
  piece.t_s = end_s_;
  piece.from_mm = position_mm_;
  end_s_ += piece.duration_s;
  position_mm_ = within(piece, piece.duration_s).position_mm;
  for (int n = 0; n <= 200; ++n) {
    const double x = within(piece, piece.duration_s * n / 200.0).position_mm;
    highest_mm_ = std::max(highest_mm_, x);
    lowest_mm_ = std::min(lowest_mm_, x);
  }
  pieces_.push_back(std::move(piece));
}

void Path::rest(double duration_s) {
  add({.duration_s = duration_s});
}

void Path::ramp(double to_mm, double speed_mm_s) {
  const double way_mm = to_mm - position_mm_;
  if (way_mm == 0.0) return;
  // A change of velocity dv along 3 s^2 - 2 s^3 takes 1.5 dv / a, and half of dv times that in way.
  const double speed = std::min(speed_mm_s, std::sqrt(std::abs(way_mm) * acceleration_mm_s2_ / 1.5));
  const double velocity = std::copysign(speed, way_mm);
  const double corner_s = 1.5 * speed / acceleration_mm_s2_;
  const bool fast = speed > kSlow_mm_s;
  add({.duration_s = corner_s, .change_mm_s = velocity, .fast = fast});
  add({.duration_s = std::abs(way_mm) / speed - corner_s, .from_mm_s = velocity, .fast = fast});
  add({.duration_s = corner_s, .from_mm_s = velocity, .change_mm_s = -velocity, .fast = fast});
}

void Path::triangle(double amplitude_mm, double speed_mm_s, int cycles) {
  const double middle_mm = position_mm_;
  for (int n = 0; n < cycles; ++n) {
    ramp(middle_mm + amplitude_mm, speed_mm_s);
    ramp(middle_mm - amplitude_mm, speed_mm_s);
  }
  ramp(middle_mm, speed_mm_s);
}

void Path::tones(std::vector<Tone> tones, double duration_s, double swell_s) {
  add({.duration_s = duration_s, .swell_s = swell_s, .tones = std::move(tones), .fast = true});
}

void Path::sine(double amplitude_mm, double frequency_Hz, int cycles) {
  tones({{amplitude_mm, kTwoPi * frequency_Hz, 0.0}}, cycles / frequency_Hz, 1.0 / frequency_Hz);
}

void Path::multisine(double amplitude_mm, double base_Hz, int periods) {
  constexpr std::array kHarmonics{1, 2, 3, 5, 7};
  std::vector<Tone> sum;
  for (std::size_t n = 0; n < kHarmonics.size(); ++n)
    sum.push_back({amplitude_mm / (2.0 * kHarmonics[n]), kTwoPi * base_Hz * kHarmonics[n],
                   -std::numbers::pi * static_cast<double>(n * (n + 1)) / kHarmonics.size()});
  tones(std::move(sum), periods / base_Hz, 1.0 / base_Hz);
}

Path::Point Path::within(const Piece& piece, double since_s) noexcept {
  if (!piece.tones.empty()) {
    const double left_s = piece.duration_s - since_s;
    Swell e = swell(since_s / piece.swell_s, piece.swell_s);
    if (left_s < piece.swell_s) {
      e = swell(left_s / piece.swell_s, piece.swell_s);
      e.rate = -e.rate;
    }
    double x = 0.0, v = 0.0, a = 0.0;
    for (const Tone& tone : piece.tones) {
      const double angle = tone.omega_1_s * since_s + tone.phase;
      x += tone.amplitude_mm * std::sin(angle);
      v += tone.amplitude_mm * tone.omega_1_s * std::cos(angle);
      a -= tone.amplitude_mm * tone.omega_1_s * tone.omega_1_s * std::sin(angle);
    }
    return {piece.from_mm + x * e.value, v * e.value + x * e.rate, a * e.value + 2.0 * v * e.rate + x * e.second};
  }
  const double s = std::clamp(since_s / piece.duration_s, 0.0, 1.0);
  const double dv = piece.change_mm_s;
  return {piece.from_mm + piece.from_mm_s * since_s + dv * piece.duration_s * s * s * s * (1.0 - 0.5 * s),
          piece.from_mm_s + dv * s * s * (3.0 - 2.0 * s), 6.0 * dv / piece.duration_s * s * (1.0 - s)};
}

Path::Point Path::at(double t_s) const noexcept {
  auto next = std::ranges::upper_bound(pieces_, t_s, {}, &Piece::t_s);
  if (next != pieces_.begin()) --next;
  return within(*next, std::clamp(t_s - next->t_s, 0.0, next->duration_s));
}

std::vector<Path::Window> Path::fast_windows(double before_s, double after_s) const {
  std::vector<Window> windows;
  for (const Piece& piece : pieces_) {
    if (!piece.fast) continue;
    const Window window{std::max(0.0, piece.t_s - before_s), piece.t_s + piece.duration_s + after_s};
    if (!windows.empty() && window.start_s <= windows.back().end_s)
      windows.back().end_s = window.end_s;
    else
      windows.push_back(window);
  }
  return windows;
}

std::vector<double> Path::grid_s() const {
  constexpr double kFine_s = 1e-3, kSettlingStep_s = 2e-3, kCoarse_s = 1e-2, kSettles_s = 0.6;
  std::vector<double> grid{0.0};
  const auto fill = [&grid](double from_s, double to_s, double step_s) {
    const auto count = static_cast<int>(std::ceil((to_s - from_s) / step_s - 1e-9));
    for (int n = 1; n < count; ++n) grid.push_back(from_s + (to_s - from_s) * n / count);
    if (to_s > grid.back()) grid.push_back(to_s);
  };
  bool was_fast = false;
  for (const Piece& piece : pieces_) {
    const double to_s = piece.t_s + piece.duration_s;
    if (piece.fast) {
      fill(piece.t_s, to_s, kFine_s);
    } else {
      const double settled_s = was_fast ? std::min(to_s, piece.t_s + kSettles_s) : piece.t_s;
      fill(piece.t_s, settled_s, kSettlingStep_s);
      fill(settled_s, to_s, kCoarse_s);
    }
    was_fast = piece.fast;
  }
  return grid;
}

namespace {

void ramps(Path& path, double stroke_mm, int count, Random& random) {
  const double slowest = stroke_mm * random.log_uniform(0.15, 0.4);
  const double ratio = random.uniform(1.6, 2.4);
  const double hold_s = random.uniform(12.0, 24.0);
  const double amplitude_mm = stroke_mm * random.uniform(0.45, 0.65);
  for (int n = 0; n < count; ++n) {
    for (const double side : {1.0, -1.0}) {
      path.ramp(side * amplitude_mm, slowest * std::pow(ratio, n));
      path.rest(hold_s);
      path.ramp(0.0, 0.12 * stroke_mm);
      path.rest(hold_s);
    }
  }
}

void waves(Path& path, double stroke_mm, Random& random) {
  const double amplitude_mm = stroke_mm * random.uniform(0.35, 0.6);
  path.triangle(amplitude_mm, stroke_mm * random.uniform(0.3, 0.8), 2);
  path.rest(random.uniform(11.0, 16.0));
  path.sine(amplitude_mm * random.uniform(0.6, 1.0), random.log_uniform(0.15, 0.4), 3);
  path.rest(random.uniform(11.0, 16.0));
  path.sine(amplitude_mm * random.uniform(0.3, 0.6), random.log_uniform(0.7, 2.5), 6);
  path.rest(random.uniform(11.0, 16.0));
  path.multisine(amplitude_mm, random.log_uniform(0.15, 0.35), 3);
  path.rest(random.uniform(11.0, 16.0));
}

double draw_acceleration(double stroke_mm, Random& random) {
  return stroke_mm * random.log_uniform(30.0, 200.0);
}

}  // namespace

Path train_path(Protocol protocol, double stroke_mm, Random& random) {
  Path path(draw_acceleration(stroke_mm, random));
  path.rest(random.uniform(14.0, 25.0));
  path.triangle(stroke_mm, 0.06 * stroke_mm, 1);
  path.rest(random.uniform(12.0, 20.0));
  if (protocol != Protocol::kWaves) ramps(path, stroke_mm, protocol == Protocol::kBoth ? 3 : 5, random);
  if (protocol != Protocol::kRamps) waves(path, stroke_mm, random);
  return path;
}

Path heldout_path(double stroke_mm, Random& random) {
  Path path(draw_acceleration(stroke_mm, random));
  path.rest(random.uniform(14.0, 20.0));
  ramps(path, 0.85 * stroke_mm, 2, random);
  waves(path, 0.95 * stroke_mm, random);
  path.triangle(0.95 * stroke_mm, 0.1 * stroke_mm, 1);
  path.rest(12.0);
  return path;
}

}  // namespace isorig::proof::foreign
