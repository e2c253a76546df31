#pragma once
#include <vector>

namespace isorig::proof {

/// What the crosshead is told to do: rests, moves at constant velocity, sines; and when it is recorded
/// densely.
class Motion {
 public:
  struct Piece {
    double t_s = 0.0;  ///< start
    double duration_s = 0.0;
    double from_mm = 0.0;
    double velocity_mm_s = 0.0;
    double amplitude_mm = 0.0;  ///< of a sine that starts and ends at from_mm
    double frequency_Hz = 0.0;
  };
  struct Window {
    double start_s = 0.0;
    double end_s = 0.0;
  };
  struct Point {
    double position_mm = 0.0;
    double velocity_mm_s = 0.0;
  };

  void rest(double duration_s);
  void move_to(double position_mm, double velocity_mm_s);
  void sine(double amplitude_mm, double frequency_Hz, int cycles);
  void dense(double start_s, double end_s) { windows_.push_back({start_s, end_s}); }

  [[nodiscard]] double end_s() const noexcept { return end_s_; }
  [[nodiscard]] const std::vector<Piece>& pieces() const noexcept { return pieces_; }
  [[nodiscard]] const std::vector<Window>& windows() const noexcept { return windows_; }
  /// At `t_s`; `cursor` is the last piece used, and times must not decrease between calls that share one.
  [[nodiscard]] Point at(double t_s, std::size_t& cursor) const noexcept;

 private:
  std::vector<Piece> pieces_;
  std::vector<Window> windows_;
  double end_s_ = 0.0;
  double position_mm_ = 0.0;
};

/// The paper's repetition: a slow triangle over +-4 mm, then for every velocity a ramp out of the rest
/// position in both directions, a hold, and a return too slow to matter.
struct PaperProtocol {
  std::vector<double> velocities_mm_s{2.0, 4.0, 6.0, 8.0, 10.0};
  double stroke_mm = 2.0;
  double triangle_mm = 4.0;
  double slow_mm_s = 0.01;
  double hold_s = 60.0;
};
[[nodiscard]] Motion paper_motion(const PaperProtocol& protocol);

/// What the training recording has not: other velocities and strokes, a wide triangle, fast triangles, sines.
struct HeldoutProtocol {
  std::vector<double> velocities_mm_s{1.0, 3.0, 5.0, 7.0, 9.0};
  double stroke_mm = 1.5;
  double wide_mm = 3.9;
  double fast_triangle_mm = 0.8;
  double fast_triangle_mm_s = 6.0;
  std::vector<double> sine_Hz{0.3, 1.3};
  double sine_mm = 0.9;
};
[[nodiscard]] Motion heldout_motion(const HeldoutProtocol& protocol);

}  // namespace isorig::proof
