#pragma once
#include <filesystem>
#include <string>
#include <vector>

namespace isorig::daemon {

/// What the daemon has to know of the actuator on the rig: its name and its lengths, for the recording. The same
/// file carries the simulation's model, which is not read here (sim/specimen.hpp).
struct Specimen {
  std::string name;
  std::string text;                ///< the whole file, kept in the recording
  double rest_length_mm = 0.0;     ///< unpressurized: the zero of position
  double minimum_length_mm = 0.0;  ///< free length at minimum_length_psi
  double minimum_length_psi = 20.0;
  double contraction_exponent = 2.0;  ///< free contraction ~ p^this, where it was not measured
  std::vector<double> measured_psi;   ///< [rest_lengths], where it was
  std::vector<double> measured_mm;

  /// Free length at a pressure: the measured one, between two of them linear; without measurements
  /// IL - (IL - ML) (p / p_ML)^n, as the simulation has it (model/actuator.hpp).
  [[nodiscard]] double pressurized_rest_length_mm(double pressure_psi) const;
};

/// Both throw base::ConfigError with everything that is wrong.
[[nodiscard]] Specimen load_specimen(const std::filesystem::path& path);
[[nodiscard]] Specimen parse_specimen(const std::string& text, const std::string& name);

}  // namespace isorig::daemon
