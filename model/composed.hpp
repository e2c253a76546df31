#pragma once
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "model/process.hpp"

namespace isorig::model {

/// One piece of a model with its numbers.
struct Part {
  const Physics* physics = nullptr;
  const Law* law = nullptr;
  std::vector<double> parameters;    ///< as law->parameters
  std::vector<double> coefficients;  ///< as law->coefficients
  bool fixed = false;                ///< its coefficients are known, not fitted
  Table table = {};                  ///< of an empirical law
};

/// What a model was fitted to. Within these ranges alone its parts beyond the nominal model are supported by data.
struct Seen {
  double lowest_mm = 0.0, highest_mm = 0.0;  ///< position
  double fastest_mm_s = 0.0;
  double travel_mm = 0.0;                      ///< of the longest recording, to and fro
  double lowest_psi = 0.0, highest_psi = 0.0;  ///< gauge; both zero where there was no pressure
  double duration_s = 0.0;                     ///< of the longest recording
  /// Which recordings, by Reference::recording_id: of a model with a part that describes those alone
  /// (describes_recording) or the zero of one. Empty: not said.
  std::vector<double> recordings;
  /// Added in any other recording, where a part that describes those alone is missing: with it the zero there is, on
  /// the mean over the fitted readings, that of the nominal model.
  double zero_elsewhere_N = 0.0;
  double error_N = 0.0;  ///< rms of a reading that was left out of the fit
  /// Of what the model has beyond the nominal one, this share is predicted: what left-out readings bear (publish.hpp).
  double share = 1.0;
  /// Of the numbers that were fitted, in the order of fitted_numbers() (identify/diagnose/fit/intervals.hpp): row by
  /// row of the lower triangle.
  std::vector<double> covariance;
  std::vector<Part> nominal;  ///< the nominal model, which it fades to
};

/// What is predicted where the nominal model gives `nominal_N` and the whole model `model_N`, inside of what was seen.
[[nodiscard]] constexpr double predicted_N(const Seen& seen, double nominal_N, double model_N) noexcept {
  return nominal_N + seen.share * (model_N - nominal_N);
}

/// A whole model: which parts, with which numbers. Order of the parts within a stage is kept; the stages
/// order themselves.
struct ModelSpec {
  std::string name;
  std::vector<Part> parts;
  std::optional<Seen> seen = {};  ///< of a model that was fitted
  double length_scale = 1.0;      ///< of its laws' ranges (length_scale.hpp)
  /// What its parts count a pressure from (Reference::nominal_pressure_psi). Not said: each recording's own nominal
  /// one.
  std::optional<double> pressure_from_psi = {};

  [[nodiscard]] std::size_t coefficient_count() const noexcept;
  [[nodiscard]] std::vector<double> coefficients() const;
  void set_coefficients(std::span<const double> values) noexcept;
  [[nodiscard]] bool has(std::string_view physics) const noexcept;
  /// Some part reads the pressure.
  [[nodiscard]] bool reads_pressure() const noexcept;
  /// Some part pulls when the pressure changes and nothing moves.
  [[nodiscard]] bool driven_by_pressure() const noexcept;
};

/// Where a part acts: its physics' stage, unless its law scales the specimen.
[[nodiscard]] Stage stage_of(const Part& part) noexcept;

/// Nominal models by name: "slse1", "slse2" (one or two standard linear solids in parallel, whose springs k1
/// add up to one); all with a free tare. Numbers are starting values.
[[nodiscard]] ModelSpec nominal_model(std::string_view name);

/// The model says which recordings it was fitted to, and this is none of them.
[[nodiscard]] bool is_of_others(const ModelSpec& spec, const Reference& reference);

/// Of the force's zeros of single recordings (force_zero), the variance with which their mean predicts the zero of a
/// further one, N^2: (1 + 1/n) s^2, with s^2 = sum (z - mean)^2 / (n - 1) over the n recordings of the fit. 0 where
/// fewer than two are known, or none has a zero of its own.
[[nodiscard]] double variance_of_further_zero_N2(const ModelSpec& spec);

/// The nominal model that `spec`, which was fitted, fades to: of the same recordings.
[[nodiscard]] ModelSpec fades_to(const ModelSpec& spec);

/// Gives every arm_start the time constant of its arm. Where that arm is gone (a law took its place) the
/// number stays.
void follow_arms(ModelSpec& spec) noexcept;

/// Part with the law's starting values.
[[nodiscard]] Part make_part(const Physics& physics, const Law& law);

/// Sets what belongs to a recording and not to a specimen (FilledBy).
void fill_from_recording(Part& part, const Reference& reference);

/// Reads a model from TOML ("isorig-model/1"). Throws base::ConfigError with every fault in it. Keys that are
/// absent keep their starting values, so that a nominal model need not state what is to be fitted.
[[nodiscard]] ModelSpec read_model(const std::filesystem::path& file);
[[nodiscard]] ModelSpec parse_model(std::string_view text, std::string name);
/// `comment` stands at the top, one line per line.
[[nodiscard]] std::string model_text(const ModelSpec& spec, std::string_view comment = {});

/// A model that runs. One instant at a time; real-time safe after construction.
///
/// What counts time (a drift) is held at the value that it has where the longest recording that the model was fitted to
/// ended (Seen::duration_s): whether a drift goes on, settles or turns, no recording has shown. Held it errs by the
/// further drift alone, which the nominal model lacks whole. What describes recordings and no others (a zero that
/// wanders) gives any other (Seen::recordings) no more than a constant, Seen::zero_elsewhere_N; of the zeros that each
/// has by itself another gets the mean.
class RunningModel {
 public:
  RunningModel(const ModelSpec& given, const Reference& reference);

  void reset(const Instant& first) noexcept;
  /// The force at `now`, N. `now.dt_s` is 0 at the first instant.
  double step(Instant now) noexcept;
  /// The same before the coefficients are applied, without Seen::zero_elsewhere_N: one value per coefficient, in the
  /// order of the spec. Laws that are not linear (slack) use the coefficients set last.
  void step_columns(Instant now, std::span<double> columns) noexcept;
  void set_coefficients(std::span<const double> values) noexcept;

  [[nodiscard]] std::size_t columns() const noexcept { return coefficients_.size(); }
  /// The force is not linear in the coefficients (LawTraits::uses_coefficients).
  [[nodiscard]] bool depends_on_coefficients() const noexcept { return piecewise_; }

 private:
  void run(Instant now) noexcept;
  struct Running {
    std::unique_ptr<Process> process;
    Stage stage;
    std::size_t first_column;  // in stage order
    double known_s;            // since the first instant; of a law that counts time, what the model has seen
    double until_s;            // by the instants' time
    bool acts;                 // in this recording
  };
  std::vector<Running> running_;
  std::vector<std::size_t> order_;    // stage order -> order of the spec
  std::vector<double> coefficients_;  // in stage order
  std::vector<double> work_;
  double zero_N_ = 0.0;  // in this recording, of a part that does not act in it
  bool piecewise_ = false;
};

}  // namespace isorig::model
