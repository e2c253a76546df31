// Whole runs in virtual time: the shipped campaign through the program, and its recording against the plant.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <set>

#include "daemon/host/virtual_run.hpp"
#include "daemon/recording/catalogue.hpp"
#include "messages/recording.hpp"
#include "processes.hpp"
#include "truth.hpp"

namespace isorig::system_test {
namespace {

using testing::HasSubstr;

TEST(VirtualCampaign, ThePapersProtocolWhole) {
  const TempDir dir;
  const auto runs = (dir / "runs").string();
  const auto start = std::chrono::steady_clock::now();
  Process program({bin("isorig"), "run", source("config/protocols/vma-isovelocity.toml"), "--rig",
                   source("config/rigs/sim.toml"), "--runs", runs, "--json"},
                  dir / "run.json");
  ASSERT_EQ(program.wait(850.0), 0) << program.output();
  const double wall_s = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();

  const auto result = nlohmann::json::parse(program.output());
  const double hours = result["simulated_s"].get<double>() / 3600.0;
  std::printf("  %.2f h of rig time, %llu ticks: %.1f s of wall time, %.1f s of CPU time, %.0f MB\n", hours,
              static_cast<unsigned long long>(result["ticks"].get<std::uint64_t>()), wall_s, program.cpu_s(),
              result["written_bytes"].get<double>() * 1e-6);
  EXPECT_EQ(result["outcome"], "done");
  EXPECT_EQ(result["fault"], "") << "what the rig does by itself, venting included, lies inside of its limits";
  EXPECT_EQ(result["missing_samples"], 0);
  const auto page = slurp(result["report"].get<std::string>());
  EXPECT_NE(page.find("20 of 20 planned repetitions complete"), std::string::npos);
  EXPECT_LT(page.size(), 10'000'000U) << "a day's run is a page that can be mailed";
  EXPECT_GT(hours, 22.0);
  EXPECT_LT(hours, 26.0);
  EXPECT_GT(result["ticks"].get<double>(), 1000.0 * result["simulated_s"].get<double>());
  EXPECT_LT(result["written_bytes"].get<double>(), 1e9);

  const daemon::Catalogue catalogue(runs, daemon::Catalogue::Access::kReadOnly);
  const auto run_row = catalogue.find_run("latest");
  ASSERT_TRUE(run_row);
  EXPECT_EQ(run_row->state, "done");
  EXPECT_EQ(run_row->sessions, 20);
  EXPECT_EQ(run_row->sessions_done, 20);
  std::set<std::pair<double, int>> seen;
  for (const auto& s : catalogue.sessions_of(run_row->id)) {
    EXPECT_EQ(s.state, "done") << s.label;
    seen.insert({s.pressure_psi, s.repetition});
  }
  std::set<std::pair<double, int>> wanted;
  for (const double psi : {5.0, 10.0, 15.0, 20.0}) {
    for (int repetition = 1; repetition <= 5; ++repetition) wanted.insert({psi, repetition});
  }
  EXPECT_EQ(seen, wanted);

  // Rows go as they come: a day of recording takes no more memory than its longest session.
  for (const std::string format : {"csv", "hdf5", "mat"}) {
    Process out(
        {bin("isorig"), "export", "latest", "--runs", runs, "--format", format, "--out", (dir / format).string()},
        dir / (format + ".log"));
    ASSERT_EQ(out.wait(240.0), 0) << out.output();
    std::printf("  export as %s: %.1f s of CPU time, %.0f MB\n", format.c_str(), out.cpu_s(), out.peak_MB());
    EXPECT_LT(out.peak_MB(), 250.0) << format;
    std::filesystem::remove_all(dir / format);
  }
}

std::string run_short(const TempDir& dir, const std::string& name, const std::string& seed) {
  const auto answer =
      isorig(dir, {"run", source("config/protocols/vma-short.toml"), "--rig", source("config/rigs/sim.toml"), "--runs",
                   (dir / name).string(), "--seed", seed, "--json"});
  EXPECT_EQ(answer.code, 0) << answer.text;
  const std::string directory = answer.json().value("directory", "");
  std::string bytes;
  for (const auto& segment : messages::list_segments(directory)) bytes += slurp(segment);
  return bytes;
}

/// By its own name or by a link, a page takes the place of an earlier page alone.
TEST(VirtualRun, ItsPageTakesNothingElsesPlace) {
  const TempDir dir;
  const auto runs = (dir / "runs").string();
  const auto answer = isorig(dir, {"run", source("config/protocols/vma-short.toml"), "--rig",
                                   source("config/rigs/sim.toml"), "--runs", runs, "--json"});
  const std::string directory = answer.json().value("directory", "");
  const auto segment = std::filesystem::path(directory) / "segment-0001.lcm";
  const auto was = slurp(segment);
  std::filesystem::create_symlink(segment, dir / "link.html");
  for (const auto& out : {segment.string(), (dir / "link.html").string()}) {
    const auto refused = isorig(dir, {"report", "latest", "--runs", runs, "--out", out});
    EXPECT_EQ(refused.code, 2) << refused.text;
    EXPECT_THAT(refused.text, testing::HasSubstr("is there already, and is no page"));
  }
  EXPECT_TRUE(slurp(segment) == was);
  for (int twice = 0; twice < 2; ++twice) {
    EXPECT_EQ(isorig(dir, {"report", "latest", "--runs", runs, "--out", (dir / "page.html").string()}).code, 0);
  }
}

TEST(VirtualRun, SameSeedSameBytesAnotherSeedOthers) {
  const TempDir dir;
  const auto first = run_short(dir, "first", "7");
  const auto second = run_short(dir, "second", "7");
  const auto other = run_short(dir, "other", "8");
  EXPECT_GT(first.size(), 1'000'000U);
  EXPECT_TRUE(first == second);
  EXPECT_FALSE(first == other);
}

TEST(VirtualRun, WhatWasRecordedIsWhatThePlantDid) {
  const TempDir dir;
  Truth truth;
  daemon::VirtualRunOptions options;
  options.start.protocol_name = "vma-short.toml";
  options.start.protocol_text = slurp(source("config/protocols/vma-short.toml"));
  options.runs_root = dir / "runs";
  options.on_tick = [&](sim::Rig& rig, daemon::Core&, std::int64_t) {
    const auto t = rig.truth();
    truth.add({t.mono_ns, t.position_mm, t.force_N, t.pressure_psi});
  };
  const auto rig = daemon::load_rig(source("config/rigs/sim.toml"));
  const auto result = daemon::run_virtual(rig, options);
  ASSERT_EQ(result.outcome, "done") << result.fault;

  RunComparison comparison(truth);
  const auto report = messages::read_run(result.directory, comparison);
  EXPECT_TRUE(report.whole()) << testing::PrintToString(report.complaints());
  comparison.finish();
  comparison.print();
  for (const auto* c : {&comparison.position, &comparison.force, &comparison.pressure_psi}) {
    EXPECT_GT(c->compared, 50'000U);
    EXPECT_EQ(c->outside, 0U) << "by up to " << c->worst_excess;
  }
  EXPECT_GT(comparison.mean_position.compared, 500U);
  EXPECT_EQ(comparison.mean_position.outside, 0U);
  // Stamps within 15 us rms, and the noise of the position, which is as much as 23 us at 10 mm/s.
  EXPECT_GT(comparison.position.stamps, 300U);
  EXPECT_LT(comparison.position.stamp_rms_us(), 40.0);
  for (const auto* s : {&comparison.frame_sequence, &comparison.pressure_sequence}) {
    EXPECT_EQ(s->missing, 0U);
    EXPECT_EQ(s->repeated, 0U);
    EXPECT_NEAR(static_cast<double>(s->samples), 1000.0 * result.simulated_s, 2000.0);
  }
}

// Three repetitions of which each takes long enough to be killed in.
constexpr const char* kThreeLongRepetitions = R"(format = "isorig-protocol/1"
name = "three"
recording.policy = "round_ramps"
steps = [
  { do = "repeat", unit = "session", for = { repetition = [1, 2, 3] }, steps = [
    { do = "pressurize", pressure_psi = 10, rate_psi_s = 5, settled_for_s = 1, timeout_s = 30 },
    { do = "mark", label = "repetition {repetition}" },
    { do = "ramp", to_mm = 1, velocity_mm_s = 10 },
    { do = "hold", duration_s = 5000 },
    { do = "ramp", to_mm = 0, velocity_mm_s = 1 },
  ] },
]
)";

TEST(VirtualRun, KilledInTheSecondRepetitionGoesOnFromItsStart) {
  const TempDir dir;
  const auto runs = (dir / "runs").string();
  const auto rig = source("config/rigs/sim.toml");
  spit(dir / "three.toml", kThreeLongRepetitions);
  const auto catalogue = [&] { return isorig(dir, {"runs", "--runs", runs, "--json"}).json(); };
  {
    Process victim({bin("isorig"), "run", (dir / "three.toml").string(), "--rig", rig, "--runs", runs, "--quiet"},
                   dir / "victim.log");
    ASSERT_TRUE(wait_until(60.0, [&] {
      const auto rows = catalogue();
      return rows.is_array() && rows.size() == 1 && rows[0].value("sessions_done", 0) >= 1;
    })) << victim.output();
    EXPECT_EQ(victim.stop(SIGKILL), -SIGKILL);
  }
  auto rows = catalogue();
  ASSERT_EQ(rows.size(), 1U);
  ASSERT_EQ(rows[0]["state"], "interrupted") << rows.dump(2);
  const int done_before = rows[0]["sessions_done"];
  ASSERT_LT(done_before, 3);
  const std::string id = rows[0]["id"];
  // How far it came: by the catalogue of the killed process, by one that the next writer has corrected, and by one that
  // is made anew from the recording.
  const double recorded_s = rows[0]["recorded_s"];
  EXPECT_GT(recorded_s, 4990.0 * done_before);
  EXPECT_LT(recorded_s, 5100.0 * (done_before + 1));
  for (const bool anew : {false, true}) {
    if (anew)
      for (const auto* file : {"catalogue.sqlite", "catalogue.sqlite-wal", "catalogue.sqlite-shm"})
        std::filesystem::remove(dir / "runs" / file);
    const daemon::Catalogue writer(runs);
    const auto row = writer.find_run(id);
    ASSERT_TRUE(row);
    EXPECT_EQ(row->state, "interrupted");
    EXPECT_NEAR(row->recorded_s, recorded_s, 0.1) << anew;
    EXPECT_EQ(std::filesystem::path(row->protocol).filename(), "three.toml");  // the recording has its name alone
  }

  // Readable as it is: whole, or with a torn end that is named.
  const auto shown = isorig(dir, {"show", id, "--runs", runs, "--json"});
  EXPECT_TRUE(shown.code == 0 || shown.code == 7) << shown.text;
  const auto before = isorig(dir, {"export", id, "--runs", runs, "--out", (dir / "before").string()});
  EXPECT_TRUE(before.code == 0 || before.code == 7) << before.text;
  EXPECT_NO_THROW((void)messages::read_recording(dir / "before/rep-1_10-psi"));

  const auto resumed = isorig(dir, {"run", "--resume", id, "--rig", rig, "--runs", runs, "--json"}, 120.0);
  ASSERT_EQ(resumed.code, 0) << resumed.text;
  EXPECT_EQ(resumed.json()["run"], id);
  // Only what was missing was done again.
  EXPECT_NEAR(resumed.json()["simulated_s"].get<double>(), 5010.0 * (3 - done_before), 60.0 * (3 - done_before));

  rows = catalogue();
  ASSERT_EQ(rows.size(), 1U);
  EXPECT_EQ(rows[0]["state"], "done");
  EXPECT_EQ(rows[0]["sessions_done"], 3);
  EXPECT_EQ(rows[0]["attempts"], 2);

  const auto exported = isorig(dir, {"export", id, "--runs", runs, "--out", (dir / "out").string(), "--json"});
  EXPECT_TRUE(exported.code == 0 || exported.code == 7) << exported.text;
  std::set<std::string> folders;
  for (const auto& entry : std::filesystem::directory_iterator(dir / "out"))
    folders.insert(entry.path().filename().string());
  EXPECT_EQ(folders, (std::set<std::string>{"rep-1_10-psi", "rep-2_10-psi", "rep-3_10-psi"}));
  for (const auto& folder : folders) {
    const auto recording = messages::read_recording(dir / "out" / folder);
    EXPECT_NEAR(recording.frame.t_s.back() - recording.frame.t_s.front(), 5005.0, 30.0) << folder;
    EXPECT_THAT(recording.metadata.further_toml, HasSubstr("complete = true")) << folder;
  }

  // And nothing is left to resume.
  const auto again = isorig(dir, {"run", "--resume", id, "--rig", rig, "--runs", runs});
  EXPECT_NE(again.code, 0);
  EXPECT_THAT(again.text, HasSubstr("every repetition"));
}

}  // namespace
}  // namespace isorig::system_test
