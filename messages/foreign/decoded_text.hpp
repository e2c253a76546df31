#pragma once
#include <filesystem>
#include <string>
#include <string_view>

namespace isorig::foreign {

/// A file of another program as UTF-8, whatever it was written in.
struct DecodedText {
  std::string utf8;       ///< without a byte order mark
  std::string_view name;  ///< "UTF-8", "UTF-16LE", "UTF-16BE" or "Windows-1252"
};

/// UTF-8 or UTF-16 by their marks; without one UTF-16 where every other byte of the beginning is zero, UTF-8 where the
/// bytes are that, and Windows-1252 (a German or French instrument's micro sign) otherwise. Throws RecordingError where
/// UTF-16 is cut in the middle of a character or has half a pair.
[[nodiscard]] DecodedText decode(std::string_view bytes, const std::filesystem::path& file);

}  // namespace isorig::foreign
