#include "proof/real/convert.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <sstream>
#include <stdexcept>

#include "base/text_file.hpp"
#include "proof/sealed.hpp"

namespace isorig::proof {

std::vector<std::vector<double>> read_columns(const std::filesystem::path& file,
                                              std::span<const std::string_view> names) {
  std::istringstream text(base::read_text_file(file));
  std::string line, cell;
  if (!std::getline(text, line)) throw std::runtime_error(file.string() + ": empty");
  if (!line.empty() && line.back() == '\r') line.pop_back();
  std::vector<std::size_t> wanted(names.size(), std::string::npos);
  std::istringstream header(line);
  for (std::size_t column = 0; std::getline(header, cell, ','); ++column)
    for (std::size_t i = 0; i < names.size(); ++i)
      if (cell == names[i]) wanted[i] = column;
  for (std::size_t i = 0; i < names.size(); ++i)
    if (wanted[i] == std::string::npos)
      throw std::runtime_error(file.string() + ": no column " + std::string(names[i]));

  std::vector<std::vector<double>> columns(names.size());
  for (std::size_t number = 2; std::getline(text, line); ++number) {
    std::vector<double> row;
    std::istringstream cells(line);
    while (std::getline(cells, cell, ',')) {
      try {
        row.push_back(std::stod(cell));
      } catch (const std::exception&) {
        row.push_back(NAN);
      }
    }
    std::vector<double> picked;
    for (const std::size_t column : wanted) {
      if (column >= row.size() || !std::isfinite(row[column]))
        throw std::runtime_error(file.string() + ":" + std::to_string(number) + ": not a number");
      picked.push_back(row[column]);
    }
    if (!columns[0].empty() && picked[0] <= columns[0].back()) continue;
    for (std::size_t i = 0; i < picked.size(); ++i) columns[i].push_back(picked[i]);
  }
  if (columns[0].empty()) throw std::runtime_error(file.string() + ": no rows");
  return columns;
}

namespace {

using messages::Recording;
constexpr double kPascal_per_psi = 6894.757;

std::vector<double> scaled(std::vector<double> values, double factor) {
  for (double& v : values) v *= factor;
  return values;
}

Recording recording_of(std::string specimen, double length_mm, std::vector<double> t_s, std::vector<double> position_mm,
                       std::vector<double> force_N) {
  Recording r;
  r.metadata.specimen = std::move(specimen);
  r.metadata.rest_length_mm = length_mm;
  r.frame = {std::move(t_s), std::move(position_mm), std::move(force_N)};
  return r;
}

/// Keeps what `keep(i, t)` says.
template <class Keep>
void thin(messages::FrameSamples& frame, Keep&& keep) {
  messages::FrameSamples kept;
  for (std::size_t i = 0; i < frame.size(); ++i) {
    if (!keep(i, frame.t_s[i])) continue;
    kept.t_s.push_back(frame.t_s[i]);
    kept.position_mm.push_back(frame.position_mm[i]);
    kept.force_N.push_back(frame.force_N[i]);
  }
  frame = std::move(kept);
}

Recording emps(const std::filesystem::path& file) {
  constexpr std::string_view kNames[] = {"time_s", "position_m", "drive_force_N"};
  auto c = read_columns(file, kNames);
  return recording_of("EMPS linear axis", 250.0, std::move(c[0]), scaled(std::move(c[1]), 1e3), std::move(c[2]));
}

/// Arc length on a radius of 100 mm, for 1 kg there. What is measured is the motion alone: its acceleration
/// (a parabola through nine frames, 33 ms of a period of 590 ms) is the force that must have acted, and the
/// weight, known from mass and inertia of the pendulum, is where the search starts: 113.7 1/s^2 * 0.1 m * 1
/// kg = 11.37 N.
Recording pendulum(const std::filesystem::path& file) {
  constexpr std::string_view kNames[] = {"time_s", "angle_from_hanging_rad"};
  const auto c = read_columns(file, kNames);
  constexpr double kRadius_mm = 100.0;
  constexpr std::ptrdiff_t kReach = 4;
  std::vector<double> arc_mm = scaled(c[1], kRadius_mm), t_s, force_N, position_mm;
  for (std::ptrdiff_t i = kReach; i + kReach < std::ssize(arc_mm); ++i) {
    // Evenly spaced frames: the parabola's normal equations are sums of powers.
    double s2 = 0.0, s4 = 0.0, y0 = 0.0, y2 = 0.0;
    for (std::ptrdiff_t j = -kReach; j <= kReach; ++j) {
      const auto u = static_cast<double>(j);
      s2 += u * u;
      s4 += u * u * u * u;
      y0 += arc_mm[i + j];
      y2 += u * u * arc_mm[i + j];
    }
    constexpr double kCount = 2 * kReach + 1;
    const double bend = (kCount * y2 - s2 * y0) / (kCount * s4 - s2 * s2);
    const double dt_s = (c[0][i + kReach] - c[0][i - kReach]) / (2.0 * kReach);
    t_s.push_back(c[0][i]);
    position_mm.push_back((y0 - bend * s2) / kCount);
    force_N.push_back(-1e-3 * 2.0 * bend / (dt_s * dt_s));
  }
  Recording r = recording_of("pendulum", kRadius_mm, std::move(t_s), std::move(position_mm), std::move(force_N));
  thin(r.frame, [](std::size_t, double time_s) { return time_s > 0.1; });  // the hand has let go
  return r;
}

Recording elastomer(const std::filesystem::path& file) {
  constexpr std::string_view kNames[] = {"time_s", "displacement_m", "force_N"};
  auto c = read_columns(file, kNames);
  Recording r = recording_of("VHB 4910", 80.0, std::move(c[0]), scaled(std::move(c[1]), 1e3), std::move(c[2]));
  thin(r.frame, [](std::size_t i, double t_s) { return t_s < 20.0 || (t_s < 200.0 ? i % 10 == 0 : i % 50 == 0); });
  return r;
}

Recording silicone(const std::filesystem::path& file) {
  constexpr std::string_view kNames[] = {"time_s", "extension_m", "force_N"};
  auto c = read_columns(file, kNames);
  return recording_of("silicone", 33.0, std::move(c[0]), scaled(std::move(c[1]), 1e3), std::move(c[2]));
}

Recording with_pressure(Recording r, const std::vector<double>& pressure_psi) {
  double mean = 0.0;
  for (const double p : pressure_psi) mean += p / static_cast<double>(pressure_psi.size());
  r.metadata.nominal_pressure_psi = mean;
  r.pressure = messages::PressureSamples{r.frame.t_s, pressure_psi};
  return r;
}

Recording cylinder(const std::filesystem::path& file) {
  constexpr std::string_view kNames[] = {"time_s", "displacement_m", "pressure_Pa", "force_N"};
  auto c = read_columns(file, kNames);
  for (auto& column : c) column.erase(column.begin(), column.begin() + 15);  // as the author does
  const auto pressure_psi = scaled(c[2], 1.0 / kPascal_per_psi);
  Recording r = with_pressure(
      recording_of("pneumatic cylinder", 100.0, std::move(c[0]), scaled(std::move(c[1]), 1e3), std::move(c[3])),
      pressure_psi);
  r.metadata.nominal_pressure_psi = 0.0;  // force = pressure times area, from nothing
  return r;
}

Recording festo(const std::filesystem::path& file) {
  constexpr std::string_view kNames[] = {"time_s", "length_m", "pressure_kPa", "force_N"};
  auto c = read_columns(file, kNames);
  constexpr double kRest_mm = 182.0;
  std::vector<double> position_mm;
  for (const double length_m : c[1]) position_mm.push_back(1e3 * length_m - kRest_mm);
  const auto pressure_psi = scaled(c[2], 1e3 / kPascal_per_psi);
  return with_pressure(recording_of("Festo muscle", kRest_mm, std::move(c[0]), std::move(position_mm), std::move(c[3])),
                       pressure_psi);
}

constexpr std::string_view kAxis = R"(format = "isorig-model/1"
name = "mass and damper"
[[part]]
physics = "mass"
[[part]]
physics = "dashpot"
[[part]]
physics = "constant"
)";
constexpr std::string_view kSwing = R"(format = "isorig-model/1"
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
constexpr std::string_view kOneTime = R"(format = "isorig-model/1"
name = "one relaxation time"
[[part]]
physics = "spring"
[[part]]
physics = "maxwell"
time_constant_s = 10.0
[[part]]
physics = "constant"
)";
constexpr std::string_view kSpring = R"(format = "isorig-model/1"
name = "linear spring"
[[part]]
physics = "spring"
[[part]]
physics = "constant"
)";
constexpr std::string_view kPiston = R"(format = "isorig-model/1"
name = "pressure times area"
[[part]]
physics = "pressure_coupling"
law = "force"
force_N_psi = 3.385
fixed = true
[[part]]
physics = "constant"
)";
constexpr std::string_view kMuscle = R"(format = "isorig-model/1"
name = "force in proportion to the pressure"
[[part]]
physics = "pressure_coupling"
law = "force"
[[part]]
physics = "constant"
)";

