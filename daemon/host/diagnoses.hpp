#pragma once
#include <cstddef>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

namespace isorig::daemon {

/// The diagnoses and investigations (docs/diagnosis.md, docs/investigate.md) that lie in some folders or up to three
/// folders deep in them; what an investigation holds is part of it and not listed by itself. Links are not followed.
/// Reads the disk at every call, and tells files by name: only what a look finds is ever read.
class Diagnoses {
 public:
  static constexpr std::size_t kListed = 100;
  /// A page of one has some hundred kB.
  static constexpr std::size_t kPageBytes = std::size_t{24} << 20U;

  /// Of each place, that a look takes in; `cut` says that there are more.
  static constexpr std::size_t kEntries = 50'000;

  /// A place that is not there, or may not be read, holds none.
  explicit Diagnoses(const std::vector<std::filesystem::path>& places, std::size_t entries = kEntries);

  /// {diagnoses: [...], all, places, cut}: newest first, docs/api.md. What cannot be read is there with `wrong`.
  [[nodiscard]] nlohmann::json list() const;
  /// The text of a report that lies in one of the places, up to six folders deep: of a path in the list's `pages`, or
  /// of what one of these links to. Its file is called as a command calls its page, and nothing on the way to it is
  /// hidden or a link. Throws NotThere, and std::runtime_error for one that cannot be read.
  [[nodiscard]] nlohmann::json page(const std::string& path) const;
  /// The protocol that the diagnosis proposes to run next. Throws as page() does.
  [[nodiscard]] nlohmann::json experiment(const std::string& id) const;

 private:
  struct Found {
    std::filesystem::path place, folder;
    bool investigation = false;
    std::filesystem::file_time_type made;
    [[nodiscard]] std::filesystem::path document() const;
  };
  struct Look {
    std::vector<Found> found;
    bool cut = false;  ///< there was more to look at than is looked at
  };
  [[nodiscard]] Look look() const;
  void look_into(const std::filesystem::path& place, const std::filesystem::path& folder, int depth, Look& look,
                 std::size_t& left) const;

  std::vector<std::filesystem::path> places_;
  std::size_t entries_;
};

}  // namespace isorig::daemon
