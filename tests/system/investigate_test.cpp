// isorig investigate on the virtual rig: explanations that a poor first protocol leaves tied, and what the
// experiment designed for them settles. Effects are concealed in the rig's model; fixed seeds.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "base/lock_file.hpp"
#include "processes.hpp"

namespace isorig::system_test {
namespace {

using testing::HasSubstr;

/// One ramp out and back, ten means a second: too little to tell a lag from a dead time.
constexpr const char* kPoor = R"(format = "isorig-protocol/1"
name = "poor"
recording.policy = "averaged"
recording.average_interval_s = 0.1
steps = [
  { do = "repeat", unit = "session", for = { repetition = [1] }, steps = [
    { do = "pressurize", pressure_psi = 15, rate_psi_s = 5, settled_for_s = 5, timeout_s = 60 },
    { do = "hold", duration_s = 20 },
    { do = "ramp", to_mm = 1, velocity_mm_s = 2 },
    { do = "hold", duration_s = 40 },
    { do = "ramp", to_mm = 0, velocity_mm_s = 0.1 },
    { do = "hold", duration_s = 30 },
  ] },
]
)";

/// The virtual specimen follows its pressure, by design of the rig; the nominal model may see it.
constexpr const char* kNominal = R"(format = "isorig-model/1"
name = "slse1 that sees the pressure"
[[part]]
physics = "spring"
[[part]]
physics = "maxwell"
[[part]]
physics = "constant"
[[part]]
physics = "pressure_coupling"
law = "force"
)";

constexpr const char* kTruth = R"(format = "isorig-model/1"
name = "truth"
[[part]]
physics = "spring"
stiffness_N_mm = 2.5
[[part]]
physics = "maxwell"
stiffness_N_mm = 1.5
time_constant_s = 5.0
)";

/// The shipped virtual rig with one more effect in its specimen, and a force channel of that noise.
std::string rig_with(const TempDir& dir, const std::string& effect, const std::string& noise_N) {
  spit(dir / "truth.toml", kTruth + effect);
  auto text = replaced(slurp(source("config/rigs/sim.toml")), "\"../", "\"" + source("config/"));
  text = replaced(text, "force_noise_N = 0.01", "force_noise_N = " + noise_N);
  spit(dir / "rig.toml", text + "\n[sim.physics]\nmodel = \"truth.toml\"\nnominal_pressure_psi = 15.0\n");
  return (dir / "rig.toml").string();
}

Answer investigate(const TempDir& dir, const std::string& rig, const std::vector<std::string>& more = {},
                   bool report = false) {
  spit(dir / "poor.toml", kPoor);
  spit(dir / "nominal.toml", kNominal);
  std::vector<std::string> words{"investigate",
                                 "--rig",
                                 rig,
                                 "--protocol",
                                 (dir / "poor.toml").string(),
                                 "--model",
                                 (dir / "nominal.toml").string(),
                                 "--out",
                                 (dir / "out").string()};
  if (!report) words.emplace_back("--no-report");
  words.insert(words.end(), more.begin(), more.end());
  return isorig(dir, std::move(words), 200.0);
}

nlohmann::json record_of(const TempDir& dir) {
  return nlohmann::json::parse(slurp(dir / "out/investigation.json"));
}

struct Case {
  const char* name;
  const char* effect;
  const char* noise_N;
  const char* truth;
  const char* rival;  ///< tied with it after the first recording
};

void PrintTo(const Case& c, std::ostream* out) {
  *out << c.name;
}

class Confusable : public testing::TestWithParam<Case> {};

