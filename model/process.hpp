#pragma once
#include <algorithm>
#include <functional>
#include <limits>
#include <memory>
#include <span>
#include <string_view>
#include <vector>

namespace isorig::model {

/// Recording ids are whole numbers up to this: what a double and a TOML float hold exactly.
inline constexpr double kLargestRecordingId = 9007199254740991.0;  // 2^53 - 1
/// Of a recording that was not made yet: no event of another is in it.
inline constexpr double kPlannedRecordingId = 1.0;

inline constexpr double kAtmosphere_psi = 14.696;  ///< what a gauge counts from

/// Where a recording's numbers are counted from. Sign and frame, once for the whole project: extension and
/// tension positive, position relative to the unpressurized rest length, pressure gauge.
struct Reference {
  /// Rest length minus pressurized rest length: what a pressurized McKibben is stretched by at position 0.
  double elongation_at_zero_mm = 0.0;
  double nominal_pressure_psi = 0.0;
  double duration_s = 0.0;  ///< of the recording; 0 when it is not known (a running rig)
  /// Which recording: a whole number made from its readings (messages::recording_id). 0: not known (a running rig).
  double recording_id = 0.0;
  double largest_force_N = 0.0;  ///< that was read, as a magnitude; 0 when it is not known (a running rig)
  double rest_length_mm = 0.0;   ///< at position 0, without pressure; 0 when it is not known
  double lowest_position_mm = 0.0, highest_position_mm = 0.0;  ///< that were read; equal when not known (a running rig)
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

/// What fills in a parameter that belongs to a recording and not to a specimen.
enum class FilledBy { kNothing, kRecordingDuration, kRecordingId, kRestLength };

/// The instrument's limit that a value must exceed to be claimed. A smaller value would only describe the instrument's
/// own error.
enum class Resolution { kNone, kPositionNoise, kSampleInterval };

/// What identification has to know of a parameter beyond its range. Declared where the parameter is.
struct ParameterTraits {
  /// The time of an event: no gradient leads to it, so it is scanned for; its interval runs from reading to reading.
  bool event_time = false;
  /// Where the process stood when the recording began. Any value is as good a law as any other.
  bool initial_state = false;
  FilledBy filled_by = FilledBy::kNothing;
  Resolution resolution = Resolution::kNone;
  double resolution_factor = 0.0;  ///< times that, in the parameter's unit
  /// `starts` are multiplied by Reference::largest_force_N: for a force whose scale depends on the rig.
  bool starts_are_shares_of_largest_force = false;
  /// A place on the frame's own scale, whose zero may be anywhere: `starts` are shares of the way from the lowest to
  /// the highest position of the recording, and the bounds do not follow the specimen's size.
  bool starts_are_shares_of_travel = false;
  /// The effect that the law turns into at its lower bound. A fit that ends there is reported under that effect's name.
  std::string_view lower_bound_is = {};
  std::string_view upper_bound_is = {};  ///< the same of its upper bound
  /// Name of the law that this one becomes at the bound, where that is a law in its own right. Empty: a number at its
  /// bound says that the law is not the right one.
  std::string_view lower_limit_law = {};
  std::string_view upper_limit_law = {};
};

/// What a person must know of a number to judge it. `isorig effects` prints it, and docs/effect-sheets.md is that
/// print. No number of an effect may lack a field (tests/model/effects/effects_sheet_test.cpp).
struct NumberSheet {
  std::string_view what;  ///< one sentence: the quantity, and what its sign means where it has one
  std::string_view unit;  ///< "mm", "N/mm"; "1" of a ratio
  std::string_view
      range;  ///< why the range, or the sign, is what it is: "Physics: ", "Instrument: " or "Numerics: " first
  std::string_view errors;  ///< what makes it wrong, what it is mistaken for
};

/// What enters nonlinearly: found by search, within bounds.
struct Parameter {
  std::string_view name;         ///< with its unit, as it stands in TOML and JSON
  std::string_view symbol = {};  ///< in Law::formula
  double lower = 0.0;
  double upper = 0.0;
  std::vector<double> starts = {};  ///< where a search begins
  bool logarithmic = false;         ///< searched on a logarithmic scale
  bool fixed = false;               ///< given, not identified
  ParameterTraits traits = {};
  NumberSheet sheet = {};
};

/// What enters linearly. The sign is a law of nature (a spring pushes back, friction dissipates), not a
/// habit.
struct Coefficient {
  std::string_view name;
  std::string_view symbol = {};  ///< in Law::formula
  Sign sign = Sign::kFree;
  NumberSheet sheet = {};
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

/// The quantity that a law accumulates from the start of the recording. Such a law changes even when the motion
/// repeats, so that it may give out energy that it took in before. Laws that count time or travel are therefore left
/// out of the test of passivity, and fade beyond the range they were fitted to. The largest strain stops growing once a
/// known amplitude repeats.
enum class Counts { kNothing, kTime, kTravel, kLargestStrain };

/// How a law works among others. Declared where the law is.
struct LawTraits {
  /// The law is another form of a linear Maxwell arm of the nominal model, and takes its place. Its first parameter is
  /// the arm's time constant, its first coefficient the arm's stiffness.
  bool replaces_arm = false;
  /// The law scales the force of all other specimen parts (Process::shape) instead of adding its own.
  bool scales_specimen = false;
  /// Process::shape uses the coefficients: the force is not linear in them, and solving takes several passes.
  bool uses_coefficients = false;
  /// Of an event (a parameter with event_time): the sign of the step it makes in the force.
  double event_force_step = 0.0;
  Counts counts = Counts::kNothing;
  /// Of a law that consists of Maxwell arms beside those of the nominal model: their time constants in s.
  std::vector<double> (*relaxation_times_s)(std::span<const double> parameters) = nullptr;
};

/// One mathematical form of a piece of physics.
struct Law {
  std::string_view name;
  std::string_view formula;
  std::vector<Parameter> parameters;
  std::vector<Coefficient> coefficients;
  std::function<std::unique_ptr<Process>(std::span<const double> parameters, const Reference&)> make;
  LawTraits traits = {};
  /// Set instead of `make` for a law that is a table (empirical models).
  std::function<std::unique_ptr<Process>(const Table&, const Reference&)> make_table = {};
};

/// What an effect asks of a recording's pressure channel before it can be tried.
enum class PressureNeed {
  kNone,
  kMeasured,
  kStill,   ///< measured, and still: where the gauge sees what the motion does to the pressure, nothing of it is hidden
  kVaries,  ///< by a fifth: else what grows with the pressure cannot be told from what is there at any pressure
};

/// The variable over which an effect is drawn, with the motion that draws it (identify/diagnose/explain/shape.hpp).
enum class ShapeOf { kPosition, kLoop, kRate, kTime, kStep, kPressure, kTravel, kLoad, kAcceleration };

/// When identification tries an effect, and what it costs. Declared where the effect is, so that no other file needs
/// to know its name.
struct PhysicsTraits {
  /// Beyond the recording format's list of thirteen: dearer a priori.
  bool unusual = false;
  /// Refines another physics: tried only where that is part of the model, given or found.
  std::string_view refines = {};
  /// Effects that are special cases of this one, where some of its numbers are equal or zero. Its residual is never
  /// larger than theirs, so residuals cannot favour the simpler effect: a priori this one is dearer by what its further
  /// number costs in evidence.
  std::vector<std::string_view> contains = {};
  /// Acts on one of these: tried only where the model has any (empty: always).
  std::vector<std::string_view> needs_any_of = {};
  /// A model that has one may lack another.
  bool repeatable = false;
  PressureNeed pressure = PressureNeed::kNone;
  /// Pulls without motion: can judge a recording of none; bounded by the largest force (diagnose/search/physical_size).
  bool driven_by_pressure = false;
  /// What the event of an event law is called in a figure.
  std::string_view event_name = {};
  /// Where it acts: elastic branch, arm, dashpot, friction element, kinematic input, pressure path, mass, force
  /// channel.
  std::string_view acts_on = {};
  /// What it depends on, most important first: words of the covariates of a diagnosis, and load and acceleration.
  std::vector<std::string_view> depends_on = {};
  ShapeOf shape_of = ShapeOf::kPosition;
  /// What people call it: "dry friction". In reports and on pages.
  std::string_view words = {};
};

/// An entry of the catalogue.
struct Physics {
  std::string_view name;
  Stage stage = Stage::kSpecimen;
  std::string_view what;     ///< one sentence
  std::string_view source;   ///< of the law
  std::string_view reveals;  ///< the experiment that shows it, and what it is mistaken for
  std::vector<Law> laws;
  PhysicsTraits traits = {};
};

/// The law's parameter that is the time of an event; as many as there are parameters when it is no event.
[[nodiscard]] inline std::size_t event_parameter(const Law& law) {
  std::size_t at = 0;
  while (at < law.parameters.size() && !law.parameters[at].traits.event_time) ++at;
  return at;
}
[[nodiscard]] inline bool is_event(const Law& law) {
  return event_parameter(law) < law.parameters.size();
}

/// The law is a shape over the whole of a recording, such as a zero that wanders: another recording has another.
[[nodiscard]] inline bool describes_recording(const Law& law) {
  return std::any_of(law.parameters.begin(), law.parameters.end(), [](const Parameter& parameter) {
    return parameter.traits.filled_by == FilledBy::kRecordingDuration;
  });
}

}  // namespace isorig::model
