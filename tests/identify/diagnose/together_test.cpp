// Which recordings may be one question.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <optional>

#include "concealed_specimen.hpp"
#include "identify/diagnose/diagnosis.hpp"
#include "identify/diagnose/force_zeros.hpp"
#include "identify/diagnose/forecast.hpp"
#include "identify/diagnose/guard/plausible.hpp"
#include "messages/recording_id.hpp"
#include "model/catalogue.hpp"
#include "model/composed.hpp"
#include "model/elements.hpp"

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

/// Two pressures that a frame stood still in are two recordings.
TEST(Together, RecordingsOfOneFrameAndTwoPressuresAreTwo) {
  messages::Recording one = at(10.0), other = at(10.0);
  one.pressure.emplace(messages::PressureSamples{{0.0, 1.0}, {10.0, 9.0}});
  other.pressure.emplace(messages::PressureSamples{{0.0, 1.0}, {10.0, 11.0}});
  const std::vector<std::string> names{"a", "b"};
  EXPECT_NO_THROW(refuse_repeated(std::vector{one, other}, names));
  EXPECT_THROW(refuse_repeated(std::vector{one, one}, names), std::invalid_argument);
  other.pressure.reset();  // a copy that has lost its pressure
  EXPECT_THROW(refuse_repeated(std::vector{one, other}, names), std::invalid_argument);
}

/// One session exported by two clocks, a copy short of a row, and two cuts that overlap are the same readings.
TEST(Together, TheSameReadingsAtOtherTimesAreOneRecording) {
  const messages::Recording whole = test::record({.seed = 3});
  const auto refused = [&](const messages::Recording& other) {
    try {
      refuse_repeated(std::vector{whole, other}, std::vector<std::string>{"a", "b"});
    } catch (const std::invalid_argument&) {
      return true;
    }
    return false;
  };
  const auto part = [&](std::size_t from, std::size_t to) {
    messages::Recording r = whole;
    for (auto* column : {&r.frame.t_s, &r.frame.position_mm, &r.frame.force_N}) {
      column->resize(to);
      column->erase(column->begin(), column->begin() + static_cast<std::ptrdiff_t>(from));
    }
    return r;
  };
  messages::Recording other_clock = whole;
  for (double& t_s : other_clock.frame.t_s) t_s = 1.0001 * t_s + 0.013;
  EXPECT_TRUE(refused(other_clock));
  EXPECT_TRUE(refused(part(0, whole.frame.size() - 1)));
  EXPECT_TRUE(refused(part(7, whole.frame.size())));
  EXPECT_FALSE(refused(test::record({.seed = 4}))) << "the same motion with other noise";
  const auto marks = [](const messages::Recording& r) { return messages::reading_marks(r); };
  const std::size_t half = whole.frame.size() / 2;
  EXPECT_FALSE(messages::share_readings(marks(part(0, half)), marks(part(half, whole.frame.size()))));
  EXPECT_TRUE(messages::share_readings(marks(part(0, half)), marks(part(half / 4, half + half / 4))));
}

