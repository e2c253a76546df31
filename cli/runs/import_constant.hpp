#pragma once
#include <filesystem>
#include <string>
#include <vector>

#include "messages/foreign/samples.hpp"
#include "messages/recording.hpp"

namespace isorig::cli {

/// A column that has the same number in every row was told or is dead, and nothing was measured with it. Throws
/// ImportRefused where it is what a model is to predict and it was not said that all is as stated; gives notes of the
/// others, which may stand still: a crosshead, a constant load, a regulated pressure.
[[nodiscard]] std::vector<std::string> check_constant_columns(const std::filesystem::path& file,
                                                              const foreign::Test& test, messages::Output output,
                                                              bool as_stated);

}  // namespace isorig::cli
