#include "daemon/recording/trip_evidence.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <functional>
#include <nlohmann/json.hpp>
#include <sstream>

#include "cli/screen/show_trips.hpp"
#include "daemon/host/virtual_run.hpp"
#include "daemon/recording/catalogue.hpp"
#include "fault_matrix_rig.hpp"
#include "recording_rig.hpp"
#include "tree.hpp"

static std::function<void(const std::string&)> on_fsync;  // with the name of the file

/// The evidence is synced with it, the recording with fdatasync. (A program's own symbol comes before libc's.)
extern "C" int fsync(int fd) {
  char link[64], name[512];
  std::snprintf(link, sizeof link, "/proc/self/fd/%d", fd);
  const auto n = ::readlink(link, name, sizeof name);
  const std::filesystem::path path(std::string(name, n > 0 ? static_cast<std::size_t>(n) : 0));
  if (on_fsync) on_fsync(path.filename().string());
  return static_cast<int>(::syscall(SYS_fsync, fd));
}

/// What a trip leaves behind beside the recording, and the story that is told of it.
namespace isorig::daemon::testing {
namespace {

using nlohmann::json;
using ::testing::HasSubstr;

constexpr std::int64_t kTripMs = 15'000;

EventRecord transition(std::int64_t ms, const char* code, RunState from, RunState to, Severity severity) {
  auto e = event_record(ms, 3, code, severity);
  e.from = from;
  e.to = to;
  return e;
}

/// A run that is averaged, and trips after 15 s. The frame's samples end at `frame_until_ms`.
class TripEvidenceTest : public ::testing::Test {
 protected:
  void record(std::int64_t until_ms, std::int64_t frame_until_ms, const std::vector<EventRecord>& events) {
    auto info = run_info();
    info.step_words = {"", "", "", "hold 30 s"};
    Recorder recorder(recorder_options(folder.path()), info);
    Streams streams;
    for (std::int64_t i = 0; i < until_ms; ++i) {
      for (const auto& e : events) {
        if (e.mono_ns == i * kMs + 1) streams.events.push(e);
      }
      if (i < frame_until_ms) streams.frame.push(frame_record(i, 3, Keep::kAveraged));
      streams.pressure.push(pressure_record(i, 3, Keep::kAveraged));
      if (i % 10 == 0) streams.control.push(control_record(i, 3));
      if (i % 50 == 0) {
        recorder.drain(streams, i * kMs);
        if (after_turn) after_turn();
      }
    }
    recorder.finish(streams, false);
    const auto report = messages::read_run(folder.path(), recorded);
    EXPECT_EQ(report.state(), messages::RecordingState::kIncomplete);
  }
  [[nodiscard]] json trip(int number) const {
    return json::parse(file_text(folder.path() / ("trip-" + std::to_string(number) + ".json")));
  }
  [[nodiscard]] std::vector<std::string> lines(const std::string& file) const {
    std::vector<std::string> all;
    std::istringstream in(file_text(folder.path() / file));
    for (std::string line; std::getline(in, line);) all.push_back(line);
    return all;
  }

