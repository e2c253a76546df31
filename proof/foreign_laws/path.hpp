#pragma once
#include <vector>

#include "proof/generator/random.hpp"

namespace isorig::proof::foreign {

/// The crosshead's motion as a function of time whose acceleration is continuous: ramps whose velocity changes along a
/// smooth step, sines and sums of sines that swell and fade over a cycle. What the crosshead does is known exactly: its
/// controller is no part of this generator.
class Path {
 public:
  struct Point {
    double position_mm = 0.0;
    double velocity_mm_s = 0.0;
    double acceleration_mm_s2 = 0.0;
  };
  struct Window {
    double start_s = 0.0;
    double end_s = 0.0;
  };

  explicit Path(double acceleration_mm_s2) : acceleration_mm_s2_(acceleration_mm_s2) {}
  void rest(double duration_s);
  /// Moves to a position, at most at this speed: a short way is travelled more slowly.
  void ramp(double to_mm, double speed_mm_s);
  void triangle(double amplitude_mm, double speed_mm_s, int cycles);
  void sine(double amplitude_mm, double frequency_Hz, int cycles);
  /// Harmonics 1, 2, 3, 5, 7 of equal velocity with phases after Schroeder 1970.
  void multisine(double amplitude_mm, double base_Hz, int periods);

  [[nodiscard]] double end_s() const noexcept { return end_s_; }
  /// Where the crosshead is fast and a recorder looks often: from shortly before to `after_s` after.
  [[nodiscard]] std::vector<Window> fast_windows(double before_s, double after_s) const;
  [[nodiscard]] Point at(double t_s) const noexcept;
  /// Times of the grid that the laws are integrated on: every corner, 1 ms where it moves fast, 10 ms at rest.
  [[nodiscard]] std::vector<double> grid_s() const;
  [[nodiscard]] double highest_mm() const noexcept { return highest_mm_; }
  [[nodiscard]] double lowest_mm() const noexcept { return lowest_mm_; }
  [[nodiscard]] double acceleration_mm_s2() const noexcept { return acceleration_mm_s2_; }

 private:
  struct Tone {
    double amplitude_mm = 0.0;
    double omega_1_s = 0.0;
    double phase = 0.0;
  };
  struct Piece {
    double t_s = 0.0;
    double duration_s = 0.0;
    double from_mm = 0.0;
    double from_mm_s = 0.0;  ///< velocity at the start
    double change_mm_s = 0.0;
    double swell_s = 0.0;
    std::vector<Tone> tones{};
    bool fast = false;
  };
  void add(Piece piece);
  void tones(std::vector<Tone> tones, double duration_s, double swell_s);
  [[nodiscard]] static Point within(const Piece& piece, double since_s) noexcept;

  double acceleration_mm_s2_;
  std::vector<Piece> pieces_;
  double end_s_ = 0.0;
  double position_mm_ = 0.0;
  double highest_mm_ = 0.0;
  double lowest_mm_ = 0.0;
};

/// Training and held-out sessions, for a specimen with this stroke: other velocities, amplitudes and waveforms.
enum class Protocol { kRamps, kWaves, kBoth };
[[nodiscard]] Path train_path(Protocol protocol, double stroke_mm, Random& random);
[[nodiscard]] Path heldout_path(double stroke_mm, Random& random);

}  // namespace isorig::proof::foreign