const std::array kCases{
    RealCase{"emps",
             {"emps/emps_estimation.csv"},
             "coulomb_friction, then friction_asymmetry",
             "M 95.11 kg, Fv 203.5 N s/m, Fc 20.39 N, offset -3.16 N (Janot, Gautier and Brunot 2019)",
             kAxis,
             emps},
    RealCase{"pendulum",
             {"pbj-pendulum/no_damper_trial_01.csv"},
             "coulomb_friction",
             "mass 1 kg by construction; friction 0.28 to 0.32 N per kg at 100 mm; no viscosity",
             kSwing,
             pendulum},
    RealCase{"elastomer",
             {"vhb4910-tape/relax_stretch2.0.csv"},
             "second_relaxation",
             "three times in the hold: 3.5, 28 and 341 s",
             kOneTime,
             elastomer},
    RealCase{"silicone",
             {"elastomer-tensile/dragon_skin_30.csv"},
             "strain_stiffening",
             "residual of a line 9.7 %",
             kSpring,
             silicone},
    RealCase{"festo",
             {"festo-bpa-10mm-isometric/len20cm_short50_test9.csv"},
             "pressure_threshold",
             "about 380 kPa (55 psi); residual of a line 44.5 %, with a threshold 10.0 %; load cell clipped at "
             "-8.735 N",
             kMuscle,
             festo},
    RealCase{"cylinder",
             {"pneumatic-cylinder-friction/o-ring_3bar.csv"},
             "coulomb_friction",
             "5.5 N at 3 bar, area 490.9 mm^2 (3.385 N/psi, given)",
             kPiston,
             cylinder},
    RealCase{"cylinder-pressures",
             {"pneumatic-cylinder-friction/o-ring_1bar.csv", "pneumatic-cylinder-friction/o-ring_3bar.csv",
              "pneumatic-cylinder-friction/o-ring_5bar.csv", "pneumatic-cylinder-friction/o-ring_7bar.csv"},
             "coulomb_friction, then friction_with_pressure",
             "3.9, 5.5, 7.0, 7.9 N at 1, 3, 5, 7 bar: about 0.046 N/psi",
             kPiston,
             cylinder},
};

}  // namespace

std::span<const RealCase> real_cases() {
  return kCases;
}

std::string recording_name(const RealCase& real, std::size_t i) {
  return real.files.size() == 1 ? "recording" : "recording-" + std::to_string(i + 1);
}

void write_real_case(const RealCase& real, const std::filesystem::path& source, const std::filesystem::path& out) {
  for (std::size_t i = 0; i < real.files.size(); ++i)
    messages::write_recording(out / recording_name(real, i), real.convert(source / real.files[i]));
  write_text(out / "nominal.toml", real.nominal_toml);
}

}  // namespace isorig::proof
