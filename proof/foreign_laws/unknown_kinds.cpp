#include "proof/foreign_laws/kind_lists.hpp"

namespace isorig::proof::foreign {
namespace {

template <class Law>
void add_specimen(Rig& rig, Law law) {
  rig.specimen.push_back(std::move(law));
}

/// Nominal arms in the form of a spectrum, for the springs of quasi-linear viscoelasticity.
std::vector<SpectralArm> reduced_relaxation(const Rig& rig) {
  std::vector<SpectralArm> arms;
  for (const Arm& arm : rig.arms) arms.push_back({arm.stiffness_N_mm / rig.stiffness_N_mm, arm.time_s});
  return arms;
}

}  // namespace

std::vector<Kind> unknown_kinds() {
  const char* share = "share of the peak force";
  return {
      // Elastic and relaxing force bend alike. The elastic half alone is a named effect, so that name is no error.
      {"quasi_linear",
       kUnknown,
       {"strain_stiffening", "quasi_linear_viscoelasticity"},
       "specimen",
       {"strain", "history"},
       "Fung 1972; Suzuki et al. 2021",
       "share of the spring's stiffness",
       0.1,
       3.0,
       [](Random& random, const Rig& rig, const Path&) {
         return Shape{{"length_mm", rig.stroke_mm * random.uniform(0.8, 1.6)}};
       },
       [](double s, const Shape& q, Rig& rig) {
         add_specimen(
             rig, [k = s * rig.stiffness_N_mm, l = q.at("length_mm"), arms = reduced_relaxation(rig)](const Drive& d) {
               Signal bent;
               for (const double x : d.position_mm) bent.push_back(fung_square_N(k, x, l));
               const Signal relaxing = relax(d.t_s, bent, arms, 1.0);
               for (std::size_t i = 0; i < bent.size(); ++i) bent[i] += relaxing[i];
               return bent;
             });
       }},
      {"snapping_truss",
       kUnknown,
       {},
       "specimen",
       {"position", "history"},
       "von Mises 1923",
       share,
       0.03,
       0.3,
       [](Random& random, const Rig& rig, const Path&) {
         return Shape{{"at_mm", rig.stroke_mm * random.uniform(-0.2, 0.2)},
                      {"rise_mm", rig.stroke_mm * random.uniform(0.15, 0.3)}};
       },
       [](double s, const Shape& q, Rig& rig) {
         add_specimen(rig, [k = s * rig.peak_N / q.at("rise_mm"), q](const Drive& d) {
           return snapping_truss(d, k, q.at("at_mm"), q.at("rise_mm"));
         });
       }},
      // Contact is elastic beyond a position: that half has a name.
      {"bladder_contact",
       kUnknown,
       {"strain_stiffening"},
       "specimen",
       {"position", "rate"},
       "Hunt & Crossley 1975",
       share,
       0.03,
       0.5,
       [](Random& random, const Rig& rig, const Path&) {
         return Shape{{"at_mm", rig.stroke_mm * random.uniform(-0.4, -0.1)},
                      {"damping_s_mm", random.uniform(0.3, 1.0) / rig.stroke_mm}};
       },
       [](double s, const Shape& q, Rig& rig) {
         add_specimen(rig, [k = s * rig.peak_N / std::pow(0.5 * rig.stroke_mm, 1.5), q](const Drive& d) {
           return bladder_contact(d, k, q.at("at_mm"), q.at("damping_s_mm"));
         });
       }},
      {"eccentric_gear",
       kUnknown,
       {},
       "kinematics",
       {"position"},
       "Ottewill, Neild & Wilson 2009",
       "share of the stroke",
       0.01,
       0.1,
       [](Random& random, const Rig& rig, const Path&) {
         return Shape{{"pitch_mm", rig.stroke_mm * random.uniform(0.2, 0.8)}};
       },
       [](double s, const Shape& q, Rig& rig) {
         rig.kinematics.push_back([e = s * rig.stroke_mm, p = q.at("pitch_mm")](const Drive& d) {
           return eccentric_position(d.position_mm, e, p);
         });
       }},
      {"cogging",
       kUnknown,
       {},
       "fixture",
       {"position"},
       "Zhu & Howe 2000",
       share,
       0.02,
       0.3,
       [](Random& random, const Rig& rig, const Path&) {
         return Shape{{"pitch_mm", rig.stroke_mm * random.uniform(0.15, 0.6)}};
       },
       [](double s, const Shape& q, Rig& rig) {
         rig.fixture.push_back([f = s * rig.peak_N, p = q.at("pitch_mm")](const Drive& d) {
           Signal force;
           for (const double x : d.position_mm) force.push_back(cogging_N(f, x, p));
           return force;
         });
       }},
      {"permanent_set",
       kUnknown,
       {"permanent_set"},
       "specimen",
       {"strain", "history"},
       "Guo & Sluys 2008",
       "share of the extension beyond yield",
       0.03,
       0.5,
       [](Random& random, const Rig& rig, const Path&) {
         return Shape{{"yield_mm", rig.stroke_mm * random.uniform(0.0, 0.4)}};
       },
       [](double s, const Shape& q, Rig& rig) {
         add_specimen(rig, [s, y = q.at("yield_mm")](const Drive& d) { return permanent_set(d, s, y); });
       }},
      // The catalogue names both a difference of drag beside friction and, as one effect, damping by direction.
      {"one_way_damping",
       kUnknown,
       {"viscous_drag", "friction_asymmetry", "directional_damping"},
       "specimen",
       {"rate", "direction"},
       "Reynolds et al. 2003",
       "share of the peak force at a stroke per second",
       0.02,
       1.0,
       [](Random&, const Rig&, const Path&) { return Shape{}; },
       [](double s, const Shape&, Rig& rig) {
         add_specimen(rig, [c = s * rig.peak_N / rig.stroke_mm](const Drive& d) { return one_way_damping(d, c); });
       }},
      {"self_heating",
       kUnknown,
       {},
       "specimen",
       {"travel", "time"},
       "Gent & Hindi 1988",
       "share of the specimen's force",
       0.02,
       0.4,
       [](Random& random, const Rig& rig, const Path&) {
         return Shape{{"travel_mm", rig.stroke_mm * random.uniform(3.0, 8.0)},
                      {"time_s", random.log_uniform(5.0, 40.0)}};
       },
       [](double s, const Shape& q, Rig& rig) {
         add_specimen(rig, [s, q](const Drive& d) { return self_heating(d, s, q.at("travel_mm"), q.at("time_s")); });
       }},
      // The ceiling comes down from the peak force by the strength.
      {"analogue_saturation",
       kUnknown,
       {"cell_nonlinearity"},
       "sensor",
       {"force"},
       "ISO 376:2011",
       share,
       0.05,
       0.5,
       [](Random& random, const Rig&, const Path&) {
         return Shape{{"width_share", random.log_uniform(0.003, 0.02)}};
       },
       [](double s, const Shape& q, Rig& rig) {
         rig.sensor.push_back(
             [ceiling = (1.0 - s) * rig.peak_N, w = q.at("width_share") * rig.peak_N](const Drive&, const Signal& f) {
               Signal out;
               for (const double one : f) out.push_back(saturated_N(one, ceiling, w));
               return out;
             });
       }},
      {"cell_hysteresis",
       kUnknown,
       {},
       "sensor",
       {"force", "history"},
       "ISO 376:2011 (reversibility)",
       "share of the force",
       0.05,
       0.5,
       [](Random& random, const Rig&, const Path&) {
         return Shape{{"span_share", random.uniform(0.1, 0.4)}};
       },
       [](double s, const Shape& q, Rig& rig) {
         rig.sensor.push_back([s, span = q.at("span_share") * rig.peak_N](const Drive&, const Signal& f) {
           return cell_hysteresis(f, s, span);
         });
       }},
  };
}

}  // namespace isorig::proof::foreign