/// One zero of the pressure for all, the model says which, and a prediction counts from it too.
TEST(Together, PressuresOfSeveralRecordingsCountFromOneZero) {
  const auto pressed = [](double nominal_psi, bool says, unsigned seed) {
    messages::Recording r = test::record({.coupling_N_mm_psi = 0.0, .seed = seed});
    messages::PressureSamples gauge;
    for (double t_s = r.frame.t_s.front(); t_s < r.frame.t_s.back(); t_s += 0.2) {
      gauge.t_s.push_back(t_s);
      gauge.pressure_psi.push_back(nominal_psi + 2.0 * std::sin(t_s / 7.0));
    }
    for (std::size_t k = 0; k < r.frame.size(); ++k)
      r.frame.force_N[k] += 0.2 * (nominal_psi + 2.0 * std::sin(r.frame.t_s[k] / 7.0));
    r.pressure = std::move(gauge);
    r.metadata.nominal_pressure_psi = says ? std::optional(nominal_psi) : std::nullopt;
    return r;
  };
  model::ModelSpec nominal = model::nominal_model("slse1");
  const model::Physics& coupling = *model::find_physics("pressure_coupling");
  nominal.parts.push_back(model::make_part(coupling, *model::find_law(coupling, "force")));
  for (const bool says : {true, false}) {
    const Diagnosis d = diagnose({pressed(15.0, says, 41), pressed(10.0, says, 42)}, {"a", "b"}, nominal, {}).diagnosis;
    EXPECT_TRUE(d.missing.empty()) << (says ? "stated" : "not stated")
                                   << (d.missing.empty() ? "" : d.missing[0].effect->name);
    ASSERT_TRUE(d.model.pressure_from_psi);
    // The mean of the gauge where nothing is stated: a sine of 2 psi over a number of periods that is not whole.
    EXPECT_NEAR(*d.model.pressure_from_psi, 10.0, says ? 1e-12 : 0.5);
    EXPECT_EQ(model::parse_model(model::model_text(d.model, ""), "m").pressure_from_psi, d.model.pressure_from_psi);
    // Of a third pressure, which this model has not seen, and whose own mean is another.
    messages::Recording third = pressed(13.0, says, 43);
    Excitation excitation = reconstruct_excitation(third);
    count_pressure_from(excitation, *d.model.pressure_from_psi);
    const Forecast predicted = forecast(d.model, excitation);
    double mean_N = 0.0;
    for (std::size_t k = 0; k < third.frame.size(); ++k)
      mean_N += (third.frame.force_N[k] - predicted.force_N[k]) / static_cast<double>(third.frame.size());
    EXPECT_NEAR(mean_N, 0.0, 0.02) << (says ? "stated" : "not stated");
  }
}

/// Every session is tared anew: which zero each recording has is no physics that the model lacks.
class Tares : public ::testing::Test {
 protected:
  static constexpr double kApart_N = 0.4;  // twenty noises of a reading

  static messages::Recording tared(double zero_N, double friction_N, unsigned seed) {
    messages::Recording r = test::record({.friction_N = friction_N, .seed = seed});
    for (double& force_N : r.frame.force_N) force_N += zero_N;
    return r;
  }
  static Diagnosis found(std::vector<messages::Recording> recordings) {
    const std::vector<std::string> names{"a", "b"};
    return diagnose(std::move(recordings), names, model::nominal_model("slse1"), {}).diagnosis;
  }
  static std::vector<std::string> names_of(const Diagnosis& d) {
    std::vector<std::string> out;
    for (const MissingEffect& missing : d.missing) out.emplace_back(missing.effect->name);
    return out;
  }
  /// Zeros of model.toml with their intervals, by recording.
  static std::map<double, NamedValue> zeros_of(const Diagnosis& d) {
    std::map<double, NamedValue> out;
    for (std::size_t p = 0; p < d.model.parts.size(); ++p)
      if (d.model.parts[p].physics->name == "force_zero") out[d.model.parts[p].parameters[0]] = d.model_numbers[p][0];
    return out;
  }
  static std::vector<std::string> tares_listed(const Diagnosis& d) {
    std::vector<std::string> out;
    for (const DataFault& fault : d.faults)
      if (fault.kind == "tare") out.push_back(fault.text);
    return out;
  }
};

TEST_F(Tares, ThatDifferAreNoPhysicsWhateverTheOrder) {
  for (const bool reversed : {false, true}) {
    std::vector<messages::Recording> two{tared(0.0, 0.0, 11), tared(kApart_N, 0.0, 12)};
    if (reversed) std::swap(two[0], two[1]);
    const double id[] = {messages::recording_id(two[0]), messages::recording_id(two[1])};
    const Diagnosis d = found(two);
    EXPECT_EQ(d.verdict, Verdict::kConsistent) << reversed;
    const auto zeros = zeros_of(d);
    ASSERT_EQ(zeros.size(), 1u);
    const bool of_second = zeros.begin()->first == id[1];
    ASSERT_TRUE(of_second || zeros.begin()->first == id[0]);
    const double expected_N = of_second == !reversed ? kApart_N : -kApart_N;
    EXPECT_LE(zeros.begin()->second.low, expected_N);
    EXPECT_GE(zeros.begin()->second.high, expected_N);
    EXPECT_LT(zeros.begin()->second.high - zeros.begin()->second.low, 0.05 * kApart_N);
    EXPECT_THAT(tares_listed(d), ElementsAre(AllOf(HasSubstr(of_second ? "b: " : "a: "), HasSubstr("0.4 N"),
                                                   HasSubstr(expected_N > 0.0 ? "above" : "below"))));
    // The file keeps the zero with its recording, and another recording is predicted with the mean of both.
    const model::ModelSpec read = model::parse_model(model::model_text(d.model, ""), "m");
    const auto force_N = [&](double recording_id) {
      model::RunningModel running(read, {.elongation_at_zero_mm = 20.0, .recording_id = recording_id});
      running.reset({.elongation_mm = 20.0});
      return running.step({.elongation_mm = 20.0});
    };
    const double own_N = force_N(id[of_second ? 1 : 0]), longest_N = force_N(id[of_second ? 0 : 1]);
    EXPECT_NEAR(own_N - longest_N, zeros.begin()->second.value, 1e-9);
    EXPECT_NEAR(force_N(12345.0), 0.5 * (own_N + longest_N), 1e-9);
  }
}

