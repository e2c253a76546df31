#pragma once
#include <cstdint>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include "base/process.hpp"
#include "cli/campaign/plan.hpp"

/// A piece is what one command makes of one recording: DIR/pieces/SHARD/NAME/ with the command's own files, log.txt,
/// piece.json (of what it was made and what came out: the same bytes wherever it ran) and times.json (when, where, how
/// long). It appears at once, by a rename, or not at all. What is made of a case of a study lies in DIR/NAME/, since
/// the names of a study's cases differ, and a study may be moved. Where "recording" stands here, a case is meant, too.
namespace isorig::cli::pieces {

/// SHA-256 of a file in hexadecimal digits, read in parts. Throws base::FileError.
[[nodiscard]] std::string sha256_of_file(const std::filesystem::path& file);

/// A file of a recording: what it holds, and when it was last written.
struct FileStamp {
  std::string name;
  std::uintmax_t bytes = 0;
  std::int64_t written_ns = 0;
  std::int64_t changed_ns = 0;  ///< by the kernel's own clock, which nobody sets back
  std::string sha256{};         ///< empty: not looked into yet
};

/// Those of a recording's files that are there, or of a case's two recordings. Throws base::FileError when there is no
/// recording.toml.
[[nodiscard]] std::vector<FileStamp> files_of(const Ask& ask, const std::string& recording);

/// Tells whether a file is still the one that it was, without reading it.
struct FileState {
  std::uint64_t device = 0, inode = 0;
  std::uintmax_t bytes = 0;
  std::int64_t written_ns = 0, changed_ns = 0;
  [[nodiscard]] bool operator==(const FileState&) const = default;
};

/// What all pieces of a campaign have in common, as it was when this process began to make them.
struct Workshop {
  Plan plan;
  nlohmann::ordered_json ask_stamp;  ///< stamp_of(plan.ask)
  std::filesystem::path program;     ///< isorig, or isorig-proof
  base::Processes* among = nullptr;
  std::optional<FileState> program_state{};  ///< without it nobody looks whether the program is replaced
  std::optional<FileState> judged_state{};   ///< the same of plan.ask.judged
  std::vector<std::string> controls{};       ///< controls_of(plan.ask)
};

/// As things are now. Throws PlanError where the model file or the controls are not those that the plan names.
[[nodiscard]] Workshop workshop_of(const Plan& plan, const std::filesystem::path& program);

/// No piece can be made before somebody has done something. what() says what.
class CannotGoOn : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};
/// The file system has less room left than a piece may need.
class NoRoom : public CannotGoOn {
 public:
  using CannotGoOn::CannotGoOn;
};
/// The model file, the controls or the program are not what the workshop was opened with: pieces of two models would
/// stand in one table as if they were of one.
class InputsChanged : public CannotGoOn {
 public:
  using CannotGoOn::CannotGoOn;
};

/// Throws InputsChanged.
void check_inputs(const Workshop& shop);

[[nodiscard]] std::filesystem::path piece_folder(const Plan& plan, const std::string& recording);
/// Where the log of an attempt that failed lies, with failure.json.
[[nodiscard]] std::filesystem::path failed_folder(const Plan& plan, const std::string& recording);

/// The piece is there, made of what the recording and the options are now. A file is read again only when its time has
/// changed.
[[nodiscard]] bool is_done(const Workshop& shop, const std::string& recording);

/// The piece that lies there was made as the plan says, whatever became of the recording since. Where it was not, or is
/// not there, the plan waits for it.
[[nodiscard]] bool made_as_planned(const Plan& plan, const std::string& recording);

/// How often in a row it has failed.
[[nodiscard]] unsigned failures_of(const Plan& plan, const std::string& recording);

enum class Ended {
  kDoneBefore,
  kMade,
  kFailed,       ///< as failed_folder() says
  kInterrupted,  ///< by Processes::end(); nothing is left of it
};

struct Attempt {
  Ended ended = Ended::kFailed;
  std::string words{};  ///< "exit 0, 2.1 s", why it failed
};

/// Makes the piece of a recording unless it is done. Two processes may do it at the same time; one of the two results,
/// which are equal, stays. Throws CannotGoOn: before it begins, or where the model file, the controls or the program
/// were changed while the piece was made, of which nothing is left then. Whatever else goes wrong is a failed attempt.
[[nodiscard]] Attempt make_piece(const Workshop& shop, const std::string& recording);

/// Removes what was left by processes that were killed. Only where no other process makes pieces in this folder.
void sweep(const Plan& plan);

}  // namespace isorig::cli::pieces
