#pragma once
#include <algorithm>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "base/formatted.hpp"
#include "base/text_file.hpp"
#include "messages/recording.hpp"
#include "proof/sealed.hpp"

/// Studies of a few readings, and a program that stands in for isorig: what it answers is the test's.
namespace isorig::proof_test {

namespace fs = std::filesystem;

inline std::string case_name(unsigned number) {
  return base::formatted("case-%03u", number);
}

/// As `isorig-proof generate` lays it out: each case conceals "slack".
inline void write_study(const fs::path& study, unsigned cases) {
  messages::Recording recording;
  for (int k = 0; k < 3; ++k) {
    recording.frame.t_s.push_back(0.1 * k);
    recording.frame.position_mm.push_back(k);
    recording.frame.force_N.push_back(2.0 * k);
  }
  nlohmann::json listed = nlohmann::json::array(), labels = nlohmann::json::array();
  const std::string truth = "t_s,force_N\n0,0\n0.1,2\n0.2,4\n";
  for (unsigned i = 0; i < cases; ++i) {
    const std::string name = case_name(i);
    for (const char* part : {"train", "heldout"}) messages::write_recording(study / name / part, recording);
    listed.push_back({{"case", name}, {"nominal", i % 2 == 0 ? "slse1" : "slse2"}});
    labels.push_back({{"case", name},
                      {"category", "single"},
                      {"nominal", i % 2 == 0 ? "slse1" : "slse2"},
                      {"trap", "none"},
                      {"noise_N", 0.01},
                      {"residual_over_noise", 20.0},
                      {"truth_sha256", proof::sha256(truth)},
                      {"effects", {{{"effect", "slack"}, {"size", 1.0}}}}});
    proof::write_text(study / "sealed" / "truth" / (name + ".csv"), truth);
  }
  proof::write_text(study / "cases.json", nlohmann::json{{"cases", listed}}.dump());
  proof::seal(study / "sealed" / "labels.json", study / "labels.sha256", nlohmann::json{{"cases", labels}}.dump());
}

/// A shell script with the variables act (diagnose or predict), recording, model, out and decide, which begins with
/// `acts` and then names slack with `probability`. Every call is a line of the file `calls`, every diagnosis one of
/// `diagnosed`, both beside it.
inline void write_program(const fs::path& program, const std::string& probability, const std::string& acts = "") {
  const auto beside = [&](const char* name) { return (program.parent_path() / name).string(); };
  proof::write_text(program, R"(#!/bin/sh
if [ "$2" = --deciding ]; then
  echo '[{"name": "cost_nats", "unit": "nat", "value": 3.0, "least": 0.0, "most": 9.0, "whole": false},
         {"name": "most_rows", "unit": "row", "value": 4.0, "least": 4.0, "most": 8.0, "whole": true}]'
  exit
fi
echo "$*" >>')" + beside("calls") +
                                 R"('
act=$1 recording=$2 decide=
while [ $# -gt 0 ]; do
  case $1 in
    --model) model=$2 ;;
    --out) out=$2 ;;
    --decide) decide=$2 ;;
  esac
  shift
done
if [ $act = predict ]; then printf 't_s,force_N\n0,0\n0.1,2\n0.2,3\n' >"$out"; exit; fi
echo "$recording $model $decide" >>')" +
                                 beside("diagnosed") + "'\n" + acts + R"(
echo '{"verdict": "missing_physics", "missing": [{"effect": "slack", "probability": )" +
                                 probability + R"(}]}' >"$out/diagnosis.json"
)");
  fs::permissions(program, fs::perms::owner_all);
}

/// The lines of a file; none where there is no file.
inline std::vector<std::string> lines_of(const fs::path& file) {
  std::vector<std::string> out;
  if (!fs::exists(file)) return out;
  const std::string text = base::read_text_file(file);
  for (std::size_t from = 0; from < text.size();) {
    const std::size_t end = std::min(text.find('\n', from), text.size());
    out.push_back(text.substr(from, end - from));
    from = end + 1;
  }
  return out;
}

}  // namespace isorig::proof_test
