#include <algorithm>
#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>
#include <stdexcept>

#include "base/formatted.hpp"
#include "base/json_words.hpp"
#include "base/text_file.hpp"
#include "base/whole_file.hpp"
#include "identify/fv/fv_analysis.hpp"
#include "identify/report/page.hpp"

namespace isorig::identify {
namespace {

using Json = nlohmann::ordered_json;
constexpr const char* kFormat = "isorig-fv/1";

Json number(double value) {
  return std::isfinite(value) ? Json(value) : Json(nullptr);
}
Json number(const std::optional<double>& value) {
  return value ? number(*value) : Json(nullptr);
}
Json number(const Estimate& e) {
  return {{"value", number(e.value)}, {"se", number(e.standard_error)}};
}
Json number(const std::optional<Estimate>& e) {
  return e ? number(*e) : Json(nullptr);
}

Json json_of(const Ramp& r) {
  Json flags = Json::array();
  for (RampFlag f : r.flags) flags.push_back(name(f));
  return {{"t_start_s", number(r.move.t_start_s)},
          {"t_end_s", number(r.move.t_end_s)},
          {"from_mm", number(r.move.from_mm)},
          {"to_mm", number(r.move.to_mm)},
          {"velocity_mm_s", number(r.move.velocity_mm_s)},
          {"strain_rate_per_s", number(r.strain_rate_per_s)},
          {"initial_strain", number(r.initial_strain)},
          {"strain_step", number(r.strain_step)},
          {"start_force_N", number(r.start_force_N)},
          {"drift_N_s", number(r.drift_N_s)},
          {"t_peak_s", number(r.t_peak_s)},
          {"peak_force_N", number(r.peak_force_N)},
          {"normalized_force", number(r.normalized_force)},
          {"normalized_force_if_zero_drifts", number(r.normalized_force_if_zero_drifts)},
          {"overshoot_mm", number(r.overshoot_mm)},
          {"plateau_share", number(r.plateau_share)},
          {"pressure_before_psi", number(r.pressure_before_psi)},
          {"pressure_change_psi", number(r.pressure_change_psi)},
          {"flags", flags},
          {"usable", r.usable()}};
}

Json json_of(const SeriesFit& s) {
  Json arms = Json::array();
  for (const SeriesArm& a : s.arms)
    arms.push_back({{"stiffness_N_mm", number(a.stiffness_N_mm)},
                    {"gamma_per_s", number(a.gamma_per_s)},
                    {"kappa", number(a.kappa)}});
  return {{"samples", s.samples},
          {"offset_N", number(s.offset_N)},
          {"stiffness_N_mm", number(s.stiffness_N_mm)},
          {"arms", arms},
          {"rms_N", number(s.rms_N)},
          {"r_squared", number(s.r_squared)},
          {"residual_correlation", number(s.residual_correlation)},
          {"bic", number(s.bic)},
          {"converged", s.stop == SeriesStop::kConverged || s.stop == SeriesStop::kAtBounds},
          {"stop", name_of(s.stop)},
          {"statements", s.statements}};
}

Json json_of(const RecordingResult& r) {
  Json ramps = Json::array(), series = Json::array();
  for (const Ramp& ramp : r.ramps.ramps) ramps.push_back(json_of(ramp));
  for (const SeriesFit& s : r.series) series.push_back(json_of(s));
  return {{"path", r.path},
          {"specimen", r.specimen},
          {"nominal_pressure_psi", number(r.nominal_pressure_psi)},
          {"samples", r.samples},
          {"duration_s", number(r.duration_s)},
          {"position_noise_mm", number(r.ramps.position_noise_mm.sigma)},
          {"force_noise_N", number(r.ramps.force_noise_N.sigma)},
          {"clipped_samples", r.ramps.clipped_samples},
          {"moves", r.ramps.moves.size()},
          {"ramps", ramps},
          {"whole_series", series},
          {"whole_series_refusal", r.series_refusal.empty() ? Json(nullptr) : Json(r.series_refusal)},
          {"statements", r.ramps.statements}};
}

Json json_of(const FvFit& fit) {
  Json parameters = Json::object();
  for (const FittedParameter& p : fit.parameters)
    parameters[p.name] = {{"value", number(p.value)},
                          {"ci95", {number(p.low), number(p.high)}},
                          {"identifiable", p.identifiable},
                          {"statement", p.statement.empty() ? Json(nullptr) : Json(p.statement)}};
  return {{"parameters", parameters},
          {"points", fit.points},
          {"r_squared", number(fit.r_squared)},
          {"residual_rms", number(fit.residual_rms)},
          {"noise", number(fit.noise)},
          {"mean_residual_extension", number(fit.mean_residual_extension)},
          {"mean_residual_shortening", number(fit.mean_residual_shortening)}};
}

Json json_of(const Curve& c) {
  Json means = Json::array();
  for (const CurvePoint& p : c.means)
    means.push_back({{"strain_rate_per_s", number(p.strain_rate_per_s)},
                     {"normalized_force", number(p.normalized_force)},
                     {"sd", p.repetitions > 1 ? number(p.normalized_force_sd) : Json(nullptr)},
                     {"se", number(p.standard_error)},
                     {"repetitions", p.repetitions}});
  Json out = {{"specimen", c.specimen},
              {"nominal_pressure_psi", number(c.nominal_pressure_psi)},
              {"recordings", c.recordings},
              {"initial_strain", number(c.initial_strain)},
              {"strain_step", number(c.strain_step)},
              {"means", means}};
  if (c.control) out["control"] = {{"kappa", c.control->kappa}, {"gamma_per_s", c.control->gamma_per_s}};
  out["fit"] = c.result.fit ? json_of(*c.result.fit) : Json(nullptr);
  out["refusal"] = c.result.fit ? Json(nullptr) : Json(c.result.refusal);
  return out;
}

/// A CSV cell that a spreadsheet reads back as it was.
std::string cell(std::string_view text) {
  if (text.find_first_of(",\"\n") == std::string_view::npos) return std::string(text);
  std::string out = "\"";
  for (char c : text) {
    if (c == '"') out += '"';
    out += c;
  }
  return out + "\"";
}
std::string cell(double value) {
  return std::isfinite(value) ? report::number_text(value, 9) : std::string();
}
std::string cell(const std::optional<double>& value) {
  return value ? cell(*value) : std::string();
}
std::string cells(const std::optional<Estimate>& e) {
  return e ? cell(e->value) + "," + cell(e->standard_error) : std::string(",");
}

}  // namespace

std::string fv_json(const FvAnalysis& analysis) {
  Json recordings = Json::array(), curves = Json::array();
  for (const auto& r : analysis.recordings) recordings.push_back(json_of(r));
  for (const auto& c : analysis.curves) curves.push_back(json_of(c));
  const Json out = {{"format", kFormat},
                    {"model", analysis.model == FvModel::kSlse1 ? "slse1" : "slse2"},
                    {"curves", curves},
                    {"recordings", recordings}};
  return out.dump(1) + "\n";
}

void write_fv_tables(const FvAnalysis& analysis, const std::filesystem::path& folder) {
  std::filesystem::create_directories(folder);
  base::write_whole_file(folder / "fv.json", fv_json(analysis));

  std::ostringstream ramps, moves;
  ramps << "recording,specimen,nominal_pressure_psi,t_start_s,t_end_s,from_mm,to_mm,velocity_mm_s,velocity_se,"
           "strain_rate_per_s,strain_rate_se,initial_strain,strain_step,start_force_N,start_force_se,drift_N_s,"
           "drift_se,t_peak_s,peak_force_N,peak_force_se,normalized_force,normalized_force_se,overshoot_mm,"
           "pressure_before_psi,pressure_change_psi,usable,flags\n";
  moves << "recording,kind,t_start_s,t_end_s,from_mm,to_mm,velocity_mm_s,velocity_se\n";
  for (const auto& r : analysis.recordings) {
    for (const Ramp& p : r.ramps.ramps) {
      std::string flags;
      for (RampFlag f : p.flags) flags += (flags.empty() ? "" : " ") + std::string(name(f));
      ramps << cell(r.path) << ',' << cell(r.specimen) << ',' << cell(r.nominal_pressure_psi) << ','
            << cell(p.move.t_start_s) << ',' << cell(p.move.t_end_s) << ',' << cell(p.move.from_mm) << ','
            << cell(p.move.to_mm) << ',' << cells(p.move.velocity_mm_s) << ',' << cells(p.strain_rate_per_s) << ','
            << cell(p.initial_strain) << ',' << cell(p.strain_step) << ',' << cells(p.start_force_N) << ','
            << cells(p.drift_N_s) << ',' << cell(p.t_peak_s) << ',' << cells(p.peak_force_N) << ','
            << cells(p.normalized_force) << ',' << cell(p.overshoot_mm) << ',' << cell(p.pressure_before_psi) << ','
            << cell(p.pressure_change_psi) << ',' << (p.usable() ? "yes" : "no") << ',' << flags << '\n';
    }
    for (const Move& m : r.ramps.moves)
      moves << cell(r.path) << ',' << name(m.kind) << ',' << cell(m.t_start_s) << ',' << cell(m.t_end_s) << ','
            << cell(m.from_mm) << ',' << cell(m.to_mm) << ',' << cells(m.velocity_mm_s) << '\n';
  }
  base::write_whole_file(folder / "ramps.csv", ramps.str());
  base::write_whole_file(folder / "moves.csv", moves.str());

  std::ostringstream curves, parameters;
  curves << "specimen,nominal_pressure_psi,strain_rate_per_s,strain_rate_sd,normalized_force,normalized_"
            "force_sd,"
            "standard_error,repetitions,model\n";
  parameters << "specimen,nominal_pressure_psi,parameter,value,ci95_low,ci95_high,identifiable,r_squared,points,"
                "statement\n";
  for (const Curve& c : analysis.curves) {
    for (const CurvePoint& p : c.means) {
      curves << cell(c.specimen) << ',' << cell(c.nominal_pressure_psi) << ',' << cell(p.strain_rate_per_s) << ','
             << (p.repetitions > 1 ? cell(p.strain_rate_sd) : "") << ',' << cell(p.normalized_force) << ','
             << (p.repetitions > 1 ? cell(p.normalized_force_sd) : "") << ',' << cell(p.standard_error) << ','
             << p.repetitions << ',';
      if (c.result.fit)
        curves << cell(
            model::force_velocity(c.result.fit->elements, {c.strain_step, c.initial_strain}, p.strain_rate_per_s));
      curves << '\n';
    }
    if (!c.result.fit) continue;
    for (const FittedParameter& p : c.result.fit->parameters)
      parameters << cell(c.specimen) << ',' << cell(c.nominal_pressure_psi) << ',' << p.name << ',' << cell(p.value)
                 << ',' << cell(p.low) << ',' << cell(p.high) << ',' << (p.identifiable ? "yes" : "no") << ','
                 << cell(c.result.fit->r_squared) << ',' << c.result.fit->points << ',' << cell(p.statement) << '\n';
  }
  base::write_whole_file(folder / "curves.csv", curves.str());
  base::write_whole_file(folder / "parameters.csv", parameters.str());
}

namespace {

/// Every fitted curve of a 1-SLSE analysis. Throws without the file's name.
std::vector<ControlFit> fits_in(std::istream& in) {
  std::vector<ControlFit> out;
  const auto json = nlohmann::json::parse(in);
  if (json.at("format") != kFormat) throw std::runtime_error("its format is not " + std::string(kFormat));
  if (json.at("model") != "slse1")
    throw std::runtime_error("it is not a 1-SLSE analysis; the control is analysed with --model slse1");
  for (const auto& curve : json.at("curves")) {
    if (curve.at("fit").is_null()) continue;
    const auto& p = curve.at("fit").at("parameters");
    ControlFit c;
    c.specimen = curve.at("specimen");
    if (!curve.at("nominal_pressure_psi").is_null())
      c.nominal_pressure_psi = curve.at("nominal_pressure_psi").get<double>();
    c.element = {p.at("kappa").at("value"), p.at("gamma_per_s").at("value"), 1.0};
    out.push_back(c);
  }
  return out;
}

std::vector<ControlFit> all_controls(const std::filesystem::path& fv_json_file) {
  if (const auto why = base::why_not_a_file(fv_json_file); !why.empty())
    throw std::runtime_error(fv_json_file.string() + " " + why);
  std::ifstream in(fv_json_file);
  if (!in) throw std::runtime_error(fv_json_file.string() + ": cannot be opened");
  try {
    return fits_in(in);
  } catch (const std::exception& e) {
    throw std::runtime_error(fv_json_file.string() + ": " + base::json_words(e));
  }
}

}  // namespace

std::vector<ControlFit> read_controls(const std::filesystem::path& fv_json_file, const std::string& specimen) {
  std::vector<ControlFit> out = all_controls(fv_json_file);
  if (!specimen.empty()) std::erase_if(out, [&](const ControlFit& c) { return c.specimen != specimen; });
  if (out.empty())
    throw std::runtime_error(fv_json_file.string() + ": no fitted control" +
                             (specimen.empty() ? std::string() : " '" + specimen + "'") + " in it");
  for (const ControlFit& c : out)
    if (c.specimen != out.front().specimen)
      throw std::runtime_error(
          fv_json_file.string() +
          base::formatted(": it holds several specimens ('%s', '%s', ...); say which with --control-specimen",
                          out.front().specimen.c_str(), c.specimen.c_str()));
  return out;
}

std::vector<std::string> control_specimens(const std::filesystem::path& fv_json_file) {
  std::vector<std::string> out;
  for (const ControlFit& c : all_controls(fv_json_file))
    if (std::ranges::find(out, c.specimen) == out.end()) out.push_back(c.specimen);
  if (out.empty()) throw std::runtime_error(fv_json_file.string() + ": no fitted control in it");
  return out;
}

}  // namespace isorig::identify
