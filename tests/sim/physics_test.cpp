#include "sim/physics.hpp"

#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>

#include "driver.hpp"

namespace isorig::sim {
namespace {

using testing::Driver;
using testing::shipped;

constexpr const char* kHead = "format = 'isorig-model/1'\nname = 'test'\n";

PhysicsConfig physics(const std::string& parts, bool replaces) {
  return {model::parse_model(kHead + parts, "test.toml"), replaces, 15.0};
}

/// Measured rest lengths, as docs/config.md has them, are the daemon's business: the simulation takes its own.
TEST(SpecimenPhysics, ASpecimenWithMeasuredRestLengthsIsTheSameSpecimen) {
  const auto folder = std::filesystem::temp_directory_path() / ("isorig-lengths-" + std::to_string(::getpid()));
  std::filesystem::create_directories(folder);
  const auto file = folder / "measured.toml";
  std::filesystem::copy_file(testing::config_path("specimens/control2.toml"), file);
  std::ofstream(file, std::ios::app) << "\n[rest_lengths]\npressure_psi = [5, 10]\nlength_mm = [92.8, 88.4]\n";
  const auto plain = load_specimen(testing::config_path("specimens/control2.toml")), measured = load_specimen(file);
  EXPECT_EQ(measured.name, plain.name);
  EXPECT_EQ(measured.actuator.initial_length_mm, plain.actuator.initial_length_mm);
  std::filesystem::remove_all(folder);
}

TEST(SpecimenPhysics, EffectsAddToTheActuator) {
  const auto specimen = load_specimen(testing::config_path("specimens/control2.toml"));
  const auto friction =
      physics("[[part]]\nphysics = 'coulomb_friction'\nlaw = 'jenkins'\npresliding_mm = 0.01\nforce_N = 0.4\n", false);
  SpecimenPhysics plain(specimen.actuator, std::nullopt);
  SpecimenPhysics rough(specimen.actuator, friction);
  for (int i = 1; i <= 1000; ++i) {
    EXPECT_NEAR(plain.step(0.0, 0.0, 0.015 * i, 1e-3), rough.step(0.0, 0.0, 0.015 * i, 1e-3), 1e-12);
  }
  double difference_N = 0.0;
  for (int i = 1; i <= 200; ++i) {
    difference_N = rough.step(0.01 * i, 10.0, 15.0, 1e-3) - plain.step(0.01 * i, 10.0, 15.0, 1e-3);
  }
  EXPECT_NEAR(difference_N, 0.4, 1e-9);
  for (int i = 1; i <= 200; ++i) {
    difference_N = rough.step(2.0 - 0.01 * i, -10.0, 15.0, 1e-3) - plain.step(2.0 - 0.01 * i, -10.0, 15.0, 1e-3);
  }
  EXPECT_NEAR(difference_N, -0.4, 1e-9);
}

TEST(SpecimenPhysics, AnIdentifiedModelTakesTheSpecimensPlace) {
  SimConfig config = shipped();
  config.physics = physics("[[part]]\nphysics = 'spring'\nstiffness_N_mm = 2.5\n", true);
  Rig rig(config);
  Driver d(rig);
  d.target_psi = 15.0;
  d.run(6.0);
  d.move(2.0, 10.0);
  d.run(2.0);
  const Truth truth = rig.truth();
  const auto& a = rig.actuator();
  EXPECT_NEAR(truth.force_N, 2.5 * (2.0 + a.initial_length_mm() - a.rest_length_mm(truth.pressure_psi)), 1e-9);
}

TEST(SpecimenPhysics, IsReadFromTheRigsFile) {
  const auto directory = std::filesystem::path(::testing::TempDir()) / "isorig_physics";
  std::filesystem::create_directories(directory);
  std::ofstream(directory / "friction.toml") << kHead << "[[part]]\nphysics = 'coulomb_friction'\nforce_N = 0.4\n";
  const auto read = [&](const std::string& table) {
    const auto document =
        base::TomlDocument::parse_text("[sim]\nspecimen = 'x.toml'\n[sim.physics]\n" + table, "rig.toml");
    SimConfig config = read_sim(document.root(), directory);
    document.finish();
    return config;
  };
  const auto config = read("effects = 'friction.toml'\nnominal_pressure_psi = 10.0\n");
  ASSERT_TRUE(config.physics);
  EXPECT_TRUE(config.physics->spec.has("coulomb_friction"));
  EXPECT_FALSE(config.physics->replaces_actuator);
  EXPECT_EQ(config.physics->nominal_pressure_psi, 10.0);
  EXPECT_TRUE(read("model = 'friction.toml'\nnominal_pressure_psi = 10.0\n").physics->replaces_actuator);
  EXPECT_THROW(read("nominal_pressure_psi = 10.0\n"), base::ConfigError);
  EXPECT_THROW(read("model = 'a.toml'\neffects = 'b.toml'\nnominal_pressure_psi = 10.0\n"), base::ConfigError);
  EXPECT_THROW(read("effects = 'absent.toml'\nnominal_pressure_psi = 10.0\n"), base::ConfigError);
}

}  // namespace
}  // namespace isorig::sim
