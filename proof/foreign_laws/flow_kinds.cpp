#include "proof/foreign_laws/kind_lists.hpp"

namespace isorig::proof::foreign {
namespace {

using Strings = std::vector<std::string>;

void add_spectrum(Rig& rig, double stiffness_N_mm, std::vector<SpectralArm> arms) {
  rig.specimen.push_back([stiffness_N_mm, arms = std::move(arms)](const Drive& d) {
    return relax(d.t_s, d.position_mm, arms, stiffness_N_mm);
  });
}

/// A time far enough from those that the nominal model has.
double another_time_s(Random& random, const Rig& rig) {
  const double slowest_s = rig.arms.back().time_s, fastest_s = rig.arms.front().time_s;
  return random.chance(0.5) || fastest_s < 0.5 ? slowest_s * random.log_uniform(4.0, 12.0)
                                               : fastest_s / random.log_uniform(6.0, 12.0);
}

std::vector<Kind> relaxation_kinds() {
  const Strings when{"onset", "hold"};
  return {
      {"springpot",
       "second_relaxation",
       {},
       "specimen",
       when,
       "Scott Blair 1947; Bonfanti et al. 2020",
       "share of the spring's stiffness",
       0.05,
       3.0,
       [](Random& random, const Rig&, const Path&) {
         return Shape{{"alpha", random.uniform(0.15, 0.6)}};
       },
       [](double s, const Shape& q, Rig& rig) {
         add_spectrum(rig, s * rig.stiffness_N_mm, springpot(q.at("alpha"), 0.01, 3000.0));
       }},
      {"log_normal",
       "second_relaxation",
       {},
       "specimen",
       when,
       "Wagner 1913",
       "share of the spring's stiffness",
       0.05,
       3.0,
       [](Random& random, const Rig& rig, const Path&) {
         return Shape{{"time_s", another_time_s(random, rig)}, {"decades", random.uniform(0.3, 1.0)}};
       },
       [](double s, const Shape& q, Rig& rig) {
         add_spectrum(rig, s * rig.stiffness_N_mm, log_normal(q.at("time_s"), q.at("decades")));
       }},
      {"kohlrausch_half",
       "second_relaxation",
       {},
       "specimen",
       when,
       "Kohlrausch 1854; Williams & Watts 1970",
       "share of the spring's stiffness",
       0.05,
       3.0,
       [](Random& random, const Rig& rig, const Path&) {
         return Shape{{"time_s", another_time_s(random, rig)}};
       },
       [](double s, const Shape& q, Rig& rig) {
         add_spectrum(rig, s * rig.stiffness_N_mm, kohlrausch_half(q.at("time_s")));
       }},
  };
}

/// Force of an arm at the speed at which half of the stroke takes a second.
double arm_force_N(const Rig& rig, std::size_t arm) {
  return rig.arms[arm].stiffness_N_mm * std::min(0.5 * rig.stroke_mm, 0.5 * rig.stroke_mm * rig.arms[arm].time_s);
}

Shape which_arm(Random& random, const Rig& rig, const Path&) {
  return {{"arm", static_cast<double>(random.index(rig.arms.size()))}};
}

std::vector<Kind> viscosity_kinds() {
  const Strings rate{"rate"};
  return {
      {"eyring",
       "nonlinear_viscosity",
       {},
       "specimen",
       rate,
       "Eyring 1936",
       "force of the arm over Eyring's force",
       0.5,
       5.0,
       which_arm,
       [](double s, const Shape& q, Rig& rig) {
         const auto arm = static_cast<std::size_t>(q.at("arm"));
         rig.arms[arm].flow = [f = arm_force_N(rig, arm) / s](double eta) { return eyring(eta, f); };
       }},
      {"cross",
       "nonlinear_viscosity",
       {},
       "specimen",
       rate,
       "Cross 1965",
       "rate of the arm over the rate of thinning",
       0.2,
       20.0,
       [](Random& random, const Rig& rig, const Path& path) {
         Shape q = which_arm(random, rig, path);
         q["exponent"] = random.uniform(0.4, 0.7);
         return q;
       },
       [](double s, const Shape& q, Rig& rig) {
         const auto arm = static_cast<std::size_t>(q.at("arm"));
         rig.arms[arm].flow = [v = 0.5 * rig.stroke_mm / s, m = q.at("exponent")](double eta) {
           return cross(eta, v, m);
         };
       }},
      {"carreau",
       "nonlinear_viscosity",
       {},
       "specimen",
       rate,
       "Carreau 1972",
       "rate of the arm over the rate of thinning",
       0.5,
       20.0,
       [](Random& random, const Rig& rig, const Path& path) {
         Shape q = which_arm(random, rig, path);
         q["exponent"] = random.uniform(0.3, 0.6);
         return q;
       },
       [](double s, const Shape& q, Rig& rig) {
         const auto arm = static_cast<std::size_t>(q.at("arm"));
         rig.arms[arm].flow = [v = 0.5 * rig.stroke_mm / s, n = q.at("exponent")](double eta) {
           return carreau(eta, v, n);
         };
       }},
      {"papanastasiou",
       "nonlinear_viscosity",
       {},
       "specimen",
       rate,
       "Papanastasiou 1987",
       "yield over the force of the arm",
       0.05,
       1.0,
       [](Random& random, const Rig& rig, const Path& path) {
         Shape q = which_arm(random, rig, path);
         q["rate_mm_s"] = rig.stroke_mm * random.log_uniform(0.005, 0.05);
         return q;
       },
       [](double s, const Shape& q, Rig& rig) {
         const auto arm = static_cast<std::size_t>(q.at("arm"));
         rig.arms[arm].flow = [y = s * arm_force_N(rig, arm), v = q.at("rate_mm_s")](double eta) {
           return papanastasiou(eta, y, v);
         };
       }},
  };
}

/// Share of the peak force that the whole swing of the pressure moves.
double force_per_psi(double strength, const Rig& rig) {
  return strength * rig.peak_N / rig.supply.swing_psi;
}

std::vector<Kind> pressure_kinds() {
  const Strings pressure{"pressure"};
  return {
      {"braid_pressure",
       "pressure_coupling",
       {},
       "specimen",
       {"pressure", "strain"},
       "Chou & Hannaford 1996",
       "share of the peak force for the pressure's swing",
       0.02,
       0.5,
       [](Random& random, const Rig&, const Path&) {
         return Shape{{"thread_over_length", random.uniform(1.05, 1.3)}};
       },
       [](double s, const Shape& q, Rig& rig) {
         rig.specimen.push_back([c = force_per_psi(s, rig), p = rig.supply.nominal_psi, l = rig.rest_length_mm,
                                 b = rig.rest_length_mm * q.at("thread_over_length")](const Drive& d) {
           return braid_pressure_N(d, c, p, l, b);
         });
       }},
      {"power_pressure",
       "pressure_coupling",
       {},
       "specimen",
       pressure,
       "after Wickramatunge & Leephakpreeda 2010",
       "share of the peak force for the pressure's swing",
       0.02,
       0.5,
       [](Random& random, const Rig&, const Path&) {
         return Shape{{"exponent", random.uniform(1.5, 3.0)}};
       },
       [](double s, const Shape& q, Rig& rig) {
         rig.specimen.push_back([c = force_per_psi(s, rig), p = rig.supply.nominal_psi,
                                 m = q.at("exponent")](const Drive& d) { return power_pressure_N(d, c, p, m); });
       }},
      {"tube_pressure",
       "pressure_coupling",
       {},
       "specimen",
       pressure,
       "Richer & Hurmuzlu 2000",
       "share of the peak force for the pressure's swing",
       0.02,
       0.5,
       [](Random& random, const Rig&, const Path&) {
         return Shape{{"time_s", random.log_uniform(0.1, 0.5)}};
       },
       [](double s, const Shape& q, Rig& rig) {
         rig.specimen.push_back([c = force_per_psi(s, rig), p = rig.supply.nominal_psi,
                                 tau = q.at("time_s")](const Drive& d) { return tube_pressure_N(d, c, p, tau); });
       }},
  };
}

/// So short an elongation that the far turning point asks for a push of `share` of the peak force.
void make_slack(double share, Rig& rig) {
  rig.elongation_mm = rig.stroke_mm - share * rig.peak_N / rig.stiffness_N_mm;
}

std::vector<Kind> slack_kinds() {
  const Strings strain{"strain"};
  const auto none = [](Random&, const Rig&, const Path&) { return Shape{}; };
  return {
      {"hyperbolic_slack",
       "slack",
       {},
       "specimen",
       strain,
       "Irvine 1981",
       "push at the far end over the peak force",
       0.05,
       0.3,
       [](Random& random, const Rig&, const Path&) {
         return Shape{{"width_share", random.log_uniform(0.005, 0.03)}};
       },
       [](double s, const Shape& q, Rig& rig) {
         make_slack(s, rig);
         rig.envelope = [w = q.at("width_share") * rig.peak_N](double f) { return hyperbolic_slack_N(f, w); };
       }},
      {"bimodular",
       "slack",
       {},
       "specimen",
       strain,
       "Ambartsumyan 1965",
       "push at the far end over the peak force",
       0.05,
       0.3,
       none,
       [](double s, const Shape&, Rig& rig) {
         constexpr double kShare = 0.05;
         make_slack(s, rig);
         rig.envelope = [](double f) { return bimodular_N(f, kShare); };
       }},
  };
}

}  // namespace

std::vector<Kind> flow_kinds() {
  std::vector<Kind> all = relaxation_kinds();
  for (const auto& more : {viscosity_kinds(), pressure_kinds(), slack_kinds()})
    all.insert(all.end(), more.begin(), more.end());
  return all;
}

}  // namespace isorig::proof::foreign
