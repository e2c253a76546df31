#pragma once
#include <cstddef>
#include <cstdint>
#include <optional>

namespace isorig::identify::twin {

/// Blocks from the start of an in-control one-sided CUSUM to its false alarm, for Gaussian innovations (Siegmund 1985,
/// eq. 2.56; Montgomery 2009, eq. 9.6):
///
///     ARL = (exp(2 k b) - 2 k b - 1) / (2 k^2),   b = h + 1.166
///
/// Two sides together alarm twice as often. Within 3 % of the exact value for k from 0.1 to 1 and ARL above 100.
[[nodiscard]] double run_length(double k, double h);
/// The same with innovations whose mean is `shift` (blocks until a true parting is found): k - shift in place of k.
[[nodiscard]] double run_length(double k, double h, double shift);

/// How residuals are judged. One block is the mean of `block_s` of residuals, each in units of the standard error that
/// the model states for it (half its band / 1.96), so that a model as good as it says has blocks z of standard
/// deviation 1 at most. Residuals of neighbouring blocks are alike: a model that errs in a ramp errs in all of it. With
/// their correlation time T the blocks are an AR(1) process, phi = exp(-block_s / T), and what each adds is
///
///     e = (z - phi z_before) / sqrt(1 - phi^2)
///
/// independent, of standard deviation 1 at most. A residual that is shifted by `shift` shifts e by
/// shift sqrt((1 - phi) / (1 + phi)); k is half of that, the reference value that finds this shift soonest (Lorden
/// 1971; for AR(1) residuals Lu & Reynolds 2001). h follows from the false alarms allowed.
struct CusumDesign {
  double phi = 0.0;
  double k = 0.0;
  double h = 0.0;
};

inline constexpr double kBlock_s = 0.1;
inline constexpr double kShift = 2.0;           ///< in standard errors of a reading: where the 95 % band ends
inline constexpr double kFalseAlarm_s = 3.6e6;  ///< 1000 h in which the muscle moves as the model says
inline constexpr double kShortest_s = 1.0;      ///< a correlation time is taken to be no less: a ramp's length
inline constexpr double kLongest_s = 10.0;      ///< and no more: a shift would be taken for correlation
inline constexpr double kLearning_s = 60.0;     ///< until it is known, the longest is assumed

[[nodiscard]] CusumDesign cusum_design(double phi, double shift = kShift,
                                       double false_alarm_blocks = kFalseAlarm_s / kBlock_s);

/// Page's two-sided tabular cumulative sum (Page 1954; Montgomery 2009, 9.1.2):
///
///     C+ = max(0, C+ + e - k),   C- = max(0, C- - e - k),   alarm above h
///
/// A shift began in the blocks since the sum was last zero.
class Cusum {
 public:
  explicit Cusum(const CusumDesign& design) : design_(design) {}

  /// True when a sum exceeds h. `z`: mean residual of one block, in standard errors.
  bool add(double z);
  /// What came before says nothing of what comes: a pause.
  void interrupt() { before_.reset(); }

  [[nodiscard]] const CusumDesign& design() const { return design_; }
  [[nodiscard]] double high() const { return high_; }
  [[nodiscard]] double low() const { return low_; }
  /// Of the block added last.
  [[nodiscard]] double innovation() const { return innovation_; }
  /// Blocks for which the larger sum has been above zero.
  [[nodiscard]] std::uint64_t since() const { return high_ >= low_ ? since_high_ : since_low_; }

 private:
  CusumDesign design_;
  std::optional<double> before_;
  double high_ = 0.0, low_ = 0.0, innovation_ = 0.0;
  std::uint64_t since_high_ = 0, since_low_ = 0;
};

/// The correlation time of blocks, from their first minute: phi = sum z z' / sum z^2 about zero, which is where a model
/// that is right has them.
class Correlation {
 public:
  void add(double z);
  void interrupt() { before_.reset(); }
  [[nodiscard]] std::size_t blocks() const { return blocks_; }
  /// Between those of kShortest_s and kLongest_s.
  [[nodiscard]] double phi() const;

 private:
  std::optional<double> before_;
  double products_ = 0.0, squares_ = 0.0;
  std::size_t blocks_ = 0;
};

}  // namespace isorig::identify::twin
