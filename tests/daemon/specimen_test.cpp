#include "daemon/rig/specimen.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>

#include "base/toml_reader.hpp"

namespace isorig::daemon {
namespace {

using testing::HasSubstr;

Specimen specimen(const std::string& rest_lengths) {
  return parse_specimen(R"(name = "mesh-6mm"
[geometry]
initial_length_mm = 100.0
minimum_length_mm = 80.0
minimum_length_psi = 20.0
contraction_exponent = 2.0
)" + rest_lengths,
                        "specimen.toml");
}

std::string objection(const std::string& rest_lengths) {
  try {
    (void)specimen(rest_lengths);
  } catch (const base::ConfigError& error) {
    return error.what();
  }
  return "none";
}

TEST(Specimen, ItsFreeLengthFollowsThePowerOfThePressureWhereItWasNotMeasured) {
  const auto s = specimen("");
  EXPECT_DOUBLE_EQ(s.pressurized_rest_length_mm(0.0), 100.0);
  EXPECT_DOUBLE_EQ(s.pressurized_rest_length_mm(10.0), 95.0) << "100 - 20 (10 / 20)^2";
  EXPECT_DOUBLE_EQ(s.pressurized_rest_length_mm(20.0), 80.0);
  EXPECT_DOUBLE_EQ(s.pressurized_rest_length_mm(-0.1), 100.0) << "a sensor's zero is not below it";
}

TEST(Specimen, MeasuredFreeLengthsGoBeforeTheLawAndEndWhereTheyEnd) {
  const auto s = specimen("[rest_lengths]\npressure_psi = [0.0, 10.0, 15.0]\nlength_mm = [101.0, 92.0, 88.0]\n");
  EXPECT_DOUBLE_EQ(s.pressurized_rest_length_mm(0.0), 101.0);
  EXPECT_DOUBLE_EQ(s.pressurized_rest_length_mm(10.0), 92.0);
  EXPECT_DOUBLE_EQ(s.pressurized_rest_length_mm(12.5), 90.0) << "linear between two";
  EXPECT_DOUBLE_EQ(s.pressurized_rest_length_mm(18.0), 88.0) << "nobody measured further";
}

TEST(Specimen, MeasuredFreeLengthsThatDoNotFitAreNamed) {
  EXPECT_THAT(objection("[rest_lengths]\npressure_psi = [0.0, 10.0]\nlength_mm = [101.0]\n"),
              HasSubstr("`length_mm` needs as many values as `pressure_psi`"));
  EXPECT_THAT(objection("[rest_lengths]\npressure_psi = []\nlength_mm = []\n"), HasSubstr("at least one"));
  EXPECT_THAT(objection("[rest_lengths]\npressure_psi = [5.0, 5.0]\nlength_mm = [99.0, 98.0]\n"),
              HasSubstr("`pressure_psi` has to increase"))
      << "twice the same pressure has no length between them";
}

}  // namespace
}  // namespace isorig::daemon
