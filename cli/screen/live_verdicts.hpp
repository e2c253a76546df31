#pragma once
#include <nlohmann/json.hpp>
#include <string>

/// What a person needs of the status' timing numbers: whether they are good. Pure: no rig, no terminal.
namespace isorig::cli {

enum class Tone { kPlain, kGood, kWarn, kBad, kDim };

struct Said {
  std::string text;
  Tone tone = Tone::kPlain;
};

/// Of the bound of a clock and of a late wake-up, both in microseconds: good up to the first, bad above the second. At
/// 10 mm/s a time that is wrong by 500 us moves a point of the force-velocity curve by 5 um, which is what an encoder
/// shows as noise; 5 ms are 50 um.
inline constexpr double kLate_us[] = {500.0, 5000.0};
/// Of ticks that were skipped, as a part of all.
inline constexpr double kLateShare[] = {1e-3, 5e-2};

/// The loop of the status: skipped ticks, worst wake-up, worst run.
[[nodiscard]] Said judge_loop(const nlohmann::json& loop);
/// A device's link of the status: connection, bound of its clock, what was lost.
[[nodiscard]] Said judge_device(const nlohmann::json& link);
/// What of a run that has ended is not recorded, from the status' `last_run`: "9449 samples never came"; "" where
/// nothing is missing. The status' own counts are of all that isorigd has lost since it was started.
[[nodiscard]] std::string lost_words(const nlohmann::json& last_run);
/// The exit code for that run: its outcome, and whether anything of it was lost.
[[nodiscard]] int exit_code_of(const nlohmann::json& last_run);
/// "31.9 ms", "240 us"
[[nodiscard]] std::string microseconds_text(double us);

}  // namespace isorig::cli
