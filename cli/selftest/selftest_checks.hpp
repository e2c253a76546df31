#pragma once
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

/// What a self-test makes of the daemon's answers (docs/api.md). Pure: no rig, no terminal.
namespace isorig::cli {

enum class Verdict { kOk, kSkipped, kWarn, kFail };
[[nodiscard]] const char* name_of(Verdict verdict) noexcept;

struct Line {
  std::string check;  ///< stable name, such as "frame.rate"
  Verdict verdict = Verdict::kOk;
  std::string found;
  std::string to_do;  ///< what to check; empty when all is well
};

/// The daemon's answers, taken with the rig at rest.
struct Answers {
  nlohmann::json status, selftest, readings, calibrations;
};

/// Every check that needs no hand and no air.
[[nodiscard]] std::vector<Line> judge(const Answers& answers);

/// What came in over LCM: samples of both streams and status. Negative: the receiver could not be set up.
[[nodiscard]] Line judge_lcm(const nlohmann::json& selftest, int messages, double seconds);

/// A filled and sealed chamber: whether the set-point was reached, and what it lost.
struct AirTest {
  double wanted_psi = 0.0, reached_psi = 0.0;
  double sealed_from_psi = 0.0, sealed_to_psi = 0.0, sealed_s = 0.0;
  double vented_psi = 0.0;
};
[[nodiscard]] std::vector<Line> judge_air(const AirTest& test);

/// As a table for people.
[[nodiscard]] std::string table_of(const std::vector<Line>& lines);
[[nodiscard]] nlohmann::json to_json(const std::vector<Line>& lines);

}  // namespace isorig::cli
