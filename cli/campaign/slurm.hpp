#pragma once
#include <cstddef>
#include <filesystem>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include "cli/campaign/local.hpp"
#include "cli/campaign/plan.hpp"

/// Slurm as it is: sbatch, squeue, scontrol. What it knows about jobs is asked for and never kept here.
namespace isorig::cli::pieces {

/// Slurm is not there, does not answer or refuses. what() has its own words.
class SlurmError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

struct SlurmOptions {
  std::string more{};        ///< for sbatch, as a shell would split them
  std::size_t per_task = 1;  ///< recordings of one task of the array, at least
};

/// A job array that was submitted. Its number in DIR/slurm/: array-7.txt lists its recordings, array-7.sh is its
/// script, array-7/ holds a log and a tally of each task.
struct Array {
  std::size_t number = 0;
  std::string job;  ///< Slurm's number of it
};

struct ArrayState {
  enum { kThere, kGone, kNoAnswer } at = kThere;
  std::string words{};  ///< "2 running, 1 pending (Resources)", or what Slurm said
};

class Slurm {
 public:
  Slurm(const Plan& plan, std::filesystem::path program, SlurmOptions options);

  /// An array of this campaign that is under way: of a call that was interrupted, or whose machine was. Throws
  /// SlurmError.
  [[nodiscard]] std::optional<Array> under_way() const;

  /// Where the next array's list is to be written.
  [[nodiscard]] std::size_t next_number() const;
  [[nodiscard]] std::filesystem::path list_of(std::size_t number) const;

  /// Submits an array for the `lines` recordings of that list: tasks as MaxArraySize allows. Throws SlurmError.
  [[nodiscard]] Array submit(std::size_t number, std::size_t lines) const;

  [[nodiscard]] ArrayState state_of(const Array& array) const;
  /// What its tasks have noted so far.
  [[nodiscard]] Done tally_of(const Array& array) const;

 private:
  struct Said;
  [[nodiscard]] Said ask(const std::vector<std::string>& words) const;
  [[nodiscard]] std::string job_name(std::size_t number) const;
  [[nodiscard]] std::size_t most_tasks() const;

  Plan plan_;
  std::filesystem::path program_, folder_;
  SlurmOptions options_;
};

/// What a task notes while it works, for tally_of(). Through a temporary name.
void write_tally(const std::filesystem::path& list, const Share& share, const Done& done);

}  // namespace isorig::cli::pieces
