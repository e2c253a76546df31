#pragma once
#include <filesystem>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "identify/fv/fv_fit.hpp"
#include "identify/fv/ramps.hpp"
#include "identify/fv/series_fit.hpp"
#include "identify/report/figure.hpp"
#include "messages/recording.hpp"

namespace isorig::identify {

/// The paper's analysis of any number of recordings: `isorig fv`. Recordings of one specimen at one nominal
/// pressure are repetitions and share a curve.

/// What a figure of overlaid ramps needs, thinned: time from the start of the ramp, force over F0.
struct RampTrace {
  double velocity_mm_s = 0.0;
  std::vector<double> t_s;
  std::vector<double> force;        ///< over F0
  std::vector<double> position_mm;  ///< from the start of the ramp
};

/// The whole recording over its time, as bands: for figures.
struct History {
  std::vector<report::Series> position_mm, force_N, pressure_psi;
};

struct RecordingResult {
  std::string path;
  std::string specimen;
  std::optional<double> nominal_pressure_psi;
  double reference_length_mm = 0.0;  ///< NaN: not stated
  std::size_t samples = 0;
  double duration_s = 0.0;
  std::uint64_t fingerprint = 0;             ///< of the frame's samples: equal for copies of one recording
  std::vector<std::uint64_t> reading_marks;  ///< shared by recordings that hold the same readings
  RampAnalysis ramps;
  std::vector<RampTrace> traces;
  History history;
  /// Fits to the whole record with one and with two arms; empty where `series_refusal` says why.
  std::vector<SeriesFit> series;
  std::string series_refusal;
};

struct FvOptions {
  RampOptions ramps{};
  /// Told which part of a recording's analysis is done, by the time that its stages take of a long one.
  std::function<void(double fraction)> on_progress{};
  bool whole_series = true;
  bool history = true;  ///< of use where there are few recordings
};

[[nodiscard]] RecordingResult analyse_recording(const messages::Recording& recording, std::string path,
                                                const FvOptions& options = {});

/// One line for each recording that is another one over again, under its own path or a second one.
[[nodiscard]] std::vector<std::string> repeated_recordings(std::span<const RecordingResult> recordings);

/// Mean and standard deviation over repetitions of one commanded speed and direction.
struct CurvePoint {
  std::size_t repetitions = 0;
  double strain_rate_per_s = 0.0;  ///< mean
  double strain_rate_sd = 0.0;
  double normalized_force = 0.0;     ///< mean
  double normalized_force_sd = 0.0;  ///< 0 with one repetition: then `standard_error` is the point's own
  double standard_error = 0.0;
};

struct Curve {
  std::string specimen;
  std::optional<double> nominal_pressure_psi;
  std::vector<std::size_t> recordings;  ///< indices into FvAnalysis::recordings
  std::vector<FvPoint> points;
  std::vector<CurvePoint> means;  ///< increasing rate
  std::optional<model::FvElement> control;
  FvFitResult result;
  double initial_strain = 0.0;  ///< mean over the points
  double strain_step = 0.0;
};

enum class FvModel { kSlse1, kSlse2 };

/// Control parameters by pressure, from an earlier fv.json.
struct ControlFit {
  std::string specimen;
  std::optional<double> nominal_pressure_psi;
  model::FvElement element;
};

/// Reads the 1-SLSE fits of an fv.json. Throws std::runtime_error (file and reason) when it is none, or holds
/// no usable control.
[[nodiscard]] std::vector<ControlFit> read_controls(const std::filesystem::path& fv_json,
                                                    const std::string& specimen = {});

/// The specimens that an fv.json has a 1-SLSE fit of, each once. Throws as read_controls() does.
[[nodiscard]] std::vector<std::string> control_specimens(const std::filesystem::path& fv_json);

struct FvAnalysis {
  FvModel model = FvModel::kSlse1;
  std::vector<RecordingResult> recordings;
  std::vector<Curve> curves;
};

/// Groups, averages, fits. With kSlse2 each curve takes the control of its own pressure (within 0.5 psi).
[[nodiscard]] FvAnalysis analyse_curves(std::vector<RecordingResult> recordings, FvModel model,
                                        std::span<const ControlFit> controls = {});

/// fv.json, ramps.csv, moves.csv, curves.csv, parameters.csv. Formats: docs/force-velocity.md.
[[nodiscard]] std::string fv_json(const FvAnalysis& analysis);
void write_fv_tables(const FvAnalysis& analysis, const std::filesystem::path& folder);

}  // namespace isorig::identify