TEST_P(Confusable, IsTiedAtFirstAndSettledByTheDesignedExperiment) {
  const TempDir dir;
  const Case& c = GetParam();
  const auto rig = rig_with(dir, c.effect, c.noise_N);
  const auto answer = investigate(dir, rig);
  ASSERT_EQ(answer.code, 0) << answer.text;
  const auto record = record_of(dir);
  EXPECT_EQ(record["outcome"], "settled") << answer.text;
  ASSERT_GE(record["rounds"].size(), 2U) << answer.text;

  const auto& first = record["rounds"][0];
  EXPECT_TRUE(first["tied"]);
  EXPECT_LT(first["explanations"][0]["probability"].get<double>(), 0.9);
  const auto& experiment = first["next_experiment"];
  std::vector<std::string> tied = experiment["separates"];
  EXPECT_THAT(tied, testing::Contains(c.truth));
  EXPECT_THAT(tied, testing::Contains(c.rival));
  EXPECT_TRUE(experiment["reaches_it"]) << experiment.dump(2);
  for (const auto& pair : experiment["expected"]) EXPECT_GE(pair["leaves"].get<double>(), 100.0);

  const auto& last = record["rounds"].back();
  EXPECT_EQ(last["explanations"][0]["effects"], c.truth) << answer.text;

  // What was designed keeps the rig's limits, and was run to its end.
  const auto checked = isorig(dir, {"check", (dir / "out/round-2/protocol.toml").string(), "--rig", rig});
  EXPECT_EQ(checked.code, 0) << checked.text;
  EXPECT_THAT(checked.text, HasSubstr("within those of"));
  EXPECT_NEAR(record["rounds"][1]["rig_s"].get<double>(), experiment["duration_s"].get<double>(),
              5.0 + 0.05 * experiment["duration_s"].get<double>());
  EXPECT_TRUE(std::filesystem::exists(dir / "out/model.toml"));
}

INSTANTIATE_TEST_SUITE_P(
    OnThePoorProtocol, Confusable,
    testing::Values(
        Case{"delay", "[[part]]\nphysics = \"force_delay\"\ndelay_s = 0.02\n", "0.05", "force_delay", "force_lag"},
        Case{"lag", "[[part]]\nphysics = \"force_lag\"\ntime_constant_s = 0.02\n", "0.05", "force_lag", "force_delay"},
        Case{"friction",
             "[[part]]\nphysics = \"coulomb_friction\"\nlaw = \"jenkins\"\nforce_N = 0.02\n"
             "presliding_mm = 0.005\n",
             "0.1", "coulomb_friction", "grip_slip"},
        Case{"softening",
             "[[part]]\nphysics = \"cyclic_softening\"\nlaw = \"elastic\"\ntravel_mm = 8\n"
             "lost_N_mm = -0.01\n",
             "0.1", "cyclic_softening", "zero_drift"}),
    [](const auto& one) { return std::string(one.param.name); });

TEST(Investigate, WithNothingMissingItEndsAfterTheFirstRecording) {
  const TempDir dir;
  const auto answer = investigate(dir, rig_with(dir, "", "0.05"));
  ASSERT_EQ(answer.code, 0) << answer.text;
  const auto record = record_of(dir);
  EXPECT_EQ(record["outcome"], "consistent");
  EXPECT_EQ(record["rounds"].size(), 1U);
  EXPECT_FALSE(std::filesystem::exists(dir / "out/round-2"));
}

TEST(Investigate, GoesOnWhereItWasAndRefusesAnotherQuestion) {
  const TempDir dir;
  const auto rig = rig_with(dir, "[[part]]\nphysics = \"force_delay\"\ndelay_s = 0.02\n", "0.05");
  const auto first = investigate(dir, rig, {"--rounds", "1"});
  EXPECT_EQ(first.code, 1) << first.text;
  EXPECT_EQ(record_of(dir)["outcome"], "rounds");
  const auto recorded = std::filesystem::last_write_time(dir / "out/round-1/recordings/rep-1_15-psi/frame.csv");
  // As if it had been killed in the middle of the second run.
  std::filesystem::create_directories(dir / "out/round-2/runs");
  const auto poor = investigate(dir, rig, {"--budget", "120"});
  EXPECT_EQ(poor.code, 1) << poor.text;
  EXPECT_EQ(record_of(dir)["outcome"], "budget");
  const auto second = investigate(dir, rig);
  EXPECT_EQ(second.code, 0) << second.text;
  EXPECT_THAT(second.text, HasSubstr("recorded before"));
  EXPECT_EQ(record_of(dir)["outcome"], "settled");
  EXPECT_EQ(std::filesystem::last_write_time(dir / "out/round-1/recordings/rep-1_15-psi/frame.csv"), recorded);
  // Given once more, also with less than was allowed, an answer that is settled stays.
  const auto again = investigate(dir, rig, {"--rounds", "1"});
  EXPECT_EQ(again.code, 0) << again.text;
  EXPECT_EQ(record_of(dir)["outcome"], "settled");
  const auto other = investigate(dir, rig, {"--seed", "77"});
  EXPECT_EQ(other.code, 1);
  EXPECT_THAT(other.text, HasSubstr("another seed"));
}

