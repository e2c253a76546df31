#pragma once
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

#include "cli/campaign/merge.hpp"
#include "cli/campaign/piece.hpp"
#include "cli/campaign/plan.hpp"
#include "pieces_of_test.hpp"

/// A campaign whose program is a script, so that what it answers, and how often it was called, is the test's.
namespace isorig::cli::pieces {

class Campaign : public ::testing::Test {
 protected:
  system_test::TempDir dir_;
  std::istringstream nothing_;

  [[nodiscard]] Plan plan(Ask ask = {}, const std::string& program = "isorig 1") const {
    return {dir_ / "campaign", std::move(ask), program};
  }
  void SetUp() override { std::filesystem::create_directories(dir_ / "campaign"); }

  /// Counts its calls in CALLS; does `acts` in the piece's folder.
  [[nodiscard]] std::filesystem::path script(const std::string& acts) const {
    const std::filesystem::path file = dir_ / "program";
    system_test::spit(file, "#!/bin/sh\necho called \"$2\" >> '" + (dir_ / "calls").string() + "'\n" + acts + "\n");
    std::filesystem::permissions(file, std::filesystem::perms::owner_all);
    return file;
  }
  [[nodiscard]] std::size_t calls() const {
    const std::string text = system_test::slurp(dir_ / "calls");
    return static_cast<std::size_t>(std::ranges::count(text, '\n'));
  }
  [[nodiscard]] Workshop shop(const std::string& acts, const Plan& of) const {
    return {of, stamp_of(of.ask), script(acts), nullptr};
  }
  [[nodiscard]] std::string recording(const std::string& name) const {
    const std::filesystem::path folder = dir_ / name;
    std::filesystem::create_directories(folder);
    system_test::spit(folder / "recording.toml", "specimen = \"s\"\nnominal_pressure_psi = 15\nrepetition = 3\n");
    system_test::spit(folder / "frame.csv", "t_s,position_mm,force_N\n0,0,0\n");
    return folder.string();
  }
  static constexpr const char* kAnswers =
      R"(echo '{"verdict": "missing_physics", "missing": [{"effect": "slack", "probability": 0.97}]}' > diagnosis.json)";
};

}  // namespace isorig::cli::pieces
