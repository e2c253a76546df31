#pragma once
#include <cstddef>
#include <filesystem>
#include <fstream>
#include <functional>
#include <iosfwd>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include "base/lock_file.hpp"
#include "cli/campaign/ask.hpp"

namespace isorig::cli::pieces {

/// The command line or a list is wrong. what() says where and what to do.
class PlanError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};
/// Nothing is wrong with the call; its folder cannot be written.
class PlanUnwritable : public PlanError {
 public:
  using PlanError::PlanError;
};

/// Of one recording: its folder in DIR/pieces and DIR/failed, "607/rep-1_10-psi-a3f09c12d4e5f607", from its absolute
/// path alone. The shard before the slash (4096 of them) keeps every folder small; the digits tell recordings of one
/// name apart.
[[nodiscard]] std::filesystem::path piece_name(const std::string& recording);

/// As a plan has it: absolute, without "..", without a last slash. Throws PlanError for a path with a line end, a
/// control character or bytes that are no UTF-8.
[[nodiscard]] std::string plan_path(const std::string& recording);

/// What a campaign is about: DIR/plan.json (what is asked, by which program) and DIR/plan.txt (recordings, a path a
/// line). Recordings are never in memory all at once.
struct Plan {
  std::filesystem::path folder;  ///< absolute
  Ask ask;
  std::string program;         ///< version and revision
  std::string model_sha256{};  ///< as plan.json has it, of a model file; empty: a known name, or read_plan did not say
  std::string control_sha256{};  ///< likewise of the controls' fv.json
};

/// Where a plan's recordings are named.
struct Named {
  std::vector<std::string> recordings;  ///< on the command line
  std::string list;                     ///< a file with a path a line, "-" for standard input; empty: none
};

/// Told how much of a list is read, 0 to 1.
using ReadSoFar = std::function<void(double fraction, const std::string& doing)>;

/// Writes both files, through temporary names. Throws PlanError: no recording, one named twice (also by another path to
/// the same files), a folder that holds a campaign with other options, the paper's figures or what `isorig pool` wrote.
/// Returns how many recordings there are.
std::size_t write_plan(const Plan& plan, const Named& named, std::istream& standard_input, const ReadSoFar& at = {});

/// What write_plan left in the folder. Throws PlanError.
[[nodiscard]] Plan read_plan(const std::filesystem::path& folder);

[[nodiscard]] inline std::filesystem::path recordings_of(const Plan& plan) {
  return plan.folder / "plan.txt";
}

/// For each line of a file that write_plan or Runner wrote.
void for_each_line(const std::filesystem::path& file, const std::function<void(const std::string&)>& each);

/// A lock on a file in a campaign's folder. Throws PlanError and says who has it.
class FolderLock {
 public:
  enum class Of {
    kCampaign,  ///< one call of `isorig campaign` at a time
    kTask,      ///< shared by the tasks of a job array, which outlive the call that submitted them
    kMaker,     ///< whoever makes or sweeps pieces without an array: no task at the same time
  };
  /// `caller`: who works there when it is taken, for the message.
  explicit FolderLock(const std::filesystem::path& folder, Of of = Of::kCampaign,
                      const std::string& caller = caller_of({}));

 private:
  std::optional<base::LockFile> file_;
};

}  // namespace isorig::cli::pieces
