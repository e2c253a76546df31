#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "processes.hpp"
#include "terminal.hpp"

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
  refused(calibrate({"pressure", "--point", "0", "--point", "0.01", "--window-s", "0.5", "--yes"}) + kValid, 5,
          "point 1 was not applied");
  refused(calibrate({"pressure", "--mode", "zero", "--point", "20", "--window-s", "0.5", "--yes"}) + kValid, 5,
          "from the reference");
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
  const auto overdue =
      calibrate({"pressure", "--mode", "check", "--point", "0", "--window-s", "1.5", "--due", "2026-01-01", "--yes"}) +
      kValid;
  ASSERT_EQ(daemon.call(overdue).code, 0);
  EXPECT_EQ(daemon.call({"calibrate", "list", "--json"}).json()["records"].size(), 2U);

  const auto test = daemon.call({"selftest", "--json", "--window-s", "1"});
  EXPECT_EQ(test.code, 1) << test.text;  // for that date alone
  const auto checks = test.json();
  for (const auto& c : checks["checks"]) {
    if (c["verdict"] != "fail") continue;
    EXPECT_THAT(std::vector<std::string>({"calibration.pressure", "realtime.lateness"}),
                ::testing::Contains(c["check"]))
        << c.dump();
  }
  const auto table = daemon.call({"selftest", "--window-s", "1"});
  EXPECT_THAT(table.text, HasSubstr("OVERDUE"));
  EXPECT_THAT(table.text, HasSubstr("-> isorig calibrate pressure"));

  const std::vector<std::string> check = {"check",  source("config/protocols/vma-smoke.toml"),
                                          "--rig",  (dir / "rig.toml").string(),
                                          "--runs", daemon.runs()};
  const auto warned = isorig(dir, check);
  EXPECT_EQ(warned.code, 0) << warned.text;
  EXPECT_THAT(warned.text, HasSubstr("calibration WARNING: calibration of pressure"));
  spit(dir / "rig.toml", slurp(dir / "rig.toml") + "\n[calibration]\noverdue = \"refuse\"\n");
  EXPECT_EQ(isorig(dir, check).code, 5);
  EXPECT_EQ(daemon.process().stop(SIGTERM), 0) << daemon.log();
}

// A load cell that moves by 0.1 N within the window of 0.5 s, and may move by 0.02; its noise of 0.01 N in 500 samples
// makes the movement uncertain by 0.01 sqrt(12 / 500) = 0.0015 N.
TEST(Commission, AReadingThatMovesIsNoCalibration) {
  const TempDir dir;
  spit(dir / "rig.toml", replaced(slurp(patient_rig(dir)), "force_drift_N_h = 0.0", "force_drift_N_h = 720.0"));
  DaemonProcess daemon(dir, dir / "rig.toml");
  ASSERT_TRUE(daemon.reach("ready")) << daemon.log();
  const auto answer = daemon.call(calibrate({"force", "--mode", "zero", "--point", "0", "--window-s", "0.5",
                                             "--settle-s", "0", "--drift-max", "0.02"}) +
                                  kValid);
  EXPECT_EQ(answer.code, 5) << answer.text;
  EXPECT_THAT(answer.text, HasSubstr("the force reading has not settled: it moves by +0."));
  EXPECT_FALSE(std::filesystem::exists(dir / "runs" / "calibration"));
  EXPECT_EQ(daemon.process().stop(SIGTERM), 0) << daemon.log();
}

