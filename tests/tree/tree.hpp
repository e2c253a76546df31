#pragma once
#include <string>
#include <string_view>

/// Where the sources and the programs of this tree are. One file alone is told at compile time (tree.cpp): tests that
/// had the folders as macros were compiled anew in every clone, since the compiler cache compares what the preprocessor
/// makes.
namespace isorig::test {

/// `below` appended as it is: source_path("/config/rigs/sim.toml").
[[nodiscard]] std::string source_path(std::string_view below = {});
[[nodiscard]] std::string program_path(std::string_view below = {});

}  // namespace isorig::test