  const EventRecord stop =
      transition(kTripMs, "limit.force", RunState::kRunning, RunState::kFaulted, Severity::kProgramStop);
  TemporaryDirectory folder{"trip"};
  Collected recorded;
  std::function<void()> after_turn;
};

TEST_F(TripEvidenceTest, EverySampleRoundATripIsKeptWhateverThePolicyMakesOfThem) {
  record(30'000, 30'000, {stop});
  const auto frame = lines("trip-1-frame.csv");
  // From 10 s before to 5 s after, one a millisecond, and what came until the slice after that was over.
  ASSERT_GE(frame.size(), 1U + 15'000U);
  EXPECT_LE(frame.size(), 1U + 15'000U + 101U);
  EXPECT_EQ(frame[0].substr(0, 30), "t_s,mono_ns,bound_ns,device_us");
  const auto r = frame_record(5'001, 3, Keep::kAveraged);
  char expected[200];
  std::snprintf(expected, sizeof expected, "%lld,%.0f,%lld,%u,3,%.9g,%.9g,%.9g,%.9g", static_cast<long long>(r.mono_ns),
                double{r.bound_ns}, static_cast<long long>(r.device_us), r.sequence, double{r.raw_position_mm},
                double{r.raw_force_N}, r.position_mm, r.force_N);
  EXPECT_THAT(frame[2], HasSubstr(expected));
  EXPECT_GE(lines("trip-1-pressure.csv").size(), 1U + 14'999U);
  EXPECT_NEAR(static_cast<double>(lines("trip-1-control.csv").size()), 1501.0, 11.0);
  const auto t = trip(1);
  EXPECT_EQ(t["code"], "limit.force");
  EXPECT_EQ(t["severity"], "program stop");
  EXPECT_EQ(t["state"], "running");
  EXPECT_EQ(t["step_words"], "hold 30 s");
  EXPECT_FALSE(std::filesystem::exists(folder.path() / "trip-2.json"));
}

/// A stream that has died brings no sample that pushes the ring out: it is the evidence all the same.
TEST_F(TripEvidenceTest, TheRunUpOfAStreamThatHasDiedIsRecordedInFull) {
  record(20'000, 14'700,
         {transition(kTripMs, "stale.frame", RunState::kRunning, RunState::kFaulted, Severity::kSafeState)});
  ASSERT_FALSE(recorded.frames.empty());
  EXPECT_LE(recorded.frames.front().mono_ns, 14'000 * kMs);
  EXPECT_EQ(recorded.frames.back().mono_ns, frame_record(14'699, 3, Keep::kAveraged).mono_ns);
  std::int64_t averaged = 0;
  for (const auto& i : recorded.frame_intervals) averaged += i.samples;
  EXPECT_EQ(averaged + static_cast<std::int64_t>(recorded.frames.size()), 14'700);
  EXPECT_EQ(lines("trip-1-frame.csv").size(), 1U + 9'700U);
  EXPECT_THAT(cli::tell_trip(trip(1)), HasSubstr("no sample of the frame came after it"));
}

/// Both links die with the trip and are back 2.67 s later, with the crosshead at rest and the air out: when it came to
/// rest, and when the air went, nobody saw.
TEST_F(TripEvidenceTest, NothingIsToldOfATimeWithoutSamples) {
  TripEvidence evidence(folder.path(), {});
  for (std::int64_t i = 14'000; i < 21'000; ++i) {
    evidence.take(control_record(i, 3));
    if (i == kTripMs) evidence.take(stop);
    if (i >= kTripMs - 3 && i < kTripMs + 2'670) continue;
    auto frame = frame_record(i, 3, Keep::kFull);
    frame.position_mm = i < kTripMs ? 1.0 : 1.5;
    evidence.take(frame);
    auto pressure = pressure_record(i, 3, Keep::kFull);
    pressure.pressure_psi = i < kTripMs ? 15.0 : 0.1;
    evidence.take(pressure);
  }
  evidence.finish(true);
  const auto reaction = trip(1)["reaction"];
  EXPECT_NEAR(reaction["frame_silent_s"][0].get<double>(), -0.004, 1e-3);
  EXPECT_NEAR(reaction["frame_silent_s"][1].get<double>(), 2.67, 1e-3);
  EXPECT_NEAR(reaction["stood_s"].get<double>(), 2.67, 1e-3);
  EXPECT_NEAR(reaction["vented_s"].get<double>(), 2.67, 1e-3);
  EXPECT_EQ(reaction["position_at_mm"], 1.0);
  EXPECT_EQ(reaction["pressure_at_psi"], 15.0);
  const auto story = cli::tell_trip(trip(1));
  EXPECT_THAT(story, HasSubstr("no sample of the frame from 4 ms before the trip to 2.67 s after it; the crosshead was "
                               "seen to stand from 2.67 s on, 0.500 mm from where it was seen last before"));
  EXPECT_THAT(story, HasSubstr("no pressure reading from 3 ms before the trip to 2.67 s after it; the pressure was "
                               "seen below 1 psi from 2.67 s on, at most 0.10 psi of what was read"));
}

/// It stood, and the link died: whether it stood to the end is not known. A sensor in trouble measures no pressure.
TEST_F(TripEvidenceTest, WhatWasSeenBeforeTheSamplesEndedIsNotSaidOfTheEnd) {
  TripEvidence evidence(folder.path(), {});
  for (std::int64_t i = 14'000; i < 21'000; ++i) {
    evidence.take(control_record(i, 3));
    if (i == kTripMs) evidence.take(stop);
    auto frame = frame_record(i, 3, Keep::kFull);
    frame.position_mm = 1.0;
    if (i < kTripMs + 1'000) evidence.take(frame);
    auto pressure = pressure_record(i, 3, Keep::kFull);
    pressure.pressure_psi = 0.1;
    pressure.status = i < kTripMs ? 0 : 3;
    evidence.take(pressure);
  }
  evidence.finish(true);
  const auto reaction = trip(1)["reaction"];
  EXPECT_FALSE(reaction.contains("stood_s"));
  EXPECT_FALSE(reaction.contains("vented_s"));
  EXPECT_EQ(reaction["pressure_samples_after"], 0);
  const auto story = cli::tell_trip(trip(1));
  EXPECT_THAT(story,
              HasSubstr("no sample of the frame from 999 ms after the trip to 5.00 s after it; the crosshead was "
                        "not seen to stand"));
  EXPECT_THAT(story, HasSubstr("no pressure reading came after it"));
}

TEST_F(TripEvidenceTest, WhatEndsItIsAddedAndASecondTripHasFilesOfItsOwn) {
  record(40'000, 40'000,
         {stop, transition(kTripMs + 400, "frame.stop", RunState::kFaulted, RunState::kFaulted, Severity::kSafeState),
          transition(25'000, "reset", RunState::kFaulted, RunState::kPaused, Severity::kInfo),
          transition(26'000, "resume", RunState::kPaused, RunState::kRunning, Severity::kInfo),
          transition(28'000, "loop.late", RunState::kRunning, RunState::kFaulted, Severity::kProgramStop),
          transition(29'000, "reset", RunState::kFaulted, RunState::kPaused, Severity::kInfo)});
  std::vector<std::string> complaints;
  const auto trips = cli::read_trips(folder.path(), complaints);
  EXPECT_TRUE(complaints.empty());
  ASSERT_EQ(trips.size(), 2U);
  const auto story = cli::tell_trip(trips[0]);
  EXPECT_THAT(story, HasSubstr("trip 1: limit.force, program stop"));
  EXPECT_THAT(story, HasSubstr("before   the rig was running, step 4: hold 30 s; at "));
  EXPECT_THAT(story, HasSubstr("400 ms after: frame.stop"));
  EXPECT_THAT(story, HasSubstr("reset after 10.00 s, then resumed after 11.00 s"));
  EXPECT_THAT(story, HasSubstr("trip-1-frame.csv"));
  // The second began while the first had had its time: 10 s before it are kept again.
  EXPECT_EQ(trips[1]["code"], "loop.late");
  EXPECT_GE(lines("trip-2-frame.csv").size(), 1U + 15'000U);
}

/// The folder is away as the second trip is numbered, and seems to hold none.
TEST_F(TripEvidenceTest, ATripThatIsNumberedWhileTheFolderIsAwayReplacesNone) {
  const auto at = folder.path() / "run", away = folder.path() / "away";
  std::filesystem::create_directories(at);
  const auto write = [](TripEvidence& evidence, std::int64_t from_ms, std::int64_t trip_ms, const char* code,
                        const std::function<void()>& before, const std::function<void()>& behind) {
    for (std::int64_t i = from_ms; i < trip_ms; ++i) evidence.take(frame_record(i, 3, Keep::kAveraged));
    before();
    evidence.take(transition(trip_ms, code, RunState::kRunning, RunState::kFaulted, Severity::kProgramStop));
    behind();
    evidence.finish(true);
    EXPECT_EQ(evidence.error(), "");
  };
  const auto nothing = [] {};
  TripEvidence first(at, {}, 0);
  write(first, 0, 1'000, "loop.late", nothing, nothing);
  TripEvidence second(at, {}, 0);  // of a further attempt
  write(
      second, 20'000, 21'000, "recorder", [&] { std::filesystem::rename(at, away); },
      [&] { std::filesystem::rename(away, at); });
  std::vector<std::string> complaints;
  const auto trips = cli::read_trips(at, complaints);
  ASSERT_EQ(trips.size(), 2U);
  EXPECT_EQ(trips[0]["code"], "loop.late");
  EXPECT_EQ(trips[1]["code"], "recorder");
}

/// Reset and resumed two seconds after the trip: what the crosshead does then is the run's motion, and no stop that
/// failed.
TEST_F(TripEvidenceTest, TheReactionEndsWhereTheRunGoesOn) {
  TripEvidence evidence(folder.path(), {}, 0);
  for (std::int64_t i = 0; i < 25'000; ++i) {
    auto r = frame_record(i, 3, Keep::kAveraged);
    r.position_mm = i < kTripMs + 2'000 ? 1.0 : 1.0 + 1e-3 * static_cast<double>(i - kTripMs - 2'000);
    evidence.take(r);
    if (i == kTripMs) evidence.take(stop);
    if (i == kTripMs + 1'500)
      evidence.take(transition(i, "reset", RunState::kFaulted, RunState::kPaused, Severity::kInfo));
    if (i == kTripMs + 2'000)
      evidence.take(transition(i, "resume", RunState::kPaused, RunState::kRunning, Severity::kInfo));
  }
  evidence.finish(true);
  const auto reaction = trip(1)["reaction"];
  ASSERT_TRUE(reaction.contains("stood_s")) << reaction.dump();
  EXPECT_NEAR(reaction["position_max_mm"].get<double>(), 1.0, 1e-6);
  EXPECT_GE(lines("trip-1-frame.csv").size(), 1U + 15'000U) << "the samples are kept all the same";
}

EventRecord by(const char* who, EventRecord event) {
  std::snprintf(event.by, sizeof event.by, "%s", who);
  return event;
}

TEST_F(TripEvidenceTest, WhoResetAndWhoWentOnIsKeptWithTheTime) {
  record(
      30'000, 30'000,
      {stop, by("ann (uid 1000)", transition(25'000, "reset", RunState::kFaulted, RunState::kPaused, Severity::kInfo)),
       by("ben (uid 1001) at a page of uid 990",
          transition(26'000, "resume", RunState::kPaused, RunState::kRunning, Severity::kInfo))});
  const auto events = trip(1)["events"];
  ASSERT_EQ(events.size(), 3U);
  EXPECT_FALSE(events[0].contains("by")) << "nobody asked for the trip";
  EXPECT_EQ(events[1]["by"], "ann (uid 1000)");
  EXPECT_FALSE(events[1].contains("utc")) << "in virtual time a date says nothing";
  EXPECT_THAT(
      cli::tell_trip(trip(1)),
      HasSubstr("reset by ann (uid 1000) after 10.00 s, then resumed by ben (uid 1001) at a page of uid 990 after "
                "11.00 s\n"));
}

TEST_F(TripEvidenceTest, WhoResetARunThatWasClosedIsKeptWithTheDate) {
  record(21'000, 21'000, {stop});
  // The epoch of run_info(): 2000-01-01T00:00:00Z at mono_ns = 0.
  append_to_last_trip(
      folder.path(),
      by("ann (uid 1000)", transition(75'000, "reset", RunState::kFaulted, RunState::kStopping, Severity::kInfo)),
      run_info().epoch_unix_us);
  EXPECT_THAT(cli::tell_trip(trip(1)), HasSubstr("reset by ann (uid 1000) after 60.00 s, at 2000-01-01T00:01:15Z\n"));
}

TEST_F(TripEvidenceTest, AResetAfterTheRunWasClosedIsAddedOnce) {
  record(21'000, 21'000, {stop});
  EXPECT_THAT(cli::tell_trip(trip(1)), HasSubstr("still latched when the recording ended"));
  append_to_last_trip(folder.path(),
                      transition(75'000, "reset", RunState::kFaulted, RunState::kStopping, Severity::kInfo));
  append_to_last_trip(folder.path(),
                      transition(99'000, "reset", RunState::kFaulted, RunState::kStopping, Severity::kInfo));
  EXPECT_THAT(cli::tell_trip(trip(1)), HasSubstr("reset after 60.00 s\n"));
  const TemporaryDirectory empty("trip-none");
  append_to_last_trip(empty.path(), stop);
  EXPECT_TRUE(std::filesystem::is_empty(empty.path()));
}

TEST_F(TripEvidenceTest, AVersionThatIsNotKnownIsLeftAsItIs) {
  record(21'000, 21'000, {stop});
  auto tomorrow = trip(1);
  tomorrow["format"] = "isorig-trip/2";
  std::ofstream(folder.path() / "trip-1.json") << tomorrow;
  EXPECT_THAT([&] { append_to_last_trip(folder.path(), stop); },
              ::testing::ThrowsMessage<std::runtime_error>(HasSubstr("its format is \"isorig-trip/2\"")));
  EXPECT_EQ(trip(1), tomorrow);
}

TEST_F(TripEvidenceTest, AFileThatIsNoEvidenceIsNamedAndTheOthersAreTold) {
  record(21'000, 21'000, {stop});
  std::ofstream(folder.path() / "trip-2.json") << "{\"format\": \"something else\"}";
  std::ofstream(folder.path() / "trip-3.json") << "{ cut";
  std::vector<std::string> complaints;
  EXPECT_EQ(cli::read_trips(folder.path(), complaints).size(), 1U);
  ASSERT_EQ(complaints.size(), 2U);
  EXPECT_THAT(complaints[0], HasSubstr("trip-2.json"));
  EXPECT_THAT(complaints[0], HasSubstr("its format is \"something else\", not \"isorig-trip/1\""));
  EXPECT_THAT(complaints[1], HasSubstr("trip-3.json"));
  // Whatever stands in it, the story neither throws nor makes up numbers.
  EXPECT_THAT(cli::tell_trip(json::parse(R"({"reaction": 3, "events": {"a": 1}, "before": []})")), HasSubstr("trip ?"));
  EXPECT_THROW(append_to_last_trip(folder.path(), stop), std::runtime_error);
}

TEST_F(TripEvidenceTest, AFolderThatTakesNothingIsSaidAndEndsNothing) {
  TripEvidence evidence(folder.path() / "not there", {});
  evidence.take(frame_record(14'999, 3, Keep::kFull));
  evidence.take(stop);
  evidence.advance(kTripMs * kMs + TripEvidence::kAfterNs + 2, true);
  EXPECT_THAT(evidence.error(), HasSubstr("trip-1-frame.csv"));
  evidence.finish(true);
  EXPECT_FALSE(evidence.is_owed());
}

/// The recorder is judged by how often it comes round, and a slow disk takes 0.25 s for each file.
TEST_F(TripEvidenceTest, ATurnOfTheRecorderWritesOneFileAtMost) {
  std::vector<int> turns;
  int files = 0;
  on_fsync = [&](const std::string& file) { files += file.starts_with(".trip-") ? 1 : 0; };
  after_turn = [&] {
    if (files > 0) turns.push_back(std::exchange(files, 0));
  };
  record(25'000, 25'000,
         {stop, transition(kTripMs + 300, "reset", RunState::kFaulted, RunState::kPaused, Severity::kInfo)});
  on_fsync = {};
  EXPECT_EQ(turns, (std::vector<int>{1, 1, 1, 1}));
  EXPECT_EQ(files, 0) << "nothing was left to the end";
  EXPECT_EQ(trip(1)["files"].size(), 3U);
}

TEST_F(TripEvidenceTest, TheRecordingIsWrittenBeforeTheEvidenceOfARunThatEnds) {
  std::size_t there = 0;
  bool event_is_there = false;
  on_fsync = [&](const std::string& file) {
    if (file != ".trip-1-frame.csv.part") return;
    Collected so_far;
    messages::read_run(folder.path(), so_far);
    there = so_far.frames.size();
    for (const auto& i : so_far.frame_intervals) there += static_cast<std::size_t>(i.samples);
    for (const auto& e : so_far.events) event_is_there = event_is_there || e.code == "limit.force";
  };
  record(15'100, 15'100, {stop});
  on_fsync = {};
  EXPECT_EQ(there, 15'100U);
  EXPECT_TRUE(event_is_there);
  EXPECT_EQ(lines("trip-1-frame.csv").size(), 1U + 10'100U);
  EXPECT_EQ(trip(1)["files"].size(), 3U);
}

TEST_F(TripEvidenceTest, NothingIsAddedBehindTheRecovery) {
  const auto pause = [](std::int64_t ms) {
    return transition(ms, "pause", RunState::kRunning, RunState::kPaused, Severity::kInfo);
  };
  const auto resume = [](std::int64_t ms) {
    return transition(ms, "resume", RunState::kPaused, RunState::kRunning, Severity::kInfo);
  };
  int stories = 0;
  on_fsync = [&](const std::string& file) { stories += file == ".trip-1.json.part" ? 1 : 0; };
  record(35'000, 35'000,
         {stop, transition(25'000, "reset", RunState::kFaulted, RunState::kPaused, Severity::kInfo), resume(26'000),
          pause(27'000), resume(28'000), pause(29'000)});
  on_fsync = {};
  const auto events = trip(1)["events"];
  ASSERT_EQ(events.size(), 3U);
  EXPECT_EQ(events[2]["code"], "resume");
  EXPECT_NEAR(events[2]["t_s"].get<double>(), 11.0, 1e-6);
  EXPECT_EQ(stories, 3) << "when its time was over, with the reset, with the recovery";
}

TEST_F(TripEvidenceTest, ATripWithinTheTimeOfAnotherLeavesBothWhole) {
  record(25'000, 25'000,
         {stop, transition(16'000, "reset", RunState::kFaulted, RunState::kPaused, Severity::kInfo),
          transition(17'000, "loop.late", RunState::kPaused, RunState::kFaulted, Severity::kProgramStop),
          transition(23'000, "run.aborted", RunState::kFaulted, RunState::kStopping, Severity::kInfo)});
  EXPECT_EQ(lines("trip-1-frame.csv").size(), 1U + 12'000U);
  EXPECT_EQ(lines("trip-2-frame.csv").size(), 1U + 15'000U);
  EXPECT_THAT(cli::tell_trip(trip(1)), HasSubstr("reset after 1.00 s\n"));
  EXPECT_THAT(cli::tell_trip(trip(2)), HasSubstr("the run was aborted after 6.00 s\n"));
}

TEST_F(TripEvidenceTest, ADiskAtItsReserveGetsTheStoryAlone) {
  TripEvidence evidence(folder.path(), {});
  for (std::int64_t i = 14'000; i < 15'000; ++i) evidence.take(frame_record(i, 3, Keep::kFull));
  evidence.take(stop);
  evidence.advance(kTripMs * kMs + TripEvidence::kAfterNs + 2, false);
  EXPECT_THAT(evidence.error(), HasSubstr("no room for the samples of trip-1.json"));
  EXPECT_FALSE(std::filesystem::exists(folder.path() / "trip-1-frame.csv"));
  EXPECT_EQ(trip(1)["files"].size(), 0U);
  EXPECT_THAT(cli::tell_trip(trip(1)), HasSubstr("samples  in the recording alone"));
}

/// The story of what the plant did, against the plant.
TEST(TripStory, SaysWhenTheCrossheadStoodAndWhenTheRigWasVented) {
  test::MatrixRig rig(test::At::kFast);
  ASSERT_TRUE(rig.bring()) << rig.trouble();
  rig.strike();
  rig.plant().pressure().faults.silent = true;
  rig.watch(8.0);
  rig.plant().pressure().faults.silent = false;
  const auto seen = rig.seen();
  ASSERT_EQ(seen.cause, "stale.pressure");
  const auto t = json::parse(file_text(rig.run_folder() / "trip-1.json"));
  // Within the window of its slope, 60 ms, and the wait of a motion slower than what it calls standing.
  EXPECT_NEAR(t["reaction"]["stood_s"].get<double>(), seen.stood_s - seen.trip_s, 0.07);
  EXPECT_EQ(t["reaction"]["valves"], "vent");
  EXPECT_LE(t["reaction"]["valves_s"].get<double>(), 0.001);
  EXPECT_EQ(t["reaction"]["pressure_samples_after"], 0) << "silent";
  const auto story = cli::tell_trip(t);
  EXPECT_THAT(story, HasSubstr("trip 1: stale.pressure, safe state"));
  EXPECT_THAT(story, HasSubstr("no pressure reading came after it"));
  EXPECT_THAT(story, HasSubstr("the crosshead stood after "));
}

/// A run that a fault has ended is closed by the host, at a turn of its own: not before the last sample of the evidence
/// has come.
TEST(TripStory, TheEvidenceOfATripThatEndedItsRunIsWholeToItsEnd) {
  const auto rig = load_rig(isorig::test::source_path() + "/config/rigs/sim.toml");
  for (const std::int64_t moment_ms : {8'000, 8'007, 8'013, 8'021, 8'026, 8'034, 8'042, 8'049}) {
    SCOPED_TRACE(moment_ms);
    const TemporaryDirectory runs("trip-end");
    VirtualRunOptions options;
    options.start.protocol_name = "hold.toml";
    options.start.protocol_text =
        "format = \"isorig-protocol/1\"\nname = \"hold\"\nrecording.policy = \"averaged\"\n"
        "steps = [{ do = \"pressurize\", pressure_psi = 5, rate_psi_s = 5, settled_for_s = 1, timeout_s = 20 },\n"
        "{ do = \"hold\", duration_s = 60 }]\n";
    options.runs_root = runs.path();
    options.on_tick = [&](sim::Rig& plant, Core&, std::int64_t now_ns) {
      if (now_ns == moment_ms * kMs) plant.interlock().estop_closed = false;
    };
    const auto result = run_virtual(rig, options);
    ASSERT_EQ(result.outcome, "failed");
    ASSERT_TRUE(std::filesystem::exists(result.directory / "trip-1.json"));
    for (const auto* const file : {"trip-1-frame.csv", "trip-1-pressure.csv"}) {
      std::istringstream in(file_text(result.directory / file));
      std::int64_t after = 0;
      double last_s = 0.0;
      for (std::string line; std::getline(in, line);) {
        const double t_s = std::strtod(line.c_str(), nullptr);
        after += t_s > 0.0 ? 1 : 0;
        last_s = std::max(last_s, t_s);
      }
      const double wanted_s = static_cast<double>(TripEvidence::kAfterNs) * 1e-9;
      // At 1 kHz, by the device's clock, which is off by 18 ppm: none or one less.
      EXPECT_GE(after, static_cast<std::int64_t>(wanted_s * 1000.0) - 2) << file;
      EXPECT_GT(last_s, wanted_s - 0.002) << file;
    }
  }
}

/// A program stop holds the run for somebody to clear it; in virtual time there is nobody, nor one who has aborted it.
TEST(TripStory, ARunThatAFaultHoldsInVirtualTimeEndsAsFailedInTheCatalogueToo) {
  const auto rig = load_rig(isorig::test::source_path() + "/config/rigs/sim.toml");
  const TemporaryDirectory runs("trip-held");
  VirtualRunOptions options;
  options.start.protocol_name = "ramp.toml";
  options.start.protocol_text =
      "format = \"isorig-protocol/1\"\nname = \"ramp\"\nsteps = [\n"
      "{ do = \"pressurize\", pressure_psi = 1, rate_psi_s = 5, settled_for_s = 0.1, timeout_s = 20 },\n"
      "{ do = \"ramp\", to_mm = 1, velocity_mm_s = 1 }]\n";
  options.runs_root = runs.path();
  options.prepare = [](sim::Rig& plant) { plant.frame().faults.ignores_segments = true; };
  const auto result = run_virtual(rig, options);
  EXPECT_EQ(result.outcome, "failed");
  EXPECT_THAT(result.fault, HasSubstr("frame.following"));
  const Catalogue catalogue(runs.path(), Catalogue::Access::kReadOnly);
  const auto row = catalogue.find_run(result.run_id);
  ASSERT_TRUE(row);
  EXPECT_EQ(row->state, "failed");
  EXPECT_EQ(row->fault, result.fault);
  const auto story = cli::tell_trip(json::parse(file_text(result.directory / "trip-1.json")));
  EXPECT_THAT(story, HasSubstr("the run was given up, with nobody there to clear it after "));
  EXPECT_THAT(story, ::testing::Not(HasSubstr("aborted")));
}

}  // namespace
}  // namespace isorig::daemon::testing
