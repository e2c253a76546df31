#pragma once
#include <cstddef>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace isorig::web {

/// The protocols that people save on the page: TOML files of one folder, which is made when the first one is saved.
/// Nothing there is replaced by who has not seen it, and what is replaced is kept once, as NAME.toml~.
class SavedProtocols {
 public:
  static constexpr std::size_t kBytes = std::size_t{1} << 20U;
  static constexpr std::size_t kFiles = 1000;

  /// Empty: there is none, and save() says what to do.
  explicit SavedProtocols(std::filesystem::path folder) : folder_(std::move(folder)) {}

  [[nodiscard]] const std::filesystem::path& folder() const { return folder_; }

  struct Protocol {
    std::string text;
    std::string version;  ///< base::fingerprint of the text
  };
  /// Nothing: there is none of this name, or it is too long to be one.
  [[nodiscard]] std::optional<Protocol> read(const std::string& name) const;

  struct Saved {
    enum class Is { kDone, kThereAlready, kRefused, kFailed };
    Is is = Is::kRefused;
    std::string text;     ///< for people
    std::string version;  ///< of what is there now; empty: nothing is, or it is not known
  };
  /// `replaces`: the version that its author has seen; empty for a new one. Waits for the disk.
  [[nodiscard]] Saved save(const std::string& name, const std::string& text, const std::string& replaces) const;
  /// The last step of save(), for one that is there: puts `text` in its place and the old one aside as NAME~, unless
  /// the one that is there by then is not `replaces`.
  [[nodiscard]] Saved replace(const std::string& name, const std::string& text, const std::string& replaces) const;

 private:
  std::filesystem::path folder_;
};

/// The names of the TOML files of a folder, sorted; of one that is not there none. Links count where an administrator
/// makes them, not where pages save.
[[nodiscard]] std::vector<std::string> toml_files(const std::filesystem::path& folder, bool with_links);

}  // namespace isorig::web
