// Half and double of each deciding number, by a program that stands in for isorig.
#include "proof/scoring/sensitivity.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <nlohmann/json.hpp>

#include "base/lock_file.hpp"
#include "base/process.hpp"
#include "base/text_file.hpp"
#include "proof/sealed.hpp"
#include "tiny_study.hpp"
#include "tree.hpp"

namespace isorig::proof {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;

TEST(Sensitivity, ANumberMovesWithinWhatItMayBe) {
  EXPECT_EQ(moved({"cost", "nat", 3.0, 0.0, 1e6, false}, 2.0), 6.0);
  EXPECT_EQ(moved({"surest", "1", 0.985, 0.0, 1.0, false}, 2.0), 1.0) << "its end";
  EXPECT_EQ(moved({"correlation", "1", -0.8, -1.0, 0.0, false}, 0.5), -0.4);
  EXPECT_EQ(moved({"effects", "1", 3.0, 1.0, 6.0, true}, 0.5), 2.0) << "a whole number";
  EXPECT_EQ(moved({"products", "1", 3.0, 1.0, 3.0, true}, 2.0), std::nullopt) << "it cannot be more";
}

Outcome said(std::string verdict, std::vector<Claim> missing) {
  Outcome o;
  o.verdict = std::move(verdict);
  o.missing = std::move(missing);
  o.nominal_rmse_N = 1.0;
  o.model_rmse_N = 0.5;
  return o;
}

TEST(Sensitivity, CountsVerdictsNamesAndSureClaims) {
  Label null, one;
  null.category = "null";
  one.category = "single";
  one.effects = {"slack"};
  const std::vector<Label> labels{null, one};
  const std::vector<Outcome> stated{said("consistent", {}), said("missing_physics", {{"slack", 0.95}})};
  const Shift same = shift_of(1.0, labels, stated, stated);
  EXPECT_EQ(same.verdicts_changed, 0U);
  EXPECT_EQ(same.names_changed, 0U);
  EXPECT_EQ(same.tally.right, 1U);
  const Shift other = shift_of(1.0, labels, stated,
                               {said("missing_physics", {{"zero_drift", 0.97}}),
                                said("missing_physics", {{"slack", 0.8}, {"zero_drift", 0.92}})});
  EXPECT_EQ(other.verdicts_changed, 1U);
  EXPECT_EQ(other.names_changed, 2U);
  EXPECT_EQ(other.tally.right, 0U);
  EXPECT_EQ(other.tally.wrong, 2U);
}

class SensitivityOfAStudy : public testing::Test {
 protected:
  void SetUp() override {
    proof_test::write_study(study_, 2);
    write_program("0.95");
  }
  void TearDown() override { fs::remove_all(folder_); }

  /// Names slack with `probability`, and nothing where the cost is double.
  void write_program(const std::string& probability) {
    proof_test::write_program(program_, probability, R"(
if [ "$decide" = cost_nats=6 ]; then echo '{"verdict": "consistent", "missing": []}' >"$out/diagnosis.json"; exit; fi)");
  }
  [[nodiscard]] SensitivityOptions options(std::vector<std::string> only = {}) const {
    SensitivityOptions out;
    out.study = study_;
    out.only = std::move(only);
    out.run.isorig = program_;
    return out;
  }
  /// Diagnoses so far.
  [[nodiscard]] std::size_t diagnosed() const { return proof_test::lines_of(folder_ / "diagnosed").size(); }

