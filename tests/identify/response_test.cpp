// Recordings whose output is a position or a pressure. What is fitted is made here, by small explicit steps that share
// no line with the models under test.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <functional>
#include <nlohmann/json.hpp>
#include <random>

#include "base/toml_reader.hpp"
#include "identify/response/response_diagnosis.hpp"
#include "identify/response/response_report.hpp"

namespace isorig::identify::response {
namespace {

using messages::Output;
using messages::Recording;
using ::testing::AllOf;
using ::testing::Contains;
using ::testing::Each;
using ::testing::Field;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::SizeIs;

struct Muscle {
  double per_psi = -0.4;                                          ///< immediate stroke, mm/psi
  std::vector<std::pair<double, double>> creep = {{-0.15, 2.0}};  ///< mm/psi, s
  double play_mm = 0.0, play_psi = 1.5;
  double drift_mm_h = 0.0;
  double noise_mm = 0.004;
  unsigned seed = 5;
};

/// A hanging mass, pressure in steps and ramps: 300 s at 20 Hz. Creep by explicit midpoint steps of 0.5 ms.
Recording isotonic(const Muscle& m) {
  Recording out;
  out.metadata.specimen = "coil";
  out.metadata.output = Output::kPosition;
  out.pressure.emplace();
  const auto pressure_psi = [](double t) {
    const double within = std::fmod(t, 60.0);
    const double top = 20.0 + 5.0 * std::floor(t / 60.0);
    if (within < 5.0) return 10.0;
    if (within < 6.0) return 10.0 + (top - 10.0) * (within - 5.0);
    if (within < 30.0) return top;
    if (within < 40.0) return top - (top - 12.0) * (within - 30.0) / 10.0;
    return within < 41.0 ? 12.0 - 2.0 * (within - 40.0) : 10.0;
  };
  std::mt19937 random(m.seed);
  std::normal_distribution<double> normal;
  constexpr double kStep_s = 5e-4;
  std::vector<double> crept(m.creep.size(), 0.0);
  double play_psi = 0.0;
  for (long i = 0; i <= 600000; ++i) {
    const double t = static_cast<double>(i) * kStep_s;
    const double change = pressure_psi(t) - 10.0;
    play_psi = std::min(std::max(play_psi, change - m.play_psi), change + m.play_psi);
    if (i % 100 == 0) {
      double x = 3.0 + m.per_psi * change + m.play_mm * play_psi + m.drift_mm_h * t / 3600.0;
      for (const double c : crept) x += c;
      out.frame.t_s.push_back(t);
      out.frame.position_mm.push_back(x + m.noise_mm * normal(random));
      out.frame.force_N.push_back(2.94);
      out.pressure->t_s.push_back(t);
      out.pressure->pressure_psi.push_back(pressure_psi(t));
    }
    for (std::size_t k = 0; k < crept.size(); ++k) {
      const auto [gain, time_s] = m.creep[k];
      const double middle = pressure_psi(t + 0.5 * kStep_s) - 10.0;
      const double half = crept[k] + 0.5 * kStep_s * (gain * change - crept[k]) / time_s;
      crept[k] += kStep_s * (gain * middle - half) / time_s;
    }
  }
  return out;
}

/// A closed volume that empties: q' = -q |q / 50|^(n-1) / time, by explicit midpoint steps of 1 ms.
Recording leak(double exponent, double time_s, double from_psi = 50.0, std::size_t rows = 400) {
  Recording out;
  out.metadata.specimen = "hose";
  out.metadata.output = Output::kPressure;
  out.pressure.emplace();
  std::mt19937 random(7);
  std::normal_distribution<double> normal;
  const auto rate = [&](double q) { return -q * std::pow(q / 50.0, exponent - 1.0) / time_s; };
  double q = from_psi;
  for (std::size_t i = 0; i < rows; ++i) {
    out.pressure->t_s.push_back(0.3 * static_cast<double>(i));
    out.pressure->pressure_psi.push_back(q + 0.02 * normal(random));
    for (int k = 0; k < 300; ++k) q += 1e-3 * rate(q + 0.5e-3 * rate(q));
  }
  return out;
}

const FittedNumber& number(const std::vector<FittedNumber>& of, const std::string& name) {
  for (const FittedNumber& one : of)
    if (one.name == name) return one;
  throw std::out_of_range(name);
}

/// Within three half widths: of some thirty intervals in this file no correct one lies outside (3 x 1.96 sd).
void expect_near(const FittedNumber& fitted, double truth) {
  EXPECT_NEAR(fitted.value, truth, 1.5 * (fitted.high95 - fitted.low95)) << fitted.name;
  // An interval that says nothing would pass every truth: a fifth of the number, or of a psi where it is zero.
  EXPECT_LT(fitted.high95 - fitted.low95, 0.2 * std::max(std::fabs(truth), 1.0)) << fitted.name;
}

std::filesystem::path file_with(const std::string& text) {
  const auto file = std::filesystem::path(testing::TempDir()) /
                    (std::string(testing::UnitTest::GetInstance()->current_test_info()->name()) + ".toml");
  std::ofstream(file) << text;
  return file;
}

TEST(Response, AStepIsAnsweredAtOnceAndThenWithTheTime) {
  Data of;
  of.output = Output::kPosition;
  for (int k = 0; k <= 40; ++k) of.t_s.push_back(0.25 * k);
  of.inputs = {{"pressure_psi", std::vector<double>(41, 2.0)}};
  of.inputs[0].value[0] = 0.0;
  ResponseModel model;
  model.times_s = {1.5};
  model.inputs = {{"pressure_psi", 3.0, {4.0}}};
  const auto y = simulate(model, of, 1.0);
  EXPECT_EQ(y[0], 1.0);
  // A ramp of 0.25 s and then a constant: by convolution with 1 - exp(-t / T), exact to rounding.
  for (std::size_t k = 1; k < y.size(); ++k) {
    const double t = of.t_s[k], ramp = 0.25, time = 1.5;
    const double left = time / ramp * (std::exp(-(t - ramp) / time) - std::exp(-t / time));
    EXPECT_NEAR(y[k], 1.0 + 3.0 * 2.0 + 4.0 * 2.0 * (1.0 - left), 1e-12);
  }
}

TEST(Response, WhatTheNominalModelSaysIsConsistent) {
  const auto d = diagnose_response({isotonic({})}, {"r"}, "slse1");
  EXPECT_EQ(d.verdict, "consistent") << response_json(d).dump(1);
  EXPECT_THAT(d.missing, IsEmpty());
  expect_near(number(d.nominal.numbers, "time_1_s"), 2.0);
  expect_near(number(d.nominal.numbers, "immediate_mm_per_psi"), -0.4);
  expect_near(number(d.nominal.numbers, "retarded_1_mm_per_psi"), -0.15);
  // White noise of 0.004 mm in 6001 rows: its rms is known to 1 % (1 / sqrt(2 n)), five of them here.
  EXPECT_NEAR(d.nominal.rms, 0.004, 0.05 * 0.004);
}

TEST(Response, AFurtherCreepTimeIsFoundWithItsNumbers) {
  const auto d = diagnose_response({isotonic({.creep = {{-0.15, 1.0}, {-0.1, 20.0}}})}, {"r"}, "slse1");
  EXPECT_EQ(d.verdict, "missing_physics");
  ASSERT_THAT(d.missing, SizeIs(1));
  EXPECT_EQ(d.missing[0].effect, "second_relaxation");
  EXPECT_GT(d.missing[0].probability, 0.9);
  expect_near(number(d.missing[0].numbers, "time_1_s"), 1.0);
  expect_near(number(d.missing[0].numbers, "time_2_s"), 20.0);
  expect_near(number(d.missing[0].numbers, "retarded_2_mm_per_psi"), -0.1);
  EXPECT_LT(*d.model_heldout, 0.5 * *d.nominal_heldout);
  // slse2 has both times: nothing is missing.
  EXPECT_EQ(diagnose_response({isotonic({.creep = {{-0.15, 1.0}, {-0.1, 20.0}}})}, {"r"}, "slse2").verdict,
            "consistent");
}

TEST(Response, AHysteresisThatDoesNotDependOnTheRateIsFriction) {
  const auto d = diagnose_response({isotonic({.play_mm = -0.1})}, {"r"}, "slse1");
  EXPECT_EQ(d.verdict, "missing_physics") << response_json(d).dump(1);
  ASSERT_THAT(d.missing, SizeIs(1));
  EXPECT_EQ(d.missing[0].effect, "coulomb_friction");
  expect_near(number(d.missing[0].numbers, "play_width_psi"), 1.5);
  expect_near(number(d.missing[0].numbers, "play_gain_mm_per_psi"), -0.1);
}

TEST(Response, WhatWasLeftOutIsDrawnWithItsBandAndInWords) {
  const Muscle truth{.creep = {{-0.15, 2.0}, {-0.1, 25.0}}};
  const ResponseDiagnosis d = diagnose_response({isotonic(truth)}, {"one"}, "slse1");
  ASSERT_FALSE(d.missing.empty());
  const auto folder = std::filesystem::path(::testing::TempDir()) / "response-page";
  std::filesystem::remove_all(folder);
  write_response_report(d, folder, {"isorig diagnose one", "isorig 1", "", {}, {}});
  std::ifstream in(folder / "diagnosis-report.html", std::ios::binary);
  const std::string html{std::istreambuf_iterator<char>(in), {}};
  std::filesystem::remove_all(folder);
  const std::string begin = R"(<script type="application/json" id="data">)";
  const auto from = html.find(begin) + begin.size();
  const auto page = nlohmann::json::parse(html.substr(from, html.find("</script>", from) - from));
  std::size_t drawn = 0, moved = 0;
  for (const auto& block : page["blocks"]) {
    EXPECT_THAT(block.dump(), ::testing::Not(HasSubstr("second_relaxation"))) << "an effect by its words";
    if (block["type"] == "table" && block["columns"].size() == 5 && block["columns"][0]["name"] == "number") {
      for (const auto& row : block["rows"]) {
        if (row[0] != "time 1") continue;
        ++moved;
        EXPECT_EQ(row[1], "s");
        EXPECT_THAT(row[3].get<std::string>(), HasSubstr("["));
      }
    }
    if (block["type"] != "figure" || !block["figure"]["name"].get<std::string>().starts_with("left-out-")) continue;
    ++drawn;
    const std::string caption = block["figure"]["caption"];
    EXPECT_THAT(caption, ::testing::ContainsRegex("errs by [0-9.]+ mm rms, with what it lacked by [0-9.]+ mm"));
    for (const auto& panel : block["figure"]["panels"])
      for (const auto& series : panel["series"]) {
        EXPECT_LE(series["x"].size(), 301u);
        EXPECT_TRUE(series["mark"] == "line" || series["mark"] == "band");
      }
  }
  EXPECT_EQ(drawn, 2u);
  EXPECT_EQ(moved, 1u);
  // What is drawn is what the numbers are about, and the model that has the second time is near the noise.
  for (const LeftOutPart& part : d.left_out) {
    double squares = 0.0;
    for (const double error : part.model_residual) squares += error * error;
    EXPECT_NEAR(std::sqrt(squares / static_cast<double>(part.model_residual.size())), part.model_rms, 1e-12);
    EXPECT_LT(part.model_rms, 2.0 * truth.noise_mm);
  }
}

TEST(Response, ADriftIsFoundBesideTheCreep) {
  const auto d = diagnose_response({isotonic({.drift_mm_h = 3.0})}, {"r"}, "slse1");
  ASSERT_THAT(d.missing, SizeIs(1));
  EXPECT_EQ(d.missing[0].effect, "zero_drift");
  expect_near(number(d.missing[0].numbers, "drift_mm_per_h"), 3.0);
}

// A stroke that is not in proportion to the pressure is in no explanation: it must not be given one's name for certain.
TEST(Response, ACurvedStrokeIsNoNamedEffectForCertain) {
  Recording r = isotonic({});
  for (std::size_t k = 0; k < r.frame.size(); ++k)
    r.frame.position_mm[k] -= 0.02 * std::pow(r.pressure->pressure_psi[k] - 10.0, 2);
  const auto d = diagnose_response({r}, {"r"}, "slse1");
  EXPECT_THAT(d.verdict, testing::AnyOf("unknown_physics", "cannot_judge")) << response_json(d).dump(1);
  EXPECT_THAT(d.missing, Each(Field(&MissingPart::probability, testing::Lt(0.9))));
}

TEST(Response, ALeakInProportionIsConsistentAndOneThatIsNotHasItsExponent) {
  const auto plain = diagnose_response({leak(1.0, 40.0)}, {"r"}, "slse1");
  EXPECT_EQ(plain.verdict, "consistent") << response_json(plain).dump(1);
  expect_near(number(plain.nominal.numbers, "time_1_s"), 40.0);
  expect_near(number(plain.nominal.numbers, "rest_psi"), 0.0);
  const auto gas = diagnose_response({leak(2.0, 20.0)}, {"r"}, "slse1");
  EXPECT_EQ(gas.verdict, "missing_physics") << response_json(gas).dump(1);
  ASSERT_THAT(gas.missing, SizeIs(1));
  EXPECT_EQ(gas.missing[0].effect, "nonlinear_viscosity");
  expect_near(number(gas.missing[0].numbers, "exponent"), 2.0);
  // The same leak from another pressure: only its beginning is looked at.
  const Data other = data_of(leak(2.0, 20.0, 30.0), "other");
  const auto predicted = simulate(gas.model.model, other, begin_of(other));
  // The line through four readings of 0.02 psi is known at its end to 0.8 of that; five times both.
  for (std::size_t k = 0; k < predicted.size(); ++k) EXPECT_NEAR(predicted[k], other.output_value[k], 5.0 * 0.02 * 1.8);
}

/// One falls to the rest and one rises to it: their shares must not take each other away.
TEST(Response, WhatFallsAndWhatRisesToOneRestHaveOneModel) {
  const auto settling = [](double from_psi, unsigned seed) {
    Recording out;
    out.metadata.specimen = "hose";
    out.metadata.output = Output::kPressure;
    out.pressure.emplace();
    std::mt19937 random(seed);
    std::normal_distribution<double> normal;
    for (std::size_t i = 0; i < 800; ++i) {
      const double t_s = 0.3 * static_cast<double>(i);
      const double left = 0.6 * std::exp(-t_s / 3.0) + 0.4 * std::exp(-t_s / 60.0);
      out.pressure->t_s.push_back(t_s);
      out.pressure->pressure_psi.push_back(50.0 + (from_psi - 50.0) * left + 0.01 * normal(random));
    }
    return out;
  };
  const auto d = diagnose_response({settling(90.0, 1), settling(10.0, 2)}, {"falls", "rises"}, "slse2");
  const ResponseModel& model = d.model.model;
  ASSERT_EQ(model.shares.size(), 2U) << response_json(d).dump(1);
  // 0.01 psi on 40 psi, some hundred readings for each: a thousandth.
  EXPECT_NEAR(model.shares[0], 0.6, 0.005);
  EXPECT_NEAR(model.shares[1], 0.4, 0.005);
  for (const double from_psi : {90.0, 10.0}) {
    const Data other = data_of(settling(from_psi, 3), "other");
    const auto predicted = simulate(model, other, begin_of(other));
    // Begun on the line through four readings, 0.9 s of a curve that bends by 24 psi / (3 s)^2: up to 1 psi beside it.
    for (std::size_t k = 0; k < predicted.size(); ++k) ASSERT_NEAR(predicted[k], other.output_value[k], 1.0) << k;
  }
}

TEST(Response, ShortRecordingsAreJudged) {
  EXPECT_EQ(diagnose_response({leak(1.0, 10.0, 50.0, 99)}, {"r"}, "slse1").verdict, "consistent");
  EXPECT_THROW(static_cast<void>(diagnose_response({leak(1.0, 10.0, 50.0, 19)}, {"r"}, "slse1")),
               std::invalid_argument);
}

TEST(Response, FewRowsNameNothing) {
  const Recording whole = isotonic({.creep = {{-0.15, 1.0}, {-0.1, 20.0}}, .play_mm = -0.1});
  for (const std::size_t rows : {20U, 30U, 60U, 99U}) {
    Recording window = whole;
    for (auto* column : {&window.frame.t_s, &window.frame.position_mm, &window.frame.force_N}) {
      column->erase(column->begin(), column->begin() + 90);  // the first step begins 10 rows later
      column->resize(rows);
    }
    const auto d = diagnose_response({window}, {"r"}, "slse1");
    EXPECT_THAT(d.missing, IsEmpty()) << rows;
    EXPECT_THAT(d.verdict, testing::AnyOf("consistent", "cannot_judge", "unknown_physics")) << rows;
  }
}

TEST(Response, ARecordingWithoutNoiseIsJudgedToo) {
  EXPECT_EQ(diagnose_response({isotonic({.noise_mm = 0.0})}, {"r"}, "slse1").verdict, "consistent");
}

// A gauge in steps, and a second recording that begins exactly where the first has ended.
TEST(Response, WhatBeginsAtRestSettlesNothing) {
  Recording first = leak(1.0, 10.0), second = leak(1.0, 10.0);
  for (double& psi : first.pressure->pressure_psi) psi = std::round(psi * 10.0) / 10.0;
  for (std::size_t k = 0; k < second.pressure->size(); ++k)
    second.pressure->pressure_psi[k] = first.pressure->pressure_psi.back() + (k < 200 ? 0.0 : 5.0);
  const auto d = diagnose_response({first, second}, {"a", "b"}, "slse1");
  EXPECT_TRUE(std::isfinite(d.model.rms));
}

// What the page of all diagnoses reads (web/src/live/diagnosis_words.ts) has the shape that a diagnosis of forces has.
TEST(Response, TheJsonHasTheShapeOfOthers) {
  const auto json = response_json(diagnose_response({isotonic({.play_mm = -0.02})}, {"r"}, "slse1"));
  for (const auto& alternative : json["alternatives"]) EXPECT_TRUE(alternative["effects"].is_array());
  ResponseDiagnosis d = diagnose_response({leak(2.0, 20.0)}, {"r"}, "slse1");
  d.not_modelled = "for a reason";
  const auto withheld = response_json(d);
  EXPECT_EQ(withheld["not_modelled"]["names"], nlohmann::json({"nonlinear_viscosity"}));
  ASSERT_FALSE(withheld["where"].empty());
  for (const auto& place : withheld["where"]) EXPECT_FALSE(place["text"].get<std::string>().empty());
}

TEST(Response, APredictionNeedsTheInputsOfItsModel) {
  const auto d = diagnose_response({isotonic({})}, {"r"}, "slse1");
  Recording dry = isotonic({});
  dry.pressure.reset();
  EXPECT_THROW(static_cast<void>(data_for(dry, "dry", d.model.model)), std::invalid_argument);
  // A step too small to be looked for as an input is one all the same.
  Recording small = isotonic({});
  for (double& psi : small.pressure->pressure_psi) psi = 10.0 + 1e-9 * psi;
  EXPECT_THAT(data_for(small, "small", d.model.model).inputs, SizeIs(1));
  const auto settled = diagnose_response({leak(1.0, 40.0)}, {"r"}, "slse1");
  Recording moved = leak(1.0, 40.0);
  for (std::size_t k = 0; k < moved.pressure->size(); ++k) {
    moved.frame.t_s.push_back(moved.pressure->t_s[k]);
    moved.frame.position_mm.push_back(static_cast<double>(k / 50 % 2));
    moved.frame.force_N.push_back(0.0);
  }
  EXPECT_THROW(static_cast<void>(data_for(moved, "moved", settled.model.model)), std::invalid_argument);
}

TEST(Response, WhatIsNotOneQuestionIsRefused) {
  const auto refused = [](const std::vector<Recording>& recordings, std::string_view nominal) -> std::string {
    try {
      static_cast<void>(diagnose_response(recordings, std::vector<std::string>(recordings.size(), "r"), nominal));
    } catch (const std::invalid_argument& e) {
      return e.what();
    }
    return "";
  };
  EXPECT_THAT(refused({isotonic({}), leak(1.0, 40.0)}, "slse1"), HasSubstr("diagnose them apart"));
  EXPECT_THAT(refused({leak(1.0, 40.0)}, "model.toml"), HasSubstr("slse1 or slse2"));
  EXPECT_THAT(refused({leak(1.0, 40.0), leak(1.0, 40.0)}, "slse1"), HasSubstr("same samples"));
  Recording still = leak(1.0, 40.0);
  for (std::size_t k = 0; k < still.pressure->size(); ++k)
    still.pressure->pressure_psi[k] = 0.01 * static_cast<double>(k % 3);
  EXPECT_THAT(refused({still}, "slse1"), HasSubstr("does not change"));
}

TEST(Response, AModelFileReadsBackAsWritten) {
  for (const auto& d :
       {diagnose_response({isotonic({.creep = {{-0.15, 1.0}, {-0.1, 20.0}}, .play_mm = -0.1})}, {"r"}, "slse1"),
        diagnose_response({leak(2.0, 20.0)}, {"r"}, "slse1")}) {
    const auto file = file_with(response_model_text(d.model.model, "comment"));
    EXPECT_TRUE(is_response_model(file));
    const ResponseModel again = read_response_model(file);
    EXPECT_EQ(simulate(again, d.data[0], 1.0), simulate(d.model.model, d.data[0], 1.0));
    EXPECT_EQ(response_model_text(again, "comment"), response_model_text(d.model.model, "comment"));
  }
}

TEST(Response, AWrongModelFileSaysWhere) {
  const auto said = [](const std::string& text) -> std::string {
    try {
      static_cast<void>(read_response_model(file_with(text)));
    } catch (const base::ConfigError& e) {
      return e.what();
    }
    return "";
  };
  const std::string head = "format = \"isorig-response/1\"\nname = \"a\"\noutput = \"pressure\"\n";
  EXPECT_THAT(said(head + "times_s = []\nrest = 0.0\nshares = []\n"), HasSubstr("at least one"));
  EXPECT_THAT(said(head + "times_s = [-1.0]\nrest = 0.0\nshares = [1.0]\n"), HasSubstr(":4:"));
  EXPECT_THAT(said(head + "times_s = [1.0]\nrest = 0.0\nshares = [0.5, 0.5]\n"), HasSubstr("as many numbers"));
  EXPECT_THAT(said(head + "times_s = [1.0]\n[[input]]\ncolumn = \"force\"\nimmediate = 1\nretarded = [1]\n"),
              HasSubstr("pressure_psi"));
  EXPECT_THAT(said(head + "times_s = [1.0]\nshares = [1.0]\nrest = 0.0\nexponent = 2.0\n"), HasSubstr("scale"));
  EXPECT_EQ(said(head + "times_s = [1.0]\nshares = [1.0]\nrest = 0.0\n"), "");
}

}  // namespace
}  // namespace isorig::identify::response
