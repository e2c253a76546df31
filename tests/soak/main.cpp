#include <sys/wait.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <map>

#include "base/formatted.hpp"
#include "base/text_file.hpp"
#include "play.hpp"
#include "real.hpp"
#include "tree.hpp"

/// soak: a protocol with random faults in virtual time, seed by seed; or the daemon in real time under load
/// (docs/soak.md).
namespace isorig::soak {
namespace {

using nlohmann::ordered_json;

struct Options {
  std::string seeds = "1..3";
  std::string out = "out/soak";
  PlayOptions play;
  int jobs = 1;
  RealOptions real;
  bool no_realtime = false, no_load = false;
};

std::filesystem::path file_of(const Options& o, std::uint64_t seed) {
  return std::filesystem::path(o.out) / ("seed-" + std::to_string(seed) + ".json");
}

/// One seed in a process of its own: its memory is its own, and a crash is a finding.
[[noreturn]] void play_and_leave(const Options& o, std::uint64_t seed) {
  auto play_options = o.play;
  play_options.runs_root = std::filesystem::path(o.out) / ("runs-" + std::to_string(seed));
  std::filesystem::remove_all(play_options.runs_root);
  ordered_json result;
  try {
    result = play(seed, play_options);
  } catch (const std::exception& e) {
    result = {{"seed", seed}, {"findings", {std::string("ended by an exception: ") + e.what()}}};
  }
  const bool clean = result["findings"].empty();
  if (clean) std::filesystem::remove_all(play_options.runs_root);  // what has a finding is kept to be looked at
  const auto part = file_of(o, seed).string() + ".part";
  std::ofstream(part) << result.dump(1) << "\n";
  std::filesystem::rename(part, file_of(o, seed));
  std::fflush(nullptr);
  ::_exit(clean ? 0 : 1);
}

std::pair<std::uint64_t, std::uint64_t> range_of(const std::string& text) {
  const auto dots = text.find("..");
  const auto first = std::stoull(text.substr(0, dots));
  return {first, dots == std::string::npos ? first : std::stoull(text.substr(dots + 2))};
}

double number(const ordered_json& j, const char* group, const char* key) {
  return j.contains(group) && j[group].contains(key) ? j[group][key].get<double>() : 0.0;
}

/// A line for each seed; the totals. How many findings there are.
std::size_t print(const Options& o, std::uint64_t first, std::uint64_t last) {
  std::printf(
      "| seed | hours | struck | found | vented | slowest found, stood, vented | held resumed | runs resumed | "
      "samples made | recorded | counted missing | MB | descriptors | findings |\n"
      "|---|---|---|---|---|---|---|---|---|---|---|---|---|---|\n");
  std::size_t findings = 0, strikes = 0, seeds = 0, named = 0;
  double hours = 0.0;
  std::vector<std::string> all;
  for (auto seed = first; seed <= last; ++seed) {
    if (!std::filesystem::exists(file_of(o, seed))) continue;
    const auto j = ordered_json::parse(base::read_text_file(file_of(o, seed)));
    ++seeds;
    std::size_t found = 0, vented = 0;
    double found_s = 0.0, stood_s = 0.0, vented_s = 0.0;
    const auto none = ordered_json::array();
    const auto& struck = j.contains("strikes") ? j["strikes"] : none;
    for (const auto& s : struck) {
      if (s["cause"].get<std::string>().empty()) continue;
      ++found;
      found_s = std::max(found_s, s["found_s"].get<double>());
      stood_s = std::max(stood_s, s["stood_s"].get<double>());
      if (!s.contains("vented_s")) continue;
      ++vented;
      vented_s = std::max(vented_s, s["vented_s"].get<double>() - s["found_s"].get<double>());
    }
    strikes += struck.size();
    named += found;
    const double made = number(j, "frame", "made") + number(j, "pressure", "made");
    double recorded = 0.0, missing = 0.0;
    for (const char* stream : {"frame", "pressure"}) {
      recorded += number(j, stream, "full") + number(j, stream, "averaged");
      missing += number(j, stream, "missing");
    }
    hours += j.value("rig_s", 0.0) / 3600.0;
    std::printf(
        "| %llu | %.2f | %zu | %zu | %zu | %.2f, %.2f, %.2f s | %d | %d | %.0f | %.0f | %.0f | %.1f to %.1f | %.0f to "
        "%.0f | %zu |\n",
        static_cast<unsigned long long>(seed), j.value("rig_s", 0.0) / 3600.0, struck.size(), found, vented, found_s,
        stood_s, vented_s, j.value("held_resumed", 0), j.value("runs_resumed", 0), made, recorded, missing,
        number(j, "begin", "MB"), number(j, "end", "MB"), number(j, "begin", "descriptors"),
        number(j, "end", "descriptors"), j["findings"].size());
    for (const auto& f : j["findings"]) all.push_back("seed " + std::to_string(seed) + ": " + f.get<std::string>());
    findings += j["findings"].size();
  }
  std::printf("\n%zu seeds, %.1f h of rig time, %zu faults struck, %zu of them tripped, %zu findings\n", seeds, hours,
              strikes, named, findings);
  for (const auto& f : all) std::printf("  %s\n", f.c_str());
  return findings;
}

int soak(const Options& o) {
  const auto [first, last] = range_of(o.seeds);
  std::filesystem::create_directories(o.out);
  std::map<pid_t, std::uint64_t> running;
  auto next = first;
  std::size_t crashed = 0;
  while (next <= last || !running.empty()) {
    if (next <= last && running.size() < static_cast<std::size_t>(o.jobs)) {
      const auto seed = next++;
      if (std::filesystem::exists(file_of(o, seed))) continue;  // done before: go on with the others
      std::fflush(nullptr);
      const pid_t child = ::fork();
      if (child == 0) play_and_leave(o, seed);
      if (child < 0) throw std::runtime_error("no process could be started for a seed");
      running[child] = seed;
      continue;
    }
    if (running.empty()) break;
    int status = 0;
    const pid_t ended = ::wait(&status);
    if (WIFSIGNALED(status)) {
      ++crashed;
      std::printf("seed %llu ended by signal %d\n", static_cast<unsigned long long>(running[ended]), WTERMSIG(status));
    }
    running.erase(ended);
  }
  return print(o, first, last) + crashed == 0 ? 0 : 1;
}

}  // namespace
}  // namespace isorig::soak

