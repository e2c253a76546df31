#include "daemon/recording/catalogue.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sqlite3.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <barrier>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <fstream>
#include <random>
#include <thread>

#include "base/toml_reader.hpp"
#include "daemon/recording/amendments.hpp"
#include "daemon/recording/recording_summary.hpp"
#include "recording_rig.hpp"

namespace isorig::daemon::testing {
namespace {

using ::testing::HasSubstr;
using ::testing::ThrowsMessage;

protocol::Plan two_sessions() {
  protocol::Plan plan;
  plan.sessions.resize(2);
  plan.sessions[0].repetition = 1;
  plan.sessions[0].pressure_psi = 5.0;
  plan.sessions[0].label = "repetition 1, 5 psi";
  plan.sessions[1].first_step = 2;
  plan.sessions[1].repetition = 1;
  plan.sessions[1].pressure_psi = 10.0;
  plan.sessions[1].label = "repetition 1, 10 psi";
  return plan;
}

RunInfo info_for(const protocol::Plan& plan) {
  auto info = run_info();
  info.texts = {{"protocol.toml", "# the protocol\n"}, {"specimen.toml", "# the specimen\n"}};
  for (const auto& s : plan.sessions) info.sessions.push_back({s.first_step, s.repetition, s.pressure_psi});
  return info;
}

TEST(Catalogue, FollowsARunFromStartToEnd) {
  const TemporaryDirectory root("catalogue");
  const auto plan = two_sessions();
  const auto info = info_for(plan);
  Catalogue catalogue(root.path());
  const auto id = catalogue.new_run_id("a-run");
  ASSERT_EQ(id, "a-run");
  auto options = recorder_options(root.path() / id);
  {
    Recorder recorder(options, info);
    recorder.on_session([&](const SessionChange& c) { catalogue.on_session(id, c); });
    catalogue.open_run(id, info, plan, "p.toml", "Ada");
    Catalogue watching(root.path(), Catalogue::Access::kReadOnly);
    EXPECT_EQ(watching.find_run("a-r")->state, "running");
    EXPECT_EQ(watching.sessions_of(id)[1].state, "planned");
    Streams streams;
    run_plan(recorder, streams, {{1'000, 0, Keep::kFull}, {2'000, 2, Keep::kFull}}, 50);
    recorder.drain(streams, 2'000 * kMs);
    EXPECT_EQ(watching.sessions_of(id)[0].state, "done");
    EXPECT_EQ(watching.sessions_of(id)[1].state, "running");
    recorder.finish(streams, true);
  }
  catalogue.close_run(id, "done", "");
  const auto run = catalogue.find_run("latest");
  ASSERT_TRUE(run);
  EXPECT_EQ(run->state, "done");
  EXPECT_EQ(run->operator_name, "Ada");
  EXPECT_EQ(run->sessions, 2);
  EXPECT_EQ(run->sessions_done, 2);
  const auto sessions = catalogue.sessions_of(id);
  EXPECT_EQ(sessions[0].last_mono_ns, pressure_record(999, 0, Keep::kFull).mono_ns);
  EXPECT_EQ(sessions[1].segment, "segment-0002.lcm");
  EXPECT_EQ(catalogue.new_run_id("a-run"), "a-run-2");
  EXPECT_EQ(catalogue.inputs_of(id).first_open_session, 2U);
}

TEST(Catalogue, ACatalogueThatWasRemovedUnderADaemonIsMadeAnew) {
  const TemporaryDirectory root("catalogue");
  const auto plan = two_sessions();
  const auto info = info_for(plan);
  const auto runs = root.path() / "runs";
  Catalogue catalogue(runs);
  catalogue.open_run("gone", info, plan, "p.toml", "");
  catalogue.close_run("gone", "done", "");
  for (const char* name : {"first", "second"}) {
    std::filesystem::remove_all(runs);
    std::filesystem::create_directories(runs / name);
    catalogue.open_run(name, info, plan, "p.toml", "");
    catalogue.close_run(name, "done", "");
    const Catalogue reader(runs, Catalogue::Access::kReadOnly);
    const auto rows = reader.runs();
    ASSERT_EQ(rows.size(), 1U);
    EXPECT_EQ(rows[0].id, name);
    EXPECT_EQ(rows[0].state, "done");
  }
  // Nor is another's taken for it.
  std::filesystem::remove(runs / "catalogue.sqlite");
  Catalogue(runs).open_run("another", info, plan, "p.toml", "");
  catalogue.open_run("third", info, plan, "p.toml", "");
  EXPECT_TRUE(Catalogue(runs, Catalogue::Access::kReadOnly).find_run("third"));
  EXPECT_TRUE(Catalogue(runs, Catalogue::Access::kReadOnly).find_run("another"));
}

TEST(Catalogue, OneThatIsNoneIsNamedWithWhatToDo) {
  const TemporaryDirectory root("catalogue");
  const auto file = root.path() / "catalogue.sqlite";
  const auto plan = two_sessions();
  {
    Catalogue catalogue(root.path());
    for (int i = 0; i < 50; ++i) {
      catalogue.open_run("run-" + std::to_string(i), info_for(plan), plan, "p.toml", "");
      catalogue.close_run("run-" + std::to_string(i), "done", "");
    }
  }
  const auto told = [&](Catalogue::Access access) {
    EXPECT_THAT(([&] { (void)Catalogue(root.path(), access).runs(); }),
                ThrowsMessage<std::runtime_error>(::testing::AllOf(HasSubstr(file.string()), HasSubstr("move it aside"),
                                                                   ::testing::Not(HasSubstr("PRAGMA")),
                                                                   ::testing::Not(HasSubstr("SELECT")))));
  };
  const auto size = std::filesystem::file_size(file);
  ASSERT_GT(size, 12'288U);
  std::filesystem::resize_file(file, size / 2);
  told(Catalogue::Access::kReadOnly);
  std::mt19937_64 random(3);
  std::string noise(20'000, ' ');
  for (auto& c : noise) c = static_cast<char>(random());
  std::ofstream(file, std::ios::binary | std::ios::trunc) << noise;
  told(Catalogue::Access::kReadOnly);
  told(Catalogue::Access::kReadWrite);
  std::ofstream(file, std::ios::binary | std::ios::trunc).flush();
  told(Catalogue::Access::kReadOnly);
  EXPECT_TRUE(Catalogue(root.path()).runs().empty()) << "an empty file is filled";
}

TEST(Catalogue, AWholeNameIsFoundAmongLongerOnes) {
  const TemporaryDirectory root("catalogue");
  const auto plan = two_sessions();
  const auto info = info_for(plan);
  Catalogue catalogue(root.path());
  for (const char* name : {"a-run", "a-run-2", "a-run-3"}) {  // one second, three runs
    catalogue.open_run(name, info, plan, "p.toml", "");
    catalogue.close_run(name, "done", "");
  }
  EXPECT_EQ(catalogue.find_run("a-run")->id, "a-run");
  EXPECT_EQ(catalogue.find_run("a-run-2")->id, "a-run-2");
  EXPECT_THAT([&] { (void)catalogue.find_run("a-r"); }, ThrowsMessage<std::runtime_error>(HasSubstr("several runs")));
  EXPECT_FALSE(catalogue.find_run(""));
}

TEST(Catalogue, ARunWhoseDaemonWasKilledIsInterruptedAndCanGoOn) {
  const TemporaryDirectory root("catalogue");
  const auto plan = two_sessions();
  const auto info = info_for(plan);
  int ready[2];
  ASSERT_EQ(::pipe(ready), 0);
  const pid_t child = ::fork();
  ASSERT_GE(child, 0);
  if (child == 0) {
    Catalogue catalogue(root.path());
    Recorder recorder(recorder_options(root.path() / "killed"), info);
    recorder.on_session([&](const SessionChange& c) { catalogue.on_session("killed", c); });
    catalogue.open_run("killed", info, plan, "p.toml", "");
    Streams streams;
    run_plan(recorder, streams, {{1'000, 0, Keep::kFull}, {3'000, 2, Keep::kFull}}, 50);
    recorder.drain(streams, 3'000 * kMs);
    if (::write(ready[1], "x", 1) != 1) ::_exit(1);
    for (;;) ::pause();
  }
  ::close(ready[1]);
  char x = 0;
  ASSERT_EQ(::read(ready[0], &x, 1), 1);
  {
    const Catalogue watching(root.path(), Catalogue::Access::kReadOnly);
    EXPECT_EQ(watching.find_run("killed")->state, "running");
    EXPECT_THAT([&] { (void)watching.inputs_of("killed"); },
                ThrowsMessage<std::runtime_error>(HasSubstr("still running")));
    // Moved aside while it is written: nobody can see its lock there.
    std::filesystem::rename(root.path() / "killed", root.path() / "moved");
    EXPECT_EQ(watching.find_run("killed")->state, "unknown");
    EXPECT_THAT(watching.find_run("killed")->fault, HasSubstr("folder is not there"));
    EXPECT_EQ(watching.sessions_of("killed")[1].state, "running");
    std::filesystem::rename(root.path() / "moved", root.path() / "killed");
    EXPECT_EQ(watching.find_run("killed")->state, "running");
  }
  ASSERT_EQ(::kill(child, SIGKILL), 0);
  ASSERT_EQ(::waitpid(child, nullptr, 0), child);
  ::close(ready[0]);
  {
    // Before anybody has written it down.
    const Catalogue watching(root.path(), Catalogue::Access::kReadOnly);
    EXPECT_EQ(watching.find_run("killed")->state, "interrupted");
    EXPECT_EQ(watching.sessions_of("killed")[1].state, "interrupted");
  }
  Catalogue catalogue(root.path());
  const auto inputs = catalogue.inputs_of("killed");
  EXPECT_EQ(inputs.first_open_session, 1U);
  EXPECT_EQ(inputs.protocol_text, "# the protocol\n");
  EXPECT_EQ(inputs.specimen_text, "# the specimen\n");
  {
    Recorder recorder(recorder_options(inputs.directory), info);
    recorder.on_session([&](const SessionChange& c) { catalogue.on_session("killed", c); });
    catalogue.open_run("killed", info, plan, "p.toml", "");
    EXPECT_EQ(catalogue.find_run("killed")->attempts, 2);
    EXPECT_EQ(catalogue.sessions_of("killed")[0].state, "done");
    Streams streams;
    run_plan(recorder, streams, {{4'000, 2, Keep::kFull}}, 50, 3'500);
    recorder.finish(streams, true);
  }
  catalogue.close_run("killed", "done", "");
  EXPECT_EQ(catalogue.sessions_of("killed")[1].attempt, 2);
  EXPECT_EQ(catalogue.find_run("killed")->sessions_done, 2);
}

/// Two sessions, recorded and closed.
void record_run(const std::filesystem::path& root, const std::string& id, bool close) {
  const auto plan = two_sessions();
  const auto info = info_for(plan);
  Catalogue catalogue(root);
  Recorder recorder(recorder_options(root / id), info);
  recorder.on_session([&](const SessionChange& c) { catalogue.on_session(id, c); });
  catalogue.open_run(id, info, plan, "p.toml", "Ada");
  Streams streams;
  run_plan(recorder, streams, {{1'000, 0, Keep::kFull}, {2'000, 2, Keep::kFull}}, 50);
  EXPECT_TRUE(recorder.finish(streams, true));
  if (close) catalogue.close_run(id, "done", "");
}

TEST(Catalogue, AReaderWithoutTheRightToWriteListsRuns) {
  const TemporaryDirectory root("catalogue");
  const TemporaryDirectory copies("copies");
  std::filesystem::permissions(copies.path(), std::filesystem::perms(0777));
  record_run(root.path(), "a-run", true);
  std::filesystem::permissions(root.path(), std::filesystem::perms(0555));
  std::filesystem::permissions(root.path() / "catalogue.sqlite", std::filesystem::perms(0444));
  for (const bool with_log : {false, true}) {
    if (with_log) {  // as a daemon leaves it that was killed: what was written last is in the log alone
      std::filesystem::permissions(root.path(), std::filesystem::perms(0755));
      std::filesystem::permissions(root.path() / "catalogue.sqlite", std::filesystem::perms(0644));
      const auto kept = root.path() / "kept";
      {
        Catalogue last(root.path());
        last.close_run("a-run", "failed", "written last");
        std::filesystem::copy_file(root.path() / "catalogue.sqlite-wal", kept);
      }
      std::filesystem::rename(kept, root.path() / "catalogue.sqlite-wal");
      std::filesystem::permissions(root.path(), std::filesystem::perms(0555));
    }
    const pid_t child = ::fork();
    ASSERT_GE(child, 0);
    if (child == 0) {
      if (::geteuid() == 0 && (::setgid(65534) != 0 || ::setuid(65534) != 0)) ::_exit(9);
      ::setenv("TMPDIR", copies.path().c_str(), 1);
      int code = 2;
      try {
        const Catalogue watching(root.path(), Catalogue::Access::kReadOnly);
        const auto run = watching.find_run("latest");
        code = run && run->sessions_done == 2 && run->state == (with_log ? "failed" : "done") ? 0 : 1;
      } catch (const std::exception& e) {
        std::fprintf(stderr, "%s\n", e.what());
      }
      ::_exit(code);
    }
    int state = 0;
    ASSERT_EQ(::waitpid(child, &state, 0), child);
    EXPECT_EQ(WEXITSTATUS(state), 0) << (with_log ? "with" : "without") << " a write-ahead log";
    EXPECT_TRUE(std::filesystem::is_empty(copies.path())) << "the reader's copy is left";
  }
  std::filesystem::permissions(root.path(), std::filesystem::perms(0755));
}

TEST(Catalogue, OneThatIsLockedHoldsNobodyUpAndIsWrittenLater) {
  const TemporaryDirectory root("catalogue");
  const auto plan = two_sessions();
  const auto info = info_for(plan);
  Catalogue catalogue(root.path());
  Recorder recorder(recorder_options(root.path() / "a-run"), info);
  recorder.on_session([&](const SessionChange& c) { catalogue.on_session("a-run", c); });
  catalogue.open_run("a-run", info, plan, "p.toml", "Ada");
  sqlite3* other = nullptr;
  ASSERT_EQ(sqlite3_open((root.path() / "catalogue.sqlite").c_str(), &other), SQLITE_OK);
  ASSERT_EQ(sqlite3_exec(other, "BEGIN IMMEDIATE", nullptr, nullptr, nullptr), SQLITE_OK);
  const auto start = std::chrono::steady_clock::now();
  Streams streams;
  run_plan(recorder, streams, {{1'000, 0, Keep::kFull}, {2'000, 2, Keep::kFull}}, 500);
  EXPECT_THAT(recorder.status().catalogue_error, HasSubstr("locked"));
  EXPECT_FALSE(recorder.finish(streams, true));
  EXPECT_LT(std::chrono::steady_clock::now() - start, std::chrono::seconds(4))
      << "the time-out of one statement was 5 s";
  EXPECT_EQ(catalogue.sessions_of("a-run")[0].state, "planned");
  ASSERT_EQ(sqlite3_exec(other, "ROLLBACK", nullptr, nullptr, nullptr), SQLITE_OK);
  sqlite3_close(other);
  EXPECT_TRUE(recorder.settle());
  EXPECT_EQ(recorder.status().catalogue_error, "");
  for (const auto& s : catalogue.sessions_of("a-run")) EXPECT_EQ(s.state, "done");
}

/// As the README's first command does: a run in virtual time and a daemon, in a folder that was not there.
TEST(Catalogue, OfManyThatMakeOneAtOnceNobodyIsTurnedAway) {
  for (int round = 0; round < 50; ++round) {
    const TemporaryDirectory dir("catalogue");
    constexpr int kAtOnce = 4;
    std::barrier together(kAtOnce);
    std::array<std::string, kAtOnce> refused;
    std::vector<std::thread> all;
    for (auto& why : refused) {
      all.emplace_back([&] {
        together.arrive_and_wait();
        try {
          const Catalogue catalogue(dir.path());
        } catch (const std::exception& e) {
          why = e.what();
        }
      });
    }
    for (auto& thread : all) thread.join();
    for (const auto& why : refused) ASSERT_EQ(why, "") << "round " << round;
  }
}

TEST(Catalogue, RecordingsThatAreInNoneAreEntered) {
  const TemporaryDirectory root("catalogue");
  record_run(root.path(), "whole", true);
  record_run(root.path(), "never-closed", false);
  {  // killed between the folder and the entry
    Recorder recorder(recorder_options(root.path() / "just-begun"), info_for(two_sessions()));
    std::filesystem::copy(root.path() / "just-begun", root.path() / "killed", std::filesystem::copy_options::recursive);
  }
  for (const bool deleted : {false, true}) {
    if (deleted) {
      for (const char* end : {"", "-wal", "-shm"})
        std::filesystem::remove(root.path() / (std::string("catalogue.sqlite") + end));
    }
    const Catalogue catalogue(root.path());
    EXPECT_EQ(catalogue.find_run("whole")->state, "done");
    EXPECT_EQ(catalogue.find_run("never-closed")->state, "done") << "the recording has its end";
    EXPECT_EQ(catalogue.find_run("whole")->sessions_done, 2);
    ASSERT_TRUE(catalogue.find_run("killed"));
    EXPECT_EQ(catalogue.find_run("killed")->state, "interrupted");
    EXPECT_EQ(catalogue.find_run("killed")->started_utc, "2000-01-01T00:00:00Z");
    const auto inputs = catalogue.inputs_of("killed");
    EXPECT_EQ(inputs.first_open_session, 0U);
    EXPECT_EQ(inputs.protocol_text, "# the protocol\n");
  }
}

/// Ended by a person, by a fault, or before it had begun: the events of the recording say so.
TEST(Catalogue, OneMadeAnewKnowsWhoWasAbortedAndWhoFailed) {
  const TemporaryDirectory root("catalogue");
  const auto plan = two_sessions();
  const auto end = [](const char* code, const char* text, Severity severity, std::int64_t ms) {
    auto e = event_record(ms, 0, code, severity);
    std::snprintf(e.text, sizeof e.text, "%s", text);
    return e;
  };
  const auto record = [&](const std::string& id, int attempt, const std::vector<EventRecord>& events) {
    auto info = info_for(plan);
    Recorder recorder(recorder_options(root.path() / id), info);
    Streams streams;
    const std::int64_t from_ms = attempt == 1 ? 0 : 2'000;
    run_plan(recorder, streams, {{from_ms + 500, 0, Keep::kFull}}, 50, from_ms);
    for (const auto& e : events) streams.events.push(e);
    EXPECT_TRUE(recorder.finish(streams, false));
  };
  record("a-aborted", 1, {end("run.aborted", "aborted by ann (uid 1000)", Severity::kInfo, 500)});
  record("b-failed", 1,
         {end("limit.force", "force outside its limits", Severity::kSafeState, 490),
          end("run.failed", "ended by a fault", Severity::kInfo, 500)});
  record("c-not-started", 1, {end("run.not_started", "a countdown was taken back", Severity::kInfo, 500)});
  record("d-gone-on", 1, {end("run.aborted", "aborted by ann (uid 1000)", Severity::kInfo, 500)});
  record("d-gone-on", 2, {});
  record("e-told-only", 1, {});
  const Catalogue catalogue(root.path());
  const auto row = [&](const char* id) {
    const auto found = catalogue.find_run(id);
    EXPECT_TRUE(found) << id;
    return found ? found->state + ": " + found->fault : std::string();
  };
  EXPECT_EQ(row("a-aborted"), "aborted: aborted by ann (uid 1000)");
  EXPECT_EQ(row("b-failed"), "failed: limit.force: force outside its limits");
  EXPECT_EQ(row("c-not-started"), "not started: a countdown was taken back");
  EXPECT_EQ(row("d-gone-on"), std::string("interrupted: ") + kInterruptedFault);
  EXPECT_EQ(row("e-told-only"), std::string("interrupted: ") + kInterruptedFault);
}

TEST(Catalogue, AKilledWritersReserveIsRemovedAndALiveOnesIsNot) {
  const TemporaryDirectory root("catalogue");
  record_run(root.path(), "killed", true);
  std::ofstream(root.path() / "killed" / ".reserve") << std::string(1'000, '\0');
  Recorder alive(recorder_options(root.path() / "alive"), info_for(two_sessions()));
  ASSERT_TRUE(std::filesystem::exists(root.path() / "alive" / ".reserve"));
  const Catalogue catalogue(root.path());
  EXPECT_FALSE(std::filesystem::exists(root.path() / "killed" / ".reserve"));
  EXPECT_TRUE(std::filesystem::exists(root.path() / "alive" / ".reserve"));
}

TEST(Catalogue, InputsThatAPowerCutEmptiedAreTakenFromTheRecording) {
  const TemporaryDirectory root("catalogue");
  record_run(root.path(), "a-run", true);
  std::filesystem::resize_file(root.path() / "a-run" / "inputs" / "protocol.toml", 0);
  std::filesystem::remove(root.path() / "a-run" / "inputs" / "specimen.toml");
  const auto inputs = Catalogue(root.path()).inputs_of("a-run");
  EXPECT_EQ(inputs.protocol_text, "# the protocol\n");
  EXPECT_EQ(inputs.specimen_text, "# the specimen\n");
}

/// A newer isorig went on with it: this one leaves it alone.
TEST(Catalogue, ARunWithASegmentOfAVersionToComeIsNotGoneOnWith) {
  const TemporaryDirectory root("catalogue");
  record_run(root.path(), "a-run", true);
  const auto run = root.path() / "a-run";
  const auto segments = messages::list_segments(run);
  ASSERT_GE(segments.size(), 2U);
  make_version_3(segments.back());
  const auto is_refused = ThrowsMessage<messages::UnknownLogVersion>(HasSubstr("format \"isorig-log/3\""));
  const Catalogue catalogue(root.path());
  EXPECT_THAT([&] { (void)catalogue.inputs_of("a-run"); }, is_refused);
  const auto before = file_text(segments.back());
  EXPECT_THAT([&] { Recorder recorder(recorder_options(run), info_for(two_sessions())); }, is_refused);
  EXPECT_EQ(messages::list_segments(run), segments);
  EXPECT_EQ(file_text(segments.back()), before);
  EXPECT_FALSE(std::filesystem::exists(run / ".reserve"));
}

TEST(Catalogue, SaysWhatIsWrong) {
  const TemporaryDirectory root("catalogue");
  EXPECT_THAT([&] { Catalogue(root.path(), Catalogue::Access::kReadOnly); },
              ThrowsMessage<std::runtime_error>(HasSubstr("--runs")));
  {
    const Catalogue catalogue(root.path());
    EXPECT_FALSE(catalogue.find_run("nothing"));
    EXPECT_THAT([&] { (void)catalogue.inputs_of("nothing"); },
                ThrowsMessage<std::runtime_error>(HasSubstr("isorig runs")));
  }
  sqlite3* db = nullptr;
  ASSERT_EQ(sqlite3_open((root.path() / "catalogue.sqlite").c_str(), &db), SQLITE_OK);
  ASSERT_EQ(sqlite3_exec(db, "PRAGMA user_version = 99", nullptr, nullptr, nullptr), SQLITE_OK);
  sqlite3_close(db);
  EXPECT_THAT([&] { Catalogue again(root.path()); }, ThrowsMessage<std::runtime_error>(HasSubstr("newer isorig")));
}

/// A disk that takes a part of a note only: what was noted before can still be read, and so can what comes after.
TEST(Amendments, ANoteThatDoesNotFitLeavesTheOthersWhole) {
  const testing::TemporaryDirectory directory("noted");
  const auto& folder = directory.path();
  append_amendment(folder, {utc_now(), "Grace", {}, {}, "the first"});
  const auto size = std::filesystem::file_size(folder / "amendments.toml");
  const pid_t child = ::fork();  // the limit is of a whole process
  if (child == 0) {
    const rlimit limit{size + 50, size + 50};
    ::signal(SIGXFSZ, SIG_IGN);
    ::setrlimit(RLIMIT_FSIZE, &limit);
    try {
      append_amendment(folder, {utc_now(), "Grace", {}, {}, std::string(300, 'x')});
    } catch (const std::exception& e) {
      ::_exit(std::string(e.what()).find("No space left") != std::string::npos ? 7 : 1);
    }
    ::_exit(0);
  }
  int status = 0;
  ASSERT_EQ(::waitpid(child, &status, 0), child);
  EXPECT_EQ(WEXITSTATUS(status), 7);
  EXPECT_EQ(std::filesystem::file_size(folder / "amendments.toml"), size);
  append_amendment(folder, {utc_now(), "Grace", {}, {}, "the second"});
  const auto notes = read_amendments(folder);
  ASSERT_EQ(notes.size(), 2U);
  EXPECT_EQ(notes[1].text, "the second");

  // A file that is broken is shown as a note that says so, and gets no further ones.
  std::ofstream(folder / "amendments.toml", std::ios::app) << "[[amendment]]\nby = 'Gra";
  EXPECT_THROW(append_amendment(folder, {utc_now(), "Grace", {}, {}, "the third"}), base::ConfigError);
  const auto shown = shown_amendments(folder);
  ASSERT_EQ(shown.size(), 1U);
  EXPECT_THAT(shown[0].text, HasSubstr("the notes cannot be read: "));
}

}  // namespace
}  // namespace isorig::daemon::testing
