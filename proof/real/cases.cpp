#include "proof/real/cases.hpp"

#include <array>
#include <string>

#include "proof/real/conversions.hpp"
#include "proof/sealed.hpp"

namespace isorig::proof {
namespace {

constexpr const char* kAxis = R"(format = "isorig-model/1"
name = "mass and damper"
[[part]]
physics = "mass"
[[part]]
physics = "dashpot"
[[part]]
physics = "constant"
)";
constexpr const char* kSwing = R"(format = "isorig-model/1"
name = "pendulum with a viscous joint"
[[part]]
physics = "gravity"
length_mm = 100.0
weight_N = 11.37
[[part]]
physics = "dashpot"
[[part]]
physics = "constant"
)";
constexpr const char* kOneTime = R"(format = "isorig-model/1"
name = "one relaxation time"
[[part]]
physics = "spring"
[[part]]
physics = "maxwell"
time_constant_s = 10.0
[[part]]
physics = "constant"
)";
constexpr const char* kSpring = R"(format = "isorig-model/1"
name = "linear spring"
[[part]]
physics = "spring"
[[part]]
physics = "constant"
)";
constexpr const char* kMuscle = R"(format = "isorig-model/1"
name = "force in proportion to the pressure"
[[part]]
physics = "pressure_coupling"
law = "force"
[[part]]
physics = "constant"
)";
constexpr const char* kTank = R"(format = "isorig-model/1"
name = "one tank that drains in proportion to its level"
[[part]]
physics = "maxwell"
time_constant_s = 100.0
[[part]]
physics = "constant"
)";
/// Of a cylinder whose piston is known.
std::string piston(std::string_view force_N_psi) {
  return R"(format = "isorig-model/1"
name = "pressure times area"
[[part]]
physics = "pressure_coupling"
law = "force"
force_N_psi = )" +
         std::string(force_N_psi) + R"(
fixed = true
[[part]]
physics = "constant"
)";
}
constexpr std::string_view kBore25mm_N_psi = "3.385", kBore25_7mm_N_psi = "3.576";
/// A compliance with one retardation time (identify/response).
constexpr const char* kCompliance = "slse1";

/// Learnt from test 9; test 10 is filled in the same way, test 8 faster. The known threshold is that of the same
/// formula, F = c + a p + b max(0, p - pt), by plain least squares on a grid of pt; without the line the thresholds are
/// lower.
RealCase isometric(std::string_view name, std::string_view test9, std::string_view test10, std::string_view test8,
                   std::string_view known, double threshold_psi) {
  return {name,
          "festo-bpa-10mm-isometric",
          {test9},
          {test10, test8},
          "pressure_threshold",
          known,
          kMuscle,
          festo,
          {{"pressure_threshold", "threshold_psi", threshold_psi}}};
}

RealCase seal(std::string_view name, std::vector<std::string_view> train, std::string_view heldout,
              std::string_view known, std::string_view piston_N_psi, double force_N_psi) {
  return {name,
          "pneumatic-cylinder-friction",
          std::move(train),
          {heldout},
          "coulomb_friction, then friction_with_pressure",
          known,
          piston(piston_N_psi),
          cylinder,
          {{"friction_with_pressure", "force_N_psi", force_N_psi}}};
}

RealCase tensile(std::string_view name, std::string_view file, std::string_view known) {
  return {name, "elastomer-tensile", {file}, {}, "strain_stiffening", known, kSpring, silicone};
}

RealCase lifted(std::string_view name, std::vector<std::string_view> train, std::vector<std::string_view> heldout) {
  return {name,
          "cavatappi-muscle",
          std::move(train),
          std::move(heldout),
          "second_relaxation; a swinging load, hysteresis, ratcheting",
          "creep in the long file: 1.2, 11 and 142 s",
          kCompliance,
          lifting_muscle};
}

RealCase leaking(std::string_view name, std::string_view file) {
  return {
      name, "festo-bpa-leak-fill", {file}, {}, "not published", "all seven leak, by 3 to 77 % in 120 s", kCompliance,
      leak};
}

RealCase filled(std::string_view name, std::string_view file) {
  return {name,
          "festo-bpa-leak-fill",
          {file},
          {},
          "not published; the volume grows and the inflow is choked at first",
          "a rise of first order is only roughly right",
          kCompliance,
          filling};
}

