#pragma once
#include <filesystem>
#include <fstream>
#include <map>
#include <string>
#include <vector>

#include "../identify/iso_velocity_recording.hpp"
#include "../system/processes.hpp"

/// Small recordings, and what two campaigns made of them.
namespace isorig::pieces_test {

namespace fs = std::filesystem;

/// A few strokes of a standard linear solid; `seed` makes each another one.
inline messages::Recording small_recording(unsigned seed, const std::string& specimen, double stiffening_N = 0.0) {
  identify::testing::IsoVelocityTest test;
  test.speeds_mm_s = {2, 5, 10};
  test.precondition = false;
  test.return_speed_mm_s = 0.5;
  test.hold_s = 5.0;
  test.seed = seed;
  test.stiffening_N = stiffening_N;
  messages::Recording made = identify::testing::simulate(test);
  made.metadata.specimen = specimen;
  made.metadata.nominal_pressure_psi = 10.0;
  made.metadata.further_toml = "repetition = " + std::to_string(seed) + "\n";
  messages::PressureSamples pressure;
  for (double t = 0; t < made.frame.t_s.back(); t += 0.2) {
    pressure.t_s.push_back(t);
    pressure.pressure_psi.push_back(10.0);
  }
  made.pressure = pressure;
  return made;
}

/// Recordings r1 ... rN in folders of several specimens with the same name, one with a space in its name.
inline std::vector<std::string> make_recordings(const fs::path& folder, unsigned count) {
  std::vector<std::string> out;
  for (unsigned i = 1; i <= count; ++i) {
    const fs::path place = folder / (i % 2 == 0 ? "sheath 1" : "control") / ("rep-" + std::to_string((i + 1) / 2));
    messages::write_recording(place, small_recording(i, i % 2 == 0 ? "sheath" : "control", i % 3 == 0 ? 300.0 : 0.0));
    out.push_back(place.string());
  }
  return out;
}

/// The words of `isorig campaign --ask diagnose` behind the program's name.
inline std::vector<std::string> campaign(const std::vector<std::string>& recordings, const fs::path& out,
                                         const std::vector<std::string>& more) {
  std::vector<std::string> words{"campaign", "--ask", "diagnose", "--out", out.string()};
  words.insert(words.end(), recordings.begin(), recordings.end());
  words.insert(words.end(), more.begin(), more.end());
  return words;
}

/// Bytes of all files of a campaign by path, but for the times, the page (which has its own call at its foot) and what
/// belongs to one place of running.
inline std::map<std::string, std::string> results_in(const fs::path& campaign) {
  std::map<std::string, std::string> out;
  for (const char* file : {"campaign.csv", "campaign.json", "pooled.json", "plan.txt", "plan.json"})
    out[file] = system_test::slurp(campaign / file);
  for (const auto& entry : fs::recursive_directory_iterator(campaign / "pieces"))
    if (entry.is_regular_file() && entry.path().filename() != "times.json")
      out[entry.path().lexically_relative(campaign).string()] = system_test::slurp(entry.path());
  return out;
}

/// The names of files that are not the same in both, with those that one of them lacks; empty when all are.
inline std::vector<std::string> different_files(const fs::path& a, const fs::path& b) {
  const auto left = results_in(a), right = results_in(b);
  std::vector<std::string> out;
  for (const auto& [name, bytes] : left)
    if (const auto other = right.find(name); other == right.end() || other->second != bytes) out.push_back(name);
  for (const auto& [name, bytes] : right)
    if (!left.contains(name)) out.push_back(name);
  return out;
}

/// The folders of pieces that are there.
inline std::vector<fs::path> pieces_in(const fs::path& campaign) {
  std::vector<fs::path> out;
  std::error_code none;
  for (fs::recursive_directory_iterator at(campaign / "pieces", none), end; !none && at != end; at.increment(none))
    if (at->path().filename() == "piece.json" && !at->path().parent_path().filename().string().starts_with("."))
      out.push_back(at->path().parent_path());
  return out;
}

}  // namespace isorig::pieces_test
