#pragma once
#include <functional>
#include <limits>
#include <memory>
#include <span>
#include <string_view>
#include <vector>

namespace isorig::model {

/// Where a recording's numbers are counted from. Sign and frame, once for the whole project: extension and
/// tension positive, position relative to the unpressurized rest length, pressure gauge.
struct Reference {
  /// Rest length minus pressurized rest length: what a pressurized McKibben is stretched by at position 0.
  double elongation_at_zero_mm = 0.0;
  double nominal_pressure_psi = 0.0;
  double duration_s = 0.0;  ///< of the recording; 0 when it is not known (a running rig)
};

/// One instant of the drive. Between two instants the specimen moves at constant velocity; steps are exact
/// for that motion unless a law says otherwise.
struct Instant {
  double t_s = 0.0;
  double dt_s = 0.0;           ///< since the last instant, 0 at the first
  double position_mm = 0.0;    ///< what the specimen sees: the crosshead after play and slip
  double elongation_mm = 0.0;  ///< position + Reference::elongation_at_zero_mm
  double step_mm = 0.0;        ///< change of position since the last instant
  /// The same without reversals smaller than the reading's noise, for laws that take every reversal at its
  /// word (friction). NaN: as step_mm, which is right when the motion is known and not read.
  double slide_mm = std::numeric_limits<double>::quiet_NaN();
  double velocity_mm_s = 0.0;        ///< at the instant
  double acceleration_mm_s2 = 0.0;   ///< at the instant
  double excess_pressure_psi = 0.0;  ///< measured minus nominal
};

/// A running piece of physics. Force enters as columns: the force per unit of each coefficient of the law, so
/// that the simulator adds up coefficient x column, and identification solves for the coefficients.
/// Everything here is real-time safe: no allocation, no lock, no throw.
class Process {
 public:
  virtual ~Process() = default;
  virtual void reset(const Instant& first) noexcept = 0;
  /// Kinematics: turns the reading into what the specimen sees.
  virtual void move(Instant&) noexcept {}
  /// Writes one value per coefficient of the law.
  virtual void force(const Instant&, double* /*columns*/) noexcept {}
  /// Acts on all columns of the stages before it (a sensor's lag acts on each alike, since it is linear).
  virtual void shape(const Instant&, std::span<double> /*columns*/, std::span<const double> /*coefficients*/) noexcept {
  }
};

/// Order of the stages, from the reading of the crosshead to the reading of the load cell.
enum class Stage { kKinematics, kSpecimen, kSpecimenShape, kRig, kSensorLag, kSensorDelay, kSensor };

[[nodiscard]] std::string_view side_of(Stage stage) noexcept;

enum class Sign { kFree, kNonNegative, kNonPositive };

/// What enters nonlinearly: found by search, within bounds.
struct Parameter {
  std::string_view name;  ///< with its unit, as it stands in TOML and JSON
  double lower = 0.0;
  double upper = 0.0;
  std::vector<double> starts;  ///< where a search begins
  bool logarithmic = false;    ///< searched on a logarithmic scale
  bool fixed = false;          ///< given, not identified
};

/// What enters linearly. The sign is a law of nature (a spring pushes back, friction dissipates), not a
/// habit.
struct Coefficient {
  std::string_view name;
  Sign sign = Sign::kFree;
};

/// A function of one variable by its values at even knots, straight between them, constant beyond the ends.
struct Table {
  double first = 0.0;
  double step = 1.0;
  std::vector<double> values;

  [[nodiscard]] double at(double x) const noexcept {
    if (values.empty()) return 0.0;
    const double u = (x - first) / step;
    if (!(u > 0.0)) return values.front();
    const auto last = static_cast<double>(values.size() - 1);
    if (u >= last) return values.back();
    const auto i = static_cast<std::size_t>(u);
    return values[i] + (u - static_cast<double>(i)) * (values[i + 1] - values[i]);
  }
};

/// One mathematical form of a piece of physics.
struct Law {
  std::string_view name;
  std::string_view formula;
  std::vector<Parameter> parameters;
  std::vector<Coefficient> coefficients;
  std::function<std::unique_ptr<Process>(std::span<const double> parameters, const Reference&)> make;
  /// The law is another form of a linear Maxwell arm of the nominal model, and takes its place.
  bool replaces_arm = false;
  /// The law scales the force of all other specimen parts (Process::shape) instead of adding its own.
  bool scales_specimen = false;
  /// Set instead of `make` for a law that is a table (empirical models).
  std::function<std::unique_ptr<Process>(const Table&, const Reference&)> make_table = {};
};

/// An entry of the catalogue.
struct Physics {
  std::string_view name;
  Stage stage = Stage::kSpecimen;
  std::string_view what;     ///< one sentence
  std::string_view source;   ///< of the law
  std::string_view reveals;  ///< the experiment that shows it, and what it is mistaken for
  std::vector<Law> laws;
};

}  // namespace isorig::model
