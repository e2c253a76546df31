#include "identify/fv_analysis.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <tuple>

namespace isorig::identify {
namespace {

RampTrace trace_of(const messages::Recording& recording, const Ramp& ramp) {
  RampTrace trace;
  trace.velocity_mm_s = ramp.move.velocity_mm_s.value;
  const auto& f = recording.frame;
  const double duration_s = ramp.move.t_end_s - ramp.move.t_start_s;
  const double begin_s = ramp.move.t_start_s - std::max(0.5, 0.2 * duration_s);
  const double end_s = ramp.move.t_end_s + std::max(3.0, 2.0 * duration_s);
  const auto first =
      static_cast<std::size_t>(std::lower_bound(f.t_s.begin(), f.t_s.end(), begin_s) - f.t_s.begin());
  const auto last =
      static_cast<std::size_t>(std::upper_bound(f.t_s.begin(), f.t_s.end(), end_s) - f.t_s.begin());
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

void fit_whole_series(const messages::Recording& recording, RecordingResult& result) {
  if (result.ramps.moves.empty()) {
    result.series_refusal = "No fit to the whole record: nothing moves in it.";
  } else if (result.ramps.clipped_samples > 0) {
    result.series_refusal = "No fit to the whole record: its force is saturated in places.";
  } else if (recording.frame.size() < 20) {
    result.series_refusal = "No fit to the whole record: fewer than 20 samples.";
  } else {
    const auto& f = recording.frame;
    for (int arms : {1, 2}) result.series.push_back(fit_series(f.t_s, f.position_mm, f.force_N, arms));
  }
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
    text += (text.empty() ? "" : ", ") + (c.nominal_pressure_psi
                                              ? std::to_string(*c.nominal_pressure_psi).substr(0, 5) + " psi"
                                              : "no pressure");
  return text;
}

void fit_curve(Curve& curve, FvModel model, std::span<const ControlFit> controls) {
  if (model == FvModel::kSlse1) {
    curve.result = fit_control(curve.points);
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
}

}  // namespace

RecordingResult analyse_recording(const messages::Recording& recording, std::string path,
                                  const FvOptions& options) {
  RecordingResult out;
  out.path = std::move(path);
  out.specimen = recording.metadata.specimen;
  out.nominal_pressure_psi = recording.metadata.nominal_pressure_psi;
  out.samples = recording.frame.size();
  if (out.samples > 0) out.duration_s = recording.frame.t_s.back() - recording.frame.t_s.front();
  out.ramps = analyse_ramps(recording, options.ramps);
  if (!recording.pressure && out.nominal_pressure_psi)
    out.ramps.statements.push_back(
        "There is no pressure.csv, although the recording names a nominal pressure: whether it was kept is "
        "not known.");
  for (const Ramp& ramp : out.ramps.ramps)
    if (ramp.normalized_force && std::isfinite(ramp.move.velocity_mm_s.value))
      out.traces.push_back(trace_of(recording, ramp));
  if (options.whole_series) fit_whole_series(recording, out);
  return out;
}

FvAnalysis analyse_curves(std::vector<RecordingResult> recordings, FvModel model,
                          std::span<const ControlFit> controls) {
  FvAnalysis out;
  out.model = model;
  out.recordings = std::move(recordings);
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
  // Specimens in the order they were given in, pressures rising.
  std::map<std::string, std::size_t> first;
  for (const Curve& curve : out.curves) first.emplace(curve.specimen, first.size());
  std::stable_sort(out.curves.begin(), out.curves.end(), [&](const Curve& a, const Curve& b) {
    return std::make_pair(first[a.specimen], a.nominal_pressure_psi) <
           std::make_pair(first[b.specimen], b.nominal_pressure_psi);
  });
  for (Curve& curve : out.curves) {
    const double n = static_cast<double>(curve.points.size());
    for (const FvPoint& p : curve.points) {
      curve.initial_strain += p.initial_strain / n;
      curve.strain_step += p.strain_step / n;
    }
    curve.means = average(curve.points);
    fit_curve(curve, model, controls);
  }
  return out;
}

}  // namespace isorig::identify
