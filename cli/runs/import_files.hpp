#pragma once
#include <filesystem>
#include <functional>
#include <optional>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

#include "messages/foreign/mapping.hpp"
#include "messages/foreign/samples.hpp"

namespace isorig::cli {

/// The files are well-formed, and no recording can be made of them; what() says what to do.
class ImportRefused : public std::runtime_error {
  using std::runtime_error::runtime_error;
};

/// A file of another program, read and taken apart.
struct ImportFile {
  std::filesystem::path path;
  std::string sha256, encoding;
  foreign::Parsed parsed;
};
[[nodiscard]] ImportFile read_import_file(const std::filesystem::path& path, const foreign::Dialect& dialect);

/// A column that a person named, and where: "--unit Load=kN", or a mapping file.
struct NamedColumn {
  std::string key, where;
  bool optional = false;  ///< of a mapping file, which is for other files too
};
/// Throws ImportRefused where a name means no column of any table of these files: it would be ignored. Gives notes of
/// those that may be absent.
[[nodiscard]] std::vector<std::string> check_named_columns(const std::vector<ImportFile>& files,
                                                           const std::vector<NamedColumn>& named);

struct ImportQuestion {
  std::string file;
  foreign::Question question;
};

/// The tests of each file, and what is still to be asked before they can be converted.
struct ImportPlan {
  struct Of {
    ImportFile file;
    std::vector<std::pair<std::size_t, foreign::Understood>> tests;  ///< index of the table, and what it is
    std::vector<std::string> notes;
  };
  std::vector<Of> files;
  std::vector<ImportQuestion> questions;
  bool framed = false, gauged = false, loaded = false;  ///< some table is (foreign::Understood)
};
[[nodiscard]] ImportPlan understand_files(const std::vector<ImportFile>& files, const foreign::Mapping& mapping);

/// A length as a person types it, mm; nothing where it is none or out of range.
[[nodiscard]] std::optional<double> rest_length_of(std::string_view text);

/// A position, mm, or "whole-length", into the mapping; false where it is neither.
[[nodiscard]] bool take_zero(std::string_view text, foreign::Mapping& mapping);

struct ImportOptions {
  std::filesystem::path out;
  std::vector<std::string>
      told;  ///< what no column says and where it is from: "rest length 94.3 mm (--rest-length-mm)"
  bool one_clock = false, as_stated = false, replace = false;
  /// Told which part is done, by the time that its stages take of long files, and what comes now.
  std::function<void(double fraction, const char* doing)> on_progress{};
};
struct Imported {
  std::vector<std::string> said;
};
/// Converts, checks whether the numbers can be what their units say, and writes: one recording into `out`, several into
/// folders in it. Nothing is written before all of them are made.
[[nodiscard]] Imported make_recordings(const ImportPlan& plan, const foreign::Mapping& mapping,
                                       const ImportOptions& options);

}  // namespace isorig::cli