TEST_F(Tares, ThatDifferLeaveTheNameOfWhatIsMissing) {
  const Diagnosis d = found({tared(0.0, 0.8, 13), tared(-kApart_N, 0.8, 14)});
  EXPECT_EQ(d.verdict, Verdict::kMissingPhysics);
  EXPECT_THAT(names_of(d), ElementsAre("coulomb_friction"));
  EXPECT_EQ(zeros_of(d).size(), 1u);
  EXPECT_TRUE(d.not_modelled.why.empty()) << d.not_modelled.why;
  // A recording that is left out is predicted with its own zero: its error is that of its noise, 0.02 N of a reading.
  int recordings = 0;
  for (const LeftOut& row : d.heldout.left_out) {
    if (row.by != "recording") continue;
    ++recordings;
    EXPECT_LT(row.model_rmse_N, 0.03) << row.value;
  }
  EXPECT_EQ(recordings, 2);
}

TEST_F(Tares, ThatAreAlikeAreNotListed) {
  const Diagnosis d = found({tared(0.1, 0.0, 16), tared(0.1, 0.0, 17)});
  EXPECT_EQ(d.verdict, Verdict::kConsistent);
  EXPECT_THAT(tares_listed(d), IsEmpty());
}

/// What a recording calls its nominal pressure may be what its force is counted from, the same in all: whether two
/// share a zero is asked of the gauge. Free zeros at 1, 3 and 7 bar had taken up what grows with the pressure.
TEST(Together, RecordingsThatWereReadAtOtherPressuresShareTheirZero) {
  const auto zeros = [](double first_psi, double second_psi, bool gauge) {
    std::vector<Series> series(2);
    for (std::size_t i = 0; i < 2; ++i) {
      Excitation& excitation = series[i].excitation;
      excitation.reference.recording_id = 10.0 + static_cast<double>(i);
      excitation.reference.duration_s = 100.0 - static_cast<double>(i);
      if (gauge) excitation.pressure_psi.assign(50, i == 0 ? first_psi : second_psi);
    }
    model::ModelSpec nominal = model::nominal_model("slse1");
    give_each_its_zero(series, nominal);
    return std::ranges::count(nominal.parts, &model::element::force_zero(), &model::Part::physics);
  };
  EXPECT_EQ(zeros(15.0, 15.3, true), 1) << "one pressure";
  EXPECT_EQ(zeros(15.0, 45.0, true), 0);
  EXPECT_EQ(zeros(0.0, 0.0, false), 1) << "no gauge: by what they call nominal";
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

TEST(Together, AStretchThatNobodyStatedIsWarnedOf) {
  const auto warnings = [](const messages::Recording& recording) {
    return diagnose({recording}, {"a"}, model::nominal_model("slse1"), {}).diagnosis.warnings;
  };
  messages::Recording recording = at(10.0);
  recording.metadata.nominal_pressure_psi = 10.0;
  recording.metadata.pressurized_rest_length_mm = recording.metadata.rest_length_mm;
  EXPECT_THAT(warnings(recording), IsEmpty());
  recording.metadata.pressurized_rest_length_mm.reset();
  EXPECT_THAT(warnings(recording), ElementsAre(HasSubstr("no pressurized_rest_length_mm")));
  recording.metadata.nominal_pressure_psi.reset();
  EXPECT_THAT(warnings(recording), IsEmpty()) << "a spring, a tape, a tissue";
}

}  // namespace
}  // namespace isorig::identify