  fs::path folder_ = fs::temp_directory_path() / ("sensitivity-" + std::to_string(::getpid()));
  fs::path study_ = folder_ / "study", program_ = folder_ / "isorig";
};

TEST_F(SensitivityOfAStudy, RunsEveryCaseAtHalfAndDoubleAndNoPieceTwice) {
  Sensitivity found = measure_sensitivity(options({"cost_nats"}));
  EXPECT_EQ(diagnosed(), 6U) << "two cases as stated, at half and at double";
  ASSERT_EQ(found.numbers.size(), 1U);
  EXPECT_EQ(found.stated.right, 2U);
  const auto& [half, twice] = found.numbers[0].shifts;
  ASSERT_TRUE(half && twice);
  EXPECT_EQ(half->value, 1.5);
  EXPECT_EQ(half->verdicts_changed, 0U);
  EXPECT_EQ(twice->value, 6.0);
  EXPECT_EQ(twice->verdicts_changed, 2U);
  EXPECT_EQ(twice->names_changed, 2U);
  EXPECT_EQ(twice->tally.right, 0U);

  fs::remove(study_ / "sensitivity" / "cost_nats=6" / "case-001.json");
  found = measure_sensitivity(options());
  EXPECT_EQ(diagnosed(), 9U) << "the piece that was taken away, and the other number, which has no half";
  ASSERT_EQ(found.numbers.size(), 2U);
  EXPECT_FALSE(found.numbers[1].shifts[0]);
  EXPECT_THAT(sensitivity_text(found), HasSubstr("| `cost_nats`, 3 nat | 6 | 2/2 | 2/2 | 0 | 0 |"));
  const auto json = sensitivity_json(found);
  EXPECT_EQ(json["stated"]["right_above_0.9"], 2);
  EXPECT_EQ(json["numbers"][0]["double"]["verdicts_changed"], 2);
  EXPECT_TRUE(json["numbers"][1]["half"].is_null());
}

TEST_F(SensitivityOfAStudy, MixesNoTwoProgramsAndNamesWhatIsUnknown) {
  try {
    (void)measure_sensitivity(options({"cost_nat"}));
    FAIL();
  } catch (const std::runtime_error& e) {
    EXPECT_THAT(e.what(), HasSubstr("did you mean cost_nats?"));
  }
  (void)measure_sensitivity(options({"cost_nats"}));
  write_program("0.5");
  try {
    (void)measure_sensitivity(options({"cost_nats"}));
    FAIL();
  } catch (const std::runtime_error& e) {
    EXPECT_THAT(e.what(), HasSubstr("holds what another program made"));
  }
}

TEST_F(SensitivityOfAStudy, AnotherCallInTheFolderIsRefusedAndRunsNothing) {
  fs::create_directories(study_ / "sensitivity");
  const base::LockFile other(study_ / "sensitivity" / "sensitivity.lock");
  EXPECT_THAT([&] { (void)measure_sensitivity(options({"cost_nats"})); },
              testing::ThrowsMessage<base::LockError>(
                  HasSubstr("in use by process " + std::to_string(::getpid()) + " on " + base::host_name())));
  EXPECT_EQ(diagnosed(), 0U);
}

/// A folder that another study was generated into: its pieces have the names of the old ones.
TEST_F(SensitivityOfAStudy, MixesNoTwoStudies) {
  (void)measure_sensitivity(options({"cost_nats"}));
  const auto before = diagnosed();
  const std::string piece = base::read_text_file(study_ / "sensitivity" / "stated" / "case-000.json");
  auto labels = nlohmann::json::parse(base::read_text_file(study_ / "sealed" / "labels.json"));
  labels["cases"][0]["effects"][0]["effect"] = "zero_drift";
  seal(study_ / "sealed" / "labels.json", study_ / "labels.sha256", labels.dump());
  const auto refused = [&](const char* why) {
    EXPECT_THAT([&] { (void)measure_sensitivity(options({"cost_nats"})); },
                testing::ThrowsMessage<std::runtime_error>(HasSubstr(why)));
  };
  refused("holds what was measured of another study than");
  EXPECT_EQ(diagnosed(), before);
  EXPECT_EQ(base::read_text_file(study_ / "sensitivity" / "stated" / "case-000.json"), piece);
  fs::remove(study_ / "sensitivity" / "study.sha256");
  refused("does not say of which study");
  fs::remove_all(study_ / "sensitivity");
  EXPECT_EQ(measure_sensitivity(options({"cost_nats"})).stated.right, 1U) << "moved away, it is measured anew";
}

/// `isorig-proof run` into the results of a study that was there before.
TEST_F(SensitivityOfAStudy, RunLeavesTheResultsOfAnotherStudyAlone) {
  const auto run = [&] {
    return base::run_process({test::program_path() + "/isorig-proof", "run", study_, "--isorig", program_},
                             folder_ / "run.txt")
        .exit_code;
  };
  ASSERT_EQ(run(), 0) << base::read_text_file(folder_ / "run.txt");
  const std::string kept = base::read_text_file(study_ / "results" / "labels.sha256");
  seal(study_ / "sealed" / "labels.json", study_ / "labels.sha256", R"({"cases": []})");
  EXPECT_EQ(run(), 1);
  EXPECT_THAT(base::read_text_file(folder_ / "run.txt"), HasSubstr("holds the results of another study"));
  EXPECT_EQ(base::read_text_file(study_ / "results" / "labels.sha256"), kept);
  EXPECT_EQ(diagnosed(), 2U);
}

}  // namespace
}  // namespace isorig::proof
