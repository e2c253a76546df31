#pragma once
#include <filesystem>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "messages/recording.hpp"

/// What `isorig-proof real` asks of real measurements of others: nine sets of recordings, each with a nominal model
/// from which a known effect was left out, and with what is published of it. The files are read where they are; nothing
/// of them is kept in the repository.
namespace isorig::proof {

/// A number that is known from elsewhere, and which number of the model it is.
struct KnownNumber {
  std::string_view physics;  ///< of the part; of several such parts the one whose number is furthest off counts
  std::string_view key;      ///< ends with the unit
  double value;
};

struct RealCase {
  std::string_view name;
  std::string_view set;                   ///< folder below the recordings
  std::vector<std::string_view> train;    ///< files there, diagnosed together
  std::vector<std::string_view> heldout;  ///< predicted by the nominal model and by the one with what was missing
  std::string_view left_out;              ///< what the nominal model lacks, as known from the source
  std::string_view known;                 ///< published or checked values, in the units of the model
  std::string nominal;                    ///< a name that `--model` knows, or the text of a model.toml
  messages::Recording (*convert)(const std::filesystem::path& file);
  std::vector<KnownNumber> numbers{};
};

[[nodiscard]] std::span<const RealCase> real_cases();

/// Else `nominal` is a name.
[[nodiscard]] bool nominal_is_text(const RealCase& real);

/// Where write_real_case() puts the i-th recording to learn from, or to predict, below its folder.
[[nodiscard]] std::string train_name(const RealCase& real, std::size_t i);
[[nodiscard]] std::string heldout_name(const RealCase& real, std::size_t i);

/// The recordings, and nominal-given.toml where the nominal model has no name.
void write_real_case(const RealCase& real, const std::filesystem::path& source, const std::filesystem::path& out);

}  // namespace isorig::proof
