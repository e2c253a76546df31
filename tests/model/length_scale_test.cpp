#include "model/length_scale.hpp"

#include <gtest/gtest.h>

#include "base/toml_reader.hpp"
#include "model/catalogue.hpp"

namespace isorig::model {
namespace {

const Law& law(std::string_view physics, std::string_view name) {
  return *find_law(*find_physics(physics), name);
}

TEST(LengthScale, IsTheNearestPowerOfTenToThePapersStroke) {
  EXPECT_EQ(length_scale_of_stroke(8.0), 1.0);
  EXPECT_EQ(length_scale_of_stroke(2.6), 1.0);
  EXPECT_EQ(length_scale_of_stroke(25.0), 1.0);
  EXPECT_DOUBLE_EQ(length_scale_of_stroke(80.0), 10.0);
  EXPECT_DOUBLE_EQ(length_scale_of_stroke(0.08), 0.01);
  EXPECT_EQ(length_scale_of_stroke(0.0), 1.0);
}

TEST(LengthScale, ScalesLengthsVelocitiesAndTheirInverseAndNothingElse) {
  const Law& known = law("coulomb_friction", "stribeck");
  const Law& scaled = law_at(known, 100.0);
  ASSERT_EQ(scaled.parameters.size(), 3U);
  EXPECT_DOUBLE_EQ(scaled.parameters[0].upper, 100.0 * known.parameters[0].upper);  // presliding_mm
  EXPECT_DOUBLE_EQ(scaled.parameters[1].lower, 100.0 * known.parameters[1].lower);  // stribeck_velocity_mm_s
  EXPECT_EQ(scaled.parameters[2].upper, known.parameters[2].upper);                 // static_excess
  for (std::size_t i = 0; i < known.parameters[0].starts.size(); ++i)
    EXPECT_DOUBLE_EQ(scaled.parameters[0].starts[i], 100.0 * known.parameters[0].starts[i]);
  const Law& fung = law("quasi_linear_viscoelasticity", "fung_arm");
  EXPECT_DOUBLE_EQ(law_at(fung, 100.0).parameters[1].upper, 0.01 * fung.parameters[1].upper);  // strain_exponent_1_mm
  EXPECT_EQ(law_at(fung, 100.0).parameters[0].upper, fung.parameters[0].upper);                // time_constant_s
}

TEST(LengthScale, IsMadeOnceAndOnlyWhereThereAreLengths) {
  const Law& known = law("coulomb_friction", "dahl");
  EXPECT_EQ(&law_at(known, 10.0), &law_at(known, 10.0));
  EXPECT_NE(&law_at(known, 10.0), &known);
  EXPECT_EQ(&law_at(known, 1.0), &known);
  const Law& lag = law("force_lag", "first_order");
  EXPECT_EQ(&law_at(lag, 10.0), &lag);
}

TEST(LengthScale, AModelOfALongSpecimenCanBeReadAgain) {
  ModelSpec spec = nominal_model("slse1");
  const Physics& friction = *find_physics("coulomb_friction");
  spec.parts.push_back(make_part(friction, law("coulomb_friction", "dahl")));
  set_length_scale(spec, 100.0);
  spec.parts.back().parameters[0] = 40.0;  // mm; 1 at most in a specimen as the paper's
  const std::string text = model_text(spec);
  const ModelSpec read = parse_model(text, "read");
  EXPECT_EQ(read.length_scale, 100.0);
  EXPECT_EQ(read.parts.back().parameters[0], 40.0);
  EXPECT_EQ(model_text(read), text);

  std::string without = text;
  const std::size_t line = without.find("length_scale");
  without.erase(line, without.find('\n', line) + 1 - line);
  EXPECT_THROW((void)parse_model(without, "read"), base::ConfigError);
}

TEST(LengthScale, OfAGivenModelStaysWhereItsNumbersNeedIt) {
  ModelSpec spec = nominal_model("slse1");
  spec.parts.push_back(make_part(*find_physics("coulomb_friction"), law("coulomb_friction", "dahl")));
  set_length_scale(spec, 100.0);
  spec.parts.back().parameters[0] = 40.0;  // mm
  ModelSpec given = spec;
  set_length_scale_if_in_range(given, 1.0);
  EXPECT_EQ(given.length_scale, 100.0);
  EXPECT_EQ(model_text(parse_model(model_text(given), "read")), model_text(given));
  given.parts.back().parameters[0] = 0.5;
  set_length_scale_if_in_range(given, 1.0);
  EXPECT_EQ(given.length_scale, 1.0);
}

}  // namespace
}  // namespace isorig::model
