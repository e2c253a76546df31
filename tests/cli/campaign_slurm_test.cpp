#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "../proof/tiny_study.hpp"
#include "../system/processes_with.hpp"
#include "pieces_of_test.hpp"
#include "slurm_cluster.hpp"

/// `isorig campaign --on slurm` on a private cluster of Debian's own Slurm.
namespace isorig {
namespace {

namespace fs = std::filesystem;
using pieces_test::campaign;
using pieces_test::different_files;
using pieces_test::make_recordings;
using pieces_test::pieces_in;
using pieces_test::SlurmCluster;
using system_test::bin;
using system_test::isorig;
using system_test::Process;
using system_test::processes_with;
using system_test::slurp;
using system_test::TempDir;
using system_test::wait_until;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

class CampaignSlurm : public ::testing::Test {
 protected:
  // In a user namespace without root (unshare -r) slurmctld 22.05 ends as well: "Failed to drop supplementary groups".
  void SetUp() override {
    if (::geteuid() != 0)
      GTEST_SKIP() << "slurmctld and slurmd run as root alone: sudo ctest --test-dir build -R CampaignSlurm";
  }
};

TEST_F(CampaignSlurm, ANodeKilledInMidJobAnInterruptedCallAndACancelledTaskGiveTheBytesOfALocalRun) {
  const TempDir dir;
  const auto recordings = make_recordings(dir / "recordings", 5);
  const auto local = isorig(dir, campaign(recordings, dir / "local", {"-j", "2"}), 240.0);
  ASSERT_EQ(local.code, 0) << local.text;

  SlurmCluster cluster;
  ASSERT_TRUE(cluster.ready()) << cluster.log();
  // MaxArraySize=4 of this cluster: three tasks at most, with two recordings each or one.
  auto words = campaign(recordings, dir / "cluster", {"--on", "slurm"});
  words.insert(words.begin(), bin("isorig"));
  std::string job;
  {
    Process first(words, dir / "first.txt");
    ASSERT_TRUE(wait_until(60.0, [&] { return !cluster.on_node(0).empty() && !cluster.on_node(1).empty(); }))
        << first.output() << cluster.log();
    EXPECT_THAT(first.output(), HasSubstr("5 recordings"));
    cluster.kill_node(0);
    EXPECT_TRUE(wait_until(5.0, [&] { return cluster.on_node(0).empty(); }));
    EXPECT_LT(pieces_in(dir / "cluster").size(), recordings.size()) << "it was not in mid-job";
    // Ctrl-C leaves the jobs running and says how to go on.
    EXPECT_EQ(first.stop(SIGINT), -SIGINT) << first.output();
    EXPECT_THAT(first.output(), HasSubstr("`scancel "));
  }
  Process second(words, dir / "second.txt");
  // Slurm finds the node dead and puts its task back, but for two minutes: "BeginTime". An administrator need not wait.
  ASSERT_TRUE(
      wait_until(60.0,
                 [&] {
                   std::istringstream lines(cluster.ask({"squeue", "-h", "-r", "-t", "PENDING", "-o", "%A %r"}));
                   for (std::string id, reason; lines >> id >> reason;)
                     if (reason == "BeginTime") job = id;
                   return !job.empty();
                 }))
      << cluster.ask({"squeue"}) << cluster.log();
  EXPECT_THAT(cluster.ask({"sinfo", "-h", "-N", "-n", "n1", "-o", "%T"}), HasSubstr("down"));
  cluster.ask({"scontrol", "update", "JobId=" + job, "StartTime=now"});
  EXPECT_EQ(second.wait(120.0), 0) << second.output() << cluster.log();
  EXPECT_THAT(second.output(), HasSubstr("of an earlier call is under way"));
  EXPECT_THAT(second.output(), HasSubstr("5 of 5 recordings answered"));
  EXPECT_THAT(different_files(dir / "local", dir / "cluster"), IsEmpty());
  EXPECT_FALSE(fs::exists(dir / "cluster/slurm/array-2.txt")) << "Slurm repeated the task; no second array was needed";
}

TEST_F(CampaignSlurm, ACancelledTaskIsSubmittedAgainAndARefusalIsSaidInSlurmsWords) {
  const TempDir dir;
  const auto recordings = make_recordings(dir / "recordings", 2);
  const auto none = isorig(dir, campaign(recordings, dir / "none", {"--on", "slurm"}), 60.0);
  EXPECT_EQ(none.code, 1);
  EXPECT_THAT(none.text, HasSubstr("is slurmctld up"));

  SlurmCluster cluster;
  ASSERT_TRUE(cluster.ready()) << cluster.log();
  const auto refused = isorig(
      dir, campaign(recordings, dir / "refused", {"--on", "slurm", "--slurm-options", "--partition=nowhere"}), 60.0);
  EXPECT_EQ(refused.code, 1);
  EXPECT_THAT(refused.text, HasSubstr("sbatch refused: "));
  EXPECT_THAT(refused.text, HasSubstr("nvalid partition"));

  auto words = campaign(recordings, dir / "out", {"--on", "slurm"});
  words.insert(words.begin(), bin("isorig"));
  Process process(words, dir / "out.txt");
  ASSERT_TRUE(wait_until(60.0, [&] { return !cluster.on_node(0).empty(); })) << process.output() << cluster.log();
  cluster.ask({"scancel", "--me"});
  EXPECT_EQ(process.wait(120.0), 0) << process.output() << cluster.log();
  EXPECT_TRUE(fs::exists(dir / "out/slurm/array-2.txt"));
  EXPECT_THAT(slurp(dir / "out/slurm/array-2.txt"), HasSubstr(recordings[0]));
  EXPECT_EQ(pieces_in(dir / "out").size(), 2U);
}

/// A study with concealed effects: the same engine, with isorig-proof as the program of its tasks.
TEST_F(CampaignSlurm, AStudyOfConcealedCasesGivesTheTablesOfALocalRun) {
  const TempDir dir;
  const fs::path study = dir / "study", program = dir / "isorig";
  proof_test::write_study(study, 5);
  proof_test::write_program(program, "0.95");
  const auto run = [&](const std::string& results, const std::string& on) {
    return system_test::run(dir,
                            {bin("isorig-proof"), "run", study.string(), "--results", (dir / results).string(),
                             "--isorig", program.string(), "--threads", "1", "--on", on},
                            120.0);
  };
  ASSERT_EQ(run("local", "local").code, 0);
  SlurmCluster cluster;
  ASSERT_TRUE(cluster.ready()) << cluster.log();
  const auto on_cluster = run("cluster", "slurm");
  EXPECT_EQ(on_cluster.code, 0) << on_cluster.text << cluster.log();
  EXPECT_THAT(on_cluster.text, HasSubstr("isorig-proof: submitted as job array "));
  EXPECT_THAT(on_cluster.text, HasSubstr("5 of 5 cases answered\n"));
  EXPECT_THAT(proof_test::lines_of(dir / "diagnosed"), ::testing::SizeIs(10)) << "each case once in each";
  for (const char* file : {"campaign.csv", "campaign.json", "plan.json", "case-004/piece.json", "case-004/model.csv"})
    EXPECT_EQ(slurp(dir / "local" / file), slurp(dir / "cluster" / file)) << file;
  EXPECT_EQ(run("cluster", "slurm").code, 0);
  EXPECT_FALSE(fs::exists(dir / "cluster/slurm/array-2.txt")) << "nothing was left to run";
}

/// A piece that fails costs neither the others of its task nor the campaign: the next array is of that one alone.
TEST_F(CampaignSlurm, APieceThatFailsInsideATaskIsRepeatedByAFurtherArray) {
  const TempDir dir;
  const auto recordings = make_recordings(dir / "recordings", 3);
  const auto local = isorig(dir, campaign(recordings, dir / "local", {"-j", "2"}), 240.0);
  ASSERT_EQ(local.code, 0) << local.text;

  SlurmCluster cluster;
  ASSERT_TRUE(cluster.ready()) << cluster.log();
  auto words = campaign(recordings, dir / "cluster", {"--on", "slurm", "--per-task", "3"});  // one task
  words.insert(words.begin(), bin("isorig"));
  Process process(words, dir / "out.txt");
  std::vector<pid_t> victim;
  ASSERT_TRUE(wait_until(60.0,
                         [&] {
                           victim = processes_with("diagnose " + recordings[0]);
                           return !victim.empty();
                         }))
      << process.output() << cluster.log();
  ::kill(victim.front(), SIGKILL);
  EXPECT_EQ(process.wait(200.0), 0) << process.output() << cluster.log();
  EXPECT_EQ(slurp(dir / "cluster/slurm/array-2.txt"), recordings[0] + "\n") << "the others were made";
  EXPECT_FALSE(fs::exists(dir / "cluster/slurm/array-3.txt"));
  EXPECT_EQ(slurp(dir / "cluster/slurm/array-1/task-0.tally"), "3 1\n");
  EXPECT_EQ(slurp(dir / "cluster/slurm/array-2/task-0.tally"), "1 0\n");
  EXPECT_THAT(slurp(dir / "cluster/slurm/array-1/task-0.txt"),
              HasSubstr(recordings[0] + ": failed: ended by signal 9 (Killed)"));
  EXPECT_THAT(different_files(dir / "local", dir / "cluster"), IsEmpty());
  EXPECT_TRUE(fs::exists(dir / "cluster/pooled.json"));
}

/// Two arrays that make nothing end the command only where they come one after the other.
TEST_F(CampaignSlurm, AnArrayThatMadeSomethingBetweenTwoThatMadeNothingIsReasonToGoOn) {
  const TempDir dir;
  const auto recordings = make_recordings(dir / "recordings", 4);
  SlurmCluster cluster;
  ASSERT_TRUE(cluster.ready()) << cluster.log();
  cluster.take_tasks(false);  // the first array and the third wait until they are cancelled
  auto words = campaign(recordings, dir / "out", {"--on", "slurm"});
  words.insert(words.begin(), bin("isorig"));
  Process process(words, dir / "out.txt");
  std::size_t made = 0;
  for (const int array : {1, 2, 3}) {
    const auto list = dir / ("out/slurm/array-" + std::to_string(array) + ".sh");
    const auto waits = [&] { return !cluster.ask({"squeue", "-h", "-t", "PENDING", "-o", "%A"}).empty(); };
    ASSERT_TRUE(wait_until(60.0,
                           [&] {
                             if (!fs::exists(list)) return false;
                             return array == 2 ? !cluster.on_node(0).empty() && !pieces_in(dir / "out").empty()
                                               : waits();
                           }))
        << array << process.output() << cluster.log();
    if (array == 2) cluster.take_tasks(false);
    cluster.ask({"scancel", "--me"});
    if (array == 1) cluster.take_tasks(true);
    ASSERT_TRUE(wait_until(30.0, [&] { return cluster.on_node(0).empty() && cluster.on_node(1).empty(); }));
    const std::size_t now = pieces_in(dir / "out").size();
    EXPECT_EQ(now > made, array == 2) << "array " << array;
    made = now;
  }
  cluster.take_tasks(true);
  EXPECT_EQ(process.wait(120.0), 0) << process.output() << cluster.log();
  EXPECT_TRUE(fs::exists(dir / "out/slurm/array-4.txt"));
}

}  // namespace
}  // namespace isorig
