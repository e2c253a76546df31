#pragma once
#include <filesystem>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "messages/recording.hpp"

/// Real measurements of others, as recordings that `isorig diagnose` takes, with a nominal model from which a
/// known effect was left out. The files are read where they are; nothing of them is kept in the repository.
namespace isorig::proof {

struct RealCase {
  std::string_view name;
  std::vector<std::string_view> files;  ///< below the folder of recordings; diagnosed together
  std::string_view left_out;            ///< what the nominal model lacks, as known from the source
  std::string_view known;               ///< published or checked values, in the units of the model
  std::string_view nominal_toml;
  /// From the columns of the file to a recording.
  messages::Recording (*convert)(const std::filesystem::path& file);
};

[[nodiscard]] std::span<const RealCase> real_cases();

/// A CSV with a header: the named columns, whatever else there is. Rows whose time does not increase are left
/// out, since some of the loggers wrote a millisecond twice. Throws std::runtime_error that names the file.
[[nodiscard]] std::vector<std::vector<double>> read_columns(const std::filesystem::path& file,
                                                            std::span<const std::string_view> names);

[[nodiscard]] std::string recording_name(const RealCase& real, std::size_t i);

/// OUT/recording (or recording-1 and on, where there are several) and OUT/nominal.toml.
void write_real_case(const RealCase& real, const std::filesystem::path& source, const std::filesystem::path& out);

}  // namespace isorig::proof
