#include "identify/fv/campaign.hpp"

#include <algorithm>
#include <cmath>
#include <functional>
#include <map>
#include <stdexcept>

#include "base/formatted.hpp"

namespace isorig::identify {
namespace {

using base::formatted;
using CurveMap = std::map<std::string, std::map<double, const Curve*>>;  // specimen -> pressure -> curve

CurveMap by_specimen(const Campaign& c) {
  CurveMap out;
  for (const FvAnalysis* a : {&c.controls, &c.sheaths})
    for (const Curve& curve : a->curves)
      if (!curve.points.empty()) out[curve.specimen][curve.nominal_pressure_psi.value_or(0.0)] = &curve;
  return out;
}

/// Counts over all specimens and pressures.
Trend count(std::string claim, const CurveMap& curves, const std::function<bool(const std::string&)>& which,
            const std::function<std::optional<bool>(const std::string&, double, const Curve&)>& holds) {
  Trend t{std::move(claim), {}, 0, 0};
  std::string against;
  for (const auto& [specimen, pressures] : curves) {
    if (!which(specimen)) continue;
    for (const auto& [pressure, curve] : pressures) {
      const auto answer = holds(specimen, pressure, *curve);
      if (!answer) continue;
      ++t.of;
      if (*answer)
        ++t.holds;
      else
        against += (against.empty() ? "; not in " : ", ") + specimen + formatted(" %g psi", pressure);
    }
  }
  t.measured = t.of == 0 ? "no such specimens in these recordings" : formatted("%d of %d", t.holds, t.of) + against;
  return t;
}

bool is(const std::string& specimen, const char* material) {
  return parse_specimen(specimen).material == material;
}

const Curve* control_of(const CurveMap& curves, const std::string& specimen, double pressure) {
  const auto control = curves.find("Control" + parse_specimen(specimen).number);
  if (control == curves.end()) return nullptr;
  const auto at = control->second.find(pressure);
  return at == control->second.end() ? nullptr : at->second;
}

bool any(const std::string&) {
  return true;
}

bool is_control(const std::string& specimen) {
  return is(specimen, "Control");
}

/// Mesh number 2, 10 mm, is the paper's exception.
bool is_urethane_of_6_or_12_mm(const std::string& specimen) {
  return is(specimen, "Urethane") && parse_specimen(specimen).number != "2";
}

/// The same specimen's curve at the `back`-th pressure below this; null when it has none.
const Curve* lower_pressure(const CurveMap& curves, const std::string& specimen, double pressure, int back) {
  const auto& list = curves.at(specimen);
  auto at = list.find(pressure);
  for (int i = 0; i < back; ++i) {
    if (at == list.begin()) return nullptr;
    --at;
  }
  return at->second;
}

/// Whether `less` is less than `more`. Where one of them is no number (a curve without points in that direction)
/// nothing was compared: such a case neither holds nor speaks against the claim.
std::optional<bool> below(double less, double more) {
  if (!std::isfinite(less) || !std::isfinite(more)) return std::nullopt;
  return less < more;
}

/// By how much it lies above the control. Heights in units of the elastic jump strain_step / initial_strain: actuators
/// differ in length, and so do their jumps.
std::optional<double> height_above_control(const CurveMap& curves, const std::string& specimen, double pressure,
                                           const Curve& curve, int direction) {
  const Curve* control = control_of(curves, specimen, pressure);
  if (control == nullptr) return std::nullopt;
  const auto height = [&](const Curve& of) {
    return mean_response(of, direction) / (of.strain_step / of.initial_strain);
  };
  return height(curve) - height(*control);
}

/// By how much the fitted asymptote FV(v -> inf) lies above the control's.
std::optional<double> asymptote_gain(const CurveMap& curves, const std::string& specimen, double pressure,
                                     const Curve& curve) {
  const Curve* control = control_of(curves, specimen, pressure);
  if (control == nullptr || !curve.result.fit || !control->result.fit) return std::nullopt;
  const model::FvTest test{curve.strain_step, curve.initial_strain};
  return model::fv_asymptote(curve.result.fit->elements, test) -
         model::fv_asymptote(control->result.fit->elements, test);
}

void add_trends_with_pressure(const CurveMap& curves, std::vector<Trend>& out) {
  out.push_back(count("More pressure lowers the curve (against the next lower pressure)", curves, any,
                      [&](const std::string& s, double p, const Curve& curve) -> std::optional<bool> {
                        const Curve* lower = lower_pressure(curves, s, p, 1);
                        if (lower == nullptr) return std::nullopt;
                        return below(mean_response(curve, 0), mean_response(*lower, 0));
                      }));
  out.push_back(count("The next pressure step lowers it by less than the step before", curves, any,
                      [&](const std::string& s, double p, const Curve& curve) -> std::optional<bool> {
                        const Curve *lower = lower_pressure(curves, s, p, 1), *lowest = lower_pressure(curves, s, p, 2);
                        if (lowest == nullptr) return std::nullopt;
                        return below(mean_response(*lower, 0) - mean_response(curve, 0),
                                     mean_response(*lowest, 0) - mean_response(*lower, 0));
                      }));
  out.push_back(count("The arm's stiffness over the spring's, kappa, falls with pressure (controls)", curves,
                      is_control, [&](const std::string& s, double p, const Curve& curve) -> std::optional<bool> {
                        const Curve* lower = lower_pressure(curves, s, p, 1);
                        if (lower == nullptr || !lower->result.fit || !curve.result.fit) return std::nullopt;
                        return below(curve.result.fit->parameter("kappa").value,
                                     lower->result.fit->parameter("kappa").value);
                      }));
}

void add_trends_against_control(const CurveMap& curves, std::vector<Trend>& out) {
  out.push_back(count("Urethane, 6 and 12 mm: higher than the control at all pressures", curves,
                      is_urethane_of_6_or_12_mm,
                      [&](const std::string& s, double p, const Curve& curve) -> std::optional<bool> {
                        const auto above = height_above_control(curves, s, p, curve, 0);
                        return above ? below(0.0, *above) : std::nullopt;
                      }));
  out.push_back(count(
      "Ecoflex: lower than the control in extension, all diameters and pressures", curves,
      [](const std::string& s) { return is(s, "Ecoflex"); },
      [&](const std::string& s, double p, const Curve& curve) -> std::optional<bool> {
        const auto above = height_above_control(curves, s, p, curve, 1);
        return above ? below(*above, 0.0) : std::nullopt;
      }));
  out.push_back(count("Urethane, 6 and 12 mm: its gain in asymptote over the control shrinks with pressure", curves,
                      is_urethane_of_6_or_12_mm,
                      [&](const std::string& s, double p, const Curve& curve) -> std::optional<bool> {
                        const Curve* lower = lower_pressure(curves, s, p, 1);
                        if (lower == nullptr) return std::nullopt;
                        const auto here = asymptote_gain(curves, s, p, curve);
                        const auto there = asymptote_gain(curves, s, lower->nominal_pressure_psi.value_or(0.0), *lower);
                        return here && there ? below(*here, *there) : std::nullopt;
                      }));
}

void add_trends_of_fits(const CurveMap& curves, std::vector<Trend>& out) {
  out.push_back(count("Fits under-predict the extension response", curves, any,
                      [](const std::string&, double, const Curve& curve) -> std::optional<bool> {
                        if (!curve.result.fit || std::isnan(mean_response(curve, 1))) return std::nullopt;
                        return below(0.0, curve.result.fit->mean_residual_extension);
                      }));
  out.push_back(count("Fits over-predict the shortening response", curves, any,
                      [](const std::string&, double, const Curve& curve) -> std::optional<bool> {
                        if (!curve.result.fit || std::isnan(mean_response(curve, -1))) return std::nullopt;
                        return below(0.0, curve.result.fit->mean_residual_shortening);
                      }));
  out.push_back(count("2 mm/s is near the asymptote: the fitted curve is there above 80 % of it (controls)", curves,
                      is_control, [](const std::string&, double, const Curve& curve) -> std::optional<bool> {
                        if (!curve.result.fit || curve.means.empty()) return std::nullopt;
                        double slowest = 1e9;
                        for (const auto& p : curve.means) slowest = std::min(slowest, std::abs(p.strain_rate_per_s));
                        return below(0.8,
                                     model::share_of_asymptote(curve.result.fit->elements,
                                                               {curve.strain_step, curve.initial_strain}, slowest));
                      }));
}

std::vector<Trend> trends_of(const Campaign& c) {
  const CurveMap curves = by_specimen(c);
  std::vector<Trend> out;
  out.push_back(count("Larger response in extension than in shortening, for all actuators", curves, any,
                      [](const std::string&, double, const Curve& curve) -> std::optional<bool> {
                        return below(mean_response(curve, -1), mean_response(curve, 1));
                      }));
  add_trends_with_pressure(curves, out);
  add_trends_against_control(curves, out);
  add_trends_of_fits(curves, out);
  return out;
}

}  // namespace

SpecimenName parse_specimen(const std::string& specimen) {
  const auto digit = specimen.find_first_of("0123456789");
  if (digit == std::string::npos) return {specimen, {}};
  return {specimen.substr(0, digit), specimen.substr(digit)};
}

double mean_response(const Curve& curve, int direction) {
  double sum = 0.0, n = 0.0;
  for (const CurvePoint& p : curve.means) {
    if (direction != 0 && p.strain_rate_per_s * direction < 0.0) continue;
    sum += std::abs(p.normalized_force - 1.0);
    n += 1.0;
  }
  return n > 0.0 ? sum / n : std::nan("");
}

Campaign analyse_campaign(std::vector<RecordingResult> recordings) {
  Campaign out;
  std::vector<RecordingResult> controls;
  std::map<std::string, std::vector<RecordingResult>> sheathed;  // by number of the mesh
  for (RecordingResult& r : recordings) {
    const SpecimenName name = parse_specimen(r.specimen);
    if (name.material == "Control")
      controls.push_back(std::move(r));
    else
      sheathed[name.number].push_back(std::move(r));
  }
  if (controls.empty())
    throw std::invalid_argument("a campaign needs at least one control: no specimen is named Control<number>");
  out.controls = analyse_curves(std::move(controls), FvModel::kSlse1);
  out.sheaths.model = FvModel::kSlse2;
  for (auto& [number, list] : sheathed) {
    std::vector<ControlFit> fits;
    for (const Curve& c : out.controls.curves)
      if (parse_specimen(c.specimen).number == number && c.result.fit)
        fits.push_back({c.specimen, c.nominal_pressure_psi, c.result.fit->elements.front()});
    FvAnalysis part = analyse_curves(std::move(list), FvModel::kSlse2, fits);
    const std::size_t shift = out.sheaths.recordings.size();
    for (Curve& curve : part.curves) {
      for (std::size_t& i : curve.recordings) i += shift;
      out.sheaths.curves.push_back(std::move(curve));
    }
    for (RecordingResult& r : part.recordings) out.sheaths.recordings.push_back(std::move(r));
  }
  std::vector<double> r2;
  for (const FvAnalysis* a : {&out.controls, &out.sheaths})
    for (const Curve& c : a->curves)
      if (c.result.fit) r2.push_back(c.result.fit->r_squared);
  out.fits = r2.size();
  for (double v : r2) out.r_squared_mean += v / static_cast<double>(r2.size());
  for (double v : r2)
    out.r_squared_sd +=
        (v - out.r_squared_mean) * (v - out.r_squared_mean) / std::max(1.0, static_cast<double>(r2.size()) - 1.0);
  out.r_squared_sd = std::sqrt(out.r_squared_sd);
  out.trends = trends_of(out);
  return out;
}

}  // namespace isorig::identify
