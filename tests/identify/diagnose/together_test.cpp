// Which recordings may be one question.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "concealed_specimen.hpp"
#include "identify/diagnose/diagnosis.hpp"
#include "identify/diagnose/guard/plausible.hpp"
#include "model/catalogue.hpp"

namespace isorig::identify {
namespace {

using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

messages::Recording at(std::optional<double> nominal_psi, const std::string& specimen = "one", bool again = false) {
  static const messages::Recording recorded = test::record({}), other = test::record({.seed = 2});
  messages::Recording out = again ? other : recorded;
  out.metadata.nominal_pressure_psi = nominal_psi;
  out.metadata.specimen = specimen;
  return out;
}

std::string refusal(const std::vector<messages::Recording>& recordings, const std::vector<std::string>& names,
                    const model::ModelSpec& nominal) {
  try {
    refuse_several_pressures(recordings, names, nominal);
  } catch (const std::invalid_argument& e) {
    return e.what();
  }
  return {};
}

TEST(Together, SeveralPressuresAreRefusedWithTheRecordingsOfEach) {
  const auto slse1 = model::nominal_model("slse1");
  const std::vector recordings{at(10.0), at(5.0), at(10.2), at(20.0)};
  const std::vector<std::string> names{"a", "b", "c", "d"};
  EXPECT_THAT(refusal(recordings, names, slse1), AllOf(HasSubstr("5 to 20 psi"), HasSubstr("\n  5 psi: b\n"),
                                                       HasSubstr("\n  10 psi: a c\n"), HasSubstr("\n  20 psi: d")));
  // Before any work: not after minutes.
  EXPECT_THROW(static_cast<void>(diagnose({at(10.0), at(5.0, "one", true)}, {"a", "b"}, slse1, {})),
               std::invalid_argument);
}

TEST(Together, OnePressureIsOneQuestion) {
  const auto slse1 = model::nominal_model("slse1");
  EXPECT_EQ(refusal({}, {}, slse1), "");
  EXPECT_EQ(refusal({at(10.0), at(10.2)}, {"a", "b"}, slse1), "");
  EXPECT_EQ(refusal({at(-5.0)}, {"a"}, slse1), "");
  EXPECT_EQ(refusal({at(std::nullopt), at(std::nullopt)}, {"a", "b"}, slse1), "");
}

TEST(Together, TheSameRecordingTwiceIsRefusedByName) {
  try {
    // Another name of its specimen makes it no other recording.
    static_cast<void>(diagnose({at(10.0), at(10.0, "one", true), at(10.0, "two")}, {"a", "b", "c"},
                               model::nominal_model("slse1"), {}));
    FAIL() << "not refused";
  } catch (const std::invalid_argument& e) {
    EXPECT_THAT(e.what(), HasSubstr("c: the same samples as a"));
  }
}

TEST(Together, AModelDrivenByThePressureTakesAllOfThem) {
  auto nominal = model::nominal_model("slse1");
  const model::Physics* coupling = model::find_physics("pressure_coupling");
  ASSERT_NE(coupling, nullptr);
  nominal.parts.push_back(model::make_part(*coupling, coupling->laws[0]));
  EXPECT_EQ(refusal({at(5.0), at(20.0)}, {"a", "b"}, nominal), "");
}

TEST(Together, RecordingsOfSeveralSpecimensAreWarnedOf) {
  const auto warnings = [](const std::string& second) {
    return diagnose({at(10.0), at(10.0, second, true)}, {"a", "b"}, model::nominal_model("slse1"), {})
        .diagnosis.warnings;
  };
  EXPECT_THAT(warnings("one"), IsEmpty());
  EXPECT_THAT(warnings("two"), ElementsAre(AllOf(HasSubstr("2 specimens"), HasSubstr("\"one\", \"two\""))));
}

}  // namespace
}  // namespace isorig::identify
