#pragma once
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <span>
#include <string>
#include <string_view>

#include "base/toml_reader.hpp"

/// What the fuzz targets share (docs/fuzzing.md). A target is one function that is given any bytes. It may refuse them
/// in words; a crash, a hang, memory without bound, an exception that nobody expects and a refusal without words end
/// the program, which is the finding.
namespace isorig::fuzz {

using Bytes = std::span<const std::uint8_t>;

[[nodiscard]] inline std::string_view text(Bytes bytes) {
  return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
}

/// Ends the program with `what` unless `holds`.
void require(bool holds, std::string_view what);
/// Why an input was refused: an empty reason is a finding.
void refused(std::string_view why);
void refused(const base::ConfigError& error);

/// An input as choices: from its front, zeros once it is used up.
class Input {
 public:
  Input(const std::uint8_t* data, std::size_t size) : left_(data, size) {}
  [[nodiscard]] bool empty() const noexcept { return left_.empty(); }
  std::uint8_t byte() noexcept;
  std::uint16_t word() noexcept { return static_cast<std::uint16_t>(byte() << 8U | byte()); }
  /// At most so many bytes.
  Bytes take(std::size_t size) noexcept;
  Bytes rest() noexcept { return take(left_.size()); }
  /// Up to the next line that is nothing but "%%%%", which is passed over; the rest where there is none.
  Bytes part() noexcept;

 private:
  Bytes left_;
};
inline constexpr std::string_view kPartMark = "\n%%%%\n";

/// A folder of this process, in memory where the machine has /dev/shm; removed at its end.
[[nodiscard]] const std::filesystem::path& scratch();
void put(const std::filesystem::path& file, std::string_view bytes);

}  // namespace isorig::fuzz

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size);
