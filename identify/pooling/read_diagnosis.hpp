#pragma once
#include <filesystem>
#include <nlohmann/json_fwd.hpp>
#include <stdexcept>
#include <string>
#include <vector>

#include "messages/recording.hpp"

namespace isorig::identify::pooling {

/// Where in a campaign a recording stands.
struct Place {
  std::string specimen;
  double pressure_psi = 0.0;
  int repetition = 0;  ///< 0: recording.toml names none
};

/// Throws PoolError, with `where` for its message, when the specimen or its nominal pressure is not named.
[[nodiscard]] Place place_of(const messages::RecordingMetadata& metadata, const std::string& where);

/// The recordings of a diagnosis, for diagnosis.json: "recordings": [{"specimen", "nominal_pressure_psi", "repetition",
/// "id"}]; what recording.toml does not name is left out. `ids`: messages::recording_id of each, or empty.
[[nodiscard]] nlohmann::ordered_json recordings_json(const std::vector<messages::RecordingMetadata>& recordings,
                                                     const std::vector<double>& ids = {});

/// What is wrong with a folder, where, and what to do.
class PoolError : public std::runtime_error {
 public:
  explicit PoolError(const std::string& why) : std::runtime_error(why), why_(why) {}
  PoolError(const std::string& where, const std::string& why) : std::runtime_error(where + ": " + why), why_(why) {}
  /// what() without the place: the same wherever the folder lies.
  [[nodiscard]] const std::string& why() const noexcept { return why_; }

 private:
  std::string why_;
};

/// A diagnosis to be pooled.
struct Source {
  std::filesystem::path diagnosis;    ///< folder of diagnosis.json
  std::filesystem::path recording{};  ///< folder of recording.toml; empty: diagnosis.json says of which recording it is
  std::string name{};                 ///< of the recording, for people; empty: the folder's
};

/// A number with its standard error, as its 95 % interval states it.
struct ReadNumber {
  std::string name;  ///< with its unit: "force_N"
  double value = 0.0;
  double standard_error = 0.0;  ///< NaN without a finite interval
};

struct ReadEffect {
  std::string name, law;
  double probability = 0.0;
  bool refused = false;  ///< located and not modelled: its law predicts left-out readings worse
  std::vector<ReadNumber> numbers;
};

/// A number of the nominal model's parts: "spring.stiffness_N_mm"; of several alike parts, slowest first,
/// "maxwell_2.time_constant_s".
struct ReadDiagnosis {
  std::filesystem::path folder;
  Place place;
  std::string verdict;
  std::string cannot_judge;  ///< why; empty where it could
  std::vector<ReadEffect> missing;
  struct Tried {
    std::vector<std::string> effects;
    double weight = 0.0;
  };
  std::vector<Tried> tried;
  std::vector<std::string> invisible;  ///< effects that the recording could not have shown
  std::vector<ReadNumber> nominal;     ///< as the completed model has them: a law in an arm's place has no arm
  std::vector<std::string> asked;      ///< names of the numbers of the nominal model that the diagnosis was asked about
  std::string page;                    ///< diagnosis-report.html, or diagnosis.json where there is no page
  std::vector<double> recording_ids;   ///< messages::recording_id of its recordings; empty of an older version's
};

/// What leads to a diagnosis: the name of its page, of diagnosis.json where there is no page; empty without either.
[[nodiscard]] std::string page_in(const std::filesystem::path& diagnosis);

/// Throws PoolError.
[[nodiscard]] ReadDiagnosis read_diagnosis(const Source& source);

}  // namespace isorig::identify::pooling
