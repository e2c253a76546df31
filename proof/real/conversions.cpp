#include "proof/real/conversions.hpp"

#include <algorithm>
#include <cmath>
#include <sstream>
#include <stdexcept>

#include "base/text_file.hpp"

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

Recording with_pressure(Recording r, const std::vector<double>& pressure_psi) {
  double mean = 0.0;
  for (const double p : pressure_psi) mean += p / static_cast<double>(pressure_psi.size());
  r.metadata.nominal_pressure_psi = mean;
  r.pressure = messages::PressureSamples{r.frame.t_s, pressure_psi};
  return r;
}

/// Nothing but pressures, of which one reading answers to the next.
Recording closed_volume(std::string specimen, std::vector<double> t_s, std::vector<double> pressure_psi) {
  Recording r;
  r.metadata.specimen = std::move(specimen);
  r.metadata.output = messages::Output::kPressure;
  r.pressure = messages::PressureSamples{std::move(t_s), std::move(pressure_psi)};
  return r;
}

}  // namespace

Recording emps_axis(const std::filesystem::path& file) {
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

Recording elastomer_cycle(const std::filesystem::path& file) {
  constexpr std::string_view kNames[] = {"time_s", "displacement_m", "force_N"};
  auto c = read_columns(file, kNames);
  return recording_of("VHB 4910", 80.0, std::move(c[0]), scaled(std::move(c[1]), 1e3), std::move(c[2]));
}

Recording silicone(const std::filesystem::path& file) {
  constexpr std::string_view kNames[] = {"time_s", "extension_m", "force_N"};
  auto c = read_columns(file, kNames);
  Recording r = recording_of("silicone", 33.0, std::move(c[0]), scaled(std::move(c[1]), 1e3), std::move(c[2]));
  r.metadata.units_stated = true;  // pulled to more than ten times its length
  return r;
}

Recording cylinder(const std::filesystem::path& file) {
  constexpr std::string_view kNames[] = {"time_s", "displacement_m", "pressure_Pa", "force_N"};
  auto c = read_columns(file, kNames);
  constexpr std::ptrdiff_t kDeviating = 15;  // the author leaves them out as well
  if (std::ssize(c[0]) <= kDeviating) throw std::runtime_error(file.string() + ": no more than 15 rows");
  for (auto& column : c) column.erase(column.begin(), column.begin() + kDeviating);
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

Recording filling(const std::filesystem::path& file) {
  constexpr std::string_view kNames[] = {"time_s", "pressure_kPa"};
  auto c = read_columns(file, kNames);
  return closed_volume("Festo muscle", std::move(c[0]), scaled(std::move(c[1]), 1e3 / kPascal_per_psi));
}

/// By the conversion of a later script of the same laboratory, kPa = 0.7654 counts - 18.609: near, and perhaps not this
/// sensor's. A relaxation time does not depend on it.
Recording leak(const std::filesystem::path& file) {
  constexpr std::string_view kNames[] = {"time_s", "pressure_sensor_counts"};
  auto c = read_columns(file, kNames);
  for (double& counts : c[1]) counts = (0.7654 * counts - 18.609) * 1e3 / kPascal_per_psi;
  return closed_volume("Festo muscle", std::move(c[0]), std::move(c[1]));
}

/// A muscle that lifts a weight: its position answers to the pressure.
Recording lifting_muscle(const std::filesystem::path& file) {
  constexpr std::string_view kNames[] = {"time_s", "displacement_mm", "pressure_kPa"};
  auto c = read_columns(file, kNames);
  const auto pressure_psi = scaled(c[2], 1e3 / kPascal_per_psi);
  Recording r;
  r.metadata.specimen = "cavatappi muscle";
  r.metadata.output = messages::Output::kPosition;
  r.frame = {c[0], std::move(c[1]), std::vector<double>(c[0].size(), 0.0)};
  r.pressure = messages::PressureSamples{std::move(c[0]), pressure_psi};
  return r;
}

/// Two tanks in series as a specimen: the force is the level, and the position the volume pumped so far. A tank that
/// drains in proportion to its level is then a Maxwell element, one that drains with its square root has a power-law
/// dashpot.
Recording tanks(const std::filesystem::path& file) {
  constexpr std::string_view kNames[] = {"time_s", "pump_V", "level_sensor_V"};
  auto c = read_columns(file, kNames);
  constexpr double kVolume_per_mm = 100.0;  // V s of the pump
  std::vector<double> pumped_mm(c[1].size(), 0.0);
  for (std::size_t i = 1; i < pumped_mm.size(); ++i)
    pumped_mm[i] = pumped_mm[i - 1] + c[1][i - 1] * (c[0][i] - c[0][i - 1]) / kVolume_per_mm;  // held between samples
  return recording_of("cascaded tanks", 500.0, std::move(c[0]), std::move(pumped_mm), std::move(c[2]));
}

}  // namespace isorig::proof
