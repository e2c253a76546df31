#pragma once
#include <filesystem>
#include <string>

#include "model/actuator.hpp"

namespace isorig::sim {

/// An actuator on the rig: what the paper's table says of it, and the model that stands for it.
struct Specimen {
  std::string name;
  std::string sheath_material;  ///< "" for a plain McKibben
  double sheath_diameter_mm = 0.0;
  double initial_length_std_mm = 0.0;
  double minimum_length_std_mm = 0.0;
  model::ActuatorParameters actuator;
};

/// Reads a specimen's TOML. Throws base::ConfigError with all that is wrong.
[[nodiscard]] Specimen load_specimen(const std::filesystem::path& path);

}  // namespace isorig::sim