int main(int argc, char** argv) {
  using namespace isorig::soak;
  CLI::App app{"A protocol with random faults in virtual time, seed by seed"};
  Options o;
  o.play.rig = isorig::test::source_path() + "/config/rigs/sim.toml";
  o.play.protocol = isorig::test::source_path() + "/config/protocols/vma-isovelocity.toml";
  app.add_option("--seeds", o.seeds, "FIRST..LAST, or one")->capture_default_str();
  app.add_option("--protocol", o.play.protocol, "Protocol file")->capture_default_str();
  app.add_option("--rig", o.play.rig, "Rig file, simulated")->capture_default_str();
  app.add_option("--faults", o.play.faults, "That strike a run")->capture_default_str();
  app.add_option("-j,--jobs", o.jobs, "Seeds at once")->capture_default_str();
  app.add_option("--out", o.out, "Where results are kept; seeds that are there are not played again")
      ->capture_default_str();
  app.add_option("--real", o.real.seconds,
                 "Instead: isorigd as a process in real time, under load, for so many seconds");
  app.add_flag("--no-realtime", o.no_realtime, "With --real: isorigd without real-time priority");
  app.add_flag("--no-load", o.no_load, "With --real: processors and disk are left alone");
  CLI11_PARSE(app, argc, argv);
  try {
    if (o.real.seconds > 0.0) {
      o.real.rig = o.play.rig;
      o.real.out = std::filesystem::path(o.out) / "real";
      o.real.programs = std::filesystem::read_symlink("/proc/self/exe").parent_path();
      o.real.real_time = !o.no_realtime;
      o.real.load = !o.no_load;
      return soak_in_real_time(o.real);
    }
    return soak(o);
  } catch (const std::exception& e) {
    std::fprintf(stderr, "soak: %s\n", e.what());
    return 2;
  }
}
