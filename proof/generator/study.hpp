#pragma once
#include <cstdint>
#include <filesystem>

#include "proof/generator/case.hpp"

namespace isorig::proof {

/// Whose formulas are concealed: the catalogue's, stepped otherwise, or others (proof/foreign_laws/).
enum class Laws { kCatalogue, kForeign };
[[nodiscard]] std::string_view name_of(Laws laws);

struct StudyOptions {
  std::uint64_t seed = 0;
  std::size_t cases = 24;
  std::filesystem::path out;
  unsigned threads = 2;
  Laws laws = Laws::kCatalogue;
};

/// Writes OUT/cases.json (names and nominal models), OUT/case-NNN/{train,heldout}, OUT/labels.sha256, and
/// what is to be kept from the tool: OUT/sealed/labels.json and OUT/sealed/truth/case-NNN.csv. The labels
/// hold the hashes of the truth, so the one published hash seals all of it. Returns that hash. Goes on from where a
/// call with the same seed, cases and laws was interrupted.
std::string generate_study(const StudyOptions& options);

}  // namespace isorig::proof
