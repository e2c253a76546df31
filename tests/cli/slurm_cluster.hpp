#pragma once
#include <algorithm>
#include <array>
#include <cstdlib>
#include <filesystem>
#include <memory>
#include <random>
#include <string>
#include <vector>

#include "../system/processes.hpp"

namespace isorig::pieces_test {

/// Debian's slurmctld and two slurmd with a munged of their own, all on this machine's loopback and in one folder. No
/// systemd, no cgroups, no accounting, nothing of a cluster that may be configured here.
class SlurmCluster {
 public:
  SlurmCluster() {
    namespace fs = std::filesystem;
    for (const char* name : {"state", "spool", "run", "log"}) fs::create_directory(dir_ / name);
    // munged refuses folders that others may write.
    fs::permissions(dir_.path(), fs::perms(0755));
    std::random_device random;
    std::string key;
    for (int i = 0; i < 256; ++i) key += static_cast<char>(random());
    system_test::spit(dir_ / "munge.key", key);
    fs::permissions(dir_ / "munge.key", fs::perms(0600));
    system_test::spit(dir_ / "slurm.conf", configuration());
    ::setenv("SLURM_CONF", (dir_ / "slurm.conf").c_str(), 1);
    munged_ = start("munged", {"munged", "--foreground", "--key-file=" + path("munge.key"),
                               "--socket=" + path("run/munge"), "--pid-file=" + path("run/munged.pid"),
                               "--log-file=" + path("log/munged.log"), "--seed-file=" + path("run/munged.seed")});
    if (!system_test::wait_until(10.0, [&] { return fs::exists(dir_ / "run/munge"); })) throw std::runtime_error(log());
    controller_ = start("slurmctld", {"slurmctld", "-D"});
    for (const int node : {0, 1}) start_node(node);
  }
  ~SlurmCluster() {
    if (ready_) ask({"scancel", "--me"});
    for (auto& node : nodes_) node.reset();
    // Steps are sessions of their own and outlive their slurmd.
    for (const pid_t pid : with_environment("SLURM_CONF=" + path("slurm.conf"))) ::kill(pid, SIGKILL);
    controller_.reset();
    munged_.reset();
    ::unsetenv("SLURM_CONF");
  }
  SlurmCluster(const SlurmCluster&) = delete;
  SlurmCluster& operator=(const SlurmCluster&) = delete;

  [[nodiscard]] bool ready() {
    ready_ = system_test::wait_until(30.0, [&] { return ask({"sinfo", "-h", "-N", "-o", "%T"}) == "idle\nidle\n"; });
    return ready_;
  }
  void start_node(int node) {
    nodes_.at(static_cast<std::size_t>(node)) =
        start("slurmd-n" + std::to_string(node + 1), {"slurmd", "-D", "-N", "n" + std::to_string(node + 1)});
  }
  /// As by a pulled plug: slurmd, the steps' keepers and what they run, at once.
  void kill_node(int node) {
    nodes_.at(static_cast<std::size_t>(node)).reset();  // SIGKILL
    std::vector<pid_t> all = on_node(node);
    const std::vector<pid_t> jobs = all;
    for (const pid_t job : jobs)
      if (const pid_t above = parent_of(job);
          system_test::slurp("/proc/" + std::to_string(above) + "/comm") == "slurmstepd\n")
        all.push_back(above);
    for (const pid_t pid : all) ::kill(pid, SIGKILL);
  }
  std::string ask(std::vector<std::string> words) { return system_test::run(dir_, std::move(words), 20.0).text; }

  /// Whether tasks that were submitted begin; those that run go on.
  void take_tasks(bool take) {
    ask({"scontrol", "update", "PartitionName=all", std::string("State=") + (take ? "UP" : "DOWN")});
  }

