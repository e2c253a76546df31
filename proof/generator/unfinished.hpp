#pragma once
#include <cstdint>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>

#include "proof/generator/study.hpp"

namespace isorig::proof {

/// A study while it is generated: STUDY/sealed/unfinished/ has what is drawn (seed, cases, laws, by which program) and
/// the label of each case that is written. A call that was interrupted leaves the folder, the next one of the same
/// study goes on from there.
class Unfinished {
 public:
  /// Forgets what is there of another study or of another program.
  explicit Unfinished(const StudyOptions& options);

  /// What keep() was given for the case with that number.
  [[nodiscard]] std::optional<nlohmann::ordered_json> kept(std::size_t number) const;
  /// Its recordings and its truth are written.
  void keep(std::size_t number, const nlohmann::ordered_json& label) const;
  /// The study is sealed.
  void finish() const;

 private:
  [[nodiscard]] std::filesystem::path file_of(std::size_t number) const;
  std::filesystem::path folder_;
};

/// The seed of an unfinished study in options.out that differs from `options` in its seed alone.
[[nodiscard]] std::optional<std::uint64_t> unfinished_seed(const StudyOptions& options);

}  // namespace isorig::proof
