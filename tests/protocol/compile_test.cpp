#include "protocol/compile.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

namespace isorig::protocol {
namespace {

using testing::ElementsAre;
using testing::IsEmpty;

/// Line 4 is the first of `steps`.
std::string text_of(const std::string& steps, const std::string& head = "") {
  return "format = \"isorig-protocol/1\"\nname = \"test\"" + head + "\nsteps = [\n" + steps + "]\n";
}

Plan plan_of(const std::string& text, const Limits& limits = {}) {
  return compile(base::TomlDocument::parse_text(text, "p.toml"), limits);
}

std::vector<std::string> faults_of(const std::string& text, const Limits& limits = {}) {
  std::vector<std::string> out;
  try {
    (void)plan_of(text, limits);
  } catch (const base::ConfigError& e) {
    for (const auto& diagnostic : e.diagnostics()) out.push_back(diagnostic.text());
  }
  return out;
}

/// What is wrong with one line of steps, the fifth of the file (after a pressurize that is right).
std::vector<std::string> faults_of_step(const std::string& step, const Limits& limits = {}) {
  return faults_of(
      text_of("{ do = \"pressurize\", pressure_psi = 5, rate_psi_s = 1, settled_for_s = 1, timeout_s = 60 },\n" + step +
              "\n"),
      limits);
}

Limits rig() {
  Limits limits;
  limits.travel_min_mm = -6.0;
  limits.travel_max_mm = 6.0;
  limits.speed_min_mm_s = 0.001;
  limits.speed_max_mm_s = 10.0;
  limits.pressure_max_psi = 22.0;
  limits.pressure_rate_max_psi_s = 5.0;
  limits.segment_interval_min_s = 0.05;
  return limits;
}

constexpr const char* kBegin =
    "{ do = \"pressurize\", pressure_psi = 5, rate_psi_s = 1, settled_for_s = 1, timeout_s = 60 },\n";

// ---------------------------------------------------------------- what is right

TEST(Compile, ExpandsListsInTheOrderTheyAreWritten) {
  const Plan plan =
      plan_of(text_of(std::string(kBegin) + "{ do = \"repeat\", for = { v = [1, 2], d = [1, -1] }, steps = [\n"
                                            "  { do = \"ramp\", to_mm = \"d * v\", velocity_mm_s = \"v\" } ] },\n"));
  std::vector<std::pair<double, double>> ramps;
  for (std::size_t i = 1; i < plan.steps.size(); ++i) {
    ramps.emplace_back(plan.steps[i].target_mm, plan.steps[i].velocity_mm_s);
  }
  EXPECT_THAT(ramps, ElementsAre(std::pair(1.0, 1.0), std::pair(-1.0, 1.0), std::pair(2.0, 2.0), std::pair(-2.0, 2.0)));
  EXPECT_EQ(plan.travel_mm, 1 + 2 + 3 + 4);
}

TEST(Compile, BindsRowsTogetherAndCountsTimes) {
  const Plan plan = plan_of(
      text_of("{ do = \"repeat\", times = 2, steps = [\n"
              "{ do = \"repeat\", unit = \"session\", for = [ { p = 5, s = 1 }, { s = 2, p = 10 } ], steps = [\n"
              "{ do = \"pressurize\", pressure_psi = \"p\", rate_psi_s = 1, settled_for_s = 1, timeout_s = 60 },\n"
              "{ do = \"ramp\", to_mm = \"-s / 2\", velocity_mm_s = 1 },\n"
              "{ do = \"ramp\", to_mm = 0, velocity_mm_s = \"1e-1 * s\" } ] } ] },\n"));
  ASSERT_EQ(plan.sessions.size(), 4U);
  std::vector<std::string> labels;
  for (const auto& session : plan.sessions) labels.push_back(session.label);
  EXPECT_THAT(labels, ElementsAre("repetition 1, 5 psi", "repetition 1, 10 psi", "repetition 2, 5 psi",
                                  "repetition 2, 10 psi"));
  EXPECT_EQ(plan.steps[1].target_mm, -0.5);
  EXPECT_EQ(plan.steps[4].target_mm, -1.0);
  EXPECT_EQ(plan.steps[5].velocity_mm_s, 0.2);
  EXPECT_EQ(plan.steps[11].session, 3U);
  EXPECT_EQ(plan.steps[11].repetition, 2);
  EXPECT_EQ(plan.sessions[3].first_step, 9U);
  EXPECT_EQ(plan.sessions[3].last_step, 11U);
}

TEST(Compile, AProtocolWithoutSessionsIsOne) {
  const Plan plan = plan_of(text_of(std::string(kBegin) + "{ do = \"hold\", duration_s = 3 },\n"));
  ASSERT_EQ(plan.sessions.size(), 1U);
  EXPECT_EQ(plan.sessions[0].last_step, 1U);
  EXPECT_EQ(plan.sessions[0].label, "repetition 1, 5 psi");
  EXPECT_EQ(plan.steps[1].session, 0U);
  EXPECT_EQ(plan.steps[1].start_s, 6.0);  // 5 psi at 1 psi/s, settled for 1 s
  EXPECT_EQ(plan.steps[1].pressure_psi, 5.0);
  EXPECT_EQ(plan.nominal_s, 9.0);
  EXPECT_EQ(plan.worst_s, 63.0);
  EXPECT_EQ(plan.steps[1].line, 5U);
  EXPECT_EQ(plan.steps[1].column, 1U);
}

TEST(Compile, WavesHaveTheirSpeedsAndDurations) {
  const Plan plan =
      plan_of(text_of(std::string(kBegin) +
                      "{ do = \"wave\", shape = \"triangle\", amplitude_mm = 2, velocity_mm_s = 4, cycles = 3 },\n"
                      "{ do = \"wave\", shape = \"triangle\", amplitude_mm = 2, frequency_hz = 0.5, cycles = 3 },\n"
                      "{ do = \"wave\", shape = \"sine\", amplitude_mm = 2, velocity_mm_s = 4, cycles = 3 },\n"
                      "{ do = \"wave\", shape = \"sine\", amplitude_mm = 1, frequency_hz = 0.1, cycles = 1, "
                      "deviation_mm = 0.1 },\n"),
              rig());
  EXPECT_NEAR(plan.steps[1].frequency_hz, 4.0 / (4 * 2), 1e-12);
  EXPECT_NEAR(plan.steps[1].nominal_s, 6.0, 1e-12);
  EXPECT_NEAR(plan.steps[2].velocity_mm_s, 4.0, 1e-12);
  EXPECT_NEAR(plan.steps[3].frequency_hz, 4.0 / (2 * M_PI * 2), 1e-12);
  EXPECT_EQ(plan.steps[3].segments_per_quarter, 6U);
  EXPECT_NEAR(plan.steps[3].deviation_mm, 2 * (1 - std::cos(M_PI / 24)), 1e-12);
  EXPECT_EQ(plan.steps[4].segments_per_quarter, 2U);
  EXPECT_LE(plan.steps[4].deviation_mm, 0.1);
  EXPECT_NEAR(plan.travel_mm, 3 * (3 * 8.0) + 4.0, 1e-9);
  EXPECT_EQ(plan.position_max_mm, 2.0);
  EXPECT_EQ(plan.position_min_mm, -2.0);
}

TEST(Compile, ASetPointKeepsBelowTheRigsLimitAndWithinATolerance) {
  const auto to = [](const std::string& psi, const std::string& tolerance_psi) {
    return text_of("{ do = \"pressurize\", pressure_psi = " + psi +
                   ", rate_psi_s = 1, tolerance_psi = " + tolerance_psi + ", settled_for_s = 1, timeout_s = 60 },\n");
  };
  EXPECT_THAT(plan_of(to("21.7", "0.1"), rig()).warnings, ElementsAre());
  EXPECT_THAT(
      plan_of(to("21.8", "0.1"), rig()).warnings,
      ElementsAre(testing::HasSubstr("`pressure_psi` = 21.8; the rig stops at 22 psi (limits.pressure_max_psi), and "
                                     "overshoot, noise and strokes may reach 0.3 psi above a set-point")));
  EXPECT_THAT(faults_of(to("22.1", "0.1"), rig()), ElementsAre(testing::HasSubstr("the rig allows at most 22")));
  EXPECT_THAT(faults_of(to("5", "2"), rig()), ElementsAre());
  EXPECT_THAT(faults_of(to("5", "2.1"), rig()), ElementsAre(testing::HasSubstr("`tolerance_psi` = 2.1")));
}

/// The frame comes to rest at each of the 2 n + 1 ends of a wave's strokes, which the frequency asked for knows nothing
/// of.
TEST(Compile, AWavesTurningPointsAreInItsTimeAndNamedWhereTheyChangeItsFrequency) {
  auto limits = rig();
  limits.turning_time_s = 0.15;
  const auto wave = [](const std::string& rest) {
    return text_of(std::string(kBegin) + "{ do = \"wave\", shape = \"triangle\", amplitude_mm = 0.1, " + rest +
                   " },\n");
  };
  const Plan fast = plan_of(wave("frequency_hz = 5, cycles = 10"), limits);
  const double turn_s = 0.15 * (1.0 + 0.22 * std::log(2.0));  // it arrives at 2 mm/s
  EXPECT_NEAR(fast.steps[1].nominal_s, 2.0 + 21 * turn_s, 1e-9);
  EXPECT_NEAR(fast.steps[1].reached_hz, 10.0 / fast.steps[1].nominal_s, 1e-9);
  EXPECT_NEAR(fast.nominal_s, 6.0 + fast.steps[1].nominal_s, 1e-9);
  EXPECT_THAT(describe(fast.steps[1]), testing::HasSubstr("at 5 Hz, of which the turning points leave about 1.78 Hz"));
  EXPECT_THAT(
      fast.warnings,
      ElementsAre("p.toml:5:71: `frequency_hz` = 5; the rig will run it at about 1.78 Hz, since its frame stands "
                  "for some 0.17 s at each turning point (limits.turning_time_s): be slower, or say by "
                  "frequency_tolerance how far off it may be"));

  // A protocol that says what it bears is taken at its word, both ways.
  EXPECT_THAT(plan_of(wave("frequency_hz = 5, cycles = 10, frequency_tolerance = 0.7"), limits).warnings,
              ElementsAre());
  EXPECT_THAT(
      faults_of(wave("frequency_hz = 5, cycles = 10, frequency_tolerance = 0.6"), limits),
      ElementsAre(testing::AllOf(testing::StartsWith("p.toml:5:71: `frequency_hz` = 5; the rig will run it at about "
                                                     "1.78 Hz"),
                                 testing::EndsWith("be slower, or allow a larger frequency_tolerance"))));
  // Slow enough, or asked for by its speed, which is kept.
  EXPECT_THAT(plan_of(wave("frequency_hz = 0.05, cycles = 10"), limits).warnings, ElementsAre());
  EXPECT_THAT(plan_of(wave("velocity_mm_s = 2, cycles = 10"), limits).warnings, ElementsAre());
  EXPECT_THAT(faults_of(wave("velocity_mm_s = 2, cycles = 10, frequency_tolerance = 0.1"), limits),
              ElementsAre(testing::HasSubstr("`frequency_tolerance` is of `frequency_hz`")));
  // Without a rig nothing is known of its turning points.
  EXPECT_THAT(plan_of(wave("frequency_hz = 5, cycles = 10"), rig()).warnings, ElementsAre());
  // Said once, however often a repeat comes by.
  const Plan often =
      plan_of(text_of(std::string(kBegin) +
                      "{ do = \"repeat\", for = { f = [2, 3] }, steps = [ { do = \"wave\", shape = \"triangle\", "
                      "amplitude_mm = 0.1, frequency_hz = \"f\", cycles = 2 } ] },\n"),
              limits);
  EXPECT_EQ(often.warnings.size(), 1U);
}

TEST(Compile, RecordsAsThePolicyAndTheStepsSay) {
  const std::string steps = std::string(kBegin) +
                            "{ do = \"hold\", duration_s = 1 },\n{ do = \"mark\", label = \"now\" },\n"
                            "{ do = \"hold\", duration_s = 1 },\n"
                            "{ do = \"ramp\", to_mm = 1, velocity_mm_s = 1 },\n"
                            "{ do = \"hold\", duration_s = 9, record = \"full\" },\n"
                            "{ do = \"ramp\", to_mm = 0, velocity_mm_s = 1, record = \"averaged\" },\n";
  const Plan round = plan_of(text_of(steps, "\nrecording = { before_s = 1.5, after_s = 2 }"));
  EXPECT_EQ(round.steps[4].keep, Keep::kFull);
  EXPECT_EQ(round.steps[4].full_after_s, 2.0);
  EXPECT_EQ(round.steps[6].full_after_s, 0.0);
  EXPECT_EQ(round.steps[5].keep, Keep::kFull);
  EXPECT_EQ(round.steps[6].keep, Keep::kAveraged);
  EXPECT_NEAR(round.full_rate_s, 1.5 + 1.0 + 9.0, 1e-12);
  const Plan full = plan_of(text_of(steps, "\nrecording = { policy = \"full\" }"));
  EXPECT_EQ(full.steps[0].keep, Keep::kFull);
  EXPECT_EQ(full.steps[6].keep, Keep::kAveraged);
  const Plan averaged = plan_of(text_of(steps, "\nrecording = { policy = \"averaged\" }"));
  EXPECT_EQ(averaged.steps[4].keep, Keep::kAveraged);
  EXPECT_EQ(averaged.steps[5].keep, Keep::kFull);
}

TEST(Compile, IsPure) {
  const std::string text = text_of(std::string(kBegin) + "{ do = \"ramp\", to_mm = 1, velocity_mm_s = 3 },\n");
  const Plan a = plan_of(text), b = plan_of(text);
  EXPECT_EQ(a.nominal_s, b.nominal_s);
  EXPECT_EQ(a.steps.size(), b.steps.size());
}

// ---------------------------------------------------------------- what is wrong, and where

TEST(CompileErrors, ANameIsOneLineOfPlainText) {
  const auto named = [](const std::string& toml) {
    return faults_of("format = \"isorig-protocol/1\"\nname = " + toml + "\nsteps = [\n" + kBegin + "]\n");
  };
  EXPECT_THAT(named("\"The paper's ramps, größer\""), IsEmpty());
  EXPECT_THAT(named("\"" + std::string(100, 'n') + "\""), IsEmpty());
  EXPECT_THAT(named("\"\\u001b[31m\""), ElementsAre(testing::HasSubstr("control character")));
  EXPECT_THAT(named("\"a\\u202eb\""), ElementsAre(testing::HasSubstr("hides text")));
  EXPECT_THAT(named("\"\""), ElementsAre(testing::HasSubstr("it has to be 1 to 100")));
  EXPECT_THAT(named("\"" + std::string(300, 'n') + "\""), ElementsAre(testing::HasSubstr("has 300 bytes")));
}

TEST(CompileErrors, ATwinIsAFileOfTheLibraryAndDoesOneOfThree) {
  const std::string steps =
      "{ do = \"pressurize\", pressure_psi = 5, rate_psi_s = 5, settled_for_s = 1, timeout_s = 9 }";
  EXPECT_THAT(faults_of(text_of(steps, "\ntwin = { model = \"muscle-5psi.toml\", on_parting = \"pause\" }"), rig()),
              testing::IsEmpty());
  EXPECT_THAT(faults_of(text_of(steps, "\ntwin = { model = \"../rig.toml\" }"), rig()),
              ElementsAre(testing::HasSubstr("`model` = \"../rig.toml\"; it has to be the name of a file")));
  EXPECT_THAT(
      faults_of(text_of(steps, "\ntwin = { on_parting = \"explode\" }"), rig()),
      ElementsAre(testing::HasSubstr("`model` is missing"), testing::HasSubstr("one of \"mark\" \"pause\" \"abort\"")));
}

TEST(CompileErrors, AllAtOnceAndInOrder) {
  EXPECT_THAT(
      faults_of(text_of("{ do = \"repeat\", for = { speed_mm_s = [2, 12] }, steps = [\n"
                        "  { do = \"ramp\", to_mm = 7, velocity_mm_s = \"speed_mm_s\" },\n"
                        "  { do = \"hold\", duration = 3 },\n"
                        "] },\n{ do = \"jump\" },\n",
                        "\nrecordng.policy = \"full\""),
                rig()),
      ElementsAre("p.toml:3:1: unknown key `recordng`; did you mean `recording`?",
                  "p.toml:4:9: a session begins with a pressurize (to 0 psi if it needs none), so that it can be "
                  "resumed on its own from a vented actuator",
                  "p.toml:6:26: `to_mm` = 7; the rig travels from -6 to 6 mm (limits.travel_min_mm, "
                  "limits.travel_max_mm)",
                  "p.toml:6:45: `velocity_mm_s` = 12 with speed_mm_s = 12; the rig allows 0.001 to 10 mm/s "
                  "(limits.speed_min_mm_s, limits.speed_max_mm_s)",
                  "p.toml:7:3: `duration_s` is missing here",
                  "p.toml:7:18: unknown key `duration`; did you mean `duration_s`?",
                  "p.toml:9:8: `do` = \"jump\"; it has to be pressurize, settle, ramp, hold, wave, mark or repeat"));
}

TEST(CompileErrors, Document) {
  EXPECT_THAT(faults_of("format = \"isorig-protocol/2\"\n"),
              ElementsAre("p.toml:1:10: `format` = \"isorig-protocol/2\"; it has to be one of \"isorig-protocol/1\""));
  EXPECT_THAT(
      faults_of("format = \"isorig-protocol/1\"\n"),
      ElementsAre("p.toml:1:1: `name` is missing here",
                  "p.toml:1:1: `steps` is missing: the list of what to do, before the first [table] of the file",
                  testing::_));
  EXPECT_THAT(faults_of("x = \n"), ElementsAre(testing::StartsWith("p.toml:1:5: not valid TOML")));
  EXPECT_THAT(faults_of(text_of("")), ElementsAre("p.toml:3:9: the protocol has no steps"));
}

struct Case {
  const char* step;
  std::vector<std::string> faults;
};

TEST(CompileErrors, EveryClassWithItsPlace) {
  const std::vector<Case> cases{
      // Expressions
      {"{ do = \"hold\", duration_s = \"2 * x\" },",
       {"p.toml:5:29: `duration_s`: unknown variable `x`; bound here: none"}},
      {"{ do = \"hold\", duration_s = \"2 + 3\" },",
       {"p.toml:5:29: `duration_s` = \"2 + 3\": only * and / may follow a value, not `+ 3`"}},
      {"{ do = \"hold\", duration_s = \"2 *\" },",
       {"p.toml:5:29: `duration_s` = \"2 *\": a number or a variable is missing at its end"}},
      {"{ do = \"hold\", duration_s = \"3x\" },",
       {"p.toml:5:29: `duration_s` = \"3x\": `3x` is neither a number nor a variable"}},
      {"{ do = \"hold\", duration_s = \"1 / 0\" },",
       {"p.toml:5:29: `duration_s` = inf; it has to be above 0 and at most 604800"}},
      {"{ do = \"hold\", duration_s = true },", {"p.toml:5:29: `duration_s` is a boolean; a number is needed"}},
      // Ranges
      {"{ do = \"hold\", duration_s = 0 },",
       {"p.toml:5:29: `duration_s` = 0; it has to be above 0 and at most 604800"}},
      {"{ do = \"ramp\", to_mm = 1, velocity_mm_s = -1 },",
       {"p.toml:5:43: `velocity_mm_s` = -1; it has to be greater than 0"}},
      {"{ do = \"settle\", force_slope_N_s = 1, window_s = 0.5, timeout_s = 9 },",
       {"p.toml:5:50: `window_s` = 0.5; it has to be from 1 to 3600"}},
      // Time-outs that cannot be met
      {"{ do = \"settle\", force_slope_N_s = 1, window_s = 10, timeout_s = 9 },",
       {"p.toml:5:66: `timeout_s` = 9, but the force cannot be judged in less than window_s + settled_for_s "
        "= 12 s"}},
      {"{ do = \"settle\", force_slope_N_s = 1, window_s = 10, expected_s = 99, timeout_s = 90 },",
       {"p.toml:5:67: `expected_s` = 99; it lies between window_s + settled_for_s = 12 s and timeout_s = 90 "
        "s"}},
      {"{ do = \"pressurize\", pressure_psi = 20, rate_psi_s = 1, settled_for_s = 5, timeout_s = 20 },",
       {"p.toml:5:88: `timeout_s` = 20, but the set-point alone takes 25 s at rate_psi_s, settled_for_s "
        "included; "
        "allow clearly more"}},
      // Limits
      {"{ do = \"pressurize\", pressure_psi = 25, rate_psi_s = 8, settled_for_s = 5, timeout_s = 60 },",
       {"p.toml:5:37: `pressure_psi` = 25; the rig allows at most 22 (limits.pressure_max_psi)",
        "p.toml:5:54: `rate_psi_s` = 8; the rig allows at most 5 (limits.pressure_rate_max_psi_s)"}},
      {"{ do = \"ramp\", to_mm = -7, velocity_mm_s = 0.0001 },",
       {"p.toml:5:24: `to_mm` = -7; the rig travels from -6 to 6 mm (limits.travel_min_mm, "
        "limits.travel_max_mm)",
        "p.toml:5:44: `velocity_mm_s` = 0.0001; the rig allows 0.001 to 10 mm/s (limits.speed_min_mm_s, "
        "limits.speed_max_mm_s)"}},
      {"{ do = \"wave\", shape = \"triangle\", amplitude_mm = 6.5, velocity_mm_s = 1, cycles = 1 },",
       {"p.toml:5:51: `amplitude_mm` = 6.5 about 0 mm goes to -6.5; the rig travels from -6 to 6 mm "
        "(limits.travel_min_mm, limits.travel_max_mm)",
        "p.toml:5:51: `amplitude_mm` = 6.5 about 0 mm goes to 6.5; the rig travels from -6 to 6 mm "
        "(limits.travel_min_mm, limits.travel_max_mm)"}},
      // ... at 10 mm/s the crosshead runs over its target by more than the limit's tolerance
      {"{ do = \"ramp\", to_mm = -5.95, velocity_mm_s = 10 },",
       {"p.toml:5:24: `to_mm` = -5.95; the rig travels from -6 to 6 mm (limits.travel_min_mm, limits.travel_max_mm), "
        "and a crosshead at 10 mm/s runs over its target: stay 0.08 mm inside, or be slower"}},
      {"{ do = \"ramp\", to_mm = -5.9, velocity_mm_s = 10 }, { do = \"ramp\", to_mm = 6, velocity_mm_s = 2 },", {}},
      {"{ do = \"wave\", shape = \"sine\", amplitude_mm = 6, velocity_mm_s = 10, cycles = 1 },", {}},
      {"{ do = \"wave\", shape = \"triangle\", amplitude_mm = 2, frequency_hz = 1.5, cycles = 1 },",
       {"p.toml:5:69: `frequency_hz` = 1.5, a peak of 12 mm/s; the rig allows 0.001 to 10 mm/s "
        "(limits.speed_min_mm_s, limits.speed_max_mm_s)"}},
      {"{ do = \"wave\", shape = \"sine\", amplitude_mm = 0.5, frequency_hz = 2, cycles = 1 },",
       {"p.toml:5:67: `frequency_hz` = 2 makes every segment of a sine cut in 24 last 0.02083333333 s; the "
        "rig's frame "
        "takes one per 0.05 s (limits.segment_interval_min_s): be slower or allow a larger deviation_mm"}},
      {"{ do = \"wave\", shape = \"sine\", amplitude_mm = 1, velocity_mm_s = 0.002, cycles = 1 },",
       {"p.toml:5:66: `velocity_mm_s` = 0.002 needs a segment at 0.0002603075125 mm/s at the turning points; "
        "the rig's "
        "slowest is 0.001 (limits.speed_min_mm_s): be faster or allow a larger deviation_mm"}},
      // Waves
      {"{ do = \"wave\", shape = \"sine\", amplitude_mm = 1, frequency_hz = 0.1, velocity_mm_s = 1, cycles = "
       "1 },",
       {"p.toml:5:1: a wave needs either `frequency_hz` or `velocity_mm_s`"}},
      {"{ do = \"wave\", shape = \"sine\", amplitude_mm = 1, frequency_hz = 0.1, cycles = 1.5 },",
       {"p.toml:5:79: `cycles` = 1.5; it has to be a whole number"}},
      {"{ do = \"wave\", shape = \"sine\", amplitude_mm = 1, frequency_hz = 0.1, cycles = 1, deviation_mm = "
       "1 },",
       {"p.toml:5:97: `deviation_mm` = 1; it has to be from 0.0001 to 0.25"}},
      {"{ do = \"wave\", shape = \"square\", amplitude_mm = 1, frequency_hz = 0.1, cycles = 1 },",
       {"p.toml:5:24: `shape` = \"square\"; it has to be one of \"triangle\" \"sine\""}},
      // Other words
      {"{ do = \"settle\", force_slope_N_s = 1, window_s = 1, timeout_s = 9, on_timeout = \"wait\" },",
       {"p.toml:5:81: `on_timeout` = \"wait\"; it has to be one of \"continue\" \"stop\""}},
      {"{ do = \"hold\", duration_s = 1, record = \"all\" },",
       {"p.toml:5:41: `record` = \"all\"; it has to be one of \"full\" \"averaged\""}},
      {"{ duration_s = 1 },",
       {"p.toml:5:1: `do` is missing here: pressurize, settle, ramp, hold, wave, mark or repeat"}},
      {"{ do = \"mark\", label = \"at {x}\" },", {"p.toml:5:24: `label`: {x} is not a variable that is bound here"}},
      {"{ do = \"mark\", label = \"at {x\" },", {"p.toml:5:24: `label`: `{` is never closed"}},
      {"{ do = \"mark\", label = \"0123456789012345678901234567890123456789012345678\" },",
       {"p.toml:5:24: `label` = \"0123456789012345678901234567890123456789012345678\" is too long; at most "
        "47 bytes"}},
      // Repeats
      {"{ do = \"repeat\", steps = [] },", {"p.toml:5:1: a repeat needs `for` (values to go through) or `times`"}},
      {"{ do = \"repeat\", times = 2 },", {"p.toml:5:1: `steps` is missing here: what to repeat"}},
      {"{ do = \"repeat\", times = 2, for = { x = [1] }, steps = [] },",
       {"p.toml:5:26: give either `for` or `times`; put one repeat into another for both"}},
      {"{ do = \"repeat\", for = { x = [] }, steps = [] },",
       {"p.toml:5:30: `x` has no values; give at least one number"}},
      {"{ do = \"repeat\", for = { x = [1, \"a\"] }, steps = [] },",
       {"p.toml:5:34: `x` holds a string; a number is needed"}},
      {"{ do = \"repeat\", for = { \"x y\" = 1 }, steps = [] },",
       {"p.toml:5:34: `x y` cannot name a variable; use letters, digits and _ (with the unit)"}},
      {"{ do = \"repeat\", for = { x = 1 }, steps = [ { do = \"repeat\", for = { x = 2 }, steps = [] } ] },",
       {"p.toml:5:74: `x` is bound already further out; choose another name"}},
      {"{ do = \"repeat\", for = [ { x = 1, y = 2 }, { x = 1 } ], steps = [] },",
       {"p.toml:5:44: this row does not bind all names that the first one does: x, y"}},
      {"{ do = \"repeat\", for = [ { x = 1 }, { x = 1, z = 3 } ], steps = [] },",
       {"p.toml:5:50: `z` is not in the first row; every row binds the same names: x"}},
      // Sessions
      {"{ do = \"repeat\", unit = \"sesion\", times = 2, steps = [] },",
       {"p.toml:5:25: `unit` = \"sesion\"; it has to be one of \"session\""}},
      {"{ do = \"repeat\", unit = \"session\", steps = [ { do = \"ramp\", to_mm = 1, velocity_mm_s = 1 } ] "
       "},",
       {"p.toml:4:1: a step outside of the sessions belongs to none of them: its samples would be recorded into the "
        "one "
        "beside it, and `isorig resume` would leave it out; put it into a session, or into one of its own with a "
        "`label`",
        "p.toml:5:44: a session begins with a pressurize (to 0 psi if it needs none), so that it can be "
        "resumed on its "
        "own from a vented actuator"}},
      {"{ do = \"repeat\", unit = \"session\", steps = [] },", {"p.toml:5:1: a session without steps"}},
  };
  for (const auto& c : cases) {
    SCOPED_TRACE(c.step);
    EXPECT_EQ(faults_of_step(c.step, rig()), c.faults);
  }
}

TEST(CompileErrors, Sessions) {
  const std::string body = "steps = [ " + std::string(kBegin).substr(0, std::string(kBegin).size() - 2) + " ] },\n";
  EXPECT_THAT(faults_of(text_of("{ do = \"repeat\", unit = \"session\", for = { repetition = [1, 1] }, " + body)),
              ElementsAre("p.toml:4:1: two sessions are called \"repetition 1, 5 psi\"; bind `repetition`, or give the "
                          "session a `label` with its {variables}"));
  EXPECT_THAT(faults_of(text_of("{ do = \"repeat\", unit = \"session\", for = { repetition = [1, 1], k = 2 }, label = "
                                "\"r{repetition} {n}\", " +
                                body)),
              testing::Contains("p.toml:4:82: `label`: {n} is not a variable that is bound here"));
  EXPECT_THAT(
      faults_of(text_of("{ do = \"repeat\", unit = \"session\", for = { n = [1, 2] }, label = \"n {n}\", " + body)),
      IsEmpty());
  EXPECT_THAT(faults_of(text_of("{ do = \"repeat\", unit = \"session\", times = 2, steps = [\n" + std::string(kBegin) +
                                "{ do = \"repeat\", unit = \"session\", times = 2, " + body + "] },\n")),
              testing::Contains("p.toml:6:25: a session cannot hold another session; take `unit` off one of them"));
}

TEST(CompileErrors, ApproachAndConstants) {
  EXPECT_THAT(faults_of(text_of(kBegin, "\napproach_velocity_mm_s = 20"), rig()),
              ElementsAre("p.toml:3:26: `approach_velocity_mm_s` = 20; the rig allows 0.001 to 10 mm/s "
                          "(limits.speed_min_mm_s, limits.speed_max_mm_s)"));
  EXPECT_THAT(faults_of(text_of(kBegin, "\nconstants.x = \"a\"")),
              ElementsAre("p.toml:3:15: `x` is a string; a number is needed"));
}

TEST(CompileErrors, APlanThatDoesNotApproachMovesNothing) {
  EXPECT_THAT(faults_of(text_of(kBegin, "\napproach = false\napproach_velocity_mm_s = 20"), rig()), IsEmpty());
  EXPECT_THAT(faults_of(text_of(std::string(kBegin) + "{ do = \"ramp\", to_mm = 1, velocity_mm_s = 1 },\n",
                                "\napproach = false"),
                        rig()),
              ElementsAre(testing::AllOf(testing::HasSubstr("p.toml:3:12: `approach` = false"),
                                         testing::HasSubstr("line 6 moves it"))));
}

/// A crosshead that comes from elsewhere at 10 mm/s runs 0.1 mm beyond where it is told to stop, less the 0.02 mm that
/// a limit lets pass.
TEST(CompileErrors, TheWayToASessionKeepsToTheTravel) {
  const auto at = [](const char* to_mm) {
    return "{ do = \"repeat\", unit = \"session\", times = 1, label = \"a\", steps = [ " +
           std::string(kBegin).substr(0, std::string(kBegin).size() - 2) + ", { do = \"ramp\", to_mm = " + to_mm +
           ", velocity_mm_s = 1 } ] },\n{ do = \"repeat\", unit = \"session\", times = 1, label = \"b\", steps = [ " +
           std::string(kBegin).substr(0, std::string(kBegin).size() - 2) + " ] },\n";
  };
  EXPECT_THAT(faults_of(text_of(at("6"), "\napproach_velocity_mm_s = 1"), rig()), IsEmpty());
  EXPECT_THAT(faults_of(text_of(at("5.92"), "\napproach_velocity_mm_s = 10"), rig()), IsEmpty());
  EXPECT_THAT(faults_of(text_of(at("6"), "\napproach_velocity_mm_s = 10"), rig()),
              ElementsAre(testing::AllOf(testing::HasSubstr("`approach_velocity_mm_s` = 10, and \"b\" begins at 6 mm"),
                                         testing::HasSubstr("stay 0.08 mm inside"))));
}

TEST(CompileErrors, EveryStepStandsInASession) {
  const std::string session = "{ do = \"repeat\", unit = \"session\", times = 1, steps = [ " +
                              std::string(kBegin).substr(0, std::string(kBegin).size() - 2) + " ] },\n";
  const std::string hold = "{ do = \"hold\", duration_s = 1 },\n";
  for (const auto& steps : {session + hold, hold + session}) {
    EXPECT_THAT(faults_of(text_of(steps)),
                ElementsAre(testing::HasSubstr("a step outside of the sessions belongs to none of them")));
  }
}

/// The chords next to a sine's turning points are not at rest: 5 mm at 10 mm/s, cut so coarsely that a quarter has two.
TEST(CompileErrors, ASineTurnsWithinTheTravel) {
  const auto sine = [](const char* amplitude_mm, const char* deviation_mm) {
    return std::string(kBegin) + "{ do = \"wave\", shape = \"sine\", amplitude_mm = " + amplitude_mm +
           ", velocity_mm_s = 10, cycles = 1, deviation_mm = " + deviation_mm + " },\n";
  };
  EXPECT_THAT(faults_of(text_of(sine("6", "0.01")), rig()), IsEmpty());
  EXPECT_THAT(faults_of(text_of(sine("6", "1.5")), rig()),
              ::testing::Contains(testing::HasSubstr("runs over its target")));
}

/// A loop that follows 0.5 psi/s needs 10 s for 5 psi, whatever the step asks for.
TEST(CompileErrors, TheTimeOfAFillingIsThatOfThePressureLoop) {
  Limits limits = rig();
  limits.loop_rate_max_psi_s = 0.5;
  const auto step = [](const char* timeout_s) {
    return std::string("{ do = \"pressurize\", pressure_psi = 5, rate_psi_s = 1, settled_for_s = 1, timeout_s = ") +
           timeout_s + " },\n";
  };
  EXPECT_THAT(faults_of(text_of(step("12")), limits), IsEmpty());
  EXPECT_THAT(faults_of(text_of(step("8"))), IsEmpty());
  EXPECT_THAT(faults_of(text_of(step("8")), limits),
              ElementsAre(testing::HasSubstr("the set-point alone takes 11 s at 0.5 psi/s, the most that the rig's "
                                             "pressure loop follows (pressure_loop.rate_limit_psi_s)")));
}

TEST(CompileErrors, ASlipThatNeverEndsIsRefused) {
  const auto faults = faults_of(text_of(std::string(kBegin) +
                                        "{ do = \"repeat\", times = 100000, steps = [\n"
                                        "{ do = \"hold\", duration_s = 1 }, { do = \"hold\", duration_s = 1 } ] },\n"));
  EXPECT_THAT(faults, ElementsAre(testing::HasSubstr("more than 100000 steps")));
}

TEST(CompileErrors, ALabelIsOneLineOfPlainText) {
  EXPECT_THAT(faults_of(text_of(std::string(kBegin) + "{ do = \"mark\", label = \"a\\u001b[31m\\nb\" },\n")),
              ElementsAre(testing::HasSubstr("`label` holds a control character")));
}

TEST(CompileErrors, MoreThanAYearIsNotTaken) {
  const std::string weeks = "  { do = \"repeat\", times = 60, steps = [ { do = \"hold\", duration_s = 604800 } ] },\n";
  EXPECT_THAT(faults_of(text_of(std::string(kBegin) + weeks)), ElementsAre(testing::HasSubstr("years; at most one")));
}

TEST(Limits, AreReadWholeAndTheirFaultsFound) {
  const auto document = base::TomlDocument::parse_text(
      "[frame]\nanything = 1\n[limits]\ntravel_min_mm = -6\ntravel_max_mm = 6\nspeed_min_mm_s = 20\n"
      "speed_max_mm_s = 10\nforce_min_N = -5\nforce_max_N = 0\npresure_max_psi = 22\n",
      "rig.toml");
  const auto root = document.root();
  root.ignore_rest();
  const Limits limits = read_limits(root.table("limits"));
  EXPECT_EQ(limits.travel_min_mm, -6.0);
  EXPECT_EQ(limits.segment_interval_min_s, 0.05);
  std::vector<std::string> faults;
  for (const auto& d : document.diagnostics()) faults.push_back(d.text());
  EXPECT_THAT(faults, ElementsAre("rig.toml:3:1: `pressure_max_psi` is missing here",
                                  "rig.toml:6:18: `speed_min_mm_s` is above `speed_max_mm_s`; swap or correct them",
                                  "rig.toml:9:15: `force_max_N` = 0; it has to be greater than 0",
                                  "rig.toml:10:1: unknown key `presure_max_psi`; did you mean `pressure_max_psi`?"));
}

}  // namespace
}  // namespace isorig::protocol