  /// What the daemons said, for a test that fails.
  [[nodiscard]] std::string log() const {
    std::string all;
    for (const auto& entry : std::filesystem::directory_iterator(dir_ / "log"))
      all += entry.path().string() + ":\n" + system_test::slurp(entry.path()) + "\n";
    return all;
  }
  /// Jobs' processes on that node.
  [[nodiscard]] std::vector<pid_t> on_node(int node) const {
    // Of this cluster: that of another test beside it has a node of the same name.
    std::vector<pid_t> out = with_environment("SLURMD_NODENAME=n" + std::to_string(node + 1));
    const std::vector<pid_t> ours = with_environment("SLURM_CONF=" + path("slurm.conf"));
    std::erase_if(out, [&](pid_t pid) { return std::find(ours.begin(), ours.end(), pid) == ours.end(); });
    return out;
  }

 private:
  [[nodiscard]] std::string path(const std::string& name) const { return (dir_ / name).string(); }

  std::unique_ptr<system_test::Process> start(const std::string& name, std::vector<std::string> words) {
    return std::make_unique<system_test::Process>(std::move(words), dir_ / ("log/" + name + ".out"));
  }

  static pid_t parent_of(pid_t pid) {
    const std::string stat = system_test::slurp("/proc/" + std::to_string(pid) + "/stat");
    return stat.empty() ? 0 : std::atoi(stat.c_str() + stat.rfind(')') + 4);
  }
  [[nodiscard]] static std::vector<pid_t> with_environment(const std::string& entry) {
    std::vector<pid_t> out;
    for (const auto& process : std::filesystem::directory_iterator("/proc")) {
      const std::string name = process.path().filename();
      if (name.find_first_not_of("0123456789") != std::string::npos || std::stoi(name) == ::getpid()) continue;
      const std::string all = '\0' + system_test::slurp(process.path() / "environ");
      if (all.find('\0' + entry + '\0') != std::string::npos) out.push_back(std::stoi(name));
    }
    return out;
  }

  [[nodiscard]] std::string configuration() const {
    std::array<char, 256> host{};
    ::gethostname(host.data(), host.size() - 1);
    const std::string name = host.data();
    // Out of the ephemeral ports, and others for each test process.
    const int port = 20000 + 4 * (::getpid() % 2500);
    std::string text = "ClusterName=isorig-test\nSlurmctldHost=" + name + "(127.0.0.1)\nSlurmUser=root\n";
    text += "SlurmctldPort=" + std::to_string(port) + "\n";
    text += "AuthType=auth/munge\nCredType=cred/munge\nAuthInfo=socket=" + path("run/munge") + "\n";
    text += "StateSaveLocation=" + path("state") + "\nSlurmdSpoolDir=" + path("spool") + "/%n\n";
    text += "SlurmctldPidFile=" + path("run/slurmctld.pid") + "\nSlurmdPidFile=" + path("run/slurmd-%n.pid") + "\n";
    text += "SlurmctldLogFile=" + path("log/slurmctld.log") + "\nSlurmdLogFile=" + path("log/slurmd-%n.log") + "\n";
    text += "ProctrackType=proctrack/linuxproc\nTaskPlugin=task/none\nSwitchType=switch/none\nMpiDefault=none\n";
    text += "JobAcctGatherType=jobacct_gather/none\nAccountingStorageType=accounting_storage/none\n";
    text += "SelectType=select/cons_tres\nSelectTypeParameters=CR_CPU\nReturnToService=2\n";
    // A node that is silent for so long is down.
    text += "SlurmdTimeout=5\nKillWait=2\nMinJobAge=5\nInactiveLimit=0\nMaxArraySize=4\n";
    for (const int node : {1, 2})
      text += "NodeName=n" + std::to_string(node) + " NodeHostname=" + name +
              " NodeAddr=127.0.0.1 Port=" + std::to_string(port + node) + " CPUs=1\n";
    return text + "PartitionName=all Nodes=n1,n2 Default=YES MaxTime=INFINITE State=UP\n";
  }

  system_test::TempDir dir_;
  bool ready_ = false;
  std::unique_ptr<system_test::Process> munged_, controller_;
  std::array<std::unique_ptr<system_test::Process>, 2> nodes_;
};

}  // namespace isorig::pieces_test
