#pragma once
#include <cstddef>
#include <functional>
#include <map>
#include <string>
#include <vector>

#include "cli/campaign/plan.hpp"
#include "identify/report/page.hpp"

namespace isorig::cli::pieces {

/// How the recordings of a plan stand.
struct Standing {
  std::size_t recordings = 0;
  std::size_t made = 0;    ///< with an answer, of whichever kind
  std::size_t bad = 0;     ///< of those: the recording could not be read
  std::size_t failed = 0;  ///< an attempt failed, none succeeded
  std::map<std::string, std::size_t> verdicts{};
  std::vector<std::string>
      findings{};  ///< what the diagnoses say together (docs/pooling.md), or the fits; empty where they say nothing
  bool stopped = false;  ///< the merge was: tables or page are those of before, the counts of what was looked at
  [[nodiscard]] std::size_t waiting() const { return recordings - made - failed; }
};

/// While tables are written.
struct Watching {
  /// Asked after every few recordings, from any thread; true: the merge is to end at once.
  std::function<bool()> stop{};
  /// Told how much is done, 0 to 1; from any thread.
  std::function<void(double fraction, const std::string& doing)> at{};
};

/// DIR/campaign.csv and campaign.json, a row a recording in the plan's order, of the pieces that are there, and
/// DIR/campaign-report.html, whose table leads to their pages. Read and written piece by piece. Up to 10,000 diagnoses
/// are pooled: pooled.json, and the page begins with what they say together. `made`: nothing where only the tables are
/// wanted; page and pooled.json then stay as they are, both of one time.
Standing merge(const Plan& plan, const identify::report::Made* made, const Watching& watching = {});

}  // namespace isorig::cli::pieces
