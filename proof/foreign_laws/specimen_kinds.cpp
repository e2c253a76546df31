#include "proof/foreign_laws/kind_lists.hpp"

namespace isorig::proof::foreign {
namespace {

using Strings = std::vector<std::string>;

/// Adds a force of the specimen that is a function of the position alone.
template <class Law>
void add_elastic(Rig& rig, const Law& law) {
  rig.specimen.push_back([law](const Drive& d) {
    Signal force;
    force.reserve(d.size());
    for (const double x : d.position_mm) force.push_back(law(x));
    return force;
  });
}

Shape presliding(Random& random, const Rig& rig, const Path&) {
  return {{"presliding_mm", rig.stroke_mm * random.log_uniform(0.002, 0.02)}};
}

std::vector<Kind> friction_kinds() {
  const Strings memory{"direction", "history"};
  return {
      {"dahl_square",
       "coulomb_friction",
       {},
       "specimen",
       memory,
       "Dahl 1976",
       "share of the peak force",
       0.02,
       0.3,
       presliding,
       [](double s, const Shape& q, Rig& rig) {
         rig.specimen.push_back(
             [f = s * rig.peak_N, x = q.at("presliding_mm")](const Drive& d) { return dahl_square(d, f, x); });
       }},
      {"bouc_wen",
       "coulomb_friction",
       {},
       "specimen",
       memory,
       "Bouc 1967, Wen 1976",
       "share of the peak force",
       0.02,
       0.3,
       [](Random& random, const Rig& rig, const Path& path) {
         Shape q = presliding(random, rig, path);
         q["exponent"] = random.uniform(1.5, 3.0);
         q["gamma"] = random.uniform(0.2, 0.5);
         return q;
       },
       [](double s, const Shape& q, Rig& rig) {
         rig.specimen.push_back([f = s * rig.peak_N, q](const Drive& d) {
           return bouc_wen(d, f, q.at("presliding_mm"), q.at("exponent"), q.at("gamma"));
         });
       }},
      {"lugre_half",
       "coulomb_friction",
       {},
       "specimen",
       {"direction", "rate", "history"},
       "Canudas de Wit et al. 1995; Bo & Pavelescu 1982",
       "share of the peak force",
       0.02,
       0.3,
       [](Random& random, const Rig& rig, const Path& path) {
         Shape q = presliding(random, rig, path);
         q["excess"] = random.uniform(0.2, 0.8);
         q["stribeck_mm_s"] = rig.stroke_mm * random.log_uniform(0.05, 0.5);
         return q;
       },
       [](double s, const Shape& q, Rig& rig) {
         rig.specimen.push_back([f = s * rig.peak_N, q](const Drive& d) {
           return lugre_half(d, f, q.at("presliding_mm"), q.at("excess"), q.at("stribeck_mm_s"));
         });
       }},
      {"prandtl_ishlinskii",
       "coulomb_friction",
       {"friction_asymmetry"},
       "specimen",
       memory,
       "Kuhnen 2003; Al Janaideh, Rakheja & Su 2009",
       "share of the peak force",
       0.02,
       0.3,
       [](Random& random, const Rig& rig, const Path&) {
         return Shape{{"reach_mm", rig.stroke_mm * random.uniform(0.1, 0.5)}, {"asymmetry", random.uniform(-0.5, 0.5)}};
       },
       [](double s, const Shape& q, Rig& rig) {
         rig.specimen.push_back([f = s * rig.peak_N, q](const Drive& d) {
           return prandtl_ishlinskii(d, f, q.at("reach_mm"), q.at("asymmetry"));
         });
       }},
      {"arctan_friction",
       "coulomb_friction",
       {},
       "specimen",
       {"direction", "rate"},
       "Mostaghel & Davis 1997",
       "share of the peak force",
       0.02,
       0.3,
       [](Random& random, const Rig& rig, const Path&) {
         return Shape{{"velocity_mm_s", rig.stroke_mm * random.log_uniform(0.002, 0.01)}};
       },
       [](double s, const Shape& q, Rig& rig) {
         rig.specimen.push_back(
             [f = s * rig.peak_N, v = q.at("velocity_mm_s")](const Drive& d) { return arctan_friction(d, f, v); });
       }},
      {"load_friction",
       "coulomb_friction",
       {"friction_with_load"},
       "specimen",
       {"direction", "force", "history"},
       "Amontons 1699; Coleman & Hodgdon 1986; Duclusaud et al. 2025",
       "friction coefficient",
       0.03,
       0.4,
       presliding,
       [](double s, const Shape& q, Rig& rig) {
         rig.specimen.push_back([s, x = q.at("presliding_mm")](const Drive& d) { return load_friction(d, s, x); });
       }},
  };
}

std::vector<Kind> stiffening_kinds() {
  const Strings strain{"strain"};
  // Lengths scale with the stroke, so that every law bends within it.
  return {
      {"fung_square",
       "strain_stiffening",
       {},
       "specimen",
       strain,
       "Fung, Fronek & Patitucci 1979",
       "share of the spring's stiffness",
       0.05,
       3.0,
       [](Random& random, const Rig& rig, const Path&) {
         return Shape{{"length_mm", rig.stroke_mm * random.uniform(0.8, 2.0)}};
       },
       [](double s, const Shape& q, Rig& rig) {
         add_elastic(rig,
                     [k = s * rig.stiffness_N_mm, l = q.at("length_mm")](double x) { return fung_square_N(k, x, l); });
       }},
      {"gent",
       "strain_stiffening",
       {},
       "specimen",
       strain,
       "Gent 1996",
       "share of the spring's stiffness",
       0.1,
       3.0,
       [](Random& random, const Rig& rig, const Path&) {
         // J1 at the stroke, with a fibre length a few strokes long, stays below half of the limit.
         const double share = random.uniform(0.25, 0.5);
         const double stretch = 1.0 + share, worst = 1.0 - share;
         const double most = std::max(stretch * stretch + 2.0 / stretch, worst * worst + 2.0 / worst) - 3.0;
         return Shape{{"length_mm", rig.stroke_mm / share}, {"limit", most * random.uniform(1.6, 3.0)}};
       },
       [](double s, const Shape& q, Rig& rig) {
         add_elastic(
             rig, [k = s * rig.stiffness_N_mm, q](double x) { return gent_N(k, x, q.at("length_mm"), q.at("limit")); });
       }},
      {"ogden",
       "strain_stiffening",
       {},
       "specimen",
       strain,
       "Ogden 1972",
       "share of the spring's stiffness",
       0.1,
       3.0,
       [](Random& random, const Rig& rig, const Path&) {
         return Shape{{"length_mm", rig.stroke_mm * random.uniform(2.0, 4.0)}, {"exponent", random.uniform(4.0, 9.0)}};
       },
       [](double s, const Shape& q, Rig& rig) {
         add_elastic(rig, [k = s * rig.stiffness_N_mm, q](double x) {
           return ogden_N(k, x, q.at("length_mm"), q.at("exponent"));
         });
       }},
      {"hyperbolic_knee",
       "strain_stiffening",
       {},
       "specimen",
       strain,
       "Bacon & Watts 1971",
       "share of the spring's stiffness",
       0.05,
       2.0,
       [](Random& random, const Rig& rig, const Path&) {
         return Shape{{"at_mm", rig.stroke_mm * random.uniform(-0.4, 0.4)},
                      {"width_mm", rig.stroke_mm * random.log_uniform(0.05, 0.3)}};
       },
       [](double s, const Shape& q, Rig& rig) {
         add_elastic(rig, [k = s * rig.stiffness_N_mm, q](double x) {
           return hyperbolic_knee_N(k, x, q.at("at_mm"), q.at("width_mm"));
         });
       }},
      {"braid_lock",
       "strain_stiffening",
       {},
       "specimen",
       strain,
       "Davis & Caldwell 2006",
       "share of the spring's stiffness",
       0.05,
       3.0,
       [](Random& random, const Rig& rig, const Path&) {
         return Shape{{"lock_mm", rig.stroke_mm * random.uniform(1.3, 2.5)}};
       },
       [](double s, const Shape& q, Rig& rig) {
         add_elastic(rig,
                     [k = s * rig.stiffness_N_mm, l = q.at("lock_mm")](double x) { return braid_lock_N(k, x, l); });
       }},
  };
}

std::vector<Kind> softening_kinds() {
  const Strings history{"strain", "history"};
  const auto work_N_mm = [](Random& random, const Rig& rig, const Path&) {
    // The work that a stroke about the resting elongation adds to the spring's.
    return Shape{
        {"energy_N_mm", rig.stiffness_N_mm * rig.elongation_mm * rig.stroke_mm * random.log_uniform(0.3, 2.0)}};
  };
  return {
      {"ogden_roxburgh",
       "cyclic_softening",
       {"mullins_softening"},
       "specimen",
       history,
       "Ogden & Roxburgh 1999",
       "share of the elastic force",
       0.03,
       0.5,
       work_N_mm,
       [](double s, const Shape& q, Rig& rig) {
         rig.specimen.push_back([s, e = q.at("energy_N_mm")](const Drive& d) { return ogden_roxburgh(d, s, e); });
       }},
      {"simo_damage",
       "cyclic_softening",
       {"mullins_softening"},
       "specimen",
       history,
       "Simo 1987",
       "share of the elastic force",
       0.03,
       0.5,
       [](Random& random, const Rig& rig, const Path&) {
         return Shape{{"scale_mm", rig.stroke_mm * random.log_uniform(0.2, 1.0)}};
       },
       [](double s, const Shape& q, Rig& rig) {
         rig.specimen.push_back([s, x = q.at("scale_mm")](const Drive& d) { return simo_damage(d, s, x); });
       }},
      {"miehe_damage",
       "cyclic_softening",
       {},
       "specimen",
       {"strain", "travel"},
       "Miehe 1995",
       "share of the elastic force",
       0.02,
       0.5,
       [](Random& random, const Rig& rig, const Path&) {
         return Shape{
             {"energy_N_mm", rig.stiffness_N_mm * rig.elongation_mm * rig.stroke_mm * random.log_uniform(3.0, 12.0)}};
       },
       [](double s, const Shape& q, Rig& rig) {
         rig.specimen.push_back([s, e = q.at("energy_N_mm")](const Drive& d) { return miehe_damage(d, s, e); });
       }},
  };
}

}  // namespace

std::vector<Kind> specimen_kinds() {
  std::vector<Kind> all = friction_kinds();
  for (const auto& more : {stiffening_kinds(), softening_kinds()}) all.insert(all.end(), more.begin(), more.end());
  return all;
}

}  // namespace isorig::proof::foreign