TEST(Commission, SelftestAsksAndLeavesNothingHalfDone) {
  const TempDir dir;
  DaemonProcess daemon(dir, patient_rig(dir));
  ASSERT_TRUE(daemon.reach("ready")) << daemon.log();
  const std::vector<std::string> words = {bin("isorig"), "selftest", "--window-s",   "1", "--with-pressure", "--leak-s",
                                          "600",         "--socket", daemon.socket()};
  const std::string press = "Press the emergency stop, then press Enter (n: leave it out): ",
                    release = "Release it, then press Enter: ";
  const std::string open_guard = "Open the guard, then press Enter (n: leave it out): ", pressurize = "Go on? [y/N] ";
  const auto pressure_psi = [&] { return daemon.status().value("pressure_psi", 99.0); };
  const auto is_untouched = [&] {
    return daemon.state() == "ready" && pressure_psi() < 0.6 && daemon.catalogue().empty();
  };

  {  // No to everything: neither good nor bad.
    Terminal terminal(words);
    for (const auto& question : {press, open_guard, pressurize}) {
      ASSERT_TRUE(terminal.shows(question)) << terminal.shown();
      terminal.type("n\r");
    }
    (void)terminal.wait();
    EXPECT_TRUE(terminal.shows("the operator left it out"));
    EXPECT_TRUE(terminal.shows("the operator said no"));
    EXPECT_TRUE(is_untouched());
  }
  {  // A terminal that is closed says no to what is left.
    Terminal terminal(words);
    ASSERT_TRUE(terminal.shows(press)) << terminal.shown();
    terminal.type(Terminal::kCtrlD);
    (void)terminal.wait();
    EXPECT_TRUE(terminal.shows("the operator said no")) << terminal.shown();
    EXPECT_TRUE(is_untouched());
  }
  {  // Ctrl-C while it asks: it only looked.
    Terminal terminal(words);
    ASSERT_TRUE(terminal.shows(press)) << terminal.shown();
    terminal.type(Terminal::kCtrlC);
    EXPECT_EQ(terminal.wait(), -SIGINT);
    EXPECT_TRUE(is_untouched());
  }
  {  // An operator who says that it is pressed, and a daemon that sees nothing of it (this rig has no button); Ctrl-C
     // with the air sealed in.
    Terminal terminal(words);
    ASSERT_TRUE(terminal.shows(press)) << terminal.shown();
    terminal.type(Terminal::kEnter);
    ASSERT_TRUE(terminal.shows(release)) << terminal.shown();
    terminal.type(Terminal::kEnter);
    ASSERT_TRUE(terminal.shows(open_guard)) << terminal.shown();
    terminal.type("n\r");
    ASSERT_TRUE(terminal.shows(pressurize)) << terminal.shown();
    terminal.type("y\r");
    ASSERT_TRUE(wait_until(60.0, [&] { return daemon.state() == "paused" && pressure_psi() > 4.0; }))
        << daemon.status().dump(2);
    terminal.type(Terminal::kCtrlC);
    EXPECT_EQ(terminal.wait(), 1);
    EXPECT_TRUE(terminal.shows("interrupted: the rig vents")) << terminal.shown();
    EXPECT_TRUE(wait_until(60.0, [&] { return daemon.state() == "ready" && pressure_psi() < 0.6; }))
        << daemon.status().dump(2);
    const auto rows = daemon.catalogue();
    ASSERT_EQ(rows.size(), 1U);
    EXPECT_EQ(rows[0]["state"], "aborted");
  }
  {  // The contact that does not open fails the test.
    Terminal terminal({bin("isorig"), "selftest", "--window-s", "1", "--socket", daemon.socket()});
    ASSERT_TRUE(terminal.shows(press)) << terminal.shown();
    terminal.type(Terminal::kEnter);
    ASSERT_TRUE(terminal.shows(release)) << terminal.shown();
    terminal.type(Terminal::kEnter);
    ASSERT_TRUE(terminal.shows(open_guard)) << terminal.shown();
    terminal.type("n\r");
    EXPECT_EQ(terminal.wait(), 1);
    EXPECT_TRUE(terminal.shows("was not seen open: a press would go unnoticed")) << terminal.shown();
  }
  // Nobody there to ask.
  const auto alone = run(dir, {"sh", "-c", "exec \"$0\" \"$@\" </dev/null", bin("isorig"), "selftest",
                               "--with-pressure", "--socket", daemon.socket()});
  EXPECT_EQ(alone.code, 2) << alone.text;
  EXPECT_THAT(alone.text, HasSubstr("add --yes"));
  EXPECT_EQ(daemon.catalogue().size(), 1U);
  EXPECT_EQ(daemon.process().stop(SIGTERM), 0) << daemon.log();
}

}  // namespace
}  // namespace isorig::system_test
