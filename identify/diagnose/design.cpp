#include "identify/diagnose/design.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <numbers>

namespace isorig::identify {
namespace {

struct Motif {
  bool sine = false;
  double amplitude_mm = 1.0;
  double peak_mm_s = 1.0;
  int cycles = 4;
  [[nodiscard]] double period_s() const noexcept {
    return (sine ? 2.0 * std::numbers::pi : 4.0) * amplitude_mm / peak_mm_s;
  }
};

constexpr double kRest_s = 20.0;

/// The motion as the rig would run it, corners rounded over 40 ms.
Series simulate(const Motif& motif, const model::Reference& reference) {
  Series series;
  series.drive.reference = reference;
  const double busy_s = motif.period_s() * motif.cycles,
               step_s = std::clamp(motif.period_s() / 400.0, 0.005, 0.5);
  const auto at = [&](double t_s) {
    const double phase = std::clamp(t_s, 0.0, busy_s) / motif.period_s();
    if (motif.sine) return motif.amplitude_mm * std::sin(2.0 * std::numbers::pi * phase);
    const double u = phase - std::floor(phase);
    return motif.amplitude_mm * (u < 0.25 ? 4.0 * u : u < 0.75 ? 2.0 - 4.0 * u : 4.0 * u - 4.0);
  };
  const auto rounded = [&](double t_s) {
    double sum = 0.0;
    for (int i = -2; i <= 2; ++i) sum += at(t_s + 0.01 * i);
    return sum / 5.0;
  };
  for (double t = -1.0; t < busy_s + kRest_s; t += t < busy_s + 1.0 ? step_s : 0.2) {
    model::Instant now;
    now.t_s = t;
    now.position_mm = rounded(t);
    now.elongation_mm = now.position_mm + reference.elongation_at_zero_mm;
    now.velocity_mm_s = (rounded(t + 1e-3) - rounded(t - 1e-3)) / 2e-3;
    now.acceleration_mm_s2 = (rounded(t + 5e-3) - 2.0 * now.position_mm + rounded(t - 5e-3)) / 25e-6;
    if (!series.nodes.empty()) {
      now.dt_s = t - series.nodes.back().t_s;
      now.step_mm = now.position_mm - series.nodes.back().position_mm;
    }
    now.slide_mm = now.step_mm;
    series.nodes.push_back(now);
  }
  series.count.assign(series.nodes.size(), 1.0);
  series.force_N.assign(series.nodes.size(), 0.0);
  return series;
}

std::string protocol_text(const Motif& motif, const std::string& name, double pressure_psi) {
  char text[900];
  std::snprintf(
      text, sizeof text,
      "format = \"isorig-protocol/1\"\n"
      "name = \"%s\"\n"
      "description = \"Separates explanations that a diagnosis left tied\"\n"
      "recording.policy = \"full\"\n\n"
      "steps = [\n"
      "  { do = \"repeat\", unit = \"session\", for = { repetition = [1] }, steps = [\n"
      "    { do = \"pressurize\", pressure_psi = %.6g, rate_psi_s = 1, settled_for_s = 5, timeout_s = 120 "
      "},\n"
      "    { do = \"hold\", duration_s = %.6g },\n"
      "    { do = \"wave\", shape = \"%s\", amplitude_mm = %.6g, velocity_mm_s = %.6g, cycles = %d },\n"
      "    { do = \"hold\", duration_s = %.6g },\n"
      "  ] },\n"
      "]\n",
      name.c_str(), pressure_psi, kRest_s, motif.sine ? "sine" : "triangle", motif.amplitude_mm,
      motif.peak_mm_s, motif.cycles, kRest_s);
  return text;
}

}  // namespace

std::optional<Experiment> design_experiment(const Search& search, const Selection& selection,
                                            const DesignLimits& limits) {
  // A set that holds all of the chosen one and something more is no rival of it.
  std::vector<std::size_t> tied{selection.best};
  double rivals = 0.0;
  for (std::size_t i = 0; i < selection.pool.size(); ++i) {
    const Hypothesis& other = selection.pool[i];
    const bool more =
        std::ranges::all_of(selection.chosen().effects, [&](const auto* e) { return other.has(*e); });
    if (i == selection.best || !other.empirical.empty() || (more && !selection.chosen().effects.empty()))
      continue;
    rivals += selection.weight[i];
    if (selection.weight[i] > 0.05) tied.push_back(i);
  }
  if (tied.size() < 2 || rivals < 0.1) return std::nullopt;
  std::ranges::sort(tied, std::greater<>(), [&](std::size_t i) { return selection.weight[i]; });
  if (tied.size() > 4) tied.resize(4);
  const model::Reference& reference = search.instrument_problem().series()[0].drive.reference;
  std::vector<Motif> menu;
  for (const double frequency_Hz : {0.5, 1.0, 2.0, 4.0}) {
    const double amplitude = std::min(1.0, limits.fastest_mm_s / (2.0 * std::numbers::pi * frequency_Hz));
    menu.push_back({true, amplitude, 2.0 * std::numbers::pi * frequency_Hz * amplitude, 8});
  }
  menu.push_back({false, std::min(2.0, limits.most_mm), std::min(5.0, limits.fastest_mm_s), 4});
  menu.push_back({false, 0.2, 0.05, 3});
  menu.push_back({false, limits.most_mm, 0.1, 2});
  std::optional<Experiment> best;
  constexpr double kApart = 40.0;
  for (const Motif& motif : menu) {
    std::vector<Series> run{simulate(motif, reference)};
    double worst = 1e300;
    for (const std::size_t i : tied) {
      const Problem truth(run, search.instrument());
      const Eigen::VectorXd force = truth.predict(selection.pool[i].fit.spec);
      run[0].force_N.assign(force.data(), force.data() + force.size());
      const Problem problem(run, search.instrument());
      for (const std::size_t j : tied)
        if (j != i) worst = std::min(worst, problem.fit(selection.pool[j].fit.spec, 5).chi2);
    }
    const double duration = 2.0 * kRest_s + motif.period_s() * motif.cycles;
    const bool enough = worst >= kApart, had = best && best->distance >= kApart;
    if (best && (had ? !(enough && duration < best->duration_s) : worst <= best->distance)) continue;
    char name[80];
    std::snprintf(name, sizeof name, "%s-%.3gmm-%.3gmm_s", motif.sine ? "sine" : "triangle",
                  motif.amplitude_mm, motif.peak_mm_s);
    best = Experiment{name, protocol_text(motif, name, reference.nominal_pressure_psi), duration, worst, {}};
  }
  if (best)
    for (const std::size_t i : tied) best->separates.push_back(selection.pool[i].key());
  return best;
}

}  // namespace isorig::identify
