#include "proof/foreign_laws/kind_lists.hpp"

namespace isorig::proof::foreign {
namespace {

using Strings = std::vector<std::string>;

/// A filter of the force channel: its strength is its mean delay.
Kind filter_kind(std::string_view law, std::string_view effect, std::string_view nearly, std::string_view source,
                 decltype(Kind::draw) draw, decltype(Kind::conceal) conceal) {
  return {.law = law,
          .effect = effect,
          .accepted = {std::string(nearly)},
          .acts_on = "sensor",
          .depends_on = {"onset", "rate"},
          .source = source,
          .strength_is = "mean delay in s",
          .start = 0.01,
          .most = 0.06,
          .draw = draw,
          .conceal = conceal};
}

std::vector<Kind> channel_kinds() {
  const auto none = [](Random&, const Rig&, const Path&) { return Shape{}; };
  return {
      // A few poles are a lag and a delay at once: below their corner only the mean delay is seen.
      filter_kind("two_pole", "force_lag", "force_delay", "Zverev 1967", none,
                  [](double s, const Shape&, Rig& rig) {
                    rig.sensor.push_back([s](const Drive& d, const Signal& f) { return two_pole(d, f, s); });
                  }),
      filter_kind("four_pole", "force_lag", "force_delay", "Zverev 1967", none,
                  [](double s, const Shape&, Rig& rig) {
                    rig.sensor.push_back([s](const Drive& d, const Signal& f) { return four_pole(d, f, s); });
                  }),
      filter_kind("hann_filter", "force_delay", "force_lag", "Blackman & Tukey 1958", none,
                  [](double s, const Shape&, Rig& rig) {
                    rig.sensor.push_back([s](const Drive& d, const Signal& f) { return hann_filter(d.t_s, f, s); });
                  }),
      filter_kind(
          "beating_delay", "force_delay", "force_lag", "Nilsson 1998",
          [](Random& random, const Rig&, const Path&) {
            return Shape{{"depth", random.uniform(0.2, 0.6)}, {"period_s", random.log_uniform(0.3, 10.0)}};
          },
          [](double s, const Shape& q, Rig& rig) {
            rig.sensor.push_back([s, q](const Drive& d, const Signal& f) {
              return beating_delay(d.t_s, f, s, q.at("depth"), q.at("period_s"));
            });
          }),
  };
}

/// Mass whose force at the highest acceleration of the session is this share of the peak force.
double mass_kg(double share, const Shape& q, const Rig& rig) {
  return share * rig.peak_N / (1e-3 * q.at("acceleration_mm_s2"));
}

/// A mass between specimen and load cell.
Kind fixture_kind(std::string_view law, Strings depends_on, std::string_view source, decltype(Kind::draw) draw,
                  decltype(Kind::conceal) conceal) {
  return {.law = law,
          .effect = "fixture_inertia",
          .accepted = {},
          .acts_on = "fixture",
          .depends_on = std::move(depends_on),
          .source = source,
          .strength_is = "share of the peak force at the highest acceleration",
          .start = 0.02,
          .most = 0.5,
          .draw = draw,
          .conceal = conceal};
}

Shape ringing(const Path& path, double frequency_Hz, double damping) {
  return {{"acceleration_mm_s2", path.acceleration_mm_s2()}, {"frequency_Hz", frequency_Hz}, {"damping", damping}};
}

void add_ringing(Rig& rig, double share, const Shape& q, Signal (*law)(const Drive&, double, double, double)) {
  rig.fixture.push_back([m = mass_kg(share, q, rig), q, law](const Drive& d) {
    return law(d, m, q.at("frequency_Hz"), q.at("damping"));
  });
}

std::vector<Kind> fixture_kinds() {
  return {
      fixture_kind(
          "sprung_mass", {"onset", "rate"}, "Den Hartog 1934",
          [](Random& random, const Rig&, const Path& path) {
            const double frequency_Hz = random.uniform(25.0, 60.0);
            return ringing(path, frequency_Hz, random.uniform(0.3, 0.8));
          },
          [](double s, const Shape& q, Rig& rig) { add_ringing(rig, s, q, sprung_mass); }),
      fixture_kind(
          "two_masses", {"onset", "rate"}, "Den Hartog 1934",
          [](Random& random, const Rig&, const Path& path) {
            const double frequency_Hz = random.uniform(10.0, 25.0);
            return ringing(path, frequency_Hz, random.uniform(0.1, 0.4));
          },
          [](double s, const Shape& q, Rig& rig) { add_ringing(rig, s, q, two_masses); }),
      fixture_kind(
          "growing_mass", {"onset", "rate", "position"}, "Cayley 1857; Wong & Yasui 2006",
          [](Random& random, const Rig& rig, const Path& path) {
            return Shape{{"acceleration_mm_s2", path.acceleration_mm_s2()},
                         {"length_mm", rig.stroke_mm * random.uniform(2.0, 5.0)}};
          },
          [](double s, const Shape& q, Rig& rig) {
            rig.fixture.push_back(
                [m = mass_kg(s, q, rig), l = q.at("length_mm")](const Drive& d) { return growing_mass(d, m, l); });
          }),
  };
}

void add_drift(Rig& rig, double size_N, std::function<Signal(const Signal&)> drift) {
  rig.sensor.push_back([size_N, drift = std::move(drift)](const Drive& d, const Signal& f) {
    Signal out = f;
    const Signal one = drift(d.t_s);
    for (std::size_t i = 0; i < out.size(); ++i) out[i] += size_N * one[i];
    return out;
  });
}

std::vector<Kind> drift_kinds() {
  const Strings time{"time"};
  const char* share = "share of the peak force";
  return {
      {"logarithmic_creep",
       "zero_drift",
       {},
       "sensor",
       time,
       "Andrade 1910; Nabarro 2001",
       share,
       0.02,
       0.3,
       [](Random& random, const Rig&, const Path& path) {
         return Shape{{"sign", random.sign()}, {"time_s", random.log_uniform(5.0, 60.0)}, {"whole_s", path.end_s()}};
       },
       [](double s, const Shape& q, Rig& rig) {
         add_drift(rig, s * q.at("sign") * rig.peak_N,
                   [q](const Signal& t) { return logarithmic_creep(t, q.at("time_s"), q.at("whole_s")); });
       }},
      {"diffusing_heat",
       "zero_drift",
       {},
       "sensor",
       time,
       "Carslaw & Jaeger 1959",
       share,
       0.02,
       0.3,
       [](Random& random, const Rig&, const Path& path) {
         return Shape{{"sign", random.sign()}, {"whole_s", path.end_s()}};
       },
       [](double s, const Shape& q, Rig& rig) {
         add_drift(rig, s * q.at("sign") * rig.peak_N,
                   [whole_s = q.at("whole_s")](const Signal& t) { return diffusing_heat(t, whole_s); });
       }},
      {"thermostat",
       "zero_drift",
       {},
       "sensor",
       time,
       "Newton 1701 (law of cooling), relay control",
       share,
       0.02,
       0.3,
       [](Random& random, const Rig&, const Path& path) {
         return Shape{{"sign", random.sign()},
                      {"room_s", path.end_s() * random.uniform(0.15, 0.4)},
                      {"amplifier_s", path.end_s() * random.uniform(0.05, 0.15)}};
       },
       [](double s, const Shape& q, Rig& rig) {
         add_drift(rig, s * q.at("sign") * rig.peak_N,
                   [q](const Signal& t) { return thermostat(t, q.at("room_s"), q.at("amplifier_s")); });
       }},
      {"random_walk",
       "zero_drift",
       {},
       "sensor",
       time,
       "Einstein 1905",
       share,
       0.02,
       0.3,
       [](Random& random, const Rig&, const Path& path) {
         return Shape{{"seed", static_cast<double>(random.index(1U << 30))}, {"whole_s", path.end_s()}};
       },
       [](double s, const Shape& q, Rig& rig) {
         add_drift(rig, s * rig.peak_N, [q](const Signal& t) {
           return random_walk(t, static_cast<std::uint64_t>(q.at("seed")), q.at("whole_s"));
         });
       },
       true},
  };
}

/// An instant within or shortly after a fast motion.
double busy_time_s(Random& random, const Path& path) {
  const auto windows = path.fast_windows(0.0, 0.5);
  const Path::Window& w = windows[1 + random.index(windows.size() - 1)];
  return random.uniform(w.start_s, w.end_s);
}

std::vector<Kind> kinematic_kinds() {
  const Strings time{"time"}, turning{"direction", "history"};
  return {
      {"stick_slips",
       "grip_slip",
       {},
       "kinematics",
       time,
       "Bowden & Leben 1939",
       "share of the stroke",
       0.02,
       0.3,
       [](Random& random, const Rig&, const Path& path) {
         Shape q{{"events", 2.0 + static_cast<double>(random.index(3))}, {"time_s", random.log_uniform(0.005, 0.05)}};
         for (int n = 0; n < static_cast<int>(q["events"]); ++n) {
           q["at_s_" + std::to_string(n)] = busy_time_s(random, path);
           q["share_" + std::to_string(n)] = random.uniform(0.4, 1.0);
         }
         return q;
       },
       [](double s, const Shape& q, Rig& rig) {
         std::vector<SlipEvent> events;
         for (int n = 0; n < static_cast<int>(q.at("events")); ++n)
           events.push_back({q.at("at_s_" + std::to_string(n)), q.at("share_" + std::to_string(n))});
         rig.kinematics.push_back([slip = s * rig.stroke_mm, events, tau = q.at("time_s")](const Drive& d) {
           Signal x = stick_slips(d.t_s, slip, events, tau);
           for (std::size_t i = 0; i < x.size(); ++i) x[i] += d.position_mm[i];
           return x;
         });
       },
       true},
      {"afterslip",
       "grip_slip",
       {},
       "kinematics",
       time,
       "Marone, Scholz & Bilham 1991",
       "share of the stroke",
       0.02,
       0.3,
       [](Random& random, const Rig&, const Path& path) {
         return Shape{{"at_s", busy_time_s(random, path)}, {"time_s", random.log_uniform(0.3, 3.0)}};
       },
       [](double s, const Shape& q, Rig& rig) {
         rig.kinematics.push_back([slip = s * rig.stroke_mm, q](const Drive& d) {
           Signal x = afterslip(d.t_s, slip, q.at("at_s"), q.at("time_s"));
           for (std::size_t i = 0; i < x.size(); ++i) x[i] += d.position_mm[i];
           return x;
         });
       },
       true},
      {"spread_play",
       "crosshead_backlash",
       {},
       "kinematics",
       turning,
       "Krasnosel'skii & Pokrovskii 1989",
       "share of the stroke",
       0.01,
       0.2,
       [](Random&, const Rig&, const Path&) { return Shape{}; },
       [](double s, const Shape&, Rig& rig) {
         rig.kinematics.push_back(
             [play = s * rig.stroke_mm](const Drive& d) { return spread_play(d.position_mm, play); });
       }},
      {"worn_play",
       "crosshead_backlash",
       {},
       "kinematics",
       {"direction", "position", "history"},
       "Krasnosel'skii & Pokrovskii 1989",
       "share of the stroke",
       0.01,
       0.2,
       [](Random& random, const Rig& rig, const Path&) {
         return Shape{{"worn_mm", rig.stroke_mm * random.uniform(0.2, 0.6)}};
       },
       [](double s, const Shape& q, Rig& rig) {
         rig.kinematics.push_back([play = s * rig.stroke_mm, worn = q.at("worn_mm")](const Drive& d) {
           return worn_play(d.position_mm, play, worn);
         });
       }},
      {"compliant_play",
       "crosshead_backlash",
       {},
       "kinematics",
       turning,
       "Nordin & Gutman 2002",
       "share of the stroke",
       0.01,
       0.2,
       [](Random& random, const Rig&, const Path&) {
         return Shape{{"time_s", random.log_uniform(0.005, 0.03)}};
       },
       [](double s, const Shape& q, Rig& rig) {
         rig.kinematics.push_back(
             [play = s * rig.stroke_mm, tau = q.at("time_s")](const Drive& d) { return compliant_play(d, play, tau); });
       },
       false,
       "time_s"},
  };
}

}  // namespace

std::vector<Kind> rig_kinds() {
  std::vector<Kind> all = channel_kinds();
  for (const auto& more : {fixture_kinds(), drift_kinds(), kinematic_kinds()})
    all.insert(all.end(), more.begin(), more.end());
  return all;
}

}  // namespace isorig::proof::foreign
