#include "identify/fv/fv_analysis.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <stdexcept>
#include <tuple>

#include "base/quantile.hpp"
#include "identify/report/page.hpp"
#include "messages/recording_id.hpp"

namespace isorig::identify {
namespace {

/// The ELVH's total error band is 0.3 psi; the paper's pressures are 5 psi apart.
constexpr double kPressureMismatchPsi = 0.5;

RampTrace trace_of(const messages::Recording& recording, const Ramp& ramp) {
  RampTrace trace;
  trace.velocity_mm_s = ramp.move.velocity_mm_s.value;
  const auto& f = recording.frame;
  const double duration_s = ramp.move.t_end_s - ramp.move.t_start_s;
  const double begin_s = ramp.move.t_start_s - std::max(0.5, 0.2 * duration_s);
  const double end_s = ramp.move.t_end_s + std::max(3.0, 2.0 * duration_s);
  const auto first = static_cast<std::size_t>(std::lower_bound(f.t_s.begin(), f.t_s.end(), begin_s) - f.t_s.begin());
  const auto last = static_cast<std::size_t>(std::upper_bound(f.t_s.begin(), f.t_s.end(), end_s) - f.t_s.begin());
  // Every sample of the ramp, every few of the hold after it.
  const std::size_t every = std::max<std::size_t>(1, (last - first) / 300);
  for (std::size_t i = first; i < last; ++i) {
    const bool inside = f.t_s[i] > ramp.move.t_start_s && f.t_s[i] < ramp.move.t_end_s + 0.1;
    if (!(inside && last - first < 3000) && i % every != 0) continue;
    trace.t_s.push_back(f.t_s[i] - ramp.move.t_start_s);
    trace.force.push_back(f.force_N[i] / ramp.start_force_N->value);
    trace.position_mm.push_back(f.position_mm[i] - ramp.move.from_mm);
  }
  return trace;
}

void fit_whole_series(const messages::Recording& recording, RecordingResult& result,
                      const std::function<void(double)>& done) {
  if (result.ramps.moves.empty()) {
    result.series_refusal = "No fit to the whole record: nothing moves in it.";
  } else if (result.ramps.clipped_samples > 0) {
    result.series_refusal = "No fit to the whole record: its force is saturated in places.";
  } else if (recording.frame.size() < 20) {
    result.series_refusal = "No fit to the whole record: fewer than 20 samples.";
  } else {
    const auto& f = recording.frame;
    try {
      for (int arms : {1, 2}) {
        result.series.push_back(fit_series(f.t_s, f.position_mm, f.force_N, arms));
        done(arms == 1 ? 0.4 : 0.95);
      }
    } catch (const std::domain_error& e) {
      result.series.clear();
      result.series_refusal = std::string("No fit to the whole record: ") + e.what() + ".";
    }
  }
}

History history_of(const messages::Recording& recording) {
  constexpr std::size_t kStretches = 700;
  const auto& f = recording.frame;
  History out{report::enveloped(f.t_s, f.position_mm, "position", 2, kStretches),
              report::enveloped(f.t_s, f.force_N, "force", 0, kStretches),
              {}};
  if (recording.pressure)
    out.pressure_psi =
        report::enveloped(recording.pressure->t_s, recording.pressure->pressure_psi, "pressure", 1, kStretches);
  return out;
}

std::vector<CurvePoint> average(const std::vector<FvPoint>& points) {
  std::vector<FvPoint> sorted = points;
  std::sort(sorted.begin(), sorted.end(),
            [](const FvPoint& a, const FvPoint& b) { return a.strain_rate_per_s < b.strain_rate_per_s; });
  std::vector<CurvePoint> out;
  for (std::size_t i = 0; i < sorted.size();) {
    // One commanded speed: within 10 % of each other, as crossheads keep it. The paper's speeds are 25 %
    // apart.
    std::size_t j = i + 1;
    const double first = sorted[i].strain_rate_per_s;
    while (j < sorted.size() && sorted[j].strain_rate_per_s * first > 0.0 &&
           std::abs(sorted[j].strain_rate_per_s - first) <
               0.1 * std::max(std::abs(first), std::abs(sorted[j].strain_rate_per_s)))
      ++j;
    CurvePoint p;
    const double n = static_cast<double>(j - i);
    p.repetitions = j - i;
    for (std::size_t k = i; k < j; ++k) {
      p.strain_rate_per_s += sorted[k].strain_rate_per_s / n;
      p.normalized_force += sorted[k].normalized_force / n;
      p.standard_error += sorted[k].standard_error * sorted[k].standard_error / (n * n);
    }
    p.standard_error = std::sqrt(p.standard_error);
    for (std::size_t k = i; k < j && j - i > 1; ++k) {
      p.strain_rate_sd += std::pow(sorted[k].strain_rate_per_s - p.strain_rate_per_s, 2) / (n - 1.0);
      p.normalized_force_sd += std::pow(sorted[k].normalized_force - p.normalized_force, 2) / (n - 1.0);
    }
    p.strain_rate_sd = std::sqrt(p.strain_rate_sd);
    p.normalized_force_sd = std::sqrt(p.normalized_force_sd);
    out.push_back(p);
    i = j;
  }
  return out;
}

std::string pressures_text(std::span<const ControlFit> controls) {
  std::string text;
  for (const ControlFit& c : controls)
    text += (text.empty() ? "" : ", ") +
            (c.nominal_pressure_psi ? std::to_string(*c.nominal_pressure_psi).substr(0, 5) + " psi" : "no pressure");
  return text;
}

/// A number that is none is no result, whatever it would be called.
void refuse_unless_finite(FvFitResult& result) {
  if (!result.fit) return;
  // The ends of an interval and a standard error may be unknown; a value may not.
  const auto& fit = *result.fit;
  if (std::isfinite(fit.residual_rms) && std::all_of(fit.parameters.begin(), fit.parameters.end(),
                                                     [](const FittedParameter& p) { return std::isfinite(p.value); })) {
    return;
  }
  result.fit.reset();
  result.refusal = "No fit: it did not come out in finite numbers; look at the points.";
}

void fit_curve(Curve& curve, FvModel model, std::span<const ControlFit> controls) {
  if (model == FvModel::kSlse1) {
    curve.result = fit_control(curve.points);
    refuse_unless_finite(curve.result);
    return;
  }
  for (const ControlFit& c : controls) {
    const bool same =
        c.nominal_pressure_psi.has_value() == curve.nominal_pressure_psi.has_value() &&
        (!c.nominal_pressure_psi || std::abs(*c.nominal_pressure_psi - *curve.nominal_pressure_psi) < 0.5);
    if (same && !curve.control) curve.control = c.element;
  }
  if (curve.control)
    curve.result = fit_sheath(curve.points, *curve.control);
  else
    curve.result.refusal = "No fit: the control has no fit at this pressure (it has " +
                           (controls.empty() ? std::string("none") : pressures_text(controls)) + ").";
  refuse_unless_finite(curve.result);
}

/// A specimen has one length at one pressure: strains of several would be points of several curves.
void compare_lengths(const std::vector<RecordingResult>& recordings, Curve& curve) {
  if (!curve.result.fit) return;
  constexpr double kMountedAnew =
      0.02;  // of the length: what a caliper and a new mounting may leave between repetitions
  const RecordingResult* shortest = nullptr;
  const RecordingResult* longest = nullptr;
  for (const std::size_t i : curve.recordings) {
    const RecordingResult& r = recordings[i];
    if (!std::isfinite(r.reference_length_mm)) continue;
    if (shortest == nullptr || r.reference_length_mm < shortest->reference_length_mm) shortest = &r;
    if (longest == nullptr || r.reference_length_mm > longest->reference_length_mm) longest = &r;
  }
  if (shortest == nullptr || longest->reference_length_mm <= (1.0 + kMountedAnew) * shortest->reference_length_mm)
    return;
  curve.result.fit->statements.push_back(
      "Its recordings contradict each other: the rest length (pressurized, where stated) is " +
      report::number_text(shortest->reference_length_mm, 4) + " mm in " + shortest->path + " and " +
      report::number_text(longest->reference_length_mm, 4) + " mm in " + longest->path +
      ". Correct recording.toml, or give them names of their own.");
}

/// Specimens in the order they were given in, pressures rising: a shell sorts folders as text, 10 before 5.
void sort_recordings(std::vector<RecordingResult>& recordings) {
  std::map<std::string, std::size_t> first;
  for (const RecordingResult& r : recordings) first.emplace(r.specimen, first.size());
  std::stable_sort(recordings.begin(), recordings.end(), [&](const RecordingResult& a, const RecordingResult& b) {
    return std::make_pair(first[a.specimen], a.nominal_pressure_psi) <
           std::make_pair(first[b.specimen], b.nominal_pressure_psi);
  });
}

/// What the pressure says against the recording's own words about it.
void state_pressure(const messages::Recording& recording, RecordingResult& out) {
  if (!out.nominal_pressure_psi) return;
  if (!recording.pressure) {
    out.ramps.statements.push_back(
        "There is no pressure.csv, although the recording names a nominal pressure: whether it was kept is "
        "not known.");
    return;
  }
  std::vector<double> before;
  for (const Ramp& ramp : out.ramps.ramps)
    if (ramp.pressure_before_psi) before.push_back(*ramp.pressure_before_psi);
  if (before.empty()) {
    if (!out.ramps.ramps.empty())
      out.ramps.statements.push_back(
          "pressure.csv has no sample before any ramp, so whether the pressure was kept is not known. Are both "
          "files on one clock? `isorig align` finds the offset.");
    return;
  }
  const double measured_psi = base::quantile(std::move(before), 0.5);
  if (!(std::abs(measured_psi - *out.nominal_pressure_psi) <= kPressureMismatchPsi))
    out.ramps.statements.push_back("The measured pressure before the ramps is " + report::number_text(measured_psi, 3) +
                                   " psi, the nominal one " + report::number_text(*out.nominal_pressure_psi, 3) +
                                   " psi: is this pressure.csv of this recording?");
}

}  // namespace

RecordingResult analyse_recording(const messages::Recording& recording, std::string path, const FvOptions& options) {
  const auto done = [&](double fraction) {
    if (options.on_progress) options.on_progress(fraction);
  };
  RecordingResult out;
  out.path = std::move(path);
  out.specimen = recording.metadata.specimen;
  out.nominal_pressure_psi = recording.metadata.nominal_pressure_psi;
  out.reference_length_mm = recording.metadata.reference_length_mm();
  out.samples = recording.frame.size();
  if (out.samples > 0) out.duration_s = recording.frame.t_s.back() - recording.frame.t_s.front();
  out.ramps = analyse_ramps(recording, options.ramps);
  out.fingerprint = messages::fingerprint(recording);
  out.reading_marks = messages::reading_marks(recording);
  state_pressure(recording, out);
  for (const Ramp& ramp : out.ramps.ramps)
    if (ramp.normalized_force && std::isfinite(ramp.move.velocity_mm_s.value))
      out.traces.push_back(trace_of(recording, ramp));
  done(options.whole_series ? 0.2 : 0.9);
  if (options.whole_series) fit_whole_series(recording, out, done);
  if (options.history) out.history = history_of(recording);
  return out;
}

std::vector<std::string> repeated_recordings(std::span<const RecordingResult> recordings) {
  std::vector<std::string> out;
  std::map<std::uint64_t, std::string> seen;
  for (const RecordingResult& r : recordings) {
    const auto [first, is_new] = seen.emplace(r.fingerprint, r.path);
    std::string as = is_new ? "" : first->second;
    for (const RecordingResult& other : recordings) {
      if (&other == &r || !as.empty()) break;
      if (messages::share_readings(r.reading_marks, other.reading_marks)) as = other.path;
    }
    if (as.empty()) continue;
    out.push_back(r.path + ": the same samples as " + as +
                  "; counted twice they would make the results look more certain than they are, so name one of them");
  }
  return out;
}

FvAnalysis analyse_curves(std::vector<RecordingResult> recordings, FvModel model,
                          std::span<const ControlFit> controls) {
  FvAnalysis out;
  out.model = model;
  out.recordings = std::move(recordings);
  sort_recordings(out.recordings);
  std::map<std::tuple<std::string, bool, double>, std::size_t> index;
  for (std::size_t i = 0; i < out.recordings.size(); ++i) {
    const RecordingResult& r = out.recordings[i];
    const auto key =
        std::make_tuple(r.specimen, r.nominal_pressure_psi.has_value(), r.nominal_pressure_psi.value_or(0.0));
    const auto [at, is_new] = index.emplace(key, out.curves.size());
    if (is_new) {
      Curve curve;
      curve.specimen = r.specimen;
      curve.nominal_pressure_psi = r.nominal_pressure_psi;
      out.curves.push_back(std::move(curve));
    }
    Curve& curve = out.curves[at->second];
    curve.recordings.push_back(i);
    for (const FvPoint& p : points_of(r.ramps.ramps)) curve.points.push_back(p);
  }
  for (Curve& curve : out.curves) {
    const double n = static_cast<double>(curve.points.size());
    for (const FvPoint& p : curve.points) {
      curve.initial_strain += p.initial_strain / n;
      curve.strain_step += p.strain_step / n;
    }
    curve.means = average(curve.points);
    fit_curve(curve, model, controls);
    compare_lengths(out.recordings, curve);
  }
  return out;
}

}  // namespace isorig::identify
