#pragma once
#include <filesystem>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "messages/recording.hpp"

namespace isorig::cli {

/// What is to be put into a folder.
struct Overwriting {
  std::span<const std::string_view> names;        ///< of the files that are written
  std::span<const std::string_view> also;         ///< that go, or are written whatever stands there
  std::span<const std::filesystem::path> read{};  ///< what it is made of
  bool replace = false;                           ///< as told
};

/// Why that would destroy something, and what to do; "" if it does not. What is read stays, by whatever name or link it
/// stands in the folder; what is there already stays unless it is to be replaced.
[[nodiscard]] std::string why_not_to_overwrite(const std::filesystem::path& folder, const Overwriting& what);

/// Lines that say what became of the files beside a recording that was replaced.
[[nodiscard]] std::vector<std::string> said_of(const messages::Replaced& replaced);

}  // namespace isorig::cli
