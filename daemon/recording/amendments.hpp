#pragma once
#include <filesystem>
#include <string>
#include <vector>

namespace isorig::daemon {

/// What was put right about a run afterwards. The recording stays as it was; this stands beside it, in
/// RUN/amendments.toml, oldest first. Empty: not touched.
struct Amendment {
  std::string at_utc;
  std::string by;             ///< whoever amends
  std::string specimen;       ///< the name that counts from now on
  std::string operator_name;  ///< likewise
  std::string text;
  std::string specimen_file{};  ///< the specimen's whole file; empty in notes of earlier versions
};

/// It is on the disk when this returns. Throws std::runtime_error when it cannot be written, base::ConfigError when
/// what is there cannot be read; then nothing has changed.
void append_amendment(const std::filesystem::path& run_dir, const Amendment& amendment);

/// Nothing when there is no such file. Throws base::ConfigError when it cannot be read.
[[nodiscard]] std::vector<Amendment> read_amendments(const std::filesystem::path& run_dir);

/// The same for whoever shows a run: a file that cannot be read is a note that says so and why.
[[nodiscard]] std::vector<Amendment> shown_amendments(const std::filesystem::path& run_dir);

/// The last that names a specimen; null where none does.
[[nodiscard]] const Amendment* last_of_specimen(const std::vector<Amendment>& amendments);

/// Now, as in "2026-11-22T07:15:00Z".
[[nodiscard]] std::string utc_now();

}  // namespace isorig::daemon
