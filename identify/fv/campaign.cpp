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

std::vector<Trend> trends_of(const Campaign& c) {
  const CurveMap curves = by_specimen(c);
  const auto all = [](const std::string&) { return true; };
  std::vector<Trend> out;
  out.push_back(count("Larger response in extension than in shortening, for all actuators", curves, all,
                      [](const std::string&, double, const Curve& curve) -> std::optional<bool> {
                        return mean_response(curve, 1) > mean_response(curve, -1);
                      }));
  // Neighbouring pressures.
  auto previous = [&](const std::string& specimen, double pressure, int back) -> const Curve* {
    const auto& list = curves.at(specimen);
    auto at = list.find(pressure);
    for (int i = 0; i < back; ++i) {
      if (at == list.begin()) return nullptr;
      --at;
    }
    return at->second;
  };
  out.push_back(count("More pressure lowers the curve (against the next lower pressure)", curves, all,
                      [&](const std::string& s, double p, const Curve& curve) -> std::optional<bool> {
                        const Curve* lower = previous(s, p, 1);
                        if (lower == nullptr) return std::nullopt;
                        return mean_response(curve, 0) < mean_response(*lower, 0);
                      }));
  out.push_back(count("The next pressure step lowers it by less than the step before", curves, all,
                      [&](const std::string& s, double p, const Curve& curve) -> std::optional<bool> {
                        const Curve *lower = previous(s, p, 1), *lowest = previous(s, p, 2);
                        if (lowest == nullptr) return std::nullopt;
                        return mean_response(*lower, 0) - mean_response(curve, 0) <
                               mean_response(*lowest, 0) - mean_response(*lower, 0);
                      }));
  out.push_back(count(
      "kappa_c falls with pressure (controls)", curves, [](const std::string& s) { return is(s, "Control"); },
      [&](const std::string& s, double p, const Curve& curve) -> std::optional<bool> {
        const Curve* lower = previous(s, p, 1);
        if (lower == nullptr || !lower->result.fit || !curve.result.fit) return std::nullopt;
        return curve.result.fit->parameter("kappa").value < lower->result.fit->parameter("kappa").value;
      }));
  auto above_control = [&](const std::string& s, double p, const Curve& curve, int direction) -> std::optional<bool> {
    const Curve* control = control_of(curves, s, p);
    if (control == nullptr) return std::nullopt;
    // Heights in units of the elastic jump: actuators differ in length, so their jumps do.
    auto height = [&](const Curve& of) { return mean_response(of, direction) / (of.strain_step / of.initial_strain); };
    return height(curve) > height(*control);
  };
  out.push_back(count(
      "Urethane, 6 and 12 mm: higher than the control at all pressures", curves,
      [](const std::string& s) { return is(s, "Urethane") && parse_specimen(s).number != "2"; },
      [&](const std::string& s, double p, const Curve& c2) { return above_control(s, p, c2, 0); }));
  out.push_back(count(
      "Ecoflex: lower than the control in extension, all diameters and pressures", curves,
      [](const std::string& s) { return is(s, "Ecoflex"); },
      [&](const std::string& s, double p, const Curve& c2) -> std::optional<bool> {
        const auto above = above_control(s, p, c2, 1);
        if (!above) return std::nullopt;
        return !*above;
      }));
  auto asymptote_gain = [&](const std::string& s, double p, const Curve& curve) -> std::optional<double> {
    const Curve* control = control_of(curves, s, p);
    if (control == nullptr || !curve.result.fit || !control->result.fit) return std::nullopt;
    const model::FvTest test{curve.strain_step, curve.initial_strain};
    return model::fv_asymptote(curve.result.fit->elements, test) -
           model::fv_asymptote(control->result.fit->elements, test);
  };
  out.push_back(count(
      "Urethane, 6 and 12 mm: its gain in asymptote over the control shrinks with pressure", curves,
      [](const std::string& s) { return is(s, "Urethane") && parse_specimen(s).number != "2"; },
      [&](const std::string& s, double p, const Curve& curve) -> std::optional<bool> {
        const Curve* lower = previous(s, p, 1);
        if (lower == nullptr) return std::nullopt;
        const auto here = asymptote_gain(s, p, curve);
        const auto below = asymptote_gain(s, lower->nominal_pressure_psi.value_or(0.0), *lower);
        if (!here || !below) return std::nullopt;
        return *here < *below;
      }));
  out.push_back(count("Fits under-predict the extension response", curves, all,
                      [](const std::string&, double, const Curve& curve) -> std::optional<bool> {
                        if (!curve.result.fit) return std::nullopt;
                        return curve.result.fit->mean_residual_extension > 0.0;
                      }));
  out.push_back(count("Fits over-predict the shortening response", curves, all,
                      [](const std::string&, double, const Curve& curve) -> std::optional<bool> {
                        if (!curve.result.fit) return std::nullopt;
                        return curve.result.fit->mean_residual_shortening > 0.0;
                      }));
  out.push_back(count(
      "2 mm/s is near the asymptote: the fitted curve is there above 80 % of it (controls)", curves,
      [](const std::string& s) { return is(s, "Control"); },
      [](const std::string&, double, const Curve& curve) -> std::optional<bool> {
        if (!curve.result.fit || curve.means.empty()) return std::nullopt;
        double slowest = 1e9;
        for (const auto& p : curve.means) slowest = std::min(slowest, std::abs(p.strain_rate_per_s));
        return model::share_of_asymptote(curve.result.fit->elements, {curve.strain_step, curve.initial_strain},
                                         slowest) > 0.8;
      }));
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