const std::array kCases{
    RealCase{"emps",
             "emps",
             {"emps_estimation.csv"},
             {"emps_validation_pulses.csv"},
             "coulomb_friction, then friction_asymmetry",
             "M 95.11 kg, Fv 203.5 N s/m, Fc 20.39 N, offset -3.16 N (Janot, Gautier and Brunot 2019)",
             kAxis,
             emps_axis,
             {{"mass", "mass_kg", 95.11},
              {"dashpot", "viscosity_N_s_mm", 0.2035},
              {"coulomb_friction", "force_N", 20.39},
              {"friction_asymmetry", "viscosity_half_difference_N_s_mm", -0.03685}}},
    RealCase{"pendulum",
             "pbj-pendulum",
             {"no_damper_trial_01.csv", "no_damper_trial_03.csv", "no_damper_trial_05.csv"},
             {"no_damper_trial_02.csv", "no_damper_trial_04.csv", "no_damper_trial_06.csv", "no_damper_trial_07.csv",
              "no_damper_trial_08.csv", "no_damper_trial_09.csv", "no_damper_trial_10.csv", "no_damper_trial_11.csv",
              "no_damper_trial_12.csv", "no_damper_trial_13.csv", "no_damper_trial_15.csv"},
             "coulomb_friction",
             "mass 1 kg by construction; friction 0.28 to 0.32 N per kg at 100 mm; no viscosity. Trial 14 is not used: "
             "its release is no free motion",
             kSwing,
             pendulum,
             {{"coulomb_friction", "force_N", 0.30}}},
    RealCase{"vhb-relaxation",
             "vhb4910-tape",
             {"relax_stretch2.0.csv"},
             {},
             "second_relaxation",
             "three times in the hold: 3.5, 28 and 341 s",
             kOneTime,
             elastomer},
    RealCase{"vhb-cycles",
             "vhb4910-tape",
             {"cycle_rate0.01_stretch2.0.csv", "cycle_rate0.05_stretch2.0.csv"},
             {"cycle_rate0.03_stretch2.0.csv", "cycle_rate0.03_stretch1.5.csv", "cycle_rate0.03_stretch3.0.csv"},
             "strain_stiffening, second_relaxation, slack",
             "the curve bends; the force rises with the rate; on the way back the strip is slack",
             kOneTime,
             elastomer_cycle},
    tensile("dragon-skin-30", "dragon_skin_30.csv", "residual of a line 9.7 %, of a cubic 0.2 %"),
    tensile("dragon-skin-10", "dragon_skin_10.csv", "stiffens (Marechal et al. 2020)"),
    tensile("ecoflex-00-30", "ecoflex_00-30.csv", "residual of a line 36.2 %, of a cubic 1.5 %"),
    tensile("ecoflex-00-50", "ecoflex_00-50.csv", "stiffens (Marechal et al. 2020)"),
    isometric("festo-rest", "len20cm_rest_test9.csv", "len20cm_rest_test10.csv", "len20cm_rest_test8.csv",
              "a threshold alone 13.8 psi; beside a line 29.8 psi", 29.75),
    isometric("festo-short25", "len20cm_short25_test9.csv", "len20cm_short25_test10.csv", "len20cm_short25_test8.csv",
              "a threshold alone 39.2 psi; beside a line 40.5 psi", 40.5),
    isometric("festo-short50", "len20cm_short50_test9.csv", "len20cm_short50_test10.csv", "len20cm_short50_test8.csv",
              "a threshold alone 55.5 psi; beside a line 57.8 psi; load cell clipped at -8.735 N", 57.75),
    isometric("festo-short75", "len20cm_short75_test9.csv", "len20cm_short75_test10.csv", "len20cm_short75_test8.csv",
              "a threshold alone 67 psi; beside a line 73 psi; load cell clipped", 73.0),
    RealCase{"o-ring-3bar",
             "pneumatic-cylinder-friction",
             {"o-ring_3bar.csv"},
             {},
             "coulomb_friction",
             "5.5 N at 3 bar, area 490.9 mm^2 (3.385 N/psi, given)",
             piston(kBore25mm_N_psi),
             cylinder,
             {{"coulomb_friction", "force_N", 5.5}}},
    RealCase{"x-ring-3bar",
             "pneumatic-cylinder-friction",
             {"x-ring257_3bar.csv"},
             {},
             "coulomb_friction",
             "6.5 N at 3 bar, half of the range; area 518.7 mm^2 (3.576 N/psi, given)",
             piston(kBore25_7mm_N_psi),
             cylinder,
             {{"coulomb_friction", "force_N", 6.5}}},
    seal("o-ring", {"o-ring_1bar.csv", "o-ring_3bar.csv", "o-ring_7bar.csv"}, "o-ring_5bar.csv",
         "3.9, 5.5, 7.0, 7.9 N at 1, 3, 5, 7 bar; a line through 1, 3 and 7 bar: 0.045 N/psi", kBore25mm_N_psi, 0.0453),
    seal("kdn", {"kdn_1bar.csv", "kdn_3bar.csv", "kdn_7bar.csv"}, "kdn_5bar.csv",
         "5.7, 5.7, 6.2, 6.8 N at 1, 3, 5, 7 bar; a line through 1, 3 and 7 bar: 0.014 N/psi", kBore25mm_N_psi, 0.0136),
    seal("x-ring", {"x-ring257_1bar.csv", "x-ring257_3bar.csv", "x-ring257_7bar.csv"}, "x-ring257_5bar.csv",
         "4.5, 6.5, 8.6, 15.0 N at 1, 3, 5, 7 bar; a line through 1, 3 and 7 bar: 0.124 N/psi", kBore25_7mm_N_psi,
         0.1244),
    RealCase{"tanks",
             "cascaded-tanks",
             {"tanks_estimation.csv"},
             {"tanks_validation.csv"},
             "force_lag (the second tank), nonlinear_viscosity (outflow by the square root), overflow",
             "two tanks without overflow 0.61 V rms (validation 0.68), with it 0.45 V (0.56)",
             kTank,
             tanks},
    lifted("cavatappi-400g", {"sample3_400g.csv"}, {"sample3_400g_long_hold.csv"}),
    lifted("cavatappi-long-hold", {"sample3_400g_long_hold.csv"}, {"sample3_400g.csv"}),
    lifted("cavatappi-100g", {"sample1_100g.csv"}, {}),
    lifted("cavatappi-300g", {"sample1_300g.csv"}, {}),
    lifted("cavatappi-500g", {"sample1_500g.csv"}, {}),
    leaking("leak-1", "leak_1.csv"),
    leaking("leak-2", "leak_2.csv"),
    leaking("leak-3", "leak_3.csv"),
    leaking("leak-4", "leak_4.csv"),
    leaking("leak-5", "leak_5.csv"),
    leaking("leak-6", "leak_6.csv"),
    leaking("leak-7", "leak_7.csv"),
    filled("fill-1", "fill_1.csv"),
    filled("fill-2", "fill_2.csv"),
    filled("fill-3", "fill_3.csv"),
    filled("fill-4", "fill_4.csv"),
    filled("fill-5", "fill_5.csv"),
    filled("fill-6", "fill_6.csv"),
    filled("fill-7", "fill_7.csv"),
    filled("fill-8", "fill_8.csv"),
};

std::string numbered(std::string_view what, std::size_t of, std::size_t i) {
  return std::string(what) + (of == 1 ? "" : "-" + std::to_string(i + 1));
}

}  // namespace

std::span<const RealCase> real_cases() {
  return kCases;
}

bool nominal_is_text(const RealCase& real) {
  return real.nominal.find('\n') != std::string::npos;
}

std::string train_name(const RealCase& real, std::size_t i) {
  return numbered("train", real.train.size(), i);
}

std::string heldout_name(const RealCase& real, std::size_t i) {
  return numbered("heldout", real.heldout.size(), i);
}

void write_real_case(const RealCase& real, const std::filesystem::path& source, const std::filesystem::path& out) {
  const auto folder = source / real.set;
  for (std::size_t i = 0; i < real.train.size(); ++i)
    messages::write_recording(out / train_name(real, i), real.convert(folder / real.train[i]));
  for (std::size_t i = 0; i < real.heldout.size(); ++i)
    messages::write_recording(out / heldout_name(real, i), real.convert(folder / real.heldout[i]));
  if (nominal_is_text(real)) write_text(out / "nominal-given.toml", real.nominal);
}

}  // namespace isorig::proof
