#pragma once
#include <filesystem>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

namespace isorig::cli::pieces {

/// What is asked of every recording; or of every case of a study with concealed effects, a folder with the recordings
/// train/ and heldout/, by isorig-proof (docs/proof.md).
struct Ask {
  std::string command = "diagnose";  ///< or "fv"; "case" of a study
  /// slse1, slse2 or the absolute path of a file. Of "case": the list that has each case's nominal model.
  std::string model = "slse1";
  unsigned threads = 1;                ///< of one diagnosis; changes no result
  std::string judged{};                ///< of "case": the absolute path of the isorig that is asked
  std::vector<std::string> options{};  ///< of "case": further words of its diagnosis
  std::string control{};               ///< absolute path of the fv.json with the controls of sheaths; empty: none

  [[nodiscard]] bool is_case() const { return command == "case"; }
  [[nodiscard]] bool operator==(const Ask&) const = default;
};

/// As plan.json has it; from_json throws nlohmann's exceptions.
[[nodiscard]] nlohmann::ordered_json to_json(const Ask& ask);
[[nodiscard]] Ask ask_from_json(const nlohmann::ordered_json& json);

/// The files that decide the result beside the recording: of the model, of the controls.
[[nodiscard]] std::vector<std::string> input_files(const Ask& ask);

/// What of it decides the result: the texts of input_files() by their SHA-256. Throws base::FileError.
[[nodiscard]] nlohmann::ordered_json stamp_of(const Ask& ask);
/// The same of files that had these SHA-256; nothing is read.
[[nodiscard]] nlohmann::ordered_json stamp_of(const Ask& ask, const std::string& model_sha256,
                                              const std::string& control_sha256);

/// The command that answers for one recording, to be run in the folder that the answer belongs into. `model`: the words
/// that name its model (control.hpp).
[[nodiscard]] std::vector<std::string> words_of(const Ask& ask, const std::filesystem::path& program,
                                                const std::string& recording, const std::vector<std::string>& model);

/// Where in the folder that is asked about the recordings lie: "" for the folder itself.
[[nodiscard]] std::vector<std::string> recordings_in(const Ask& ask);

/// Who asks and what is asked about, for messages: "isorig campaign" and "recordings".
[[nodiscard]] std::string caller_of(const Ask& ask);
[[nodiscard]] std::string subjects_of(const Ask& ask);

/// Of the command's answer: the file with its numbers, and its page.
[[nodiscard]] std::string numbers_file(const Ask& ask);
[[nodiscard]] std::string page_file(const Ask& ask);

/// In which way two plans differ, "model: slse1 there, slse2 here"; empty when in none that changes a result.
[[nodiscard]] std::string difference(const Ask& there, const Ask& here);

}  // namespace isorig::cli::pieces