/// Where `href`s of a page lead that are files beside it, and are not there.
std::vector<std::string> dead_links(const std::filesystem::path& page) {
  std::vector<std::string> out;
  const std::string text = slurp(page), key = "\"href\":\"";
  for (auto at = text.find(key); at != std::string::npos; at = text.find(key, at + 1)) {
    const auto begin = at + key.size();
    const std::string href = text.substr(begin, text.find('"', begin) - begin);
    if (!href.empty() && href.find(':') == std::string::npos && href[0] != '#' &&
        !std::filesystem::exists(page.parent_path() / href))
      out.push_back(href);
  }
  return out;
}

/// The page of the last diagnosis is made where the budget ends it, too, and where there is none its numbers are led
/// to.
TEST(Investigate, AnotherCallInTheFolderIsRefusedAndTouchesNothing) {
  const TempDir dir;
  std::filesystem::create_directories(dir / "out/round-1");
  spit(dir / "out/round-1/begun", "by the other");
  const base::LockFile other(dir / "out/investigation.lock");
  const auto answer = investigate(dir, rig_with(dir, "", "0.01"));
  EXPECT_EQ(answer.code, 1);
  EXPECT_THAT(answer.text, HasSubstr("investigation.lock: in use by process " + std::to_string(::getpid())));
  EXPECT_EQ(slurp(dir / "out/round-1/begun"), "by the other");
}

TEST(Investigate, WhenTheBudgetEndsItsPageLeadsToTheLastDiagnosis) {
  const TempDir dir;
  const auto rig = rig_with(dir, "[[part]]\nphysics = \"force_delay\"\ndelay_s = 0.02\n", "0.05");
  const std::vector<std::string> budget{"--budget", "120"};
  const auto answer = investigate(dir, rig, budget, true);
  ASSERT_EQ(answer.code, 1) << answer.text;
  ASSERT_EQ(record_of(dir)["outcome"], "budget");
  const auto page = dir / "out/investigation-report.html";
  const auto leads_to = [&](const char* file) { return slurp(page).find(file) != std::string::npos; };
  EXPECT_TRUE(leads_to("round-1/diagnosis/diagnosis-report.html"));
  EXPECT_THAT(dead_links(page), testing::IsEmpty());
  // As a round leaves it that was not the last when it was diagnosed.
  std::filesystem::remove(dir / "out/round-1/diagnosis/diagnosis-report.html");
  EXPECT_EQ(investigate(dir, rig, budget, true).code, 1);
  EXPECT_TRUE(leads_to("round-1/diagnosis/diagnosis.json"));
  EXPECT_THAT(dead_links(page), testing::IsEmpty());
}

TEST(Investigate, StartsNoRealRig) {
  const TempDir dir;
  const auto answer =
      isorig(dir, {"investigate", "--rig", source("config/rigs/sim-wire.toml"), "--out", (dir / "out").string()});
  EXPECT_EQ(answer.code, 2) << answer.text;
  EXPECT_THAT(answer.text, HasSubstr("isorig start"));
  EXPECT_THAT(answer.text, HasSubstr("isorig diagnose"));
  EXPECT_FALSE(std::filesystem::exists(dir / "out"));
}

}  // namespace
}  // namespace isorig::system_test
