#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "processes.hpp"

/// isorig calibrate, selftest and check as an operator or a script meets them, on a simulated rig with a known error.
namespace isorig::system_test {
namespace {

using ::testing::HasSubstr;

std::vector<std::string> calibrate(std::vector<std::string> more) {
  std::vector<std::string> words = {"calibrate"};
  words.insert(words.end(), more.begin(), more.end());
  words.insert(words.end(), {"--operator", "R. Boyle", "--reference", "gauge-7", "--reference-uncertainty", "0.01"});
  return words;
}
const std::vector<std::string> kValid = {"--reference-due", "2999-01-01"};

std::vector<std::string> operator+(std::vector<std::string> a, const std::vector<std::string>& b) {
  a.insert(a.end(), b.begin(), b.end());
  return a;
}

TEST(Commission, CalibrateThenSelftestThenCheck) {
  const TempDir dir;
  auto text = slurp(patient_rig(dir));
  text = replaced(text, "offset_psi = 0.0", "offset_psi = 0.2");
  spit(dir / "rig.toml", text);
  DaemonProcess daemon(dir, dir / "rig.toml");
  ASSERT_TRUE(daemon.reach("ready")) << daemon.log();

  // Refused, each with its reason, and nothing kept.
  const auto refused = [&](const std::vector<std::string>& words, int code, const std::string& why) {
    const auto answer = daemon.call(words);
    EXPECT_EQ(answer.code, code) << answer.text;
    EXPECT_THAT(answer.text, HasSubstr(why));
  };
  refused({"calibrate", "pressure", "--point", "0"}, 2, "--operator");
  refused(calibrate({"pressure", "--point", "0", "--reference-due", "2020-01-01"}), 5, "ended on 2020-01-01");
  refused(calibrate({"pressure", "--mode", "zero", "--point", "60"}) + kValid, 5, "outside the sensor's range");
  refused(calibrate({"pressure", "--mode", "zero"}) + kValid, 2, "no terminal");
  refused(calibrate({"force", "--drive", "5"}) + kValid, 2, "--drive is for pressure");
  refused(calibrate({"pressure", "--drive", "5", "--point", "5"}) + kValid, 5, "add --yes");
  refused(calibrate({"pressure", "--mode", "zero", "--point", "0", "--window-s", "0.5", "--settle-s", "0", "--drift-max", "1e-12"}) + kValid,
          5, "has not settled");
  refused(calibrate({"pressure", "--point", "0", "--point", "0.01", "--window-s", "0.5", "--yes"}) + kValid, 5, "3 levels or more");
  refused(calibrate({"pressure", "--mode", "zero", "--point", "20", "--window-s", "0.5", "--yes"}) + kValid, 5, "from the reference");
  EXPECT_FALSE(std::filesystem::exists(dir / "runs" / "calibration"));

  // Found: the sensor reads 0.2 psi at 0. Noise of one count (0.0023 psi) in 500 samples: 0.1 mpsi; five of those.
  const auto zero = calibrate({"pressure", "--mode", "zero", "--point", "0", "--window-s", "0.5", "--yes"}) + kValid;
  const auto dry = daemon.call(zero + std::vector<std::string>{"--dry-run"});
  EXPECT_EQ(dry.code, 0) << dry.text;
  EXPECT_THAT(dry.text, HasSubstr("nothing was kept"));
  const auto kept = daemon.call(zero);
  ASSERT_EQ(kept.code, 0) << kept.text;
  EXPECT_THAT(kept.text, HasSubstr("is in force"));
  const auto list = daemon.call({"calibrate", "list", "--json"}).json();
  ASSERT_EQ(list["records"].size(), 1U);
  EXPECT_NEAR(list["in_force"]["pressure"]["offset"], -0.2, 5e-4);
  EXPECT_TRUE(wait_until(5.0, [&] { return std::abs(daemon.status().value("pressure_psi", 1.0)) < 0.02; }));

  // Half a second later in the same second there is no second record of that name; the first stays.
  const auto overdue = calibrate({"pressure", "--mode", "check", "--point", "0", "--window-s", "1.5", "--due", "2026-01-01", "--yes"}) + kValid;
  ASSERT_EQ(daemon.call(overdue).code, 0);
  EXPECT_EQ(daemon.call({"calibrate", "list", "--json"}).json()["records"].size(), 2U);

  const auto test = daemon.call({"selftest", "--json", "--window-s", "1"});
  EXPECT_EQ(test.code, 1) << test.text;  // for that date alone
  const auto checks = test.json();
  for (const auto& c : checks["checks"]) {
    if (c["verdict"] != "fail") continue;
    EXPECT_THAT(std::vector<std::string>({"calibration.pressure", "realtime.lateness"}), ::testing::Contains(c["check"])) << c.dump();
  }
  const auto table = daemon.call({"selftest", "--window-s", "1"});
  EXPECT_THAT(table.text, HasSubstr("OVERDUE"));
  EXPECT_THAT(table.text, HasSubstr("-> isorig calibrate pressure"));

  const std::vector<std::string> check = {"check", source("config/protocols/vma-smoke.toml"), "--rig", (dir / "rig.toml").string(),
                                          "--runs", daemon.runs()};
  const auto warned = isorig(dir, check);
  EXPECT_EQ(warned.code, 0) << warned.text;
  EXPECT_THAT(warned.text, HasSubstr("calibration WARNING: calibration of pressure"));
  spit(dir / "rig.toml", slurp(dir / "rig.toml") + "\n[calibration]\noverdue = \"refuse\"\n");
  EXPECT_EQ(isorig(dir, check).code, 5);
  EXPECT_EQ(daemon.process().stop(SIGTERM), 0) << daemon.log();
}

}  // namespace
}  // namespace isorig::system_test
