#pragma once
#include <filesystem>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

namespace isorig::cli::pieces {

/// What is asked of every recording.
struct Ask {
  std::string command = "diagnose";  ///< or "fv"
  std::string model = "slse1";       ///< slse1, slse2 or the absolute path of a file
  unsigned threads = 1;              ///< of one diagnosis; changes no result

  [[nodiscard]] bool operator==(const Ask&) const = default;
};

/// As plan.json has it; from_json throws nlohmann's exceptions.
[[nodiscard]] nlohmann::ordered_json to_json(const Ask& ask);
[[nodiscard]] Ask ask_from_json(const nlohmann::ordered_json& json);

/// What of it decides the result: the model's text by its SHA-256 where that is a file. Throws base::FileError.
[[nodiscard]] nlohmann::ordered_json stamp_of(const Ask& ask);

/// The command that answers for one recording, to be run in the folder that the answer belongs into.
[[nodiscard]] std::vector<std::string> words_of(const Ask& ask, const std::filesystem::path& program,
                                                const std::string& recording);

/// Of the command's answer: the file with its numbers, and its page.
[[nodiscard]] std::string numbers_file(const Ask& ask);
[[nodiscard]] std::string page_file(const Ask& ask);

/// In which way two plans differ, "model: slse1 there, slse2 here"; empty when in none that changes a result.
[[nodiscard]] std::string difference(const Ask& there, const Ask& here);

}  // namespace isorig::cli::pieces
